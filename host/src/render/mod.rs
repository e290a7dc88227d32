//! A scene becomes a turn of slices; and what a pinhole would see, to compare with.

pub mod blur;
pub mod bow;
mod canvas;
pub mod clear;
pub mod fast;
pub mod gpu;
pub mod halftone;
pub mod joint;
pub mod live;
pub mod mesh;
pub mod pick;
pub mod plan;
pub mod precut;
mod second_pass;
mod sight;
pub mod tessellate;
pub mod truth;
pub mod turn;
mod visible;

use crate::scene::ShadedScene;
use core::time::Duration;
use plan::Plan;
use protocol::rig::Rig;
use thiserror::Error;
use turn::{Depth, Turn};

pub use visible::anything_visible;

/// Why a turn cannot be rendered.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum RenderError {
    /// The slices would not fit in memory.
    #[error(transparent)]
    TurnTooLarge(#[from] turn::TurnTooLarge),
    /// Straight edges would need too many pieces.
    #[error("cutting edges to {limit_mm} mm gives more than {allowed} triangles: make the scene smaller, with --fit-m")]
    TooManyTriangles {
        /// The length to which edges are cut.
        limit_mm: u32,
        /// The most triangles.
        allowed: usize,
    },
    /// The GPU cannot render this, or has gone.
    #[error(transparent)]
    Gpu(#[from] gpu::GpuError),
}

/// A way to render turns.
pub trait Renderer: Send + Sync {
    /// What it is called, with the device or the instructions that it uses.
    fn name(&self) -> String;

    /// Makes `scene` ready for `rig`, to be rendered by `plan` once or turn after turn.
    fn prepare<'a>(
        &'a self,
        scene: &'a ShadedScene,
        rig: &Rig,
        plan: &Plan,
    ) -> Result<Box<dyn Prepared + 'a>, RenderError>;

    /// Renders `scene` by `plan` into those slices of a turn that `slices` names; the others stay dark. `done` is called from any
    /// thread after each slice.
    fn render_slices(
        &self,
        scene: &ShadedScene,
        rig: &Rig,
        plan: &Plan,
        slices: &[u32],
        done: &(dyn Fn() + Sync),
    ) -> Result<Turn, RenderError> {
        let mut turn = dark_turn(rig, plan)?;
        self.prepare(scene, rig, plan)?.render(Wanted { slices, number: 0, done }, &mut turn)?;
        Ok(turn)
    }

    /// Renders every slice of a turn.
    fn render_turn(
        &self,
        scene: &ShadedScene,
        rig: &Rig,
        plan: &Plan,
        done: &(dyn Fn() + Sync),
    ) -> Result<Turn, RenderError> {
        self.render_slices(scene, rig, plan, &(0..rig.rotation.slices).collect::<Vec<_>>(), done)
    }
}

/// A scene on a rig, ready to be rendered as often as is wanted, with all that a turn needs in its place.
pub trait Prepared: Send {
    /// Renders what is wanted into `turn`, which [`dark_turn`] or an earlier call has made; the other slices stay as they are.
    fn render(&mut self, wanted: Wanted<'_>, turn: &mut Turn) -> Result<(), RenderError>;

    /// Where the time of the last call of [`Prepared::render`] went, in order: of all threads together, by the clock, on the CPU, of the device on a GPU.
    /// `None` where nobody has taken it.
    fn stages(&self) -> Option<Vec<(&'static str, Duration)>> {
        None
    }
}

/// What to render.
#[derive(Clone, Copy)]
pub struct Wanted<'a> {
    /// The slices, each once.
    pub slices: &'a [u32],
    /// The number of the turn: halftones that alternate do so by its parity.
    pub number: u32,
    /// Called from any thread after each slice.
    pub done: &'a (dyn Fn() + Sync),
}

/// A turn for `rig` with what `plan` puts in a pixel, dark.
pub fn dark_turn(rig: &Rig, plan: &Plan) -> Result<Turn, RenderError> {
    let depth = if plan.halftone == plan::Halftone::Grey { Depth::Grey } else { Depth::Binary };
    Ok(Turn::dark(rig.rotation.slices, rig.projector.width_px, rig.projector.height_px, depth)?)
}
