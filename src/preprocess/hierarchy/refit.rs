//! Other light on the same cloud: the radiance of all nodes from that of the leaves, without building anything anew.

use glam::Vec3;
use rayon::prelude::*;

use super::propagate::{mean_color, of_color};
use super::prune::LUMINANCE;
use super::{Hierarchy, LARGEST};
use crate::{Error, Result};

/// What of a hierarchy depends on its light, a node each: in the place of the fields of the same names.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct NodeRadiance {
    /// [`Hierarchy::colors`].
    pub colors: Vec<[f32; 3]>,
    /// [`Hierarchy::radiance_vectors`].
    pub radiance_vectors: Vec<[f32; 3]>,
    /// [`Hierarchy::brightest_point`].
    pub brightest_point: f32,
}

/// Subtrees of up to this many nodes are one task.
const TASK_NODES: usize = 1 << 14;

/// A part of both arrays, from node `first` on.
struct Part<'a> {
    first: usize,
    colors: &'a mut [[f32; 3]],
    radiance_vectors: &'a mut [[f32; 3]],
}

impl Hierarchy {
    /// The nodes that have no children, in their order.
    pub fn leaves(&self) -> impl Iterator<Item = usize> {
        (0..self.len()).filter(|node| self.is_leaf(*node))
    }

    /// The radiance of all nodes where each leaf sends `share` times what it did and `added` besides, from all its points
    /// alike; leaves in the order of [`Hierarchy::leaves`]. With a share of 1 and nothing added these are the hierarchy's
    /// own values to the byte.
    ///
    /// # Errors
    /// [`Error::Argument`] for another number of leaves, a share or radiance that is negative or beyond 1e15, or
    /// where sums are not finite.
    pub fn refit(&self, share: f32, added: &[Vec3]) -> Result<NodeRadiance> {
        let leaves = self.len().div_ceil(2);
        if added.len() != leaves {
            return Err(Error::Argument(format!("radiance of {} leaves for a hierarchy of {leaves}", added.len())));
        }
        let usable = |value: Vec3| value.min_element() >= 0.0 && value.cmple(Vec3::splat(LARGEST)).all();
        if let Some(leaf) = added.par_iter().position_first(|value| !usable(*value)) {
            return Err(Error::Argument(format!("leaf {leaf} is to send {}, which is no radiance", added[leaf])));
        }
        if !(0.0..=LARGEST).contains(&share) {
            return Err(Error::Argument(format!("a share of {share} of the cloud's own light")));
        }
        let mut radiance = NodeRadiance {
            colors: vec![[0.0; 3]; self.len()],
            radiance_vectors: vec![[0.0; 3]; self.len()],
            brightest_point: 0.0,
        };
        let (colors, radiance_vectors) = (&mut radiance.colors[..], &mut radiance.radiance_vectors[..]);
        self.refit_part(share, added, Part { first: 0, colors, radiance_vectors });
        let most = added.par_iter().map(|value| value.max_element()).reduce(|| 0.0, f32::max);
        // A leaf of several points does not know its brightest one.
        radiance.brightest_point = share * self.brightest_point + most;
        let root = Vec3::from(radiance.radiance_vectors.first().copied().unwrap_or_default());
        if !(root.is_finite() && radiance.brightest_point.is_finite()) {
            return Err(Error::Argument("the light is so strong that its sums are not finite".into()));
        }
        Ok(radiance)
    }

    /// The same hierarchy in that light.
    pub fn with_radiance(self, radiance: NodeRadiance) -> Self {
        let NodeRadiance { colors, radiance_vectors, brightest_point } = radiance;
        Self { colors, radiance_vectors, brightest_point, ..self }
    }

    /// A whole subtree, whose leaves are lit by `added`.
    fn refit_part(&self, share: f32, added: &[Vec3], mut part: Part<'_>) {
        let Part { first, .. } = part;
        if part.colors.len() <= TASK_NODES {
            // Children come after their parent, and a subtree's last leaf is its last node.
            let mut added = added.iter().rev();
            for node in (first..first + part.colors.len()).rev() {
                let (color, radiance_vector) = if self.is_leaf(node) {
                    self.leaf_radiance(node, share, added.next().copied().unwrap_or_default())
                } else {
                    self.inner_radiance(node, |child| {
                        let at = child - first;
                        (part.colors[at].into(), part.radiance_vectors[at].into())
                    })
                };
                part.set(node, color, radiance_vector);
            }
            return;
        }
        let right_first = self.right(first);
        let left_nodes = right_first - first - 1;
        let (left_added, right_added) = added.split_at(left_nodes.div_ceil(2));
        let (own_colors, colors) = part.colors.split_at_mut(1);
        let (own_vectors, vectors) = part.radiance_vectors.split_at_mut(1);
        let (left_colors, right_colors) = colors.split_at_mut(left_nodes);
        let (left_vectors, right_vectors) = vectors.split_at_mut(left_nodes);
        let below = |first, colors, radiance_vectors| Part { first, colors, radiance_vectors };
        let (left, right) = (
            below(first + 1, &mut *left_colors, &mut *left_vectors),
            below(right_first, &mut *right_colors, &mut *right_vectors),
        );
        rayon::join(|| self.refit_part(share, left_added, left), || self.refit_part(share, right_added, right));
        let (color, radiance_vector) = self.inner_radiance(first, |child| match child == right_first {
            true => (right_colors[0].into(), right_vectors[0].into()),
            false => (left_colors[0].into(), left_vectors[0].into()),
        });
        (own_colors[0], own_vectors[0]) = (color.into(), radiance_vector.into());
    }

    fn leaf_radiance(&self, node: usize, share: f32, added: Vec3) -> (Vec3, Vec3) {
        let color = Vec3::from(self.colors[node]) * share + added;
        let sent = Vec3::from(self.area_vectors[node]) * added.dot(LUMINANCE);
        (color, of_color(color, Vec3::from(self.radiance_vectors[node]) * share + sent))
    }

    fn inner_radiance(&self, node: usize, of: impl Fn(usize) -> (Vec3, Vec3)) -> (Vec3, Vec3) {
        let (left, right) = (self.left(node), self.right(node));
        let ((left_color, left_vector), (right_color, right_vector)) = (of(left), of(right));
        let color = mean_color((left_color, self.areas[left]), (right_color, self.areas[right]));
        (color, of_color(color, left_vector + right_vector))
    }
}

impl Part<'_> {
    fn set(&mut self, node: usize, color: Vec3, radiance_vector: Vec3) {
        let at = node - self.first;
        (self.colors[at], self.radiance_vectors[at]) = (color.into(), radiance_vector.into());
    }
}

#[cfg(test)]
mod tests {
    use super::super::{BuildOptions, build};
    use super::*;
    use crate::reference::sampling::Random;
    use crate::scene::Cloud;

    fn cloud(points: usize) -> Cloud {
        let mut random = Random::new(3, 7);
        let mut cloud = Cloud::default();
        for n in 0..points {
            let (a, b, c) = (random.square(), random.square(), random.square());
            cloud.positions.push(Vec3::new(a.x, a.y, b.x));
            // Some are black, as in a dark room.
            cloud.colors.push(if n % 7 == 0 { Vec3::ZERO } else { Vec3::new(b.y, c.x, c.y) });
            cloud.normals.push((Vec3::new(c.x, b.y, a.x) - 0.5).normalize_or(Vec3::Y));
            cloud.spacing.push(0.01 + 0.02 * a.y);
        }
        cloud
    }

    #[test]
    fn nothing_added_is_what_was_built_to_the_byte() {
        for (points, options) in [
            (1, BuildOptions::unpruned()),
            (2, BuildOptions::unpruned()),
            (50_000, BuildOptions::unpruned()),
            (50_000, BuildOptions { color_threshold: 10.0, normal_threshold: -1.0, ..BuildOptions::default() }),
        ] {
            let (hierarchy, _) = build(&cloud(points), &options).expect("a hierarchy");
            let same = hierarchy.refit(1.0, &vec![Vec3::ZERO; hierarchy.leaves().count()]).expect("radiance");
            assert!(same.colors == hierarchy.colors, "{points} points: colours");
            assert!(same.radiance_vectors == hierarchy.radiance_vectors, "{points} points: radiance vectors");
            assert_eq!(same.brightest_point, hierarchy.brightest_point);
        }
    }

    #[test]
    fn new_radiance_of_all_points_is_what_a_new_hierarchy_has() {
        let mut cloud = cloud(40_000);
        let (hierarchy, _) = build(&cloud, &BuildOptions::unpruned()).expect("a hierarchy");
        let light = |p: Vec3| Vec3::new(3.0, 1.0, 0.5) * p.x;
        let share = 0.25;
        let added: Vec<Vec3> =
            hierarchy.leaves().map(|leaf| light(Vec3::from_slice(&hierarchy.spheres[leaf]))).collect();
        let relit = hierarchy.refit(share, &added).expect("radiance");
        for (color, position) in cloud.colors.iter_mut().zip(&cloud.positions) {
            *color = *color * share + light(*position);
        }
        let (anew, _) = build(&cloud, &BuildOptions::unpruned()).expect("a hierarchy");
        assert_eq!(anew.skips, hierarchy.skips);
        for node in 0..anew.len() {
            let near = |a: [f32; 3], b: [f32; 3], size: f32| Vec3::from(a).distance(b.into()) <= 1e-5 * size;
            assert!(near(relit.colors[node], anew.colors[node], 4.0), "colour of node {node}");
            let size = 4.0 * anew.areas[node];
            assert!(near(relit.radiance_vectors[node], anew.radiance_vectors[node], size), "vector of node {node}");
        }
        let brightest = anew.brightest_point;
        assert!(relit.brightest_point >= brightest && relit.brightest_point < brightest + 0.26);
    }

    #[test]
    fn what_is_no_radiance_is_refused_on_one_line() {
        let (hierarchy, _) = build(&cloud(100), &BuildOptions::unpruned()).expect("a hierarchy");
        let dark = vec![Vec3::ZERO; 100];
        let with = |value: Vec3| {
            let mut added = dark.clone();
            added[70] = value;
            added
        };
        for (share, added, word) in [
            (1.0, dark[1..].to_vec(), "99 leaves for a hierarchy of 100"),
            (-1.0, dark.clone(), "share of -1"),
            (f32::NAN, dark.clone(), "share of NaN"),
            (1.0, with(Vec3::new(0.0, f32::NAN, 0.0)), "leaf 70"),
            (1.0, with(Vec3::NEG_X), "leaf 70"),
            (1.0, with(Vec3::splat(2e15)), "leaf 70"),
            (f32::INFINITY, dark.clone(), "share of inf"),
        ] {
            let message = hierarchy.refit(share, &added).expect_err(word).to_string();
            assert!(message.contains(word) && !message.contains('\n'), "{message}");
        }
    }
}
