//! What of the scan lies under the cursor: a ray through the hierarchy's spheres, on the CPU.

use glam::{Vec3, Vec4};

use crate::preprocess::hierarchy::Hierarchy;

/// A point of the scan's surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Where, world space.
    pub position: Vec3,
    /// Mean unit normal of the points there; zero where they cancel out.
    pub normal: Vec3,
    /// Distance from the ray's origin, metres.
    pub distance: f32,
}

/// Rays that leave a surface through its back, as those from outside of a room do, have at least this cosine with its
/// normal.
const BEHIND: f32 = 0.1;

/// The nearest leaf, seen from its front, whose sphere the ray meets, as a disc through its middle across its normal; `direction` is unit.
pub fn surface(hierarchy: &Hierarchy, origin: Vec3, direction: Vec3) -> Option<Hit> {
    let mut best: Option<Hit> = None;
    let mut node = 0;
    while node < hierarchy.len() {
        let sphere = Vec4::from(hierarchy.spheres[node]);
        let (centre, radius) = (sphere.truncate(), sphere.w);
        let along = (centre - origin).dot(direction);
        let across = (centre - origin).length_squared() - along * along;
        let reach = radius * radius - across;
        let nearest = best.map_or(f32::INFINITY, |hit| hit.distance);
        let met = reach >= 0.0 && along + radius > 0.0 && along - reach.max(0.0).sqrt() < nearest;
        if !met {
            node = hierarchy.skips[node] as usize;
            continue;
        }
        if hierarchy.is_leaf(node) {
            let normal = Vec3::from(hierarchy.area_vectors[node]).normalize_or_zero();
            let slope = direction.dot(normal);
            if slope > BEHIND {
                node += 1;
                continue;
            }
            // Seen edge-on, a disc is met far away from its middle.
            let distance = if slope.abs() > 0.2 { (centre - origin).dot(normal) / slope } else { along }
                .clamp(along - radius, along + radius);
            if distance > 0.0 && distance < nearest {
                best = Some(Hit { position: origin + direction * distance, normal, distance });
            }
        }
        node += 1;
    }
    best
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::preprocess::hierarchy::{BuildOptions, build};
    use crate::scene::Cloud;

    /// Floor at y = 0 and a wall at z = -2, points every 5 cm.
    fn room() -> Hierarchy {
        let mut cloud = Cloud::default();
        for i in 0..80 * 80 {
            let (u, v) = ((i % 80) as f32 * 0.05 - 2.0, (i / 80) as f32 * 0.05);
            for (position, normal) in [(Vec3::new(u, 0.0, v - 2.0), Vec3::Y), (Vec3::new(u, v, -2.0), Vec3::Z)] {
                cloud.positions.push(position);
                cloud.normals.push(normal);
                cloud.colors.push(Vec3::ONE);
                cloud.spacing.push(0.05);
            }
        }
        build(&cloud, &BuildOptions::default()).expect("a hierarchy").0
    }

    #[test]
    fn the_nearest_surface_is_met_where_it_is() {
        let hierarchy = room();
        let eye = Vec3::new(0.1, 1.5, 1.5);
        for target in [Vec3::new(0.3, 0.0, 0.4), Vec3::new(-0.8, 0.0, -1.0), Vec3::new(0.2, 1.1, -2.0)] {
            let hit = surface(&hierarchy, eye, (target - eye).normalize()).expect("a surface");
            assert!(hit.position.distance(target) < 0.05, "{hit:?} instead of {target}");
            let normal = if target.y == 0.0 { Vec3::Y } else { Vec3::Z };
            assert!(hit.normal.dot(normal) > 0.9, "{hit:?}");
        }
        let below = surface(&hierarchy, Vec3::new(0.1, -2.0, 0.0), Vec3::Y);
        assert_eq!(below, None, "from behind, a floor hides nothing");
        assert_eq!(surface(&hierarchy, eye, Vec3::Y), None, "there is no ceiling");
        assert_eq!(surface(&hierarchy, eye, Vec3::Z), None, "nor anything behind");
    }
}
