//! What makes the daemon's turns, apart from clocks and threads: the same strokes in the same order make the same turns, so that what was
//! recorded can be painted again.

use super::cuts::Cuts;
use super::stage::Stage;
use super::telemetry::SeenViewer;
use super::wish::Wish;
use crate::halftoned::Halftoned;
use crate::pattern::{Pattern, draw};
use crate::render::live::slices_of_moved_viewers;
use crate::render::plan::{Halftone, Plan};
use crate::render::turn::Turn;
use crate::render::{RenderError, Renderer, Wanted, dark_turn};
use protocol::rig::{Rig, TrackedViewer};
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// Turns that may be in somebody's hands: on screen, waiting, being sent, in the mailbox, being painted.
const TURNS: usize = 6;

/// What makes a picture: the same key is the same picture.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", tag = "kind", content = "of")]
pub enum Key {
    /// Nothing.
    Dark,
    /// A test pattern.
    Pattern(Pattern),
    /// What is on the stage.
    Scene(Box<View>),
}

/// A scene at a moment, for those who look at it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct View {
    /// How it stands and moves, and its halftone.
    pub wish: Wish,
    /// Which of the stage's plans it is rendered by.
    pub rung: usize,
    /// The turn of the mirror for which it moves.
    pub moment: u64,
    /// Who is tracked.
    pub viewers: Vec<SeenViewer>,
}

impl View {
    /// Whether it is the same as `other` but for where viewers are.
    fn is_of_same_scene(&self, other: &Self) -> bool {
        (&self.wish, self.rung, self.moment) == (&other.wish, other.rung, other.moment)
    }
}

/// `rig` with these around it, beside whom its file has.
pub fn around(rig: &Rig, viewers: &[SeenViewer]) -> Rig {
    let mut rig = rig.clone();
    rig.viewing.tracked.extend(viewers.iter().map(TrackedViewer::from));
    rig
}

/// Slices that are rendered before the turn that shows them.
#[derive(Default)]
struct Ahead {
    turn: Option<Turn>,
    slices: Vec<u32>,
}

impl Ahead {
    fn of(&self, slice: u32) -> Option<&[u8]> {
        self.slices.binary_search(&slice).is_ok().then_some(self.turn.as_ref())?.map(|turn| turn.slice(slice))
    }
}

/// A painter at work.
pub struct Painter {
    rig: Arc<Rig>,
    renderer: Box<dyn Renderer>,
    stage: Option<Stage>,
    cuts: Cuts,
    turns: Vec<Arc<Turn>>,
    /// What was painted last.
    standing: Option<(Key, Arc<Turn>)>,
    ahead: Ahead,
}

impl Painter {
    /// Before an empty stage.
    pub fn new(rig: Arc<Rig>, renderer: Box<dyn Renderer>) -> Self {
        let (stage, cuts, turns, standing, ahead) = (None, Cuts::default(), Vec::new(), None, Ahead::default());
        Self { rig, renderer, stage, cuts, turns, standing, ahead }
    }

    /// What is on the stage.
    pub fn stage(&self) -> Option<&Stage> {
        self.stage.as_ref()
    }

    /// Something else is on the stage.
    pub fn set_stage(&mut self, stage: Stage) {
        self.stage = Some(stage);
        self.begin_anew();
    }

    /// Forgets what was painted: what follows depends on nothing before.
    pub fn begin_anew(&mut self) {
        self.cuts.clear();
        self.standing = None;
        self.ahead.slices.clear();
    }

    /// By what `view` is rendered; nothing where there is no stage.
    pub fn plan(&self, view: &View) -> Option<Plan> {
        let plans = &self.stage.as_ref()?.plans;
        let plan = plans[view.rung.min(plans.len() - 1)].plan;
        Some(Plan { halftone: view.wish.halftone, ..plan })
    }

    /// Whether the turn that was painted last is of the same wish as `view`: then slices of both may stand in a turn together.
    pub fn may_join(&self, view: &View) -> bool {
        matches!(&self.standing, Some((Key::Scene(last), _)) if last.wish == view.wish)
    }

    /// The slices that are other ones than in the turn that was painted last.
    pub fn changed(&self, key: &Key) -> Vec<u32> {
        if let (Key::Scene(view), Some((Key::Scene(last), _))) = (key, &self.standing)
            && view.is_of_same_scene(last)
            && let Some(plan) = self.plan(view)
        {
            return slices_of_moved_viewers(
                &around(&self.rig, &last.viewers),
                &around(&self.rig, &view.viewers),
                &plan,
            );
        }
        (0..self.rig.rotation.slices).collect()
    }

    /// A turn with those `slices` of a scene, in order, as `key` has them. The others are those rendered ahead, or else those of the
    /// turn before. Patterns are painted whole.
    pub fn paint(&mut self, key: &Key, slices: &[u32]) -> Result<Halftoned<Arc<Turn>>, Failed> {
        let (turn, halftone) = match key {
            Key::Dark => {
                let plan = Plan { halftone: Halftone::BlueNoise, ..Plan::default() };
                (Arc::new(dark_turn(&self.rig, &plan)?), plan.halftone)
            }
            Key::Pattern(pattern) => (Arc::new(draw(&self.rig, *pattern)?), Halftone::BlueNoise),
            Key::Scene(view) => (self.paint_scene(view, slices)?, view.wish.halftone),
        };
        self.standing = Some((key.clone(), Arc::clone(&turn)));
        Ok(Halftoned { turn, halftone, number: 0 })
    }

    fn paint_scene(&mut self, view: &View, slices: &[u32]) -> Result<Arc<Turn>, Failed> {
        let plan = self.plan(view).ok_or_else(|| Failed("there is no scene".into()))?;
        let mut turn = self.spare_turn(&plan)?;
        let place = Arc::get_mut(&mut turn).ok_or_else(|| Failed("a turn in two hands".into()))?;
        if let Some((_, standing)) = &self.standing {
            for slice in (0..place.slices()).filter(|slice| slices.binary_search(slice).is_err()) {
                place.slice_mut(slice).copy_from_slice(self.ahead.of(slice).unwrap_or_else(|| standing.slice(slice)));
            }
        }
        self.render(view, slices, place)?;
        self.ahead.slices.clear();
        if self.turns.len() < TURNS {
            self.turns.push(Arc::clone(&turn));
        }
        Ok(turn)
    }

    /// Renders those `slices`, in order, for the next turn that is painted.
    pub fn paint_ahead(&mut self, view: &View, slices: &[u32]) -> Result<(), Failed> {
        let plan = self.plan(view).ok_or_else(|| Failed("there is no scene".into()))?;
        let mut turn = match self.ahead.turn.take() {
            Some(turn) => turn,
            None => dark_turn(&self.rig, &plan)?,
        };
        let rendered = self.render(view, slices, &mut turn);
        self.ahead.turn = Some(turn);
        rendered?;
        self.ahead.slices = slices.to_vec();
        Ok(())
    }

    fn render(&mut self, view: &View, slices: &[u32], place: &mut Turn) -> Result<(), Failed> {
        let stage = self.stage.as_ref().ok_or_else(|| Failed("there is no scene".into()))?;
        let plan = self.plan(view).ok_or_else(|| Failed("there is no scene".into()))?;
        let View { wish, moment, .. } = view;
        let clip = stage.clip(&wish.animation)?;
        let lit = stage.at(wish, clip, *moment, self.rig.turns_per_second())?;
        let rig = around(&self.rig, &view.viewers);
        let (pieces, drawn) = self.cuts.of(lit, (stage, wish, *moment), &rig, &plan)?;
        let wanted = Wanted { slices, number: 0, done: &|| () };
        Ok(self.renderer.prepare(&pieces, &rig, &drawn)?.render(wanted, place)?)
    }

    /// A turn that nobody has in hand any more, or another one.
    fn spare_turn(&mut self, plan: &Plan) -> Result<Arc<Turn>, RenderError> {
        let spare = self.turns.iter().position(|turn| Arc::strong_count(turn) == 1);
        match spare {
            Some(place) => Ok(self.turns.swap_remove(place)),
            None => Ok(Arc::new(dark_turn(&self.rig, plan)?)),
        }
    }
}

/// Why there is no picture.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Failed(pub String);

impl<E: std::error::Error> From<E> for Failed {
    fn from(error: E) -> Self {
        Self(error.to_string())
    }
}
