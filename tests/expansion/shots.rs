//! Cubemaps of a cloud.

use glam::{Vec2, Vec3, Vec3Swizzles, vec3};
use relume::preprocess::expansion::shots::{FACES, NO_POINT, Shot, ShotsBy, direction, project};
use relume::preprocess::spacing;
use relume::scene::Cloud;

use super::{Random, on_threads};

const SIZE: u32 = 128;
const EYE: Vec3 = vec3(0.2, -0.1, 0.15);

/// Points on the faces of a cube of two metres around the origin, `rows * rows` on each: anywhere, or one about the middle
/// of each cell of a grid.
fn cube(rows: usize, is_even: bool) -> Cloud {
    let mut random = Random(9);
    let mut cloud = Cloud::default();
    for n in 0..6 * rows * rows {
        let (axis, side) = (n % 3, if n / 3 % 2 == 0 { 1.0 } else { -1.0 });
        let cell = n / 6;
        let mut position = random.vector();
        if is_even {
            position[(axis + 1) % 3] = ((cell % rows) as f32 + 0.25 + 0.5 * position[(axis + 1) % 3]) / rows as f32;
            position[(axis + 2) % 3] = ((cell / rows) as f32 + 0.25 + 0.5 * position[(axis + 2) % 3]) / rows as f32;
        }
        position = position * 2.0 - 1.0;
        position[axis] = side;
        cloud.positions.push(position);
        cloud.normals.push(Vec3::AXES[axis] * -side);
        cloud.colors.push(Vec3::ONE);
    }
    cloud.spacing = spacing::estimate(&cloud.positions, 16).unwrap();
    cloud
}

#[test]
fn places_and_directions_are_inverses() {
    let mut random = Random(2);
    for _ in 0..10_000 {
        let towards = random.vector() * 2.0 - 1.0;
        let (face, at) = project(towards, SIZE);
        assert!(at.cmpge(Vec2::ZERO).all() && at.cmple(Vec2::splat(SIZE as f32)).all(), "{towards}: {at}");
        let back = direction(face, at, SIZE).normalize();
        assert!(back.dot(towards.normalize()) > 0.999_999, "{towards} came back as {back}");
        let (same, there) = project(direction(face, at, SIZE) * 3.0, SIZE);
        // On an edge either face will do.
        assert!(same != face || there.distance(at) < 1e-3, "{towards}: {at} and {there}");
    }
    // In the order of OpenGL and Vulkan, but as a camera sees them: right x down is forward, or it would be a mirror image
    // and no patch of a photo would be found in it.
    let half = 0.5 * SIZE as f32;
    for (face, forward) in [Vec3::X, Vec3::NEG_X, Vec3::Y, Vec3::NEG_Y, Vec3::Z, Vec3::NEG_Z].into_iter().enumerate() {
        assert_eq!(project(forward, SIZE), (face, Vec2::splat(half)));
        assert_eq!(FACES[face].x_axis.cross(FACES[face].y_axis), forward);
        assert_eq!(FACES[face].z_axis, forward);
    }
    assert_eq!(direction(0, Vec2::new(SIZE as f32, half), SIZE), vec3(1.0, 0.0, 1.0));
    assert_eq!(direction(2, Vec2::new(half, SIZE as f32), SIZE), vec3(0.0, 1.0, -1.0));
    // Beyond a face's edge lies the next face: to the right of -Z is +X.
    assert_eq!(project(direction(5, Vec2::new(1.5 * SIZE as f32, half), SIZE), SIZE).0, 0);
}

#[test]
fn a_closed_surface_has_no_holes() {
    let holes = |cloud: &Cloud| {
        let shot = Shot::take(cloud, EYE, SIZE, ShotsBy::Splats);
        let seen = (0..cloud.len()).filter(|&n| shot.sees(cloud.positions[n], cloud.spacing[n]).is_some()).count();
        assert!(seen as f32 > 0.999 * cloud.len() as f32, "{seen} of {} points are seen", cloud.len());
        shot.faces.iter().flat_map(|face| &face.point).filter(|&&point| point == NO_POINT).count()
    };
    for rows in [30, 100, 200] {
        assert_eq!(holes(&cube(rows, true)), 0, "{rows} rows");
    }
    // Points anywhere leave empty discs of any size, if seldom.
    let holes = holes(&cube(100, false));
    assert!(holes < 100, "{holes} of {} pixels", 6 * SIZE * SIZE);
}

#[test]
fn points_are_where_they_are_seen() {
    are_where_they_are_seen(ShotsBy::Splats, 0.01, 3.0);
    // Holes are filled from as far as the pyramid has found something.
    are_where_they_are_seen(ShotsBy::Points, 0.02, 8.0);
}

/// Every pixel's point lies at most `reach` spacings from it, and at most the given share of pixels has none.
fn are_where_they_are_seen(by: ShotsBy, holes: f32, reach: f32) {
    let cloud = cube(100, false);
    let shot = Shot::take(&cloud, EYE, SIZE, by);
    let empty = shot.faces.iter().flat_map(|face| &face.point).filter(|point| **point == NO_POINT).count();
    assert!(empty as f32 <= holes * (6 * SIZE * SIZE) as f32, "{by:?}: {empty} pixels show nothing");
    for (face, pixels) in shot.faces.iter().enumerate() {
        assert_eq!((pixels.point.len(), pixels.depth.len()), ((SIZE * SIZE) as usize, (SIZE * SIZE) as usize));
        for (n, (&point, &depth)) in pixels.point.iter().zip(&pixels.depth).enumerate() {
            if point == NO_POINT {
                continue;
            }
            let at = Vec2::new((n as u32 % SIZE) as f32 + 0.5, (n as u32 / SIZE) as f32 + 0.5);
            let ray = direction(face, at, SIZE).normalize();
            let (position, spacing) = (cloud.positions[point as usize], cloud.spacing[point as usize]);
            let off = (position - EYE).reject_from_normalized(ray).length();
            assert!(off < reach * spacing.max(depth * 2.0 / SIZE as f32), "pixel {at} shows a point {off} m beside it");
            let expected = (position - EYE).dot(FACES[face].z_axis);
            assert!((depth - expected).abs() < reach * spacing + 0.01 * depth, "{at}: depth {depth}, not {expected}");
        }
    }
}

#[test]
fn what_stands_behind_is_not_seen() {
    is_not_seen_behind(ShotsBy::Splats);
    is_not_seen_behind(ShotsBy::Points);
}

fn is_not_seen_behind(by: ShotsBy) {
    let mut cloud = cube(100, false);
    let walls = cloud.len();
    // A screen of 0.6 x 0.6 metres half way to +X; from the origin it hides 1.2 x 1.2 metres of the wall.
    for n in 0..54 * 54 {
        cloud.positions.push(vec3(0.5, (n % 54) as f32 / 90.0 - 0.294, (n / 54) as f32 / 90.0 - 0.294));
        cloud.normals.push(Vec3::NEG_X);
        cloud.colors.push(Vec3::ONE);
        cloud.spacing.push(0.011);
    }
    let shot = Shot::take(&cloud, Vec3::ZERO, SIZE, by);
    let (mut hidden, mut open) = (0, 0);
    for n in 0..cloud.len() {
        let (position, spacing) = (cloud.positions[n], cloud.spacing[n]);
        let seen = shot.sees(position, spacing);
        let off = position.yz().abs().max_element();
        if n >= walls || position.x < 0.9 || off > 0.75 {
            open += u32::from(seen.is_none());
        } else if off < 0.5 {
            hidden += 1;
            assert_eq!(seen, None, "{position} is behind the screen");
        }
        // A point is seen in the pixel that it projects to.
        if let Some((face, pixel)) = seen {
            let (expected, at) = project(position, SIZE);
            let pixel = Vec2::new((pixel as u32 % SIZE) as f32, (pixel as u32 / SIZE) as f32);
            assert!(face == expected && (at - pixel - 0.5).abs().max_element() <= 0.501, "{position}: {face} {pixel}");
        }
    }
    assert!(hidden > 2000 && open < 100, "{hidden} are hidden; {open} in the open are not seen");
    // A point in the eye, and one that is no number, have no place.
    assert_eq!(shot.sees(Vec3::ZERO, 0.1), None);
    assert_eq!(shot.sees(Vec3::NAN, 0.1), None);
}

#[test]
fn threads_change_nothing() {
    let cloud = cube(100, false);
    let run = |threads, by| {
        let shot = on_threads(threads, || Shot::take(&cloud, EYE, SIZE, by));
        let depths = |shot: &Shot, n: usize| shot.faces[n].depth.iter().map(|d| d.to_bits()).collect::<Vec<_>>();
        (0..6).map(|n| (shot.faces[n].point.clone(), depths(&shot, n))).collect::<Vec<_>>()
    };
    for by in [ShotsBy::Splats, ShotsBy::Points] {
        let one = run(1, by);
        assert!(one == run(2, by) && one == run(3, by));
    }
}

#[test]
fn nothing_and_one_point() {
    for by in [ShotsBy::Splats, ShotsBy::Points] {
        let shot = Shot::take(&Cloud::default(), Vec3::ZERO, 32, by);
        assert!(shot.faces.iter().all(|face| face.point.iter().all(|&point| point == NO_POINT)));
        assert!(shot.faces.iter().all(|face| face.depth.iter().all(|&depth| depth == f32::INFINITY)));
    }
    let one = |position: Vec3| Cloud {
        positions: vec![position],
        normals: vec![Vec3::Y],
        colors: vec![Vec3::ONE],
        spacing: vec![0.01],
        ..Cloud::default()
    };
    // Far away it still has a pixel; in the eye it has none.
    let count = |cloud: &Cloud, by| {
        let faces = Shot::take(cloud, Vec3::ZERO, 32, by).faces;
        faces.iter().flat_map(|face| &face.point).filter(|&&point| point == 0).count()
    };
    for by in [ShotsBy::Splats, ShotsBy::Points] {
        assert!((1..=4).contains(&count(&one(vec3(3.0, 1000.0, 5.0)), by)));
        assert_eq!(count(&one(Vec3::ZERO), by), 0);
    }
}
