//! What the surfaces of a scan are made of (Preiner 2010, 4.1): scans carry no material, so that one is chosen for all of
//! them, or by colour.

use std::fmt;
use std::str::FromStr;

use glam::Vec3;

/// How surfaces reflect.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Surfaces {
    /// Share of the albedo that is reflected diffusely, 0 to 1.
    pub diffuse: f32,
    /// Share of the light that is reflected around the mirror's direction, 0 to 1.
    pub specular: f32,
    /// Exponent of that lobe (Phong), 1 to 10,000.
    pub shininess: f32,
}

impl Default for Surfaces {
    fn default() -> Self {
        Self { diffuse: 1.0, specular: 0.0, shininess: 32.0 }
    }
}

impl Surfaces {
    /// The first thing that makes no sense.
    ///
    /// # Errors
    /// A line about it.
    pub fn check(&self) -> Result<(), String> {
        let Self { diffuse, specular, shininess } = *self;
        let share = |value: f32| (0.0..=1.0).contains(&value);
        if !(share(diffuse) && share(specular) && diffuse + specular <= 1.0) {
            return Err(format!(
                "diffuse {diffuse} and specular {specular} reflect more light than comes, or less than none"
            ));
        }
        if !(1.0..=10_000.0).contains(&shininess) {
            return Err(format!("a shininess of {shininess}; it is 1 to 10000"));
        }
        Ok(())
    }
}

/// Surfaces of the colours in a range.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Brush {
    /// Least of each channel, linear Rec. 709.
    pub from: Vec3,
    /// Most of each channel.
    pub to: Vec3,
    /// What they are made of.
    pub surfaces: Surfaces,
}

/// As `--surfaces` takes it.
impl fmt::Display for Surfaces {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "diffuse={} specular={} shininess={}", self.diffuse, self.specular, self.shininess)
    }
}

/// `[diffuse=D] [specular=S] [shininess=N]`; what is left out is the default.
impl FromStr for Surfaces {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let mut surfaces = Self::default();
        for word in text.split_whitespace() {
            surfaces.set(word)?;
        }
        surfaces.check().map(|()| surfaces)
    }
}

impl Surfaces {
    /// Takes one `KEY=VALUE`.
    fn set(&mut self, word: &str) -> Result<(), String> {
        let (key, value) = word.split_once('=').ok_or_else(|| format!("{word:?} is not KEY=VALUE"))?;
        let own = match key {
            "diffuse" => &mut self.diffuse,
            "specular" => &mut self.specular,
            "shininess" => &mut self.shininess,
            _ => return Err(format!("surfaces have no {key:?}; they have diffuse, specular and shininess")),
        };
        *own = value.parse().map_err(|_| format!("{word}: not a number"))?;
        Ok(())
    }
}

/// As `--brush` takes it.
impl fmt::Display for Brush {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [from, to] = [self.from, self.to].map(|v| format!("{},{},{}", v.x, v.y, v.z));
        write!(f, "from={from} to={to} {}", self.surfaces)
    }
}

/// `from=R,G,B to=R,G,B` and what [`Surfaces`] have.
impl FromStr for Brush {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (mut range, mut surfaces) = ([None; 2], Surfaces::default());
        for word in text.split_whitespace() {
            let own = match word.split_once('=') {
                Some(("from", value)) => Some((0, value)),
                Some(("to", value)) => Some((1, value)),
                _ => None,
            };
            let Some((end, value)) = own else {
                surfaces.set(word)?;
                continue;
            };
            let numbers: Option<Vec<f32>> = value.split(',').map(|part| part.parse().ok()).collect();
            let color = numbers.and_then(|numbers| <[f32; 3]>::try_from(numbers).ok());
            range[end] = Some(Vec3::from(color.ok_or_else(|| format!("{word}: not R,G,B"))?));
        }
        let [Some(from), Some(to)] = range else {
            return Err(format!("brush {text:?} needs from=R,G,B and to=R,G,B"));
        };
        let brush = Self { from, to, surfaces };
        Self::check_all(&[brush]).map(|()| brush)
    }
}

impl Brush {
    /// Most of them: shaders ask one after the other.
    pub const MOST: usize = 8;

    /// Whether it is about surfaces of this colour.
    pub fn fits(&self, color: Vec3) -> bool {
        color.cmpge(self.from).all() && color.cmple(self.to).all()
    }

    /// The first thing that makes no sense about these, of which the first that fits a colour wins.
    ///
    /// # Errors
    /// A line about it.
    pub fn check_all(brushes: &[Self]) -> Result<(), String> {
        if brushes.len() > Self::MOST {
            return Err(format!("{} brushes; at most {}", brushes.len(), Self::MOST));
        }
        for (brush, number) in brushes.iter().zip(1..) {
            if !brush.from.cmple(brush.to).all() {
                return Err(format!("brush {number}: no colour is between {} and {}", brush.from, brush.to));
            }
            brush.surfaces.check().map_err(|problem| format!("brush {number}: {problem}"))?;
        }
        Ok(())
    }
}

/// Where the albedo of a point comes from.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum AlbedoFrom {
    /// Its colour, at most 1: that of a scan under even light.
    #[default]
    Colour,
    /// The same for all channels of all points, above 0 and at most 1, whatever light is baked into their colours.
    Constant(f32),
}

impl AlbedoFrom {
    /// Whether it makes sense.
    ///
    /// # Errors
    /// A line about what does not.
    pub fn check(&self) -> Result<(), String> {
        match *self {
            Self::Constant(albedo) if !(albedo > 0.0 && albedo <= 1.0) => {
                Err(format!("an albedo of {albedo}; it is above 0 and at most 1"))
            }
            _ => Ok(()),
        }
    }
}

impl fmt::Display for AlbedoFrom {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Colour => write!(f, "colour"),
            Self::Constant(albedo) => write!(f, "constant:{albedo}"),
        }
    }
}

/// `colour` or `constant:V`.
impl FromStr for AlbedoFrom {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let unknown = || format!("{text:?} is no albedo: colour or constant:V, V above 0 and at most 1");
        let albedo = match text.split_once(':') {
            None if text == "colour" => Self::Colour,
            Some(("constant", value)) => Self::Constant(value.parse().map_err(|_| unknown())?),
            _ => return Err(unknown()),
        };
        albedo.check().map(|()| albedo)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn albedos_are_read_and_written() {
        for text in ["colour", "constant:0.5", "constant:1"] {
            assert_eq!(text.parse::<AlbedoFrom>().expect(text).to_string(), text);
        }
        for text in ["", "color", "constant", "constant:", "constant:0", "constant:1.1", "constant:NaN", "colour:1"] {
            let message = text.parse::<AlbedoFrom>().expect_err(text);
            assert!(message.contains("albedo") && !message.contains('\n'), "{text}: {message}");
        }
    }

    #[test]
    fn brushes_are_inclusive_and_checked() {
        let surfaces = Surfaces { diffuse: 0.2, specular: 0.7, shininess: 100.0 };
        let brush = Brush { from: Vec3::splat(0.25), to: Vec3::new(0.5, 0.5, 1.0), surfaces };
        assert!(brush.fits(brush.from) && brush.fits(brush.to) && !brush.fits(Vec3::splat(0.6)));
        assert_eq!(Brush::check_all(&[brush; Brush::MOST]), Ok(()));
        for (brushes, word) in [
            (vec![brush; 9], "9 brushes"),
            (vec![brush, Brush { from: Vec3::ONE, to: Vec3::ZERO, ..brush }], "brush 2"),
            (vec![Brush { from: Vec3::NAN, ..brush }], "no colour"),
            (vec![Brush { surfaces: Surfaces { diffuse: 0.5, ..surfaces }, ..brush }], "more light"),
            (vec![Brush { surfaces: Surfaces { shininess: 0.0, ..surfaces }, ..brush }], "shininess of 0"),
        ] {
            let message = Brush::check_all(&brushes).expect_err(word);
            assert!(message.contains(word) && !message.contains('\n'), "{message}");
        }
    }

    #[test]
    fn surfaces_and_brushes_are_read_and_written() {
        for text in ["from=0,0,0 to=1,0.5,0.25 diffuse=0.1 specular=0.9 shininess=300", "from=0.1,0,0 to=9,9,9"] {
            let brush: Brush = text.parse().expect("a brush");
            assert_eq!(brush.to_string().parse(), Ok(brush));
            assert_eq!(brush.surfaces.to_string().parse(), Ok(brush.surfaces));
        }
        for (text, word) in [
            ("from=0,0,0", "needs from"),
            ("from=0,0 to=1,1,1", "not R,G,B"),
            ("from=1,1,1 to=0,0,0", "no colour is between"),
            ("from=0,0,0 to=1,1,1 diffuse=0.9 specular=0.2", "more light"),
            ("from=0,0,0 to=1,1,1 shininess=x", "not a number"),
            ("from=0,0,0 to=1,1,1 gloss=1", "no \"gloss\""),
            ("from=0,0,0 to=1,1,1 shiny", "KEY=VALUE"),
        ] {
            let message = text.parse::<Brush>().expect_err(text);
            assert!(message.contains(word) && !message.contains('\n'), "{message}");
        }
    }
}
