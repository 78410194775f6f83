//! The report of an expansion: one HTML page with its pictures beside it.

use std::fmt::Write as _;
use std::io::Write as _;
use std::path::Path;

use glam::Vec3;
use image::RgbaImage;

use crate::compare::{self, Axis, Plot, Series, luminance, to_srgb8};
use crate::formats::image::write_png;
use crate::formats::whole;
use crate::preprocess::expansion::{Expansion, Inputs, Options, Origin, ShotPictures, Transfer};
use crate::scene::Picture;
use crate::{Error, Result};

/// HDR pictures are also shown this many stops darker, so that lights differ.
const DARKER: f32 = -4.0;
/// Stops at which the map of what was gained ends.
const MOST_STOPS: f32 = 8.0;
/// Longer side of the photo on the page, pixels.
const PHOTO_SIDE: u32 = 960;

/// Writes `index.html` and its pictures into a folder, which is made where it is missing.
pub(super) fn write(
    folder: &Path,
    inputs: Inputs,
    options: &Options,
    expansion: &Expansion,
    seconds: f64,
) -> Result<()> {
    std::fs::create_dir_all(folder).map_err(|e| Error::file(folder, format!("cannot be made: {e}")))?;
    let mut page = Page { folder, body: String::new() };
    page.line("<h1>Expansion of the dynamic range</h1>")?;
    for warning in &expansion.report.warnings {
        page.line(&format!("<p class=\"warning\">{}</p>", escaped(warning)))?;
    }
    page.numbers(options, expansion, seconds)?;
    if let (Some(photo), Some(alpha)) = (inputs.photo, expansion.report.alpha) {
        page.photo(photo, alpha, expansion)?;
    }
    for (index, (shot, eye)) in expansion.pictures.iter().zip(&expansion.report.shots).enumerate() {
        page.shot(index, shot, *eye, inputs, options, expansion)?;
    }
    page.finish()
}

struct Page<'a> {
    folder: &'a Path,
    body: String,
}

impl Page<'_> {
    fn line(&mut self, text: &str) -> Result<()> {
        writeln!(self.body, "{text}").map_err(|e| Error::Argument(e.to_string()))
    }

    fn picture(&mut self, name: &str, image: &RgbaImage, caption: &str) -> Result<()> {
        write_png(&self.folder.join(name), image.width(), image.height(), image.as_raw())?;
        let caption = escaped(caption);
        self.line(&format!("<figure><img src=\"{name}\" alt=\"{caption}\"><figcaption>{caption}</figcaption></figure>"))
    }

    fn table(&mut self, rows: &[(String, String)]) -> Result<()> {
        self.line("<table>")?;
        for (name, value) in rows {
            self.line(&format!("<tr><th>{}</th><td>{}</td></tr>", escaped(name), escaped(value)))?;
        }
        self.line("</table>")
    }

    fn numbers(&mut self, options: &Options, expansion: &Expansion, seconds: f64) -> Result<()> {
        let report = &expansion.report;
        let of_over =
            |part: usize| format!("{part} ({:.1} %)", 100.0 * part as f64 / report.over_exposed.max(1) as f64);
        let transfer =
            if options.transfer == Transfer::Rgb && options.strategy.knows_colors() { "rgb" } else { "luminance" };
        let mut rows = vec![
            ("strategy".into(), format!("{}, transfer {transfer}", options.strategy.name())),
            ("points".into(), report.points.to_string()),
            (format!("over-exposed (luminance above {})", options.threshold), report.over_exposed.to_string()),
            ("of these seen in no shot".into(), of_over(report.unseen)),
            ("seen, but without a match that is good enough".into(), of_over(report.unmatched)),
            ("projected".into(), of_over(expansion.origins.iter().filter(|o| **o == Origin::Projected).count())),
            ("solved from their neighbours".into(), of_over(report.solved)),
            ("left as they were: nothing known around them".into(), of_over(report.filled)),
        ];
        if report.solved > 0 {
            rows.push(("solver".into(), format!("{} iterations, residual {:.1e}", report.iterations, report.residual)));
        }
        if let Some(cost) = report.median_cost {
            rows.push(("median cost of matches".into(), format!("{cost:.3} (limit {})", options.match_threshold)));
            rows.push(("patches compared".into(), report.compared.to_string()));
        }
        self.table(&rows)?;
        self.line("<h2>Time</h2>")?;
        let mut times: Vec<(String, String)> =
            report.seconds.iter().map(|(step, s)| ((*step).to_owned(), format!("{s:.2} s"))).collect();
        times.push(("in all, before this page".into(), format!("{seconds:.2} s")));
        self.table(&times)
    }

    fn photo(&mut self, photo: &Picture, alpha: f32, expansion: &Expansion) -> Result<()> {
        self.line("<h2>Exposure</h2>")?;
        if let Some(exposure) = &expansion.report.exposure {
            let mut rows = vec![
                ("by histograms".into(), format!("{:.4} (distance {:.5})", exposure.alpha, exposure.distance)),
                ("used".into(), format!("{alpha:.4}, {:+.1} % of it", 100.0 * (alpha / exposure.alpha - 1.0))),
            ];
            match &expansion.report.registration {
                Some(found) => rows.push((
                    "the photo in the cloud".into(),
                    format!(
                        "from {:.2}, {:.2}, {:.2}, field of view {:.1} degrees; {:.0} % of it agrees",
                        found.eye.x,
                        found.eye.y,
                        found.eye.z,
                        found.fov_y.to_degrees(),
                        100.0 * found.agreement
                    ),
                )),
                None => rows.push(("the photo in the cloud".into(), "not found".into())),
            }
            self.table(&rows)?;
            let points = exposure.curve.iter().map(|&(alpha, d)| (f64::from(alpha), d)).collect();
            let plot = Plot {
                title: "Wasserstein distance of the luminance histograms".into(),
                x: Axis { title: "exposure alpha".into(), logarithmic: true },
                y: Axis { title: "distance".into(), logarithmic: false },
                series: vec![Series { name: "photo to cloud".into(), points }],
            };
            plot.write(&self.folder.join("exposure.svg"))?;
            self.line("<figure><img src=\"exposure.svg\" alt=\"distance over exposure\"></figure>")?;
        }
        let small = shrunk(photo, PHOTO_SIDE);
        let stops = alpha.log2();
        self.picture("photo.png", &srgb(&small, stops)?, "the photo at the cloud's exposure")?;
        let darker = format!("the same {} stops darker", -DARKER);
        self.picture("photo-dark.png", &srgb(&small, stops + DARKER)?, &darker)?;
        let place = |n: u32| {
            let (x, y) = ((n % small.width) as f32, (n / small.width) as f32);
            Vec3::new(x / small.width as f32, y / small.height as f32, 0.0)
        };
        let key = Picture { rgb: (0..small.width * small.height).map(place).collect(), ..small };
        if expansion.pictures.iter().any(|shot| shot.matched.is_some()) {
            self.picture("photo-key.png", &srgb(&key, 0.0)?, "colours that stand for places in the photo below")?;
        }
        Ok(())
    }

    fn shot(
        &mut self,
        index: usize,
        shot: &ShotPictures,
        eye: Vec3,
        inputs: Inputs,
        options: &Options,
        expansion: &Expansion,
    ) -> Result<()> {
        let number = index + 1;
        self.line(&format!("<h2>Shot {number}, from {:.2}, {:.2}, {:.2}</h2>", eye.x, eye.y, eye.z))?;
        self.line("<p>Faces +X, -X, +Y above; -Y, +Z, -Z below.</p>")?;
        let (width, height) = (shot.width, shot.height);
        let of_points = |color: &dyn Fn(usize) -> Vec3| {
            let of = |&point: &u32| {
                if (point as usize) < expansion.colors.len() { color(point as usize) } else { Vec3::ZERO }
            };
            Picture { width, height, rgb: shot.points.iter().map(of).collect() }
        };
        let before = &inputs.cloud.colors;
        let magenta = Vec3::new(1.0, 0.0, 1.0);
        let seen = of_points(&|n| if luminance(before[n]) > options.threshold { magenta } else { before[n] });
        self.picture(&format!("shot{number}.png"), &srgb(&seen, 0.0)?, "the cloud, over-exposed points in magenta")?;
        if let Some(matched) = &shot.matched {
            let caption = "where in the photo they were found (red: x, green: y), blue: cost";
            self.picture(&format!("shot{number}-matches.png"), &srgb(matched, 0.0)?, caption)?;
        }
        let darker = format!("expanded, {} stops darker", -DARKER);
        self.picture(&format!("shot{number}-expanded.png"), &srgb(&shot.expanded, DARKER)?, &darker)?;
        let after = of_points(&|n| expansion.colors[n]);
        let caption = format!("the expanded cloud, {} stops darker", -DARKER);
        self.picture(&format!("shot{number}-cloud.png"), &srgb(&after, DARKER)?, &caption)?;
        let gained = of_points(&|n| {
            let stops = (luminance(expansion.colors[n]) / luminance(before[n]).max(1e-6)).max(1e-6).log2();
            heat(stops / MOST_STOPS)
        });
        let caption = format!("what was gained: black 0 stops, white {MOST_STOPS}");
        self.picture(&format!("shot{number}-gained.png"), &srgb(&gained, 0.0)?, &caption)?;
        let origins = of_points(&|n| match expansion.origins[n] {
            Origin::Kept => Vec3::splat(0.3 * luminance(before[n]).min(1.0)),
            Origin::Projected => Vec3::new(0.1, 0.6, 0.2),
            Origin::Solved => Vec3::new(0.1, 0.4, 0.9),
            Origin::Filled => Vec3::new(0.9, 0.1, 0.1),
        });
        let caption = "where colours come from: green projected, blue solved, red left as they were";
        self.picture(&format!("shot{number}-origins.png"), &srgb(&origins, 0.0)?, caption)
    }

    /// The page comes last, so that it never shows what is not there.
    fn finish(self) -> Result<()> {
        let path = self.folder.join("index.html");
        let page = format!("{HEAD}{}</body></html>\n", self.body);
        whole::write(&path, |out| {
            out.write_all(page.as_bytes()).map_err(|e| Error::file(&path, format!("cannot be written: {e}")))
        })
    }
}

const HEAD: &str = "<!doctype html>
<html lang=\"en\"><head><meta charset=\"utf-8\"><title>relume: expansion</title>
<style>
body { font: 15px/1.5 sans-serif; margin: 2em auto; max-width: 1100px; color: #222; background: #fafafa; }
table { border-collapse: collapse; margin: 1em 0; } th { text-align: left; font-weight: normal; padding-right: 2em; }
th, td { border-bottom: 1px solid #ddd; padding: 2px 1em 2px 0; }
figure { display: inline-block; margin: 0 8px 16px 0; width: 530px; vertical-align: top; }
img { width: 100%; background: #000; } figcaption { color: #555; }
.warning { background: #ffe9b3; padding: .5em 1em; border-left: 4px solid #d08000; }
</style></head><body>
";

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

fn srgb(picture: &Picture, stops: f32) -> Result<RgbaImage> {
    to_srgb8(&compare::Image::opaque(picture.width, picture.height, picture.rgb.clone())?, stops)
}

/// Means of pixels, no larger than `side`.
fn shrunk(picture: &Picture, side: u32) -> Picture {
    let factor = picture.width.max(picture.height).div_ceil(side).max(1);
    let (width, height) = ((picture.width / factor).max(1), (picture.height / factor).max(1));
    let mean = |n: u32| {
        let (x, y) = (n % width * factor, n / width * factor);
        let (right, below) = ((x + factor).min(picture.width), (y + factor).min(picture.height));
        let sum: Vec3 = (y..below).flat_map(|y| (x..right).map(move |x| picture.at(x, y))).sum();
        sum / ((right - x) * (below - y)) as f32
    };
    Picture { width, height, rgb: (0..width * height).map(mean).collect() }
}

/// Black, red, yellow, white.
fn heat(share: f32) -> Vec3 {
    let part = |from: f32| ((share - from) * 3.0).clamp(0.0, 1.0);
    Vec3::new(part(0.0), part(1.0 / 3.0), part(2.0 / 3.0))
}
