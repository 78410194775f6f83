//! The nearest neighbours of the unknown points. A few points of a cloud are unknown: only the cloud around them is
//! searched.

use std::num::NonZero;

use glam::{DVec3, UVec3, Vec3};
use kiddo::{ImmutableKdTree, SquaredEuclidean};
use rayon::prelude::*;

use crate::preprocess::neighbours::{bounds, spatial_order, turn};
use crate::{Error, Result};

/// In [`Cloud::sites`]: a known point.
pub(super) const KNOWN: u32 = u32::MAX;

/// The equations: each unknown position and what lies around it.
pub(super) struct Rows<const C: usize> {
    /// Unknown neighbours as sites, room for all neighbours a row.
    unknown: Vec<u32>,
    room: usize,
    pub(super) ends: Vec<End<C>>,
}

/// Of one equation.
#[derive(Clone, Copy)]
pub(super) struct End<const C: usize> {
    /// Number of unknown neighbours.
    unknown: u32,
    /// Number of known neighbours.
    pub(super) known: u32,
    /// Sum of the known neighbours' values.
    pub(super) sum: [f64; C],
}

impl<const C: usize> Rows<C> {
    pub(super) fn len(&self) -> usize {
        self.ends.len()
    }

    /// The unknown neighbours of a site.
    pub(super) fn unknown(&self, site: usize) -> &[u32] {
        &self.unknown[site * self.room..][..self.ends[site].unknown as usize]
    }
}

/// The distinct positions of unknown points, called sites.
pub(super) struct Sites {
    /// Along a Morton curve.
    pub(super) positions: Vec<Vec3>,
    /// The site of every point of the cloud, or [`KNOWN`].
    pub(super) of_points: Vec<u32>,
}

impl Sites {
    pub(super) fn new(positions: &[Vec3], unknown: &[bool]) -> Self {
        let points: Vec<u32> = (0..positions.len() as u32).filter(|&point| unknown[point as usize]).collect();
        let places: Vec<Vec3> = points.iter().map(|&point| positions[point as usize]).collect();
        let mut sites = Self { positions: Vec::new(), of_points: vec![KNOWN; positions.len()] };
        for run in spatial_order(&places).chunk_by(|a, b| a.1 == b.1) {
            for &(_, _, at) in run {
                sites.of_points[points[at as usize] as usize] = sites.positions.len() as u32;
            }
            sites.positions.push(run[0].1.into());
        }
        sites
    }
}

/// What is searched: all points of the cloud, and the value of each known one.
pub(super) struct Search<'a, F> {
    pub(super) positions: &'a [Vec3],
    pub(super) sites: &'a Sites,
    /// Known points that are passed over; empty where none are.
    pub(super) silent: &'a [bool],
    /// Neighbours of a site: this many distinct positions, or all where there are fewer.
    pub(super) neighbours: usize,
    /// Value of a known point.
    pub(super) value: F,
}

impl<F> Search<'_, F> {
    /// The equation of every site.
    ///
    /// The cloud is cut into cubes, and the cubes next to a site are searched; sites whose neighbours may lie farther
    /// off than that are left for larger cubes, in the end for one cube.
    pub(super) fn rows<const C: usize>(&self, progress: &dyn Fn(f32)) -> Result<Rows<C>>
    where
        F: Fn(usize) -> [f64; C] + Sync,
    {
        let sites = &self.sites.positions;
        let room = self.neighbours.min(self.positions.len());
        let mut rows = Rows {
            unknown: vec![KNOWN; sites.len() * room],
            room,
            ends: vec![End { unknown: 0, known: 0, sum: [0.0; C] }; sites.len()],
        };
        let mut open = vec![true; sites.len()];
        let bounds = bounds(self.positions);
        let mut across = cubes_across(self.positions.len());
        loop {
            let left = open.iter().filter(|open| **open).count();
            progress(1.0 - left as f32 / sites.len().max(1) as f32);
            if left == 0 {
                return Ok(rows);
            }
            let places = sites.iter().zip(&open).filter(|(_, open)| **open).map(|(&place, _)| place);
            self.search(&Grid::around(bounds, across, places), &mut open, &mut rows)?;
            across = across.div_ceil(4);
        }
    }

    /// Fills the equations of those `open` sites whose neighbours are sure to lie within the grid's marked cubes, and
    /// closes them.
    fn search<const C: usize>(&self, grid: &Grid, open: &mut [bool], rows: &mut Rows<C>) -> Result<()>
    where
        F: Fn(usize) -> [f64; C] + Sync,
    {
        let points: Vec<u32> = (0..self.positions.len() as u32)
            .into_par_iter()
            .filter(|&point| grid.marks(self.positions[point as usize]))
            .collect();
        let places: Vec<Vec3> = points.iter().map(|&point| self.positions[point as usize]).collect();
        let mut order = spatial_order(&places);
        drop(places);
        order.par_iter_mut().for_each(|copy| copy.2 = points[copy.2 as usize]);
        drop(points);
        let places = Places::new(&order)?;
        // One more than asked for: the position itself is its own nearest.
        let count = NonZero::new(self.neighbours.min(places.runs.len() - 1) + 1).unwrap_or(NonZero::<usize>::MIN);
        let at_sites = self.at_sites(&places);
        let fill = |site: usize, unknown: &mut [u32], end: &mut End<C>| {
            let at = at_sites[site] as usize;
            if let Some(value) = self.known_value(places.runs[at]) {
                // Some points of this position are known: that settles the others.
                *end = End { unknown: 0, known: 1, sum: value };
                return true;
            }
            *end = End { unknown: 0, known: 0, sum: [0.0; C] };
            let mut reach: f64 = 0.0;
            let mut found = 0;
            for near in places.nearest(at, count).take(self.neighbours) {
                found += 1;
                reach = reach.max(places.position(near).distance(places.position(at)));
                match self.known_value(places.runs[near]) {
                    Some(_) if self.is_silent(places.runs[near]) => {}
                    Some(value) => {
                        end.known += 1;
                        end.sum = std::array::from_fn(|c| end.sum[c] + value[c]);
                    }
                    None => {
                        unknown[end.unknown as usize] = self.sites.of_points[places.runs[near][0].2 as usize];
                        end.unknown += 1;
                    }
                }
            }
            let all = found == self.neighbours && reach <= grid.reach();
            all || grid.is_whole()
        };
        let room = rows.room;
        (open.par_iter_mut(), rows.unknown.par_chunks_mut(room), rows.ends.par_iter_mut())
            .into_par_iter()
            .enumerate()
            .filter(|(_, (open, _, _))| **open)
            .for_each(|(site, (open, unknown, end))| *open = !fill(site, unknown, end));
        Ok(())
    }

    /// Where each site is among the places, [`KNOWN`] for those that are not.
    fn at_sites(&self, places: &Places) -> Vec<u32> {
        let site = |copy: &Placed| Some(self.sites.of_points[copy.2 as usize]).filter(|&site| site != KNOWN);
        let found: Vec<(u32, u32)> = (0..places.runs.len() as u32)
            .into_par_iter()
            .filter_map(|at| Some((places.runs[at as usize].iter().find_map(site)?, at)))
            .collect();
        let mut at_sites = vec![KNOWN; self.sites.positions.len()];
        found.into_iter().for_each(|(site, at)| at_sites[site as usize] = at);
        at_sites
    }

    /// Whether no point of one position has anything to say.
    fn is_silent(&self, run: &[Placed]) -> bool {
        run.iter().all(|copy| self.silent.get(copy.2 as usize).copied().unwrap_or(false))
    }

    /// The mean value of the known ones among the points of one position, if any.
    fn known_value<const C: usize>(&self, run: &[Placed]) -> Option<[f64; C]>
    where
        F: Fn(usize) -> [f64; C],
    {
        let (mut count, mut sum) = (0, [0.0; C]);
        for point in run.iter().map(|copy| copy.2 as usize).filter(|&point| self.sites.of_points[point] == KNOWN) {
            let value = (self.value)(point);
            count += 1;
            sum = std::array::from_fn(|c| sum[c] + value[c]);
        }
        (count > 0).then(|| sum.map(|sum| sum / f64::from(count)))
    }
}

/// A point as [`spatial_order`] gives it: key, position, index.
type Placed = (u64, [f32; 3], u32);

/// Distinct positions and a tree over them.
struct Places<'a> {
    /// The points of each position.
    runs: Vec<&'a [Placed]>,
    turned: Vec<[f32; 3]>,
    tree: ImmutableKdTree<f32, 3>,
}

impl<'a> Places<'a> {
    fn new(order: &'a [Placed]) -> Result<Self> {
        let runs: Vec<&[Placed]> = order.chunk_by(|a, b| a.1 == b.1).collect();
        let turned = turn(&runs.iter().map(|run| run[0].1).collect::<Vec<_>>());
        let tree = ImmutableKdTree::new_from_slice(&turned)
            .map_err(|_| Error::Limit(format!("a search holds at most {} points, not {}", u32::MAX, runs.len())))?;
        Ok(Self { runs, turned, tree })
    }

    fn position(&self, at: usize) -> DVec3 {
        Vec3::from(self.runs[at][0].1).as_dvec3()
    }

    /// The `count` places nearest to one, without itself if it is among them: rounding may put others where it is.
    fn nearest(&self, at: usize, count: NonZero<usize>) -> impl Iterator<Item = usize> {
        let near = self.tree.query(&self.turned[at]).nearest_n::<SquaredEuclidean<f32>>(count).execute();
        near.into_iter().map(|near| near.item as usize).filter(move |&near| near != at)
    }
}

/// Cubes along the cloud's longest side at first: so many that a cube of a scanned surface holds about as many points
/// as a site has neighbours, few enough for a bit each.
fn cubes_across(points: usize) -> u32 {
    ((points as f64 / 32.0).sqrt() as u32).clamp(1, 256)
}

/// Cubes over the cloud; those with a site in them or next to them are marked.
struct Grid {
    low: DVec3,
    /// Edge of a cube; infinite when one cube holds everything.
    edge: f64,
    size: UVec3,
    marked: Vec<u64>,
}

impl Grid {
    fn around((low, high): (Vec3, Vec3), across: u32, sites: impl Iterator<Item = Vec3>) -> Self {
        let low = low.as_dvec3();
        let extent = high.as_dvec3() - low;
        let edge = if across > 1 { extent.max_element() / f64::from(across) } else { f64::INFINITY };
        // Nothing but points at one position.
        let edge = if edge > 0.0 { edge } else { f64::INFINITY };
        let size = (extent / edge).as_uvec3() + 1;
        let mut grid = Self { low, edge, size, marked: vec![0; (size.element_product() as usize).div_ceil(64)] };
        let mut done = grid.marked.clone();
        for site in sites {
            let cube = grid.cube(site);
            if !set(&mut done, grid.bit(cube)) {
                grid.mark_around(cube);
            }
        }
        grid
    }

    fn mark_around(&mut self, cube: UVec3) {
        let (first, last) = (cube.saturating_sub(UVec3::ONE), (cube + 1).min(self.size - 1));
        for z in first.z..=last.z {
            for y in first.y..=last.y {
                for x in first.x..=last.x {
                    let bit = self.bit(UVec3::new(x, y, z));
                    set(&mut self.marked, bit);
                }
            }
        }
    }

    fn cube(&self, position: Vec3) -> UVec3 {
        ((position.as_dvec3() - self.low) / self.edge).as_uvec3().min(self.size - 1)
    }

    fn bit(&self, cube: UVec3) -> usize {
        ((cube.z * self.size.y + cube.y) * self.size.x + cube.x) as usize
    }

    fn marks(&self, position: Vec3) -> bool {
        let bit = self.bit(self.cube(position));
        self.marked[bit / 64] >> (bit % 64) & 1 == 1
    }

    fn is_whole(&self) -> bool {
        self.edge == f64::INFINITY
    }

    /// Everything within this distance of a site is marked. A little less than an edge, for the rounding of cubes.
    fn reach(&self) -> f64 {
        0.999 * self.edge
    }
}

/// Sets a bit, and tells whether it was set before.
fn set(bits: &mut [u64], bit: usize) -> bool {
    let (word, mask) = (&mut bits[bit / 64], 1 << (bit % 64));
    let before = *word & mask != 0;
    *word |= mask;
    before
}
