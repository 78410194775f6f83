//! A picture's dynamic range by a neural network: the strategy that Sabbadin et al. 2019, "High Dynamic Range Expansion
//! of Point Clouds for Real-Time Relighting", section 6.2, compares with. Any network that turns one picture of low
//! dynamic range into one of high, as an ONNX file, or the small one that ships with relume (`tools/train_network`).
//!
//! A network takes float 1x3xHxW, sRGB-encoded in 0..1, which is what published ones such as ExpandNet (Marnerides et
//! al. 2018) take, and gives float 1x3xHxW, linear. It sees the picture in tiles that overlap, so that memory stays
//! bounded.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use glam::Vec3;
use rayon::prelude::*;
use tract_onnx::prelude::{Tensor, TypedRunnableModel, tvec};

use crate::compare::luminance;
use crate::formats::color::encode_srgb;
use crate::scene::Picture;
use crate::{Error, Result};

mod model;
mod tiles;

use tiles::Tiles;

/// An image-to-image network, ready to run on tiles of one size.
pub struct Network {
    /// What messages call it.
    name: PathBuf,
    plan: Arc<TypedRunnableModel>,
    /// Height and width of a tile.
    size: [usize; 2],
}

/// Luminances between which a pixel says how the network scales its output.
const WELL_EXPOSED: std::ops::Range<f32> = 0.05..0.7;
/// A channel from here on may be clipped, so that no result may be darker.
const CLIPPED: f32 = 0.9;
/// Pixels of the tiles that wait to be blended, at most, unless a single tile has more: 64 MiB.
const WAITING: usize = 1 << 22;

/// A tile's result: `None` where the network gave no finite colour.
type Colors = Vec<Option<Vec3>>;

impl Network {
    /// The small network that ships with relume.
    ///
    /// # Errors
    /// None that a build which passes its tests can give.
    pub fn built_in() -> Result<Self> {
        Self::new(Path::new("built-in network"), include_bytes!("../network.onnx"))
    }

    /// A network from an ONNX file. One with a fixed height and width gets tiles of that size, and any other tiles of
    /// 256x256.
    ///
    /// # Errors
    /// [`Error::File`] when the file is unreadable, no ONNX, uses what the runtime lacks, or is not made for one
    /// 1x3xHxW picture in and one of the same size out.
    pub fn read(path: &Path) -> Result<Self> {
        let bytes = std::fs::read(path).map_err(|error| Error::file(path, error))?;
        Self::new(path, &bytes)
    }

    fn new(name: &Path, bytes: &[u8]) -> Result<Self> {
        let (plan, size) = model::load(name, bytes)?;
        Ok(Self { name: name.to_owned(), plan, size })
    }

    /// The picture, linear in 0..1, with its high dynamic range, at the same size and in the same scale: 1.0 stays the
    /// white of the input, and what is clipped gets brighter, never darker. Finite and non-negative whatever the
    /// network gives; where that is no finite number, the input's colour stays.
    ///
    /// Networks differ in the scale of their output, so it is multiplied by a factor which makes the median ratio of
    /// output to input 1 over the well-exposed pixels that it saw (luminance 0.05 to 0.7); without any there is none.
    ///
    /// With `wanted`, one flag a pixel, tiles that hold no wanted pixel are left as they are. That saves their time
    /// where only over-exposed pixels matter. The result does not depend on the number of threads. `progress` gets the
    /// share of the tiles that are done.
    ///
    /// # Errors
    /// [`Error::Argument`] when `wanted` has another length than the picture; [`Error::File`] when the network fails.
    pub fn expand(
        &self,
        picture: &Picture,
        wanted: Option<&[bool]>,
        progress: &(dyn Fn(f32) + Sync),
    ) -> Result<Picture> {
        let (width, height) = (picture.width as usize, picture.height as usize);
        if let Some(flags) = wanted.filter(|flags| flags.len() != picture.rgb.len()) {
            let message = format!("{} flags for a picture of {width}x{height} pixels: one a pixel", flags.len());
            return Err(Error::Argument(message));
        }
        let tiles = Tiles::new([height, width], self.size);
        let needed = tiles.needed(wanted);
        let mut sums = vec![(Vec3::ZERO, 0.0f32); picture.rgb.len()];
        let done = AtomicUsize::new(0);
        // Tiles are computed in parallel and blended in their order, so that sums do not depend on who finishes first.
        for some in needed.chunks((WAITING / tiles.pixels()).max(1)) {
            let results = some.par_iter().map(|&origin| {
                let colors = self.run(picture, origin)?;
                progress((done.fetch_add(1, Ordering::Relaxed) + 1) as f32 / needed.len() as f32);
                Ok(colors)
            });
            for (&origin, colors) in some.iter().zip(results.collect::<Result<Vec<Colors>>>()?) {
                tiles.visit(origin, |at, pixel, weight| {
                    if let Some(color) = colors[at] {
                        sums[pixel].0 += color * weight;
                        sums[pixel].1 += weight;
                    }
                });
            }
        }
        progress(1.0);
        Ok(finish(picture, &sums))
    }

    /// What the network makes of the tile whose first row and column are `origin`. Beyond the picture its last row and
    /// column repeat.
    fn run(&self, picture: &Picture, origin: [usize; 2]) -> Result<Colors> {
        let [rows, columns] = self.size;
        let pixels = rows * columns;
        let mut input = vec![0.0f32; 3 * pixels];
        for row in 0..rows {
            let y = (origin[0] + row).min(picture.height as usize - 1);
            for column in 0..columns {
                let x = (origin[1] + column).min(picture.width as usize - 1);
                let color = picture.rgb[y * picture.width as usize + x];
                for (channel, value) in color.to_array().into_iter().enumerate() {
                    input[channel * pixels + row * columns + column] = encode_srgb(value.clamp(0.0, 1.0));
                }
            }
        }
        let fail = |problem: String| Error::file(&self.name, format!("cannot run: {problem}"));
        let tensor = Tensor::from_shape(&[1, 3, rows, columns], &input).map_err(|error| fail(model::chain(&error)))?;
        let outputs = self.plan.run(tvec!(tensor.into())).map_err(|error| fail(model::chain(&error)))?;
        // The shape was checked when the network was read, unless it depends on the values.
        let output = outputs.first().filter(|output| output.shape() == [1, 3, rows, columns]);
        let output = output.ok_or_else(|| fail("its output changes its size".to_owned()))?;
        let view = output.view();
        let values: &[f32] = view.as_slice().map_err(|error| fail(model::chain(&error)))?;
        let color = |at: usize| Vec3::new(values[at], values[pixels + at], values[2 * pixels + at]);
        Ok((0..pixels).map(|at| Some(color(at)).filter(|color| color.is_finite())).collect())
    }
}

/// The blended picture in the scale of the input.
fn finish(picture: &Picture, sums: &[(Vec3, f32)]) -> Picture {
    let blended = |&(sum, weight): &(Vec3, f32)| (weight > 0.0).then(|| sum / weight);
    let mut ratios: Vec<f32> = picture
        .rgb
        .par_iter()
        .zip(sums)
        .filter_map(|(input, sum)| {
            let exposure = luminance(*input);
            let ratio = luminance(blended(sum)?) / exposure;
            (WELL_EXPOSED.contains(&exposure) && ratio.is_finite()).then_some(ratio)
        })
        .collect();
    let middle = ratios.len() / 2;
    // A network that is black, or negative, where the picture is well exposed has no scale.
    let scale = (!ratios.is_empty())
        .then(|| *ratios.select_nth_unstable_by(middle, f32::total_cmp).1)
        .map(f32::recip)
        .filter(|scale| scale.is_finite() && *scale > 0.0)
        .unwrap_or(1.0);
    let rgb = picture.rgb.par_iter().zip(sums).map(|(&input, sum)| {
        let Some(output) = blended(sum).map(|color| color * scale).filter(|color| color.is_finite()) else {
            return input;
        };
        let output = output.max(Vec3::ZERO);
        Vec3::select(input.cmpge(Vec3::splat(CLIPPED)), output.max(input), output)
    });
    Picture { width: picture.width, height: picture.height, rgb: rgb.collect() }
}
