//! The cuts of the scene on stage, kept while it stands still or turns about the axis, and whoever looks at it.

use super::stage::{Stage, turned_deg};
use super::wish::{Animation, Transform, Wish};
use crate::render::RenderError;
use crate::render::bow::reach_m;
use crate::render::plan::Plan;
use crate::render::precut::Precut;
use crate::scene::ShadedScene;
use protocol::rig::{Rig, TrackedViewer};

/// Edges are cut for viewers on a grid of so many metres of distance and height: bows hardly change within it.
const GRID_M: f64 = 0.1;
/// After viewers in so many places edges are cut anew: pieces become no fewer when somebody goes.
const PLACES_MAX: usize = 24;
/// What lies beyond the reach of sight lines is left out; so much farther it is not, so that somebody may step back.
const STEP_BACK: f64 = 1.5;

/// What was cut.
#[derive(Default)]
pub struct Cuts {
    of: Option<(Transform, Plan)>,
    cut: Option<Precut>,
}

impl Cuts {
    /// Another scene is on stage.
    pub fn clear(&mut self) {
        *self = Self::default();
    }

    /// The pieces of `lit`, which is the scene on `stage` in turn `number` as `wish` has it, seen on `rig`, and the plan by which they are
    /// drawn. The scene and `plan` themselves where it moves otherwise, or is rendered so for the first time: somebody may be dragging it
    /// about.
    pub fn of(
        &mut self,
        lit: ShadedScene,
        (stage, wish, number): (&Stage, &Wish, u64),
        rig: &Rig,
        plan: &Plan,
    ) -> Result<(ShadedScene, Plan), RenderError> {
        let plan_of_cuts = Plan { halftone: Plan::default().halftone, ..*plan };
        let of = Some((wish.transform, plan_of_cuts));
        if self.of != of {
            *self = Self { of, cut: None };
            return Ok((lit, *plan));
        }
        if !turns_about_the_axis(wish) {
            return Ok((lit, *plan));
        }
        let circles = circles(rig);
        let reach_m = circles.iter().map(reach_m).fold(0.0, f64::max);
        let is_of_use = |cut: &Precut| cut.refinements() <= PLACES_MAX && reach_m <= cut.reach_m();
        if !self.cut.as_ref().is_some_and(is_of_use) {
            self.cut = Precut::new(&stage.at_rest(&wish.transform), &plan_of_cuts, STEP_BACK * reach_m);
        }
        let Some(cut) = &mut self.cut else { return Ok((lit, *plan)) };
        circles.iter().try_for_each(|circle| cut.refine(circle))?;
        let pieces = cut.of(&lit, turned_deg(&wish.animation, number).to_radians());
        Ok((pieces, Plan { halftone: plan.halftone, ..cut.plan() }))
    }
}

fn turns_about_the_axis(wish: &Wish) -> bool {
    let Transform { move_m: [right, _, front], .. } = wish.transform;
    match wish.animation {
        Animation::Still => true,
        Animation::Spin { .. } => [right, front] == [0.0; 2],
        Animation::Clip { .. } => false,
    }
}

/// `rig` with nobody tracked, and with a circle through each viewer in their stead, on the grid.
fn circles(rig: &Rig) -> Vec<Rig> {
    let mut rest = rig.clone();
    rest.viewing.tracked.clear();
    let through = |[distance_m, height_m]: [f64; 2]| {
        let mut circle = rest.clone();
        (circle.viewing.distance_m, circle.viewing.height_m) = (Some(distance_m), Some(height_m));
        circle.checked().ok()
    };
    let of = |viewer: &TrackedViewer| {
        let exact = [viewer.distance_m, viewer.height_m];
        through(exact.map(|metres| (metres / GRID_M).round() * GRID_M)).or_else(|| through(exact))
    };
    std::iter::once(rest.clone()).chain(rig.viewing.tracked.iter().filter_map(of)).collect()
}
