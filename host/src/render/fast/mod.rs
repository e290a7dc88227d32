//! The fast renderer on the CPU: a task a frame, drawn by [`raster`] in blocks of 8 × 4 pixels in 16-bit fixed point.

mod clock;
mod figure;
mod front;
mod job;
mod picture;
mod solids;
#[cfg(test)]
mod tests;

use super::clear::ClearRenderer;
use super::plan::{Halftone, Plan};
use super::second_pass::SecondPass;
use super::{Prepared, RenderError, Renderer};
use crate::scene::ShadedScene;
use glam::DVec2;
use protocol::rig::Rig;

pub use raster::Level;

use job::Job;
use raster::depth_step_m;

/// In scenes so large that depths less than this share of a pixel apart would be one, what lies behind would shine through: they are left
/// to the clear renderer.
const DEPTH_STEP_MAX_PX: f64 = 0.25;

/// Renders with the vector instructions of one [`Level`].
#[derive(Clone, Copy, Debug)]
pub struct FastRenderer {
    level: Level,
}

impl FastRenderer {
    /// With the best instructions that this machine has.
    pub fn new() -> Self {
        Self { level: Level::best() }
    }

    /// With those of `level`, if this machine has them.
    pub fn with(level: Level) -> Option<Self> {
        level.is_available().then_some(Self { level })
    }
}

impl Default for FastRenderer {
    fn default() -> Self {
        Self::new()
    }
}

impl Renderer for FastRenderer {
    fn name(&self) -> String {
        format!("cpu {}", self.level)
    }

    fn prepare<'a>(
        &'a self,
        scene: &'a ShadedScene,
        rig: &Rig,
        plan: &Plan,
    ) -> Result<Box<dyn Prepared + 'a>, RenderError> {
        if !plan.is_for_fixed_point() {
            return const { &ClearRenderer }.prepare(scene, rig, plan);
        }
        if matches!(plan.halftone, Halftone::SightLine | Halftone::Joint) {
            return SecondPass::prepare(self, scene, rig, plan);
        }
        let job = Job::new(self.level, scene, rig, plan)?;
        match is_deep(job.radius_m(), rig) {
            true => const { &ClearRenderer }.prepare(scene, rig, plan),
            false => Ok(Box::new(job)),
        }
    }
}

/// Whether 15 bits are too few for the depths of what reaches so far from the origin.
fn is_deep(radius_m: f32, rig: &Rig) -> bool {
    let camera = rig.camera();
    let middle = DVec2::new(rig.projector.width_px.into(), rig.projector.height_px.into()) / 2.0;
    let pixel_m = camera.ray(middle).angle_between(camera.ray(middle + DVec2::X)) * camera.position.length();
    f64::from(depth_step_m(radius_m)) > DEPTH_STEP_MAX_PX * pixel_m
}
