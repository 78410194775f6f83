//! A cloud in chunks for drawing: points in Morton order, a box around each chunk, and within a chunk an order of which
//! every beginning is spread over the whole of it, so that a part of a cloud can be drawn as a thinner cloud.

use glam::{Vec2Swizzles, Vec3};
use rayon::prelude::*;

use super::hierarchy::Hierarchy;
use super::hierarchy::morton::Lattice;
use crate::formats::color::pack_rgb9e5;
use crate::scene::Cloud;
use crate::{Error, Result};

/// Points of a chunk, all but the last.
pub const CHUNK: usize = 1 << 16;

/// A point as the device takes it: position as float bits, and colour in RGB9E5.
pub type PackedPoint = [u32; 4];

/// What lights need of a point besides: its unit normal on an octahedron, x and y in 16 bits each, and its spacing in
/// metres as float bits.
pub type PackedSurfel = [u32; 2];

/// A point and its surfel as the device takes them; `spacing` in metres.
pub fn packed(position: Vec3, color: Vec3, normal: Vec3, spacing: f32) -> (PackedPoint, PackedSurfel) {
    let [x, y, z] = position.to_array().map(f32::to_bits);
    let [u, v] = octahedral(normal);
    ([x, y, z, pack_rgb9e5(color)], [u | v << 16, spacing.to_bits()])
}

/// The leaves of a hierarchy in their order, with their mean normals.
pub fn packed_leaves(hierarchy: &Hierarchy) -> (Vec<PackedPoint>, Vec<PackedSurfel>) {
    let leaf = |node: usize| {
        let [x, y, z, radius] = hierarchy.spheres[node];
        let normal = Vec3::from(hierarchy.area_vectors[node]).normalize_or_zero();
        packed(Vec3::new(x, y, z), Vec3::from(hierarchy.colors[node]), normal, radius)
    };
    hierarchy.leaves().map(leaf).unzip()
}

/// A run of points and the box that they lie in.
#[derive(Clone, Debug, PartialEq)]
pub struct Chunk {
    /// Index of its first point.
    pub first: usize,
    /// Number of its points.
    pub count: usize,
    /// Lower corner, metres.
    pub low: Vec3,
    /// Upper corner, metres.
    pub high: Vec3,
}

/// All points of a cloud in chunks.
#[derive(Clone, Debug, Default)]
pub struct PointChunks {
    /// Positions and colours.
    pub points: Vec<PackedPoint>,
    /// Normals and spacings in the same order; empty where the cloud has no normals.
    pub surfels: Vec<PackedSurfel>,
    /// What they are divided into, in Morton order.
    pub chunks: Vec<Chunk>,
    /// Typical distance between neighbours, metres: s_0 of Bouchiba et al. 2018.
    pub spacing: f32,
}

impl PointChunks {
    /// Sorts a cloud into chunks; without spacings of its own it gets one that suits its extent.
    ///
    /// # Errors
    /// [`Error::Limit`] for more points than 32 bits count.
    pub fn new(cloud: &Cloud) -> Result<Self> {
        Self::sorted(&cloud.positions, &cloud.colors, &cloud.spacing, &cloud.normals)
    }

    /// Lower and upper corner of the box around all points; `None` without any.
    pub fn bounds(&self) -> Option<(Vec3, Vec3)> {
        self.chunks.iter().map(|chunk| (chunk.low, chunk.high)).reduce(|a, b| (a.0.min(b.0), a.1.max(b.1)))
    }

    /// The leaves of a hierarchy: all points where nothing was pruned.
    ///
    /// # Errors
    /// [`Error::Limit`] for more points than 32 bits count.
    pub fn of_hierarchy(hierarchy: &Hierarchy) -> Result<Self> {
        let leaves: Vec<usize> = (0..hierarchy.len()).filter(|&node| hierarchy.is_leaf(node)).collect();
        let pick = |node: &usize| {
            let [x, y, z, radius] = hierarchy.spheres[*node];
            (Vec3::new(x, y, z), Vec3::from(hierarchy.colors[*node]), radius)
        };
        let normals: Vec<Vec3> =
            leaves.iter().map(|node| Vec3::from(hierarchy.area_vectors[*node]).normalize_or_zero()).collect();
        let positions: Vec<Vec3> = leaves.iter().map(|node| pick(node).0).collect();
        let colors: Vec<Vec3> = leaves.iter().map(|node| pick(node).1).collect();
        let spacing: Vec<f32> = leaves.iter().map(|node| pick(node).2).collect();
        Self::sorted(&positions, &colors, &spacing, &normals)
    }

    /// The same from arrays of the same length; `spacing` may be empty.
    ///
    /// # Errors
    /// [`Error::Limit`] for more points than 32 bits count.
    pub fn from_points(positions: &[Vec3], colors: &[Vec3], spacing: &[f32]) -> Result<Self> {
        Self::sorted(positions, colors, spacing, &[])
    }

    /// `spacing` and `normals` may be empty.
    fn sorted(positions: &[Vec3], colors: &[Vec3], spacing: &[f32], normals: &[Vec3]) -> Result<Self> {
        let count = positions.len();
        if u32::try_from(count).is_err() {
            return Err(Error::Limit(format!("{count} points; at most {} can be drawn", u32::MAX)));
        }
        let (low, high) = bounds(positions.iter().copied());
        let lattice = Lattice::new(low, high);
        let mut order: Vec<(u64, u32)> =
            positions.par_iter().enumerate().map(|(i, p)| (lattice.code(*p), i as u32)).collect();
        order.par_sort_unstable();
        let sorted: Vec<Vec<PackedPoint>> = order
            .par_chunks(CHUNK)
            .map(|chunk| {
                spread_order(chunk.len())
                    .map(|k| {
                        let index = chunk[k].1 as usize;
                        packed(positions[index], colors[index], Vec3::ZERO, 0.0).0
                    })
                    .collect()
            })
            .collect();
        let typical = typical_spacing(spacing, count, high - low);
        let surfel = |index: usize| {
            packed(positions[index], colors[index], normals[index], spacing.get(index).copied().unwrap_or(typical)).1
        };
        let surfels: Vec<Vec<PackedSurfel>> = if normals.is_empty() {
            Vec::new()
        } else {
            order
                .par_chunks(CHUNK)
                .map(|chunk| spread_order(chunk.len()).map(|k| surfel(chunk[k].1 as usize)).collect())
                .collect()
        };
        let mut first = 0;
        let mut chunks = Vec::with_capacity(sorted.len());
        for chunk in &sorted {
            let (low, high) = bounds(chunk.iter().map(|[x, y, z, _]| Vec3::from([*x, *y, *z].map(f32::from_bits))));
            chunks.push(Chunk { first, count: chunk.len(), low, high });
            first += chunk.len();
        }
        Ok(Self { points: sorted.concat(), surfels: surfels.concat(), chunks, spacing: typical })
    }
}

/// A unit vector on an octahedron's square, each side in 16 bits with a sign; a zero vector as +Z.
fn octahedral(normal: Vec3) -> [u32; 2] {
    let size = normal.abs().element_sum();
    if size.is_nan() || size <= 0.0 {
        return [0, 0];
    }
    let place = normal.truncate() / size;
    let folded = (1.0 - place.yx().abs()) * place.signum();
    let place = if normal.z < 0.0 { folded } else { place };
    place.to_array().map(|side| u32::from((side * 32_767.0).round() as i16 as u16))
}

/// Lower and upper corner; zeros without points.
fn bounds(points: impl Iterator<Item = Vec3>) -> (Vec3, Vec3) {
    points.map(|p| (p, p)).reduce(|a, b| (a.0.min(b.0), a.1.max(b.1))).unwrap_or_default()
}

/// The median; without any, what a closed surface of that extent has.
fn typical_spacing(spacing: &[f32], count: usize, extent: Vec3) -> f32 {
    let mut spacing = spacing.to_vec();
    if spacing.is_empty() {
        let area = 2.0 * (extent.x * extent.y + extent.y * extent.z + extent.z * extent.x);
        let mean = (area / count.max(1) as f32).sqrt();
        return if mean.is_finite() && mean > 0.0 { mean } else { super::spacing::FALLBACK_SPACING };
    }
    let middle = spacing.len() / 2;
    *spacing.select_nth_unstable_by(middle, f32::total_cmp).1
}

/// Indices below `count` in the order of their reversed bits (van der Corput 1935).
fn spread_order(count: usize) -> impl Iterator<Item = usize> {
    let bits = count.next_power_of_two().trailing_zeros();
    let reversed = move |k: usize| if bits == 0 { 0 } else { k.reverse_bits() >> (usize::BITS - bits) };
    (0..count.next_power_of_two()).map(reversed).filter(move |k| *k < count)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_index_comes_once_and_every_beginning_is_spread() {
        for count in [0, 1, 2, 3, 100, 1 << 10] {
            let mut order: Vec<usize> = spread_order(count).collect();
            if count >= 100 {
                let quarter: Vec<usize> = order[..count / 4].iter().map(|k| k * 8 / count).collect();
                for eighth in 0..8 {
                    let share = quarter.iter().filter(|e| **e == eighth).count() as f32 / quarter.len() as f32;
                    assert!((share - 0.125).abs() < 0.05, "{share} of {count} in eighth {eighth}");
                }
            }
            order.sort_unstable();
            assert_eq!(order, (0..count).collect::<Vec<_>>());
        }
    }

    #[test]
    fn chunks_hold_all_points_within_their_boxes_whatever_the_order() {
        let mut positions: Vec<Vec3> =
            (0..200_000_u32).map(|i| Vec3::new((i % 61) as f32, (i % 97) as f32, (i % 331) as f32)).collect();
        let colors = vec![Vec3::ONE; positions.len()];
        let chunks = PointChunks::from_points(&positions, &colors, &[]).expect("few points");
        assert_eq!(chunks.points.len(), positions.len());
        assert_eq!(chunks.chunks.iter().map(|c| c.count).sum::<usize>(), positions.len());
        for chunk in &chunks.chunks {
            for [x, y, z, _] in &chunks.points[chunk.first..chunk.first + chunk.count] {
                let p = Vec3::from([*x, *y, *z].map(f32::from_bits));
                assert!(p.cmpge(chunk.low).all() && p.cmple(chunk.high).all());
            }
        }
        let mean_extent: f32 = chunks.chunks.iter().map(|c| (c.high - c.low).element_product()).sum();
        assert!(mean_extent < 2.5 * 60.0 * 96.0 * 330.0, "chunks are compact: {mean_extent}");
        positions.reverse();
        let again = PointChunks::from_points(&positions, &colors, &[]).expect("few points");
        assert_eq!(again.chunks, chunks.chunks);
    }

    #[test]
    fn normals_and_spacings_follow_their_points() {
        let mut random = crate::reference::sampling::Random::new(1, 1);
        let count = 1000;
        let mut cloud = Cloud::default();
        for n in 0..count {
            let (a, b) = (random.square(), random.square());
            cloud.positions.push(Vec3::new(a.x, a.y, n as f32));
            cloud.colors.push(Vec3::ONE);
            cloud.normals.push((Vec3::new(a.x, a.y, b.x) - 0.5).normalize_or(Vec3::NEG_Z));
            cloud.spacing.push(b.y);
        }
        let chunks = PointChunks::new(&cloud).expect("few points");
        assert_eq!(chunks.surfels.len(), count);
        for (point, surfel) in chunks.points.iter().zip(&chunks.surfels) {
            let n = f32::from_bits(point[2]) as usize;
            assert_eq!(f32::from_bits(surfel[1]), cloud.spacing[n]);
            // As `load_surfel` in `glsl/common/surfel.glsl`.
            let [x, y] = [surfel[0] as u16, (surfel[0] >> 16) as u16].map(|bits| f32::from(bits as i16) / 32_767.0);
            let mut normal = Vec3::new(x, y, 1.0 - x.abs() - y.abs());
            if normal.z < 0.0 {
                let side = |v: f32| if v < 0.0 { -1.0 } else { 1.0 };
                (normal.x, normal.y) = ((1.0 - y.abs()) * side(x), (1.0 - x.abs()) * side(y));
            }
            assert!(normal.normalize().distance(cloud.normals[n]) < 1e-3, "{normal} instead of {}", cloud.normals[n]);
        }
        assert!(PointChunks::from_points(&cloud.positions, &cloud.colors, &[]).expect("points").surfels.is_empty());
    }

    #[test]
    fn no_point_and_one_point_are_clouds() {
        assert!(PointChunks::from_points(&[], &[], &[]).expect("no points").chunks.is_empty());
        let one = PointChunks::from_points(&[Vec3::ONE], &[Vec3::ONE], &[]).expect("one point");
        assert_eq!((one.points.len(), one.chunks.len()), (1, 1));
        assert!(one.spacing > 0.0);
    }
}
