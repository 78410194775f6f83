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

/// One equation: an unknown position and what lies around it.
#[derive(Clone)]
pub(super) struct Row<const C: usize> {
    /// The unknown positions among the neighbours, as sites.
    pub(super) unknown: Box<[u32]>,
    /// Number of known neighbours.
    pub(super) known: u32,
    /// Sum of the known neighbours' values.
    pub(super) sum: [f64; C],
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
    pub(super) fn rows<const C: usize>(&self, progress: &dyn Fn(f32)) -> Result<Vec<Row<C>>>
    where
        F: Fn(usize) -> [f64; C] + Sync,
    {
        let sites = &self.sites.positions;
        let mut rows = vec![Row { unknown: Box::default(), known: 0, sum: [0.0; C] }; sites.len()];
        let mut open = vec![true; sites.len()];
        let mut left = sites.len();
        let bounds = bounds(self.positions);
        let mut across = cubes_across(self.positions.len());
        while left > 0 {
            let places = sites.iter().zip(&open).filter(|(_, open)| **open).map(|(&place, _)| place);
            let grid = Grid::around(bounds, across, places);
            for (site, row) in self.search(&grid, &open)? {
                rows[site as usize] = row;
                open[site as usize] = false;
                left -= 1;
            }
            progress(1.0 - left as f32 / sites.len() as f32);
            across = across.div_ceil(4);
        }
        Ok(rows)
    }

    /// The equations of those `open` sites whose neighbours are sure to lie within the grid's marked cubes.
    fn search<const C: usize>(&self, grid: &Grid, open: &[bool]) -> Result<Vec<(u32, Row<C>)>>
    where
        F: Fn(usize) -> [f64; C] + Sync,
    {
        let points: Vec<u32> =
            (0..self.positions.len() as u32).into_par_iter().filter(|&p| grid.marks(self.positions[p as usize])).collect();
        let places: Vec<Vec3> = points.iter().map(|&point| self.positions[point as usize]).collect();
        let order = spatial_order(&places);
        let runs: Vec<&[(u64, [f32; 3], u32)]> = order.chunk_by(|a, b| a.1 == b.1).collect();
        let distinct: Vec<[f32; 3]> = runs.iter().map(|run| run[0].1).collect();
        let turned = turn(&distinct);
        let tree: ImmutableKdTree<f32, 3> = ImmutableKdTree::new_from_slice(&turned)
            .map_err(|_| Error::Limit(format!("a search holds at most {} points, not {}", u32::MAX, distinct.len())))?;
        // One more than asked for: the position itself is its own nearest.
        let count = NonZero::new(self.neighbours.min(distinct.len() - 1) + 1).unwrap_or(NonZero::<usize>::MIN);
        let point = |copy: &(u64, [f32; 3], u32)| points[copy.2 as usize] as usize;
        let site_of = |copy| self.sites.of_points[point(copy)];
        let row = |at: usize| {
            let run = runs[at];
            let site = run.iter().map(site_of).find(|&site| site != KNOWN && open[site as usize])?;
            if let Some(value) = self.known_value(run, point) {
                // Some points of this position are known: that settles the others.
                return Some((site, Row { unknown: Box::default(), known: 1, sum: value }));
            }
            let mut near = tree.query(&turned[at]).nearest_n::<SquaredEuclidean<f32>>(count).execute();
            near.retain(|near| near.item as usize != at);
            near.truncate(self.neighbours);
            let mut unknown = Vec::with_capacity(near.len());
            let mut row = Row { unknown: Box::default(), known: 0, sum: [0.0; C] };
            let mut reach = if near.len() < self.neighbours { f64::INFINITY } else { 0.0 };
            for near in near {
                let other = runs[near.item as usize];
                reach = (Vec3::from(other[0].1).as_dvec3() - Vec3::from(run[0].1).as_dvec3()).length().max(reach);
                match self.known_value(other, point) {
                    Some(value) => {
                        row.known += 1;
                        row.sum = std::array::from_fn(|c| row.sum[c] + value[c]);
                    }
                    None => unknown.push(site_of(&other[0])),
                }
            }
            row.unknown = unknown.into();
            (reach <= grid.reach()).then_some((site, row))
        };
        Ok((0..runs.len()).into_par_iter().filter_map(row).collect())
    }

    /// The mean value of the known ones among the points of one position, if any.
    fn known_value<T, const C: usize>(&self, run: &[T], point: impl Fn(&T) -> usize) -> Option<[f64; C]>
    where
        F: Fn(usize) -> [f64; C],
    {
        let (mut count, mut sum) = (0, [0.0; C]);
        for point in run.iter().map(point).filter(|&point| self.sites.of_points[point] == KNOWN) {
            let value = (self.value)(point);
            count += 1;
            sum = std::array::from_fn(|c| sum[c] + value[c]);
        }
        (count > 0).then(|| sum.map(|sum| sum / f64::from(count)))
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
