//! Which renderer renders, and what happens where a GPU cannot.

use super::fast::FastRenderer;
use super::gpu::{GpuError, GpuRenderer};
use super::plan::Plan;
use super::turn::Turn;
use super::{Prepared, RenderError, Renderer, Wanted};
use crate::scene::ShadedScene;
use clap::ValueEnum;
use protocol::rig::Rig;
use serde::{Deserialize, Serialize};
use std::path::Path;
use std::sync::Once;

/// Which renderer is asked for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum Asked {
    /// A GPU if there is a real one, else the CPU
    #[default]
    Auto,
    /// The CPU
    Cpu,
    /// A GPU, also one that software plays; where there is none, the CPU
    Gpu,
}

/// Told why the CPU renders what a GPU was asked for.
pub type Notice = Box<dyn Fn(&GpuError) + Send + Sync>;

/// The renderer for what is asked. `notice` hears once why it is not the GPU, if that was asked for and cannot be had or fails later.
pub fn pick(asked: Asked, adapter: Option<&str>, notice: Notice) -> Box<dyn Renderer> {
    let cpu = || Box::new(FastRenderer::new());
    if asked == Asked::Cpu {
        return cpu();
    }
    let insists = asked == Asked::Gpu || adapter.is_some();
    if !insists && !may_have_gpu() {
        return cpu();
    }
    match GpuRenderer::open(adapter, None) {
        Ok(gpu) if insists || !gpu.is_software() => Box::new(WithFallback::new(gpu, notice)),
        Ok(_) => cpu(),
        Err(error) => {
            if insists {
                notice(&error);
            }
            cpu()
        }
    }
}

/// Whether it is worth a third of a second to ask for a GPU: on Linux a real one has a device file.
fn may_have_gpu() -> bool {
    cfg!(not(target_os = "linux"))
        || ["/dev/dri", "/dev/nvidiactl", "/dev/dxg"].iter().any(|file| Path::new(file).exists())
}

/// A GPU, and the CPU for what it cannot render or where it is lost.
pub struct WithFallback {
    gpu: GpuRenderer,
    cpu: FastRenderer,
    notice: Notice,
    noticed: Once,
}

impl WithFallback {
    /// `notice` hears the first error.
    pub fn new(gpu: GpuRenderer, notice: Notice) -> Self {
        Self { gpu, cpu: FastRenderer::new(), notice, noticed: Once::new() }
    }

    /// The GPU.
    pub fn gpu(&self) -> &GpuRenderer {
        &self.gpu
    }

    /// Goes on without an error that is the GPU's.
    fn forgive(&self, error: RenderError) -> Result<(), RenderError> {
        let RenderError::Gpu(error) = error else { return Err(error) };
        self.noticed.call_once(|| (self.notice)(&error));
        Ok(())
    }
}

impl Renderer for WithFallback {
    fn name(&self) -> String {
        if self.noticed.is_completed() { self.cpu.name() } else { self.gpu.name() }
    }

    fn prepare<'a>(
        &'a self,
        scene: &'a ShadedScene,
        rig: &Rig,
        plan: &Plan,
    ) -> Result<Box<dyn Prepared + 'a>, RenderError> {
        let job = match self.gpu.prepare(scene, rig, plan) {
            Ok(job) => job,
            Err(error) => {
                self.forgive(error)?;
                return self.cpu.prepare(scene, rig, plan);
            }
        };
        Ok(Box::new(Job { renderer: self, job, scene, rig: rig.clone(), plan: *plan }))
    }
}

/// Prepared on the GPU or, from its first error on, on the CPU.
struct Job<'a> {
    renderer: &'a WithFallback,
    job: Box<dyn Prepared + 'a>,
    scene: &'a ShadedScene,
    rig: Rig,
    plan: Plan,
}

impl Prepared for Job<'_> {
    fn render(&mut self, wanted: Wanted<'_>, turn: &mut Turn) -> Result<(), RenderError> {
        let Err(error) = self.job.render(wanted, turn) else { return Ok(()) };
        self.renderer.forgive(error)?;
        self.job = self.renderer.cpu.prepare(self.scene, &self.rig, &self.plan)?;
        self.job.render(wanted, turn)
    }
}
