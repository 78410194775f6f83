//! What a scan's file holds, and what of it a [`Cloud`] does not take, so that the cloud can be written again with
//! nothing lost.

use std::path::{Path, PathBuf};

use glam::DVec3;

use super::points::Points;
use super::table::Table;
use crate::Result;
use crate::scene::Cloud;

/// Everything that is read of a file.
pub(super) struct Scan {
    pub(super) points: Points,
    /// All columns that the points were taken from, and the others.
    pub(super) table: Table,
    /// Header lines of a PLY file, `comment` or `obj_info` first, without their ends.
    pub(super) comments: Vec<Vec<u8>>,
    /// What of the file is in neither, in words.
    pub(super) left_out: Vec<String>,
}

impl Scan {
    /// The valid points: see [`Points::into_cloud`].
    pub(super) fn into_cloud(self, path: &Path) -> Result<Cloud> {
        Ok(self.points.into_cloud(path)?.0)
    }

    /// The valid points, and the columns that they came from.
    pub(super) fn into_cloud_and_source(self, path: &Path) -> Result<(Cloud, Source)> {
        let Self { points, table, comments, left_out } = self;
        let viewpoint = points.viewpoint.filter(|v| v.is_finite());
        let (cloud, kept) = points.into_cloud(path)?;
        Ok((cloud, Source { path: path.to_owned(), table, kept, comments, left_out, viewpoint }))
    }
}

/// The file of a cloud: all columns, and which of its rows became points. Made by
/// [`super::cloud::load_with_source`], written by [`super::expanded::write`].
pub struct Source {
    pub(super) path: PathBuf,
    pub(super) table: Table,
    /// Row of each point, ascending.
    pub(super) kept: Vec<usize>,
    pub(super) comments: Vec<Vec<u8>>,
    pub(super) left_out: Vec<String>,
    /// Where the scanner stood, in the file's coordinates.
    pub(super) viewpoint: Option<DVec3>,
}

impl Source {
    /// Number of points: that of the cloud.
    pub fn len(&self) -> usize {
        self.kept.len()
    }

    /// True when there is no point, which no cloud that was read is.
    pub fn is_empty(&self) -> bool {
        self.kept.is_empty()
    }
}
