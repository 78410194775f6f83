//! Imperfect shadow maps of all virtual point lights in one atlas (Ritschel et al. 2008; Preiner 2010, 4.3).

use std::sync::Arc;

use ash::vk;

use super::lamp_view::{LampPass, LampViewPass};
use super::operator::Operator;
use super::vpl::{LitPoints, VplBuffers};
use crate::Result;
use crate::gpu::pipeline::DescriptorSet;
use crate::gpu::{Bindings, Buffer, Context, Recorder};

/// The atlas and what fills it.
pub struct IsmPass {
    /// Distances as float bits, all ones where nothing is; all maps of a level, then the next level.
    pub depths: Buffer,
    splat: Operator,
    pull: Operator,
    push: Operator,
    /// By buffer of points, then by which lights are the present ones.
    sets: Vec<[DescriptorSet; 2]>,
    levels: u32,
}

impl IsmPass {
    /// Room for `count` maps of `size` x `size` texels, a power of two, that are filled by `levels` steps of pull and push.
    ///
    /// # Errors
    /// When they do not fit the device.
    pub fn new<'a>(
        context: &Arc<Context>,
        lights: &VplBuffers,
        views: &LampViewPass,
        points: &[LitPoints<'a>],
        (count, size, levels): (u32, u32, u32),
    ) -> Result<Self> {
        let levels = levels.min(size.trailing_zeros());
        // The levels below the finest are less than a third of it.
        let texels = u64::from(count) * (u64::from(size) * u64::from(size) * 4).div_ceil(3);
        let depths = Buffer::with_texels(context, "shadow maps", texels * 4, vk::Format::R32_UINT)?;
        let bindings = |buffer: &LitPoints<'a>, now: usize| {
            Bindings::new()
                .and(views.bindings())
                .buffer("vpl", &lights.lights[now])
                .buffer("IsmDepths", &depths)
                .buffer("ism", &depths)
                .buffer("ism_out", &depths)
                .and(buffer.bindings())
        };
        let first = bindings(&points[0], 0);
        let splat = Operator::new(context, "ism/splat.comp", &[], &first)?;
        let pull = Operator::new(context, "ism/pull.comp", &[], &first)?;
        let push = Operator::new(context, "ism/push.comp", &[], &first)?;
        let sets = points
            .iter()
            .map(|buffer| Ok([splat.set(&bindings(buffer, 0))?, splat.set(&bindings(buffer, 1))?]))
            .collect::<Result<_>>()?;
        Ok(Self { depths, splat, pull, push, sets, levels })
    }

    /// Fills the maps of the lights in buffer `now`: `rounds` rounds of all points, each of them into one map a round.
    ///
    /// # Errors
    /// When there are more points or texels than a dispatch has.
    pub fn record(
        &self,
        recorder: &mut Recorder,
        points: &[LitPoints<'_>],
        (pass, rounds): (LampPass, u32),
        now: usize,
    ) -> Result<()> {
        super::fill(recorder, "clear shadow maps", &[(&self.depths, u32::MAX)]);
        for round in 0..rounds {
            for (buffer, sets) in points.iter().zip(&self.sets) {
                let dispatches = buffer.dispatches(pass.in_round(round, rounds));
                self.splat.record_with(recorder, "shadow maps", &sets[now], &dispatches)?;
            }
        }
        let texels = |level: u32| pass.vpls * (pass.ism_size >> level).pow(2);
        for level in 1..=self.levels {
            self.pull.record(recorder, "fill shadow maps", &LampPass { level, ..pass }, texels(level))?;
        }
        for level in (0..self.levels).rev() {
            self.push.record(recorder, "fill shadow maps", &LampPass { level, ..pass }, texels(level))?;
        }
        Ok(())
    }
}
