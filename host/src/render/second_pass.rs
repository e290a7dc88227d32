//! Halftones that a renderer does not make itself: grey slices first, then bits.

use super::halftone::{halftone_slices, slices_read};
use super::plan::{Halftone, Plan};
use super::turn::Turn;
use super::{Prepared, RenderError, Renderer, Wanted, dark_turn};
use crate::scene::ShadedScene;
use protocol::rig::Rig;

/// Grey slices by a renderer, then their halftone.
pub(super) struct SecondPass<'a> {
    grey: Box<dyn Prepared + 'a>,
    rig: Rig,
    halftone: Halftone,
    slices: Turn,
}

impl<'a> SecondPass<'a> {
    /// `scene` by `plan`, whose grey slices `renderer` makes.
    pub(super) fn prepare(
        renderer: &'a dyn Renderer,
        scene: &'a ShadedScene,
        rig: &Rig,
        plan: &Plan,
    ) -> Result<Box<dyn Prepared + 'a>, RenderError> {
        let grey = Plan { halftone: Halftone::Grey, ..*plan };
        let slices = dark_turn(rig, &grey)?;
        let grey = renderer.prepare(scene, rig, &grey)?;
        Ok(Box::new(Self { grey, rig: rig.clone(), halftone: plan.halftone, slices }))
    }
}

impl Prepared for SecondPass<'_> {
    fn render(&mut self, wanted: Wanted<'_>, turn: &mut Turn) -> Result<(), RenderError> {
        let read = match self.halftone {
            Halftone::SightLine => slices_read(&self.rig, wanted.slices),
            _ => wanted.slices.to_vec(),
        };
        self.grey.render(Wanted { slices: &read, ..wanted }, &mut self.slices)?;
        let binary = halftone_slices(&self.slices, &self.rig, self.halftone, wanted.number, wanted.slices, &|| ());
        for slice in wanted.slices {
            turn.slice_mut(*slice).copy_from_slice(binary.slice(*slice));
        }
        Ok(())
    }
}
