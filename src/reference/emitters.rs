//! Next event estimation: directions towards the emitting rectangles, even over the solid angle that each one fills
//! (Ureña, Fajardo and King, "An Area-Preserving Parametrization for Spherical Rectangles", 2013). Samples by area
//! would have no bound beside a lamp, where the squared distance goes to zero.

use std::f64::consts::TAU;

use glam::{DVec3, Vec2, Vec3};

use super::rooms::{Rectangle, Room};
use crate::compare::luminance;

/// Smaller solid angles than this drown in rounding and in any picture.
const LEAST_ANGLE: f64 = 1e-8;

/// The rectangles that emit.
pub(super) struct Emitters {
    surfaces: Vec<(usize, Rectangle)>,
}

/// The emitters that may light one receiver.
pub(super) struct Visible {
    normal: Vec3,
    emitters: Vec<VisibleEmitter>,
}

struct VisibleEmitter {
    surface: usize,
    /// The chance of being chosen; all of them sum to 1.
    share: f32,
    emission: Vec3,
    shape: SphericalRectangle,
}

/// Light from a point on an emitter.
pub(super) struct EmitterSample {
    /// Unit direction towards it.
    pub(super) direction: Vec3,
    /// Distance, metres.
    pub(super) distance: f32,
    /// Its radiance.
    pub(super) emission: Vec3,
    /// Probability density of the sample over solid angle.
    pub(super) density: f32,
}

impl Emitters {
    pub(super) fn new(room: &Room) -> Self {
        let emitting = room.surfaces.iter().enumerate().filter(|(_, r)| r.emission.max_element() > 0.0);
        Self { surfaces: emitting.map(|(surface, rectangle)| (surface, *rectangle)).collect() }
    }

    /// The emitters that face a receiver above its horizon, each with a share for its unoccluded light.
    pub(super) fn seen_from(&self, position: Vec3, normal: Vec3) -> Visible {
        let seen = |(surface, rectangle): &(usize, Rectangle)| {
            let faces = rectangle.edge_u.cross(rectangle.edge_v).dot(position - rectangle.corner) > 0.0;
            let above = rectangle.corners().iter().any(|&corner| normal.dot(corner - position) > 0.0);
            let shape = (faces && above).then(|| SphericalRectangle::new(rectangle, position))?;
            let share = luminance(rectangle.emission) * shape.solid_angle as f32;
            let visible = VisibleEmitter { surface: *surface, share, emission: rectangle.emission, shape };
            (visible.shape.solid_angle > LEAST_ANGLE).then_some(visible)
        };
        let mut emitters: Vec<_> = self.surfaces.iter().filter_map(seen).collect();
        let total: f32 = emitters.iter().map(|emitter| emitter.share).sum();
        emitters.iter_mut().for_each(|emitter| emitter.share /= total);
        Visible { normal, emitters }
    }
}

impl VisibleEmitter {
    fn density(&self) -> f32 {
        (1.0 / self.shape.solid_angle) as f32
    }

    /// A sample of this emitter alone.
    fn sample(&self, square: Vec2) -> EmitterSample {
        let (direction, distance) = self.shape.sample(square).as_vec3().normalize_and_length();
        EmitterSample { direction, distance, emission: self.emission, density: self.density() }
    }
}

impl Visible {
    /// `pick` in [0, 1) chooses the emitter by its share and `square` a direction to it. None where nothing can arrive.
    pub(super) fn sample(&self, pick: f32, square: Vec2) -> Option<EmitterSample> {
        let mut sum = 0.0;
        let chosen = self.emitters.iter().find(|emitter| {
            sum += emitter.share;
            pick < sum
        });
        // rounding may leave the sum just below 1 and `pick` above it
        let emitter = chosen.or(self.emitters.last())?;
        let sample = emitter.sample(square);
        Some(EmitterSample { density: sample.density * emitter.share, ..sample })
    }

    /// The density with which [`Visible::sample`] finds a direction that ends on `surface`.
    pub(super) fn density(&self, surface: usize) -> f32 {
        let emitter = self.emitters.iter().find(|emitter| emitter.surface == surface);
        emitter.map_or(0.0, |emitter| emitter.share * emitter.density())
    }

    /// Direct irradiance: about `samples` shared among the emitters, at least one each. `square` gives the n-th point
    /// of an even sequence; `unobstructed` answers for a direction and distance.
    pub(super) fn irradiance(
        &self,
        samples: u32,
        square: impl Fn(u32) -> Vec2,
        unobstructed: impl Fn(Vec3, f32) -> bool,
    ) -> Vec3 {
        let mut irradiance = Vec3::ZERO;
        for emitter in &self.emitters {
            let count = (emitter.share * samples as f32).ceil().max(1.0) as u32;
            let mut cosines = 0.0;
            for sample in (0..count).map(|n| emitter.sample(square(n))) {
                let cosine = self.normal.dot(sample.direction);
                if cosine > 0.0 && unobstructed(sample.direction, sample.distance) {
                    cosines += cosine;
                }
            }
            irradiance += emitter.emission * (cosines / (emitter.density() * count as f32));
        }
        irradiance
    }
}

/// A rectangle as seen from a point, in a frame with the point at 0 and the rectangle at z = `z`, below 0. In f64: the
/// solid angle is what four angles leave over a full turn.
struct SphericalRectangle {
    axes: [DVec3; 3],
    x: [f64; 2],
    y: [f64; 2],
    z: f64,
    /// z of the normals of the planes through the point and the edges at y0 and y1.
    b: [f64; 2],
    k: f64,
    solid_angle: f64,
}

impl SphericalRectangle {
    fn new(rectangle: &Rectangle, position: Vec3) -> Self {
        let (u, v) = (rectangle.edge_u.as_dvec3(), rectangle.edge_v.as_dvec3());
        let (length_u, length_v) = (u.length(), v.length());
        let (x_axis, y_axis) = (u / length_u, v / length_v);
        let to_corner = rectangle.corner.as_dvec3() - position.as_dvec3();
        let height = to_corner.dot(x_axis.cross(y_axis));
        // flip z so that the rectangle lies on its negative side
        let z_axis = x_axis.cross(y_axis) * if height > 0.0 { -1.0 } else { 1.0 };
        let (x0, y0, z) = (to_corner.dot(x_axis), to_corner.dot(y_axis), -height.abs());
        let (x1, y1) = (x0 + length_u, y0 + length_v);

        let corner = |x: f64, y: f64| DVec3::new(x, y, z);
        let corners = [corner(x0, y0), corner(x1, y0), corner(x1, y1), corner(x0, y1)];
        let plane = |n: usize| corners[n].cross(corners[(n + 1) % 4]).normalize_or_zero();
        let planes = [plane(0), plane(1), plane(2), plane(3)];
        // inner angles of the spherical quadrilateral
        let angle = |n: usize| (-planes[n].dot(planes[(n + 1) % 4])).clamp(-1.0, 1.0).acos();
        let k = TAU - angle(2) - angle(3);
        Self {
            axes: [x_axis, y_axis, z_axis],
            x: [x0, x1],
            y: [y0, y1],
            z,
            b: [planes[0].z, planes[2].z],
            k,
            solid_angle: angle(0) + angle(1) - k,
        }
    }

    /// A point of the unit square to a vector from the position to the rectangle.
    fn sample(&self, square: Vec2) -> DVec3 {
        let ([x0, x1], [y0, y1], z) = (self.x, self.y, self.z);
        // the vertical line that cuts off the fraction square.x of the solid angle
        let (sin, cos) = (f64::from(square.x) * self.solid_angle + self.k).sin_cos();
        let f = (cos * self.b[0] - self.b[1]) / sin;
        let c = (f * f + self.b[0] * self.b[0]).sqrt().recip().copysign(f).clamp(-1.0, 1.0);
        let x = (-c * z / (1.0 - c * c).sqrt()).clamp(x0, x1);
        // along that line heights on the sphere are uniform (Archimedes)
        let squared = x * x + z * z;
        let height = |y: f64| y / (squared + y * y).sqrt();
        let h = height(y0) + f64::from(square.y) * (height(y1) - height(y0));
        let y = (h * (squared / (1.0 - h * h)).sqrt()).clamp(y0, y1);
        self.axes[0] * x + self.axes[1] * y + self.axes[2] * z
    }
}
