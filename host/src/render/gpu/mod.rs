//! The renderers on a GPU, by wgpu.

mod device;
mod draw;
mod evaluate;
mod job;
mod model;
mod needs;
mod raster;

use super::plan::{DepthTest, Edges, Halftone, Plan, Precision};
use super::second_pass::SecondPass;
use super::tessellate::tessellate;
use super::{Prepared, RenderError, Renderer, Wanted, dark_turn};
use crate::scene::ShadedScene;
use clap::ValueEnum;
use device::Gpu;
use job::Job;
use model::Model;
use needs::Pipelines;
use protocol::rig::Rig;
use serde::{Deserialize, Serialize};
use shaders::project::methods::single_is_enough;
use shaders::wgsl::Mask;
use std::time::Instant;
use thiserror::Error;

/// Why a GPU does not render.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum GpuError {
    /// There is none, or none of that name.
    #[error("no GPU adapter{}: {found}", wanted.as_ref().map(|name| format!(" named {name:?}")).unwrap_or_default())]
    NoAdapter {
        /// Part of a name that was asked for.
        wanted: Option<String>,
        /// What there is.
        found: String,
    },
    /// The device has been lost.
    #[error("GPU {adapter}: {reason}")]
    Lost {
        /// The device's name.
        adapter: String,
        /// What it said.
        reason: String,
    },
    /// The device cannot hold or do what is asked for.
    #[error("GPU {adapter}: {what} needs {needed}, allowed are {allowed}")]
    TooLarge {
        /// The device's name.
        adapter: String,
        /// What is too large.
        what: String,
        /// How much it needs.
        needed: u64,
        /// What the device has.
        allowed: u64,
    },
    /// Only the CPU renders by this plan.
    #[error("GPU: {what} is rendered on the CPU only")]
    Unsupported {
        /// What of the plan, rig or scene.
        what: String,
    },
}

/// How slices are drawn on a GPU.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum Way {
    /// A pass a slice: the patent's way.
    Slice,
    /// 24 slices a pass, into an atlas.
    Atlas,
    /// A rasteriser of compute shaders, all slices at once.
    Compute,
}

impl Way {
    /// All there are.
    pub const ALL: [Self; 3] = [Self::Slice, Self::Atlas, Self::Compute];
}

/// Renders on one adapter.
pub struct GpuRenderer {
    gpu: Gpu,
    pipelines: Pipelines,
    way: Option<Way>,
}

/// The names, drivers and interfaces of all adapters, the best first.
pub fn adapters() -> Vec<String> {
    device::adapters().iter().map(device::name_of).collect()
}

impl GpuRenderer {
    /// Opens the best adapter whose name contains `adapter` in any case. `way`: how to draw; without one, what is found the quicker of
    /// [`Way::Atlas`] and [`Way::Compute`] for each scene.
    ///
    /// # Errors
    /// [`GpuError::NoAdapter`] and, where the driver fails, [`GpuError::Lost`].
    pub fn open(adapter: Option<&str>, way: Option<Way>) -> Result<Self, GpuError> {
        let gpu = Gpu::open(adapter)?;
        Ok(Self { gpu, pipelines: Pipelines::new(), way })
    }

    /// The adapter's name, driver and interface.
    pub fn adapter(&self) -> &str {
        &self.gpu.name
    }

    /// Whether the adapter is a processor that plays a GPU, and slower than [`super::fast`].
    pub fn is_software(&self) -> bool {
        self.gpu.is_software
    }

    /// How it draws from now on: see [`GpuRenderer::open`].
    pub fn set_way(&mut self, way: Option<Way>) {
        self.way = way;
    }

    /// Destroys the device: from now on all that is rendered fails with [`GpuError::Lost`], as where a card is pulled out.
    pub fn destroy(&self) {
        self.gpu.device.destroy();
    }

    /// A job by the quicker way, by the time that the second batch of each takes.
    fn quicker<'a>(
        &'a self,
        job: impl Fn(Way) -> Result<Job<'a>, GpuError>,
        rig: &Rig,
        plan: &Plan,
    ) -> Result<Job<'a>, RenderError> {
        let mut turn = dark_turn(rig, plan)?;
        let slices: Vec<_> = (0..rig.rotation.slices.min(job::SLOTS)).collect();
        let mut best: Option<(f64, Job<'a>)> = None;
        for way in [Way::Atlas, Way::Compute] {
            let mut job = job(way)?;
            let mut seconds = 0.0;
            // The first time drivers compile.
            for _ in 0..2 {
                let start = Instant::now();
                job.render(Wanted { slices: &slices, number: 0, done: &|| () }, &mut turn)?;
                seconds = start.elapsed().as_secs_f64();
            }
            if best.as_ref().is_none_or(|(least, _)| seconds < *least) {
                best = Some((seconds, job));
            }
        }
        Ok(best.expect("two ways").1)
    }
}

/// An error for what only the CPU renders.
fn refuse(rig: &Rig, plan: &Plan) -> Result<(), GpuError> {
    let what = match plan {
        Plan { precision: Precision::Double, .. } => "double precision",
        Plan { edges: Edges::Discard, .. } => "a test by pixel of what lies on triangles",
        Plan { edges: Edges::Rays, .. } => "a ray for every pixel",
        Plan { depth: DepthTest::Exact, .. } => "exact depth",
        _ if !single_is_enough(rig) => "a rig for which single precision is not enough",
        _ => return Ok(()),
    };
    Err(GpuError::Unsupported { what: what.into() })
}

impl Renderer for GpuRenderer {
    fn name(&self) -> String {
        format!("gpu {}", self.gpu.name)
    }

    fn prepare<'a>(
        &'a self,
        scene: &'a ShadedScene,
        rig: &Rig,
        plan: &Plan,
    ) -> Result<Box<dyn Prepared + 'a>, RenderError> {
        self.gpu.check()?;
        refuse(rig, plan)?;
        if plan.halftone != Halftone::Grey && !plan.halftone.is_mask() {
            return SecondPass::prepare(self, scene, rig, plan);
        }
        let mesh = tessellate(scene, rig, plan)?;
        let method = plan.halftone.binary();
        let ranks = method.map(Mask::ranks).unwrap_or_default();
        let model = Model::new(&self.gpu, &mesh, &scene.textures, rig, plan.projection.into(), &ranks)?;
        let size = [rig.projector.width_px, rig.projector.height_px];
        let job = |way| Job::new(&self.gpu, &self.pipelines, &model, way, size, method);
        Ok(Box::new(match self.way {
            Some(way) => job(way)?,
            None => self.quicker(job, rig, plan)?,
        }))
    }
}
