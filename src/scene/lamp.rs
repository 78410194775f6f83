//! Lamps that are not in the scan (Preiner 2010; its section 6 for what is no spot).
//!
//! Everything is in the relative units of the cloud: a white diffuse surface with an irradiance of pi W/m^2 in a channel
//! has the radiance 1, the white of an 8-bit cloud. A lamp's power is what it emits in a channel where its colour is 1.
//!
//! | kind | radiant intensity or irradiance, a channel |
//! | --- | --- |
//! | spot | I = power * colour / (2 pi (1 - cos(angle / 2))) W/sr within its cone, nothing outside; E = I cos / distance^2 |
//! | point | I = power * colour / (4 pi) W/sr everywhere; E = I cos / distance^2 |
//! | sun | E = power * colour * cos; its power is in W/m^2 across its light |

use std::f32::consts::TAU;
use std::fmt;
use std::str::FromStr;

use glam::{DVec3, Vec3};

/// What sends the light out, and where to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum LampKind {
    /// A cone from a point, alike in all directions within it.
    Spot {
        /// The point, metres.
        at: DVec3,
        /// Another point on the cone's axis, metres.
        to: DVec3,
        /// From rim to rim, degrees, one of [`Lamp::DEGREES`].
        degrees: f32,
    },
    /// A point that shines alike in all directions.
    Point {
        /// The point, metres.
        at: DVec3,
    },
    /// Parallel light.
    Sun {
        /// The way that the light goes, of any length.
        direction: DVec3,
    },
}

/// A lamp, in the coordinates of a scan's file or, after [`Lamp::relative_to`], in those that it is kept in.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lamp {
    /// Shape and place.
    pub kind: LampKind,
    /// Watts; watts a square metre for a sun.
    pub power: f32,
    /// Share of the power that each channel gets, linear Rec. 709.
    pub color: Vec3,
}

/// What arrives at a place from a lamp if nothing is between them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Incident {
    /// Unit direction towards the lamp.
    pub towards: Vec3,
    /// Distance to it, metres; infinite for a sun.
    pub distance: f32,
    /// Irradiance across the light, which a surface's cosine scales.
    pub irradiance: Vec3,
}

impl Lamp {
    /// Cones that a spot can have, degrees from rim to rim: a wider one is what point lamps are for.
    pub const DEGREES: std::ops::RangeInclusive<f32> = 0.1..=170.0;

    /// Radiant intensity of spots and points within their light, W/sr; irradiance across the light of a sun, W/m^2.
    pub fn strength(&self) -> Vec3 {
        let per = match self.kind {
            LampKind::Spot { .. } => TAU * (1.0 - self.half_angle().cos()),
            LampKind::Point { .. } => 2.0 * TAU,
            LampKind::Sun { .. } => 1.0,
        };
        self.color * (self.power / per)
    }

    /// The same lamp in coordinates from which `origin` was subtracted.
    pub fn relative_to(mut self, origin: DVec3) -> Self {
        match &mut self.kind {
            LampKind::Spot { at, to, .. } => {
                *at -= origin;
                *to -= origin;
            }
            LampKind::Point { at } => *at -= origin,
            LampKind::Sun { .. } => {}
        }
        self
    }

    /// Where it is; `None` for a sun.
    pub fn place(&self) -> Option<DVec3> {
        match self.kind {
            LampKind::Spot { at, .. } | LampKind::Point { at } => Some(at),
            LampKind::Sun { .. } => None,
        }
    }

    /// Unit direction of a spot's axis and of a sun's light; a point has none.
    pub fn direction(&self) -> Vec3 {
        match self.kind {
            LampKind::Spot { at, to, .. } => (to - at).normalize_or_zero().as_vec3(),
            LampKind::Sun { direction } => direction.normalize_or_zero().as_vec3(),
            LampKind::Point { .. } => Vec3::ZERO,
        }
    }

    /// Between a spot's axis and its rim, radians; pi for what has no rim.
    pub fn half_angle(&self) -> f32 {
        match self.kind {
            LampKind::Spot { degrees, .. } => 0.5 * degrees.to_radians(),
            LampKind::Point { .. } | LampKind::Sun { .. } => std::f32::consts::PI,
        }
    }

    /// What is wrong with it, if it is no lamp that could shine.
    ///
    /// # Errors
    /// A line about it.
    pub fn check(&self) -> Result<(), String> {
        let places = match self.kind {
            LampKind::Spot { at, to, .. } => [at, to],
            LampKind::Point { at } => [at, at],
            LampKind::Sun { direction } => [direction, direction],
        };
        if !places.into_iter().all(|place| place.is_finite() && place.abs().max_element() <= LARGEST) {
            return Err(format!("lamp: a place beyond {LARGEST:e} metres"));
        }
        match self.kind {
            LampKind::Spot { at, to, .. } if (to - at).try_normalize().is_none() => {
                return Err("lamp: at and to are the same place".into());
            }
            LampKind::Spot { degrees, .. } if !Self::DEGREES.contains(&degrees) => {
                let (least, most) = (Self::DEGREES.start(), Self::DEGREES.end());
                return Err(format!("lamp: an angle of {degrees} degrees; a spot's is {least} to {most}"));
            }
            LampKind::Sun { direction } if direction.try_normalize().is_none() => {
                return Err("lamp: a direction of length 0".into());
            }
            _ => {}
        }
        if !(self.power > 0.0 && f64::from(self.power) <= LARGEST) {
            return Err(format!("lamp: a power of {}; it is above 0 and at most {LARGEST:e}", self.power));
        }
        if !(self.color.min_element() >= 0.0 && self.color.max_element() > 0.0 && self.color.is_finite()) {
            return Err("lamp: a color is not negative, and above 0 in some channel".into());
        }
        Ok(())
    }

    /// Light at a place; `None` where none goes.
    pub fn incident(&self, position: Vec3) -> Option<Incident> {
        let from = |at: DVec3| {
            let (towards, distance) = (at.as_vec3() - position).normalize_and_length();
            let irradiance = self.strength() / (distance * distance);
            irradiance.is_finite().then_some(Incident { towards, distance, irradiance })
        };
        match self.kind {
            LampKind::Spot { at, .. } => {
                let (direction, cosine) = (self.direction(), self.half_angle().cos());
                from(at).filter(|incident| -incident.towards.dot(direction) >= cosine)
            }
            LampKind::Point { at } => from(at),
            LampKind::Sun { .. } => {
                Some(Incident { towards: -self.direction(), distance: f32::INFINITY, irradiance: self.strength() })
            }
        }
    }
}

/// As `--lamp` takes it.
impl fmt::Display for Lamp {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let place = |v: DVec3| format!("{},{},{}", v.x, v.y, v.z);
        match self.kind {
            LampKind::Spot { at, to, degrees } => write!(f, "spot at={} to={} angle={degrees}", place(at), place(to))?,
            LampKind::Point { at } => write!(f, "point at={}", place(at))?,
            LampKind::Sun { direction } => write!(f, "sun direction={}", place(direction))?,
        }
        write!(f, " power={} color={}", self.power, place(self.color.as_dvec3()))
    }
}

/// `spot at=X,Y,Z to=X,Y,Z power=W angle=DEG [color=R,G,B]`, `point at=X,Y,Z power=W [color=R,G,B]` or
/// `sun direction=X,Y,Z power=W [color=R,G,B]`; the angle is a spot's whole cone, from rim to rim.
impl FromStr for Lamp {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let mut words = text.split_whitespace();
        let kind = words.next().unwrap_or_default();
        let known: &[&str] = match kind {
            "spot" => &["at", "to", "angle", "power", "color"],
            "point" => &["at", "power", "color"],
            "sun" => &["direction", "power", "color"],
            _ => return Err(format!("{text:?} is no lamp: it begins with spot, point or sun")),
        };
        let mut values: Vec<(&str, &str)> = Vec::new();
        for word in words {
            let (key, value) = word.split_once('=').ok_or_else(|| format!("lamp: {word:?} is not KEY=VALUE"))?;
            if !known.contains(&key) {
                return Err(format!("lamp: a {kind} has no {key:?}; it has {}", known.join(", ")));
            }
            if values.iter().any(|(other, _)| *other == key) {
                return Err(format!("lamp: {key} is given twice"));
            }
            values.push((key, value));
        }
        let find = |key: &str| values.iter().find(|(known, _)| *known == key).map(|(_, value)| *value);
        let need = |key: &str| find(key).ok_or_else(|| format!("lamp: a {kind} needs {key}="));
        let place = |key: &str| need(key).and_then(|value| vector(key, value));
        let kind = match kind {
            "spot" => {
                let degrees = number("angle", need("angle")?)? as f32;
                LampKind::Spot { at: place("at")?, to: place("to")?, degrees }
            }
            "point" => LampKind::Point { at: place("at")? },
            _ => LampKind::Sun { direction: place("direction")? },
        };
        let power = number("power", need("power")?)? as f32;
        let color = find("color").map_or(Ok(DVec3::ONE), |value| vector("color", value))?.as_vec3();
        let lamp = Self { kind, power, color };
        lamp.check()?;
        Ok(lamp)
    }
}

/// Powers and coordinates beyond this leave no room for their squares.
const LARGEST: f64 = 1e12;

fn number(key: &str, text: &str) -> Result<f64, String> {
    let number = text.parse().ok().filter(|n: &f64| n.abs() <= LARGEST);
    number.ok_or_else(|| format!("lamp: {key}={text} is not a number"))
}

fn vector(key: &str, text: &str) -> Result<DVec3, String> {
    let numbers: Option<Vec<f64>> =
        text.split(',').map(|part| part.parse().ok().filter(|n: &f64| n.abs() <= LARGEST)).collect();
    let vector = numbers.and_then(|numbers| <[f64; 3]>::try_from(numbers).ok());
    vector.map(DVec3::from).ok_or_else(|| format!("lamp: {key}={text} is not three numbers with commas between them"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::vec3;

    fn lamp(text: &str) -> Lamp {
        text.parse().expect("a lamp")
    }

    #[test]
    fn lamps_are_read_and_written() {
        let spot = lamp("spot at=0,2,0 to=0,0,0 power=10 angle=60");
        assert_eq!((spot.place(), spot.direction()), (Some(DVec3::Y * 2.0), Vec3::NEG_Y));
        assert!((spot.half_angle().to_degrees() - 30.0).abs() < 1e-5 && spot.color == Vec3::ONE);
        for text in [
            "spot at=0.1,2,3 to=1,0.30000000000000004,-4e6 angle=90.1 power=5 color=1,0.5,0",
            "point at=1,2,3 power=0.1 color=1,1,0.3",
            "sun direction=0,-2,1e-7 power=3 color=1,1,1",
        ] {
            assert_eq!(lamp(&lamp(text).to_string()), lamp(text));
        }
        assert_eq!(lamp("sun direction=0,-2,0 power=3").direction(), Vec3::NEG_Y);
        let far = lamp("spot at=500000.25,2,0 to=500000.25,0,0 power=10 angle=60").relative_to(DVec3::X * 5e5);
        assert!(far.incident(vec3(0.25, 0.0, 0.0)).is_some_and(|light| light.distance == 2.0));
    }

    #[test]
    fn what_is_no_lamp_says_why_on_one_line() {
        let spot = "spot at=0,0,0 to=0,0,1 power=1";
        for (text, word) in [
            (String::new(), "begins with"),
            ("lantern at=0,0,0".into(), "begins with"),
            (spot.into(), "needs angle"),
            (format!("{spot} angle=0"), "0.1 to 170"),
            (format!("{spot} angle=180"), "0.1 to 170"),
            (format!("{spot} angle=NaN"), "not a number"),
            (format!("{spot} angle=30 warmth=3"), "no \"warmth\""),
            (format!("{spot} angle=30 power=2"), "given twice"),
            (format!("{spot} angle=30 color=1,2"), "three numbers"),
            (format!("{spot} angle=30 color=0,0,0"), "color"),
            (format!("{spot} angle=30 bright"), "KEY=VALUE"),
            ("spot at=1,1,1 to=1,1,1 power=1 angle=30".into(), "same place"),
            ("point at=0,0,0 power=0".into(), "power of 0"),
            ("point at=0,0,0 power=-2".into(), "power of -2"),
            ("point at=0,0,0 power=inf".into(), "not a number"),
            ("point power=1".into(), "needs at"),
            ("sun direction=0,0,0 power=1".into(), "length 0"),
            ("sun at=0,0,0 power=1".into(), "no \"at\""),
        ] {
            let message = text.parse::<Lamp>().expect_err(&text);
            assert!(message.contains(word) && !message.contains('\n'), "{text}: {message}");
        }
    }

    #[test]
    fn a_spot_lights_a_plane_by_inverse_square_and_cosine() {
        let spot = lamp("spot at=0,2,0 to=0,0,0 power=10 angle=60");
        // 10 W in a cap of 2 pi (1 - cos 30 degrees).
        let intensity = 10.0 / (TAU * (1.0 - 0.75_f32.sqrt()));
        let below = spot.incident(Vec3::ZERO).expect("light");
        assert!((below.irradiance.x - intensity / 4.0).abs() < 1e-4 && below.distance == 2.0);
        let aside = spot.incident(vec3(1.0, 0.0, 0.0)).expect("light");
        let cosine = aside.towards.y;
        assert!((aside.irradiance.y * cosine - intensity / 5.0 * 2.0 / 5.0_f32.sqrt()).abs() < 1e-4);
        assert_eq!(spot.incident(vec3(1.2, 0.0, 0.0)), None, "outside the cone");
        assert_eq!(spot.incident(vec3(0.0, 3.0, 0.0)), None, "behind");
        assert_eq!(spot.incident(vec3(0.0, 2.0, 0.0)), None, "at the lamp itself");
    }

    #[test]
    fn the_power_is_what_arrives_all_around() {
        // Over a grid of directions: intensity times solid angle.
        for text in ["spot at=0,0,0 to=1,0,0 power=7 angle=100 color=1,0.5,0", "point at=0,0,0 power=7 color=1,0.5,0"] {
            let lamp = lamp(text);
            let mut sum = Vec3::ZERO;
            let count = 400;
            for i in 0..count {
                for k in 0..count {
                    let z = 2.0 * (i as f32 + 0.5) / count as f32 - 1.0;
                    let (sin, cos) = (TAU * k as f32 / count as f32).sin_cos();
                    let across = (1.0 - z * z).sqrt();
                    let place = vec3(across * cos, across * sin, z) * 3.0;
                    let solid = 2.0 * TAU / (count * count) as f32;
                    sum += lamp.incident(place).map_or(Vec3::ZERO, |light| light.irradiance) * (9.0 * solid);
                }
            }
            assert!(sum.abs_diff_eq(vec3(7.0, 3.5, 0.0), 0.03), "{text}: {sum}");
        }
    }
}
