//! A scene becomes a turn of slices; and what a pinhole would see, to compare with.

pub mod blur;
pub mod bow;
mod canvas;
pub mod cpu;
pub mod halftone;
pub mod joint;
pub mod mesh;
pub mod plan;
mod sight;
pub mod tessellate;
pub mod truth;
pub mod turn;
mod visible;

use crate::scene::ShadedScene;
use plan::Plan;
use protocol::rig::Rig;
use thiserror::Error;
use turn::Turn;

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
}

/// A way to render a turn.
pub trait Renderer {
    /// Renders `scene` by `plan` into those slices of a turn that `slices` names; the others stay dark. `done` is called from any
    /// thread after each slice.
    fn render_slices(
        &self,
        scene: &ShadedScene,
        rig: &Rig,
        plan: &Plan,
        slices: &[u32],
        done: &(dyn Fn() + Sync),
    ) -> Result<Turn, RenderError>;

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
