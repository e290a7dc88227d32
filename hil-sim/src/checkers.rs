//! What must hold of every plane that is shown. Apart from what they check: they see light, true angles and the rig, nothing else.

use firmware::plane_store::{Plane, TurnHandle};
use protocol::message::State;
use protocol::timing::{Direction, Rotation};
use protocol::units::Nanos;
use serde::Serialize;
use std::f64::consts::TAU;

/// A plane, or the lit part of one, as it really was.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Flash {
    /// When light began.
    pub start: Nanos,
    /// When it ended.
    pub end: Nanos,
    /// The true mirror angle when it began, radians counter-clockwise, unwrapped.
    pub angle_start: f64,
    /// The true mirror angle when it ended.
    pub angle_end: f64,
    /// What was shown; never dark.
    pub plane: Plane,
    /// What the controller said that it was doing.
    pub state: State,
}

/// What the checkers found.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Verdict {
    /// Planes, or parts of planes, that were lit.
    pub lit: u64,
    /// More than half a slice from where they belong.
    pub misplaced: u64,
    /// The farthest from where it belongs, slices.
    pub farthest_slices: f64,
    /// Lit in a state that forbids it.
    pub forbidden: u64,
    /// Rotations with slices of two turns, or whose turn changed elsewhere than at slice 0.
    pub torn: u64,
    /// Slices shown twice in a rotation, or in a wrong order.
    pub disordered: u64,
    /// The first thing that was wrong.
    pub first: Option<String>,
}

impl Verdict {
    /// Whether nothing was wrong.
    pub fn is_clean(&self) -> bool {
        self.misplaced + self.forbidden + self.torn + self.disordered == 0
    }
}

/// By how much all planes are off where nothing measures the mirror: the mean over the first turn, turns in the rig's direction.
#[derive(Clone, Copy, Debug, Default)]
struct Phase {
    mean: f64,
    planes: u32,
    /// Lit before any whole plane was seen.
    parts: u32,
    /// By how much the picture is to be turned in the dark.
    shift: f64,
}

/// Sees every flash, in order.
#[derive(Clone, Debug)]
pub struct Checkers {
    rotation: Rotation,
    turn_ns: f64,
    verdict: Verdict,
    phase: Phase,
    last: Option<(Flash, TurnHandle, u16)>,
    shown_at: Vec<Option<Nanos>>,
}

/// How far a plane may be off.
const ALLOWED_SLICES: f64 = 0.5;

impl Checkers {
    /// For the rig `rotation`.
    pub fn new(rotation: &Rotation) -> Self {
        Self {
            rotation: *rotation,
            turn_ns: rotation.frame_nanos() as f64 * f64::from(rotation.frames()),
            verdict: Verdict::default(),
            phase: Phase::default(),
            last: None,
            shown_at: vec![None; rotation.slices() as usize],
        }
    }

    /// So far.
    pub fn verdict(&self) -> &Verdict {
        &self.verdict
    }

    /// The projector's rate was changed: a turn takes `turn_ns` from now on.
    pub fn set_turn_duration(&mut self, turn_ns: f64) {
        self.turn_ns = turn_ns;
    }

    /// The picture of a mirror that nothing measures is to be turned by so many turns in the rig's direction, when it is dark.
    pub fn turn_picture(&mut self, turns: f64) {
        self.phase.shift += turns;
    }

    /// The controller is in another state than [`State::OpenLoop`].
    pub fn out_of_open_loop(&mut self) {
        self.phase.mean += std::mem::take(&mut self.phase.shift);
    }

    /// The mirror was let go: where planes are to be in an open loop is found anew.
    pub fn forget_phase(&mut self) {
        self.phase = Phase::default();
    }

    /// By how much all planes are off in an open loop, turns in the rig's direction; `None` where no whole plane has been lit.
    pub fn phase(&self) -> Option<f64> {
        (self.phase.planes > 0).then_some(self.phase.mean)
    }

    /// Judges one flash.
    pub fn see(&mut self, flash: &Flash) {
        let Plane::Slice { turn, slice } = flash.plane else {
            return;
        };
        self.verdict.lit += 1;
        if !flash.state.may_light() {
            self.verdict.forbidden += 1;
            self.report(flash, &format!("lit in state {:?}", flash.state));
        }
        if u32::from(slice) >= self.rotation.slices() {
            self.verdict.disordered += 1;
            self.report(flash, "a slice that the rig does not have");
            return;
        }
        if flash.state == State::Service {
            self.last = None;
            return;
        }
        self.check_place(flash, slice);
        self.check_order(flash, turn, slice);
        self.last = Some((*flash, turn, slice));
        self.shown_at[usize::from(slice)] = Some(flash.start);
    }

    fn check_place(&mut self, flash: &Flash, slice: u16) {
        let sign = match self.rotation.direction() {
            Direction::CounterClockwise => 1.0,
            Direction::Clockwise => -1.0,
        };
        // A whole plane must be centred on the slice's middle; a part of one must lie within the slice. Both within the allowance.
        let slices = f64::from(self.rotation.slices());
        let middle = self.rotation.slice_middle(u32::from(slice)).radians();
        let whole = sign * (flash.angle_end - flash.angle_start) / TAU * slices > 0.99;
        if flash.state == State::OpenLoop {
            if whole && self.phase.planes < self.rotation.slices() {
                let turns = sign * (0.5 * (flash.angle_start + flash.angle_end) - middle) / TAU - self.phase.mean;
                self.phase.planes += 1;
                self.phase.mean += (turns - turns.round()) / f64::from(self.phase.planes);
            } else if self.phase.planes == 0 {
                // Light may begin within a plane; a turn of planes of which none moves on by a slice is a mirror that stands or drags.
                self.phase.parts += 1;
                if self.phase.parts > self.rotation.slices() {
                    self.verdict.misplaced += 1;
                    self.report(
                        flash,
                        &format!("slice {slice} is lit and the mirror does not turn by a slice a plane"),
                    );
                }
                return;
            }
        }
        let phase = if flash.state == State::OpenLoop { self.phase.mean } else { 0.0 };
        let from_middle = |angle: f64| {
            let turns = sign * (angle - middle) / TAU - phase;
            (turns - turns.round()) * slices
        };
        let (start, end) = (from_middle(flash.angle_start), from_middle(flash.angle_end));
        let off = (-0.5 - start).max(end - 0.5).max(0.0).max(if whole { (0.5 * (start + end)).abs() } else { 0.0 });
        self.verdict.farthest_slices = self.verdict.farthest_slices.max(off);
        if off > ALLOWED_SLICES {
            self.verdict.misplaced += 1;
            self.report(flash, &format!("slice {slice} is {off:.2} slices from where it belongs"));
        }
    }

    fn check_order(&mut self, flash: &Flash, turn: TurnHandle, slice: u16) {
        let Some((before, turn_before, slice_before)) = self.last else {
            if slice != 0 {
                self.verdict.torn += 1;
                self.report(flash, &format!("a turn begins at slice {slice}"));
            }
            return;
        };
        // Light may go off and on within a plane; then the parts follow each other within its duration.
        let plane_ns = self.turn_ns / f64::from(self.rotation.slices());
        let same_plane = slice == slice_before && (flash.start.signed_since(before.start) as f64) < 1.05 * plane_ns;
        let gap = flash.start.signed_since(before.start) as f64;
        let new_rotation = slice < slice_before || gap > 0.9 * self.turn_ns;
        if turn != turn_before && slice != 0 {
            self.verdict.torn += 1;
            self.report(flash, &format!("turn {turn:?} follows {turn_before:?} at slice {slice}"));
        } else if new_rotation && slice != 0 {
            self.verdict.torn += 1;
            self.report(flash, &format!("a rotation begins at slice {slice}, after slice {slice_before}"));
        }
        let again = self.shown_at[usize::from(slice)]
            .is_some_and(|at| (flash.start.signed_since(at) as f64) < 0.5 * self.turn_ns);
        if again && !same_plane {
            self.verdict.disordered += 1;
            self.report(flash, &format!("slice {slice} twice in a rotation"));
        }
    }

    fn report(&mut self, flash: &Flash, what: &str) {
        self.verdict.first.get_or_insert_with(|| format!("{:.6} s: {what}", flash.start.seconds()));
    }
}

#[cfg(test)]
#[path = "checkers_tests.rs"]
mod tests;
