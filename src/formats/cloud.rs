//! Point clouds, whatever their format.

use std::path::Path;

use glam::{DVec3, Vec3};

use super::source::{Scan, Source};
use super::{extension, las, pcd, ply};
use crate::preprocess::neighbours;
use crate::scene::Cloud;
use crate::{Error, Result};

/// Which axis of the file points up.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Up {
    /// +Y, as in relume's world: nothing is turned.
    #[default]
    Y,
    /// +Z, as in surveying: (x, y, z) becomes (x, z, -y).
    Z,
    /// -Y, as in the images of depth cameras, which look along +Z: (x, y, z) becomes (x, -y, -z).
    MinusY,
}

/// What a file cannot say about itself.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct CloudOptions {
    /// The file's up axis.
    pub up: Up,
    /// Point that estimated normals look towards where the file does not know the scanner's place: the file's
    /// coordinates with +Y turned up, [`Cloud::origin`] not subtracted. Without it they look towards the centre of the
    /// bounding box, as suits a room.
    pub orient_towards: Option<DVec3>,
}

/// Reads a cloud from a .ply, .pcd, .las or .laz file, turns +Y up and estimates the normals and the spacing that the
/// file lacks. All values of the result are finite, all normals unit, and there is at least one point.
///
/// # Errors
/// [`Error::File`] where the extension is another, the file cannot be read or understood, or it holds no valid point
/// or no colours. [`Error::Limit`] for more than 2^32 - 1 points.
pub fn load(path: &Path, options: &CloudOptions) -> Result<Cloud> {
    let cloud = read_scan(path, las::Wanted::Points)?.into_cloud(path)?;
    finish(cloud, options)
}

/// [`load`], and what the file holds beyond the cloud: with it [`super::expanded::write`] writes the cloud again,
/// every property as it was.
///
/// # Errors
/// Those of [`load`].
pub fn load_with_source(path: &Path, options: &CloudOptions) -> Result<(Cloud, Source)> {
    let (cloud, source) = read_scan(path, las::Wanted::Everything)?.into_cloud_and_source(path)?;
    Ok((finish(cloud, options)?, source))
}

fn read_scan(path: &Path, of_las: las::Wanted) -> Result<Scan> {
    match extension(path).as_str() {
        "ply" => ply::read_scan(path),
        "pcd" => pcd::read_scan(path),
        "las" | "laz" => las::read_scan(path, of_las),
        _ => Err(Error::file(path, "is not a known kind of point cloud: expected .ply, .pcd, .las or .laz")),
    }
}

/// Turns +Y up and estimates what is lacking.
fn finish(mut cloud: Cloud, options: &CloudOptions) -> Result<Cloud> {
    match options.up {
        Up::Y => {}
        Up::Z => turn(&mut cloud, |v| DVec3::new(v.x, v.z, -v.y)),
        Up::MinusY => turn(&mut cloud, |v| DVec3::new(v.x, -v.y, -v.z)),
    }
    let towards = options.orient_towards.map(|point| (point - cloud.origin).as_vec3());
    neighbours::complete(&mut cloud, towards)?;
    Ok(cloud)
}

/// Turns a cloud by a rotation that only swaps axes and signs, which is exact in any precision.
fn turn(cloud: &mut Cloud, rotation: impl Fn(DVec3) -> DVec3) {
    let turn = |v: &mut Vec3| *v = rotation(v.as_dvec3()).as_vec3();
    cloud.positions.iter_mut().for_each(turn);
    cloud.normals.iter_mut().for_each(turn);
    cloud.viewpoint.iter_mut().for_each(turn);
    cloud.origin = rotation(cloud.origin);
}
