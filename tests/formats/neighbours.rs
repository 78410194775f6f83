//! Normals and spacing.

use glam::Vec3;
use relume::preprocess::{neighbours, normals, spacing};
use relume::scene::Cloud;

use crate::Random;

const K: usize = neighbours::DEFAULT_NEIGHBOURS;

fn area(spacing: &[f32]) -> f64 {
    spacing.iter().map(|&s| f64::from(s).powi(2)).sum()
}

#[test]
fn squares_of_spacing_are_the_area_of_a_random_plane() {
    let mut random = Random(3);
    let plane: Vec<Vec3> = (0..60_000).map(|_| Vec3::new(random.next() * 3.0, 2.0, random.next() * 3.0)).collect();
    let spacing = spacing::estimate(&plane, K).unwrap();
    // Away from the border, where discs are only half covered.
    let inner = plane.iter().zip(&spacing).filter(|(p, _)| (0.25..2.75).contains(&p.x) && (0.25..2.75).contains(&p.z));
    let inner: Vec<f32> = inner.map(|(_, &s)| s).collect();
    assert!((area(&inner) / 6.25 - 1.0).abs() < 0.03, "{}", area(&inner));
    assert!((area(&spacing) / 9.0 - 1.0).abs() < 0.03, "{}", area(&spacing));
}

#[test]
fn squares_of_spacing_are_the_area_of_a_grid() {
    let grid: Vec<Vec3> = (0..90_000).map(|i| Vec3::new((i % 300) as f32, (i / 300) as f32, 1.0) * 0.01).collect();
    let spacing = spacing::estimate(&grid, K).unwrap();
    assert!((area(&spacing) / 9.0 - 1.0).abs() < 0.05, "{}", area(&spacing));
}

#[test]
fn copies_share_their_area() {
    let mut random = Random(5);
    let plane: Vec<Vec3> = (0..5_000).map(|_| Vec3::new(random.next(), 0.0, random.next())).collect();
    let once = spacing::estimate(&plane, K).unwrap();
    // Every point 20 times (more than k), and -0.0 must be the same as 0.0.
    let copies: Vec<Vec3> = (0..20)
        .flat_map(|i| plane.iter().map(move |p| if i % 2 == 0 { *p } else { Vec3::new(p.x, -0.0, p.z) }))
        .collect();
    let (normals, shared) = neighbours::normals_and_spacing(&copies, K, Vec3::Y * 9.0).unwrap();
    for (i, &s) in shared.iter().enumerate() {
        let whole = once[i % plane.len()];
        assert!((s * 20f32.sqrt() / whole - 1.0).abs() < 1e-4);
        assert!(normals[i].y > 0.999);
    }
}

#[test]
fn degenerate_clouds_have_finite_estimates() {
    let mut random = Random(7);
    let same = vec![Vec3::new(1.0, 2.0, 3.0); 10_000];
    let flat: Vec<Vec3> = (0..100_000).map(|_| Vec3::new(random.next(), random.next(), 0.0)).collect();
    let line: Vec<Vec3> = (0..1000).map(|i| Vec3::new(i as f32, i as f32, 0.0)).collect();
    let tiny: Vec<Vec3> = (0..100).map(|i| Vec3::new(i as f32, (i * i % 7) as f32, 0.0) * 1e-30).collect();
    let far: Vec<Vec3> = (0..100).map(|i| Vec3::new(i as f32, (i * i % 7) as f32, 0.0) * 1e10).collect();
    let mut one_away = same.clone();
    one_away.push(Vec3::ZERO);
    for cloud in [same, flat, line, tiny, far, one_away, vec![Vec3::ZERO], vec![]] {
        let (normals, spacing) = neighbours::normals_and_spacing(&cloud, K, Vec3::new(0.0, 0.0, 5.0)).unwrap();
        assert_eq!((normals.len(), spacing.len()), (cloud.len(), cloud.len()));
        assert!(normals.iter().all(|n| (n.length() - 1.0).abs() < 1e-5));
        assert!(spacing.iter().all(|s| s.is_finite() && *s > 0.0));
    }
}

#[test]
fn a_line_faces_the_viewer_across_itself() {
    let line: Vec<Vec3> = (0..100).map(|i| Vec3::new(i as f32 * 0.1, 0.0, 0.0)).collect();
    let normals = normals::estimate(&line, K, Vec3::new(5.0, 0.0, 2.0)).unwrap();
    assert!(normals.iter().all(|n| n.dot(Vec3::Z) > 0.999));
}

#[test]
fn normals_of_a_sphere_point_at_its_centre() {
    let mut random = Random(11);
    let centre = Vec3::new(10.0, -3.0, 2.0);
    let mut direction = || loop {
        let v = Vec3::new(random.next(), random.next(), random.next()) * 2.0 - 1.0;
        if (0.1..1.0).contains(&v.length()) {
            return v.normalize();
        }
    };
    let directions: Vec<Vec3> = (0..20_000).map(|_| direction()).collect();
    let points: Vec<Vec3> = directions.iter().map(|d| centre + 2.0 * d).collect();
    let (normals, spacing) = neighbours::normals_and_spacing(&points, K, centre).unwrap();
    assert!(normals.iter().zip(&directions).all(|(n, d)| n.dot(-d) > 0.995));
    assert!((area(&spacing) / (16.0 * std::f64::consts::PI) - 1.0).abs() < 0.03, "{}", area(&spacing));
    // The same every time, and the same apart or together.
    assert_eq!(neighbours::normals_and_spacing(&points, K, centre).unwrap(), (normals.clone(), spacing.clone()));
    assert_eq!(normals::estimate(&points, K, centre).unwrap(), normals);
    assert_eq!(spacing::estimate(&points, K).unwrap(), spacing);
}

#[test]
fn completing_keeps_what_is_there_and_prefers_the_viewpoint() {
    let mut random = Random(13);
    let positions: Vec<Vec3> = (0..500).map(|_| Vec3::new(random.next(), 0.0, random.next())).collect();
    let plain = Cloud { colors: vec![Vec3::ONE; 500], positions, ..Cloud::default() };
    let (above, below) = (Vec3::Y * 3.0, Vec3::Y * -3.0);
    for (viewpoint, towards, up) in
        [(Some(above), Some(below), 1.0), (None, Some(below), -1.0), (Some(below), None, -1.0)]
    {
        let mut cloud = Cloud { viewpoint, ..plain.clone() };
        neighbours::complete(&mut cloud, towards).unwrap();
        assert!(cloud.normals.iter().all(|n| n.y * up > 0.999));
    }
    let mut cloud = Cloud { normals: vec![Vec3::X; 500], ..plain };
    cloud.normals[3] = Vec3::ZERO;
    neighbours::complete(&mut cloud, Some(above)).unwrap();
    assert_eq!((cloud.normals[2], cloud.spacing.len()), (Vec3::X, 500));
    assert!(cloud.normals[3].y > 0.999);
}
