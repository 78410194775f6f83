//! Light of lamps at points of the cloud: what a hierarchy over them is refitted with.

use std::sync::Arc;

use ash::vk;

use super::ism::IsmPass;
use super::lamp_view::{LampPass, LampViewPass};
use super::operator::Operator;
use super::vpl::{LitPoints, VplBuffers};
use crate::Result;
use crate::gpu::pipeline::DescriptorSet;
use crate::gpu::{Bindings, Buffer, Constant, Context, Recorder};

/// Invocations of a workgroup.
const GROUP: u32 = 64;

/// The pass.
pub struct LampCloudPass {
    /// Radiance of the points, by buffer.
    radiance: Vec<Buffer>,
    direct: Operator,
    gather: Operator,
    /// By buffer of points: direct light, then each of the light buffers.
    sets: Vec<[DescriptorSet; 3]>,
}

impl LampCloudPass {
    /// Makes the pipelines for these points; `glossy` where surfaces have mirror lobes.
    ///
    /// # Errors
    /// When they do not fit the device.
    pub fn new(
        context: &Arc<Context>,
        points: &[LitPoints<'_>],
        lights: &VplBuffers,
        (views, ism): (&LampViewPass, &IsmPass),
        glossy: bool,
    ) -> Result<Self> {
        let buffer = |points: &LitPoints<'_>| {
            let bytes = u64::from(points.count.max(1)) * 16;
            Buffer::with_texels(context, "light of points", bytes, vk::Format::R32G32B32A32_SFLOAT)
        };
        let radiance: Vec<Buffer> = points.iter().map(buffer).collect::<Result<_>>()?;
        let bindings = |index: usize, now: usize| -> Bindings<'_> {
            Bindings::new()
                .and(views.bindings())
                .and(points[index].bindings())
                .buffer("vpl", &lights.lights[now])
                .buffer("ism", &ism.depths)
                .buffer("radiance", &radiance[index])
        };
        let operator = |direct: bool| {
            let constants = [Constant::new(0, glossy), Constant::new(1, direct)];
            Operator::new(context, "lamp_cloud/lamp_cloud.comp", &constants, &bindings(0, 0))
        };
        let (direct, gather) = (operator(true)?, operator(false)?);
        let set = |index| {
            let own = |now| gather.set(&bindings(index, now));
            Ok([direct.set(&bindings(index, 0))?, own(0)?, own(1)?])
        };
        let sets = (0..points.len()).map(set).collect::<Result<_>>()?;
        Ok(Self { radiance, direct, gather, sets })
    }

    /// Light straight from the lamps, in the place of what was there.
    ///
    /// # Errors
    /// When there are more points than a dispatch has.
    pub fn direct(&self, recorder: &mut Recorder, points: &[LitPoints<'_>], pass: LampPass) -> Result<()> {
        for (buffer, [direct, ..]) in points.iter().zip(&self.sets) {
            self.direct.record_with(recorder, "direct light of points", direct, &dispatches(buffer, pass))?;
        }
        Ok(())
    }

    /// Adds what the lights in buffer `now` send to every point.
    ///
    /// # Errors
    /// When there are more points than a dispatch has.
    pub fn gather(&self, recorder: &mut Recorder, points: &[LitPoints<'_>], pass: LampPass, now: usize) -> Result<()> {
        for (buffer, [_, gather @ ..]) in points.iter().zip(&self.sets) {
            self.gather.record_with(recorder, "bounced light of points", &gather[now], &dispatches(buffer, pass))?;
        }
        Ok(())
    }

    /// Radiance of all points in their order.
    ///
    /// # Errors
    /// When a Vulkan call fails.
    pub fn radiance(&self, points: &[LitPoints<'_>]) -> Result<Vec<[f32; 4]>> {
        let mut all = Vec::new();
        for (buffer, points) in self.radiance.iter().zip(points) {
            all.extend(buffer.download::<[f32; 4]>(points.count as usize)?);
        }
        Ok(all)
    }
}

/// Over all points of a buffer, with workgroups of points that take the same part of the lights.
fn dispatches(buffer: &LitPoints<'_>, pass: LampPass) -> Vec<(LampPass, u32)> {
    let run = GROUP * pass.interleave * pass.interleave;
    buffer.dispatches(pass).into_iter().map(|(pass, count)| (pass, count.next_multiple_of(run))).collect()
}
