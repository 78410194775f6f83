//! Images: OpenEXR in and out, Radiance HDR in, PNG out.

use std::io::Cursor;
use std::ops::Range;
use std::path::Path;

use ::image::codecs::png::PngEncoder;
use ::image::{ExtendedColorType, ImageEncoder, ImageFormat, ImageReader, Limits};
use exr::meta::MetaData;
use exr::prelude::{
    AnyChannel, AnyChannels, Compression, Encoding, FlatSamples, Image, IntegerBounds, Layer, LayerAttributes,
    ReadChannels, ReadLayers, WritableImage, read,
};
use glam::Vec3;
use half::slice::HalfFloatSliceExt;

pub use super::color::{decode_srgb, encode_srgb};
use super::{extension, read_bytes, whole};
use crate::scene::{FarField, Picture};
use crate::{Error, Result};

/// Reads a lat-long panorama of linear radiance from a .exr or .hdr file. Negative values (filter lobes) become 0;
/// values that are not finite become 0 with a warning; an image that is not twice as wide as high is taken with a
/// warning.
///
/// # Errors
/// [`Error::File`] where the extension is another, or the file cannot be read or has no pixels or no colours.
pub fn read_far_field(path: &Path) -> Result<FarField> {
    let Picture { width, height, rgb } = read_radiance(path, "panorama", Decompress::Together)?;
    if (i64::from(width) - 2 * i64::from(height)).abs() > 1 {
        tracing::warn!("{}: {width}x{height} is not 2:1, as a lat-long panorama should be", path.display());
    }
    Ok(FarField { width, height, radiance: rgb })
}

/// Reads an HDR photo of linear radiance from a .exr or .hdr file. Negative values become 0; values that are not finite
/// become 0 with a warning.
///
/// # Errors
/// [`Error::File`] where the extension is another, or the file cannot be read or has no pixels or no colours.
pub fn read_photo(path: &Path) -> Result<Picture> {
    read_radiance(path, "HDR photo", Decompress::Together)
}

/// Reads one frame of a light probe as [`read_photo`] does, on the calling thread alone: a stream of frames has its own
/// threads, and with one frame a thread none of them waits for another.
///
/// # Errors
/// As those of [`read_photo`].
pub fn read_probe(path: &Path) -> Result<Picture> {
    read_radiance(path, "light probe", Decompress::Alone)
}

/// Who decompresses the blocks of an EXR file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Decompress {
    /// A pool of threads that is made for the file.
    Together,
    /// The calling thread.
    Alone,
}

fn read_radiance(path: &Path, what: &str, decompress: Decompress) -> Result<Picture> {
    let (width, height, mut rgb) = match extension(path).as_str() {
        "exr" => {
            let image = read_exr(path, decompress)?;
            (image.width, image.height, image.rgb)
        }
        "hdr" => read_radiance_hdr(path)?,
        _ => return Err(Error::file(path, format!("is not a known kind of {what}: expected .exr or .hdr"))),
    };
    let mut replaced = 0;
    for value in &mut rgb {
        if !value.is_finite() {
            replaced += 1;
            *value = Vec3::ZERO;
        }
        *value = value.max(Vec3::ZERO);
    }
    if replaced > 0 {
        tracing::warn!("{}: {replaced} pixels are not finite: taken as black", path.display());
    }
    Ok(Picture { width, height, rgb })
}

fn read_radiance_hdr(path: &Path) -> Result<(u32, u32, Vec<Vec3>)> {
    let bytes = read_bytes(path)?;
    let bad = |e: ::image::ImageError| Error::file(path, format!("is not a readable Radiance HDR file: {e}"));
    let reader = || ImageReader::with_format(Cursor::new(bytes.as_slice()), ImageFormat::Hdr);
    let (width, height) = reader().into_dimensions().map_err(bad)?;
    // Two bytes of run-length code stand for at most 127 of a pixel's four.
    check_size(path, (width as usize, height as usize), 4, 64 * bytes.len() as u64)?;
    let mut reader = reader();
    reader.limits(Limits::no_limits());
    let image = reader.decode().map_err(bad)?.into_rgb32f();
    Ok((width, height, image.as_raw().chunks_exact(3).map(Vec3::from_slice).collect()))
}

/// An error where an image has no pixels, or would take more than `backed` bytes at `pixel` bytes each: nothing is
/// reserved because a header says so.
fn check_size(path: &Path, (width, height): (usize, usize), pixel: u64, backed: u64) -> Result<()> {
    if [width, height].iter().any(|&side| side == 0 || u32::try_from(side).is_err()) {
        return Err(Error::file(path, format!("has an unusable size of {width}x{height} pixels")));
    }
    if (width as u64 * height as u64).saturating_mul(pixel) > backed {
        return Err(Error::file(path, format!("promises {width}x{height} pixels, far more than it can hold")));
    }
    Ok(())
}

/// A linear image as a file has it.
#[derive(Clone, Debug, PartialEq)]
pub struct ExrImage {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// `width * height` colours, row by row from the top; as stored, so possibly negative or not finite.
    pub rgb: Vec<Vec3>,
    /// As many alphas; 1 where the file has none, 0 outside its data window.
    pub alpha: Vec<f32>,
}

/// Reads R, G, B and A (or the first layer's, `name.R` and so on, or Y as grey) of the first part, at its largest
/// resolution level, over the whole display window; black and transparent where the file has no data.
///
/// # Errors
/// [`Error::File`] where the file is no EXR, is damaged or cut short, or has no colour channels.
pub fn read_rgba_exr(path: &Path) -> Result<ExrImage> {
    read_exr(path, Decompress::Together)
}

fn read_exr(path: &Path, decompress: Decompress) -> Result<ExrImage> {
    let bytes = read_bytes(path)?;
    let bad = |e: exr::error::Error| Error::file(path, format!("is not a readable EXR file: {e}"));
    let meta = MetaData::read_from_buffered(bytes.as_slice(), false).map_err(bad)?;
    for header in &meta.headers {
        // DEFLATE reaches 1032:1. Only DWA does better, on images without any detail: up to half a gigabyte they pass.
        let channels = header.channels.list.len() as u64;
        check_size(path, header.layer_size.into(), 2 * channels, (2048 * bytes.len() as u64).max(1 << 29))?;
    }
    let reader = read().no_deep_data().largest_resolution_level().all_channels().first_valid_layer().all_attributes();
    let reader = if decompress == Decompress::Alone { reader.non_parallel() } else { reader };
    let image = reader.from_buffered(Cursor::new(bytes.as_slice())).map_err(bad)?;
    let layer = &image.layer_data;
    let channels = &layer.channel_data.list;
    let find = |name: &str| channels.iter().find(|c| c.name.to_string().eq_ignore_ascii_case(name));
    // The layer that `.R` comes first in; Blender's are called `ViewLayer.Combined.R`.
    let prefix = channels.iter().find_map(|c| c.name.to_string().strip_suffix(".R").map(|p| format!("{p}.")));
    let prefix = prefix.filter(|_| find("R").is_none()).unwrap_or_default();
    let named = |channel: &str| find(&format!("{prefix}{channel}"));
    let colors = match (named("R"), named("G"), named("B")) {
        (Some(r), Some(g), Some(b)) => [r, g, b],
        _ => {
            [named("Y").ok_or_else(|| {
                let names: Vec<String> = channels.iter().map(|c| c.name.to_string()).collect();
                Error::file(path, format!("has no colours: expected channels R, G, B among its {}", names.join(", ")))
            })?; 3]
        }
    };
    let alpha = named("A");
    // Where the data window lies in the display window.
    let window = image.attributes.display_window;
    // A crop may be small; the frame around it need not be larger than 8192x4096 then.
    let data = layer.size.0 as u64 * layer.size.1 as u64;
    check_size(path, window.size.into(), 1, data.max(1 << 25))?;
    let (width, height) = window.size.into();
    let shift = layer.attributes.layer_position - window.position;
    let mut result = ExrImage {
        width: width as u32,
        height: height as u32,
        rgb: vec![Vec3::ZERO; width * height],
        alpha: vec![0.0; width * height],
    };
    // The columns and rows of the display window that have data.
    let covered = |shift: i32, data: usize, side: usize| {
        let clamp = |at: i64| at.clamp(0, side as i64) as usize;
        clamp(shift.into())..clamp(i64::from(shift) + data as i64)
    };
    let (columns, rows) = (covered(shift.0, layer.size.0, width), covered(shift.1, layer.size.1, height));
    let mut scratch: [Vec<f32>; 4] = Default::default();
    let [scratch_r, scratch_g, scratch_b, scratch_a] = &mut scratch;
    for y in if columns.is_empty() { 0..0 } else { rows } {
        let first = (y as i64 - i64::from(shift.1)) as usize * layer.size.0;
        let from = first + (columns.start as i64 - i64::from(shift.0)) as usize;
        let (from, to) = (from..from + columns.len(), y * width + columns.start..y * width + columns.end);
        let [r, g, b] = colors.map(|channel| &channel.sample_data);
        let r = as_floats(r, from.clone(), scratch_r);
        let g = as_floats(g, from.clone(), scratch_g);
        let b = as_floats(b, from.clone(), scratch_b);
        for (rgb, ((&r, &g), &b)) in result.rgb[to.clone()].iter_mut().zip(r.iter().zip(g).zip(b)) {
            *rgb = Vec3::new(r, g, b);
        }
        match alpha {
            Some(alpha) => result.alpha[to].copy_from_slice(as_floats(&alpha.sample_data, from, scratch_a)),
            None => result.alpha[to].fill(1.0),
        }
    }
    Ok(result)
}

/// Part of a channel as 32-bit floats, in `scratch` where it is stored as something else.
fn as_floats<'a>(samples: &'a FlatSamples, part: Range<usize>, scratch: &'a mut Vec<f32>) -> &'a [f32] {
    scratch.resize(part.len(), 0.0);
    match samples {
        FlatSamples::F32(values) => return &values[part],
        FlatSamples::F16(values) => values[part].convert_to_f32_slice(scratch),
        FlatSamples::U32(values) => scratch.iter_mut().zip(&values[part]).for_each(|(to, &from)| *to = from as f32),
    }
    scratch
}

/// What goes into one EXR file. All slices hold `width * height` values, row by row from the top.
#[derive(Clone, Debug)]
pub struct ExrLayers<'a> {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// Channels R, G, B: linear Rec. 709 radiance.
    pub rgb: &'a [Vec3],
    /// Channel A, where there is one.
    pub alpha: Option<&'a [f32]>,
    /// Further channels by name.
    pub groups: &'a [(&'a str, ExrGroup<'a>)],
}

/// One named group of channels.
#[derive(Clone, Copy, Debug)]
pub enum ExrGroup<'a> {
    /// `name.R`, `name.G`, `name.B`: albedo, say.
    Color(&'a [Vec3]),
    /// `name.X`, `name.Y`, `name.Z`: normals `N`, positions `P`.
    Vector(&'a [Vec3]),
    /// Just `name`: depth `Z`.
    Scalar(&'a [f32]),
}

/// Writes a single-part EXR file with channels of 32-bit floats (positions and depth need them), ZIP-compressed,
/// groups told apart by dotted names, as Blender, Nuke and OpenImageIO read them.
///
/// # Errors
/// [`Error::Argument`] where a slice has another length than `width * height`, a size is 0 or a channel name occurs
/// twice. [`Error::File`] when the file cannot be written; an older file at `path` then stays as it was.
pub fn write_exr(path: &Path, layers: &ExrLayers) -> Result<()> {
    let ExrLayers { width, height, rgb, alpha, groups } = *layers;
    let mut channels: Vec<(String, Vec<f32>)> = Vec::new();
    let split = |channels: &mut Vec<_>, prefix: &str, names: [&str; 3], values: &[Vec3]| {
        for (component, name) in names.into_iter().enumerate() {
            channels.push((format!("{prefix}{name}"), values.iter().map(|v| v[component]).collect()));
        }
    };
    split(&mut channels, "", ["R", "G", "B"], rgb);
    channels.extend(alpha.map(|values| ("A".to_owned(), values.to_vec())));
    for (name, group) in groups {
        match group {
            ExrGroup::Color(values) => split(&mut channels, &format!("{name}."), ["R", "G", "B"], values),
            ExrGroup::Vector(values) => split(&mut channels, &format!("{name}."), ["X", "Y", "Z"], values),
            ExrGroup::Scalar(values) => channels.push(((*name).to_owned(), values.to_vec())),
        }
    }
    let expected = width as usize * height as usize;
    for (index, (name, values)) in channels.iter().enumerate() {
        if values.len() != expected || expected == 0 {
            let held = values.len();
            return Err(Error::Argument(format!("EXR channel {name} has {held} values for {width}x{height} pixels")));
        }
        if channels[..index].iter().any(|(other, _)| other == name) {
            return Err(Error::Argument(format!("EXR channel {name} occurs twice")));
        }
    }
    let list = channels.into_iter().map(|(name, v)| AnyChannel::new(name.as_str(), FlatSamples::F32(v))).collect();
    let encoding = Encoding { compression: Compression::ZIP16, ..Encoding::FAST_LOSSLESS };
    let size = (width as usize, height as usize);
    let layer = Layer::new(size, LayerAttributes::default(), encoding, AnyChannels::sort(list));
    let image = Image::from_layer(layer);
    debug_assert_eq!(image.attributes.display_window, IntegerBounds::new((0, 0), size));
    whole::write(path, |out| {
        image.write().to_buffered(out).map_err(|e| Error::file(path, format!("cannot be written: {e}")))
    })
}

/// Writes an 8-bit sRGB image with straight alpha: `4 * width * height` bytes, row by row from the top.
///
/// # Errors
/// [`Error::Argument`] where `rgba8` has another length or a size is 0. [`Error::File`] when the file cannot be
/// written; an older file at `path` then stays as it was.
pub fn write_png(path: &Path, width: u32, height: u32, rgba8: &[u8]) -> Result<()> {
    let held = rgba8.len();
    if held as u64 != 4 * u64::from(width) * u64::from(height) || held == 0 {
        return Err(Error::Argument(format!("PNG has {held} bytes for {width}x{height} RGBA pixels")));
    }
    whole::write(path, |out| {
        let encoded = PngEncoder::new(out).write_image(rgba8, width, height, ExtendedColorType::Rgba8);
        encoded.map_err(|e| Error::file(path, format!("cannot be written: {e}")))
    })
}
