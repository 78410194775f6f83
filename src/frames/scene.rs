//! What renderers share.

use std::sync::Arc;

use crate::Result;
use crate::gpu::Context;
use crate::passes::convolve::GpuFarField;
use crate::passes::{GpuHierarchy, Paper};
use crate::preprocess::hierarchy::{Hierarchy, NodeRadiance};
use crate::scene::FarField;

/// What a scan lights with, on the device: renderers of any settings can share it.
#[derive(Clone)]
pub struct GpuScene {
    pub(super) hierarchy: Arc<GpuHierarchy>,
    pub(super) far_field: Arc<GpuFarField>,
    pub(super) paper: Paper,
    pub(super) bytes: u64,
}

impl GpuScene {
    /// Uploads a hierarchy and what lies beyond it, for renderings in the given ways of the paper.
    ///
    /// # Errors
    /// [`crate::Error::Limit`] where the scene does not fit the device.
    pub fn new(
        context: &Arc<Context>,
        hierarchy: &Hierarchy,
        far_field: Option<&FarField>,
        paper: Paper,
    ) -> Result<Self> {
        let before = context.bytes_now();
        let hierarchy = Arc::new(GpuHierarchy::new(context, hierarchy, paper)?);
        let far_field = Arc::new(GpuFarField::new(context, far_field)?);
        Ok(Self { hierarchy, far_field, paper, bytes: context.bytes_now() - before })
    }

    /// Puts another far field of the same size in the place of the one that it was made with, for all renderers of it.
    ///
    /// # Errors
    /// [`crate::Error::Argument`] for another size, or where it was made without.
    pub fn set_far_field(&self, far_field: &FarField) -> Result<()> {
        self.far_field.update(far_field)
    }

    /// Gives all nodes other radiance, or that which they were made with, for all renderers of it. `hierarchy` is the one
    /// that it was made of.
    ///
    /// # Errors
    /// [`crate::Error::Argument`] for another number of nodes; Vulkan's own errors.
    pub fn relight(&self, hierarchy: &Hierarchy, radiance: Option<&NodeRadiance>) -> Result<()> {
        self.hierarchy.relight(hierarchy, radiance)
    }
}
