//! Which renderer renders.

use super::Renderer;
use super::fast::FastRenderer;
use super::gpu::{GpuError, GpuRenderer};
use clap::ValueEnum;

/// Which renderer is asked for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum Asked {
    /// A GPU if there is a real one, else the CPU
    #[default]
    Auto,
    /// The CPU
    Cpu,
    /// A GPU, also one that software plays; where there is none, the CPU
    Gpu,
}

/// The renderer for what is asked, and why it is not the GPU if that was asked for and cannot be had.
pub fn pick(asked: Asked, adapter: Option<&str>) -> (Box<dyn Renderer>, Option<GpuError>) {
    let cpu = || Box::new(FastRenderer::new());
    if asked == Asked::Cpu {
        return (cpu(), None);
    }
    match GpuRenderer::open(adapter, None) {
        Ok(gpu) if asked == Asked::Gpu || adapter.is_some() || !gpu.is_software() => (Box::new(gpu), None),
        Ok(_) => (cpu(), None),
        Err(error) if asked == Asked::Gpu || adapter.is_some() => (cpu(), Some(error)),
        Err(_) => (cpu(), None),
    }
}
