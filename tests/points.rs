//! The point renderer on clouds of known surfaces: what is hidden, how the surface is filled, which way it faces.

mod common;

use std::f32::consts::TAU;
use std::sync::Arc;

use common::{Device, Random};
use glam::{Vec2, Vec3, vec3};
use relume::frames::points::{HiddenPoints, PointDisplay, PointFrame, PointGeometry, PointRenderer, PointSettings};
use relume::gpu::Profile;
use relume::preprocess::point_chunks::PointChunks;
use relume::reference::points::{self as plain, View};
use relume::scene::Camera;

/// A surface that rays meet where its points lie.
#[derive(Clone, Copy)]
enum Shape {
    /// Corner and two edges.
    Rectangle(Vec3, Vec3, Vec3),
    /// Centre and radius.
    Sphere(Vec3, f32),
}

impl Shape {
    fn area(&self) -> f32 {
        match self {
            Self::Rectangle(_, u, v) => u.cross(*v).length(),
            Self::Sphere(_, radius) => 2.0 * TAU * radius * radius,
        }
    }

    fn sample(&self, random: &mut Random) -> Vec3 {
        let (a, b) = (random.next(), random.next());
        match *self {
            Self::Rectangle(corner, u, v) => corner + u * a + v * b,
            Self::Sphere(centre, radius) => {
                let z = 2.0 * a - 1.0;
                let across = (1.0 - z * z).max(0.0).sqrt();
                centre + radius * vec3(across * (TAU * b).cos(), z, across * (TAU * b).sin())
            }
        }
    }

    /// Distance in multiples of `direction`, and the normal.
    fn hit(&self, origin: Vec3, direction: Vec3) -> Option<(f32, Vec3)> {
        match *self {
            Self::Rectangle(corner, u, v) => {
                let normal = u.cross(v).normalize();
                let t = (corner - origin).dot(normal) / direction.dot(normal);
                let place = origin + direction * t - corner;
                let (a, b) = (place.dot(u) / u.length_squared(), place.dot(v) / v.length_squared());
                (t > 1e-4 && (0.0..=1.0).contains(&a) && (0.0..=1.0).contains(&b)).then_some((t, normal))
            }
            Self::Sphere(centre, radius) => {
                let (from, length2) = (origin - centre, direction.length_squared());
                let half = from.dot(direction) / length2;
                let root = (half * half - (from.length_squared() - radius * radius) / length2).sqrt();
                let t = if -half - root > 1e-4 { -half - root } else { -half + root };
                (t > 1e-4).then(|| (t, (from + direction * t) / radius))
            }
        }
    }
}

fn add_box(shapes: &mut Vec<Shape>, low: Vec3, high: Vec3) {
    let (x, y, z) = (Vec3::X * (high - low).x, Vec3::Y * (high - low).y, Vec3::Z * (high - low).z);
    let faces = [(low, x, y), (low + z, x, y), (low, z, y), (low + x, z, y), (low, x, z), (low + y, x, z)];
    shapes.extend(faces.map(|(corner, u, v)| Shape::Rectangle(corner, u, v)));
}

/// Known surfaces, points on them and a view.
struct Scene {
    shapes: Vec<Shape>,
    positions: Vec<Vec3>,
    chunks: Arc<PointChunks>,
    view: View,
}

impl Scene {
    fn new(shapes: Vec<Shape>, points: usize, camera: Camera, (width, height): (usize, usize)) -> Self {
        let area: f32 = shapes.iter().map(Shape::area).sum();
        let mut random = Random(7);
        let mut positions = Vec::with_capacity(points);
        for shape in &shapes {
            for _ in 0..(shape.area() / area * points as f32) as usize {
                positions.push(shape.sample(&mut random));
            }
        }
        let spacing = (area / points as f32).sqrt();
        let colors: Vec<Vec3> = positions.iter().map(|p| (p.fract_gl() + 0.1) * 0.5).collect();
        let chunks = PointChunks::from_points(&positions, &colors, &[spacing]).expect("few points");
        Self { shapes, positions, chunks: Arc::new(chunks), view: View { camera, width, height, spacing } }
    }

    /// A closed room with boxes and a ball.
    fn room(points: usize, size: (usize, usize)) -> Self {
        let mut shapes = vec![Shape::Sphere(vec3(0.0, 0.6, -0.8), 0.4)];
        add_box(&mut shapes, vec3(-2.0, 0.0, -2.5), vec3(2.0, 2.8, 2.5));
        add_box(&mut shapes, vec3(-1.6, 0.0, -2.2), vec3(-0.7, 1.5, -1.3));
        add_box(&mut shapes, vec3(0.6, 0.0, -1.2), vec3(1.3, 0.7, -0.5));
        let camera = Camera { from: vec3(0.8, 1.5, 2.2), at: vec3(-0.2, 0.9, -1.0), fov_y: 60_f32.to_radians() };
        Self::new(shapes, points, camera, size)
    }

    /// Open ground with boards and a ball close by, and houses up to 60 m away: points are 30 pixels apart here and
    /// less than one there.
    fn street(points: usize, size: (usize, usize)) -> Self {
        let mut shapes = vec![
            Shape::Rectangle(vec3(-30.0, 0.0, -60.0), Vec3::X * 60.0, Vec3::Z * 66.0),
            Shape::Sphere(vec3(-0.3, 0.8, -2.5), 0.8),
        ];
        for i in 0..2 {
            let (x, step) = (-2.4 + 2.9 * i as f32, 0.5 * i as f32);
            add_box(&mut shapes, vec3(x, 0.0, step - 0.6), vec3(x + 1.3, 1.2 + step, step - 0.3));
        }
        for i in 0..9 {
            let (x, z) = (-24.0 + 6.0 * i as f32, -20.0 - 4.0 * (i * 5 % 7) as f32);
            add_box(&mut shapes, vec3(x, 0.0, z), vec3(x + 3.0, 4.0 + (i * 3 % 5) as f32, z + 3.0));
        }
        let camera = Camera { from: vec3(0.2, 1.6, 2.6), at: vec3(0.0, 1.3, -2.0), fov_y: 60_f32.to_radians() };
        Self::new(shapes, points, camera, size)
    }

    fn settings(&self) -> PointSettings {
        let (width, height) = (self.view.width as u32, self.view.height as u32);
        PointSettings { width, height, memory_budget: 1 << 30, ..PointSettings::default() }
    }

    fn renderer(&self, device: &Device, settings: PointSettings) -> PointRenderer {
        PointRenderer::new(&device.0, &self.chunks, settings).expect("a renderer")
    }

    /// Depth along the view and world normal of what a place in the image shows.
    fn cast(&self, place: Vec2) -> Option<(f32, Vec3)> {
        let direction = self.view.world_from_view(self.view.ray(place));
        let hits = self.shapes.iter().filter_map(|s| s.hit(self.view.camera.from, direction));
        hits.min_by(|a, b| a.0.total_cmp(&b.0))
    }

    fn centre(&self, pixel: usize) -> Vec2 {
        Vec2::new((pixel % self.view.width) as f32 + 0.5, (pixel / self.view.width) as f32 + 0.5)
    }

    /// Whether a pixel's point is visible; for one without a point, whether nothing is to be seen there. The point of a
    /// pixel lies anywhere in it, but is kept on the ray through the pixel's centre: its depth may differ from that of
    /// the surface there by what the surface does within a pixel.
    fn truth(&self, pixel: usize, point: [f32; 4]) -> bool {
        let centre = self.centre(pixel);
        if point[2] == 0.0 {
            return self.cast(centre).is_none();
        }
        let corners = [Vec2::ZERO, Vec2::new(-0.5, -0.5), Vec2::new(0.5, -0.5), Vec2::new(-0.5, 0.5), Vec2::splat(0.5)];
        corners.into_iter().filter_map(|side| self.cast(centre + side)).any(|(depth, _)| point[2] <= depth * 1.003)
    }
}

/// Share of pixels that a visibility mask has right.
fn right(scene: &Scene, renderer: &mut PointRenderer) -> f64 {
    renderer.classify(&scene.view.camera, &mut Profile::default()).expect("a mask");
    let points = renderer.images().points().expect("points");
    let mask = renderer.images().surface().expect("a mask");
    let ok = (0..mask.len()).filter(|&i| scene.truth(i, points[i]) == (mask[i][3] != 0.0)).count();
    ok as f64 / mask.len() as f64
}

#[test]
fn hidden_points_are_told_from_visible_ones_better_than_by_a_fixed_neighbourhood() {
    let device = Device::new();
    let size = (1248, 768);
    for (name, scene, bound) in
        [("room", Scene::room(1_000_000, size), 0.98), ("street", Scene::street(1_000_000, size), 0.97)]
    {
        let ours = right(&scene, &mut scene.renderer(&device, scene.settings()));
        assert!(ours >= bound, "{name}: {ours:.4} right");
        for radius in [15, 25] {
            let settings = PointSettings { hidden: HiddenPoints::Fixed(radius), ..scene.settings() };
            let fixed = right(&scene, &mut scene.renderer(&device, settings));
            println!("{name}: {ours:.4} of pixels right, {fixed:.4} with a radius of {radius} pixels");
            assert!(ours > fixed, "{name}: {ours:.4}, with a radius of {radius} {fixed:.4}");
        }
    }
}

#[test]
fn the_filled_surface_is_the_true_one() {
    let device = Device::new();
    let scene = Scene::room(1_000_000, (1248, 768));
    let frame = scene.renderer(&device, scene.settings()).render(&scene.view.camera).expect("a picture");
    let (mut near, mut covered, mut angles) = (0, 0, Vec::new());
    for (pixel, value) in frame.color_depth.iter().enumerate() {
        let Some((depth, normal)) = scene.cast(scene.centre(pixel)) else { continue };
        covered += 1;
        near += usize::from((value[3] / depth - 1.0).abs() <= 0.01);
        // Away from edges: what is seen a few pixels off has the same normal.
        let around = [Vec2::new(-6.0, 0.0), Vec2::new(6.0, 0.0), Vec2::new(0.0, -6.0), Vec2::new(0.0, 6.0)];
        if around.iter().all(|side| {
            scene.cast(scene.centre(pixel) + *side).is_some_and(|(_, other)| other.dot(normal).abs() > 0.98)
        }) {
            let [x, y, z, _] = frame.normal[pixel];
            angles.push(vec3(x, y, z).dot(normal).abs().min(1.0).acos().to_degrees());
        }
    }
    assert_eq!(covered, frame.color_depth.len(), "the room is closed");
    let share = near as f64 / covered as f64;
    angles.sort_by(f32::total_cmp);
    let (median, most) = (angles[angles.len() / 2], angles[angles.len() * 9 / 10]);
    println!(
        "{share:.4} of depths within 1 %; normals off by {median:.2} degrees in the median, nine tenths by {most:.2}"
    );
    assert!(share >= 0.98, "{share:.4} of depths within 1 %");
    assert!(median <= 10.0, "{median} degrees");
}

#[test]
fn both_geometry_passes_draw_the_same() {
    let device = Device::new();
    let scene = Scene::room(100_000, (200, 120));
    let draw = |geometry| {
        let settings = PointSettings { geometry: Some(geometry), display: PointDisplay::Raw, ..scene.settings() };
        scene.renderer(&device, settings).render(&scene.view.camera).expect("a picture").color_depth
    };
    let (raster, atomics) = (draw(PointGeometry::Raster), draw(PointGeometry::Atomics));
    // A rasteriser rounds places to parts of a pixel, so that points on a border may go either way, and depths a little
    // otherwise.
    let alike = |(a, b): &(&[f32; 4], &[f32; 4])| a[..3] == b[..3] && (a[3] - b[3]).abs() <= 1e-5 * a[3];
    let same = raster.iter().zip(&atomics).filter(alike).count();
    assert!(same as f64 >= 0.99 * raster.len() as f64, "{same} of {} pixels", raster.len());
    assert_eq!(atomics, draw(PointGeometry::Atomics), "the same bytes again");
}

#[test]
fn the_operators_do_what_the_plain_ones_do() {
    let device = Device::new();
    for (width, height) in [(161, 97), (64, 64), (1, 1), (3, 200)] {
        for scene in [Scene::room(60_000, (width, height)), Scene::street(60_000, (width, height))] {
            // A rasteriser would round places to parts of a pixel.
            let settings = PointSettings { geometry: Some(PointGeometry::Atomics), ..scene.settings() };
            let mut renderer = scene.renderer(&device, settings);
            renderer.classify(&scene.view.camera, &mut Profile::default()).expect("a mask");
            let expected = plain::project(&scene.positions, &scene.view);
            let points = renderer.images().points().expect("points");
            let differ = |a: Vec3, b: [f32; 4]| (a - vec3(b[0], b[1], b[2])).length() > 1e-4 * (1.0 + a.z);
            // Points on the border of two pixels may go either way.
            let off = expected.position.iter().zip(&points).filter(|(a, b)| differ(**a, **b)).count();
            assert!(off * 500 <= points.len(), "{width}x{height}: {off} points differ");
            // From the device's own points on, everything agrees.
            let mut finest = expected;
            for (position, point) in finest.position.iter_mut().zip(&points) {
                *position = vec3(point[0], point[1], point[2]);
            }
            let visible = plain::hidden_points(&plain::point_pyramid(finest), &scene.view);
            let mask = renderer.images().surface().expect("a mask");
            let off = visible.weight.iter().zip(&mask).filter(|(a, b)| **a != b[3]).count();
            assert!(off * 1000 <= mask.len(), "{width}x{height}: {off} of {} are classified otherwise", mask.len());
            let mut visible = visible;
            for (k, [x, y, z, weight]) in mask.into_iter().enumerate() {
                (visible.position[k], visible.weight[k]) = (vec3(x, y, z), weight);
            }
            let filled = plain::pull_push(visible);
            renderer.draw(&scene.view.camera, &mut Profile::default()).expect("a picture");
            let surface = renderer.images().surface().expect("a surface");
            for (k, value) in surface.into_iter().enumerate() {
                assert_eq!(filled[0].weight[k], value[3], "{width}x{height}: texel {k}");
                assert!(!differ(filled[0].position[k], value), "{width}x{height}: {k}: {value:?}");
            }
        }
    }
}

#[test]
fn a_cloud_larger_than_the_budget_is_drawn_in_parts_and_looks_the_same() {
    let device = Device::new();
    let scene = Scene::room(400_000, (160, 100));
    let whole = scene.renderer(&device, scene.settings()).render(&scene.view.camera).expect("a picture");
    let settings = PointSettings { memory_budget: 14 << 20, ..scene.settings() };
    let parts = scene.renderer(&device, settings).render(&scene.view.camera).expect("a picture");
    assert!(parts.profile.passes["points"].runs > whole.profile.passes["points"].runs);
    assert_eq!(parts.color_depth, whole.color_depth);
    let error = PointRenderer::new(&device.0, &scene.chunks, PointSettings { memory_budget: 8 << 20, ..settings });
    let message = error.err().expect("too small").to_string();
    assert!(message.contains("8 MiB") && message.contains("160x100"), "{message}");
}

#[test]
fn fewer_points_are_a_thinner_cloud_and_chunks_out_of_view_are_left_out() {
    let device = Device::new();
    let scene = Scene::room(400_000, (160, 100));
    let mut renderer = scene.renderer(&device, PointSettings { display: PointDisplay::Raw, ..scene.settings() });
    let covered = |frame: &PointFrame| frame.color_depth.iter().filter(|c| c[3] > 0.0).count();
    let all = renderer.render(&scene.view.camera).expect("a picture");
    assert!(all.drawn < scene.positions.len() as u64, "what lies behind the eye is left out");
    renderer.show(PointDisplay::Raw, Some(all.drawn / 10));
    let thin = renderer.render(&scene.view.camera).expect("a picture");
    assert!(thin.drawn.abs_diff(all.drawn / 10) < 20, "{} of {}", thin.drawn, all.drawn);
    assert!(covered(&thin) * 3 > covered(&all) / 4 && covered(&thin) < covered(&all));
    let away = Camera { from: vec3(0.0, 1.0, 9.0), at: vec3(0.0, 1.0, 20.0), ..scene.view.camera };
    let nothing = renderer.render(&away).expect("a picture");
    assert_eq!((nothing.drawn, covered(&nothing)), (0, 0));
}

#[test]
fn odd_clouds_and_views_give_pictures_without_nan() {
    let device = Device::new();
    let camera = Camera { from: Vec3::ZERO, at: Vec3::NEG_Z, fov_y: 1.0 };
    let clouds: [&[Vec3]; 5] = [
        &[],
        &[vec3(0.0, 0.0, -3.0)],
        &[vec3(0.0, 0.0, -1e9), vec3(1.0, 0.0, -1e9)],
        &[Vec3::ZERO; 3],
        &[vec3(0.0, 0.0, -1e-20), vec3(0.0, 0.0, 3.0), vec3(1e18, 1e18, -1e18)],
    ];
    for positions in clouds {
        let chunks = PointChunks::from_points(positions, &vec![Vec3::ONE; positions.len()], &[]).expect("few points");
        for display in PointDisplay::ALL {
            let settings = PointSettings { width: 33, height: 20, display, ..PointSettings::default() };
            let mut renderer = PointRenderer::new(&device.0, &Arc::new(chunks.clone()), settings).expect("a renderer");
            let frame = renderer.render(&camera).expect("a picture");
            assert!(frame.color_depth.iter().chain(&frame.normal).flatten().all(|v| v.is_finite()), "{positions:?}");
        }
    }
    let settings = PointSettings { spacing: Some(f32::NAN), ..PointSettings::default() };
    assert!(PointRenderer::new(&device.0, &Arc::new(PointChunks::default()), settings).is_err());
    let settings = PointSettings { width: 0, ..PointSettings::default() };
    assert!(PointRenderer::new(&device.0, &Arc::new(PointChunks::default()), settings).is_err());
}
