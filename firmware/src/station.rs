//! What a board's control task does with what its interrupts queued: time without wraps, safety inputs first, one step after the other.

use crate::config::Config;
use crate::controller::{Controller, Input, Output};
use crate::conversation::{Report, Request};
use crate::fault_log::FaultLog;
use crate::plane_store::TurnHandle;
use crate::safety::Levels;
use crate::sequencer::Frame;
use crate::time_base::TimeBase;
use core::num::NonZeroU32;
use protocol::message::State;
use protocol::timing::Rotation;
use protocol::units::Nanos;

/// Something that happened. A capture is the time base's count at the edge itself.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Event {
    /// The control timer fired, with the encoder at this count.
    Tick(u32),
    /// The index, captured.
    Index(u32),
    /// A frame pulse, captured.
    Frame(u32),
    /// A plane pulse, captured.
    Plane(u32),
    /// The host wants something.
    Request(Request),
}

/// The controller between a board's queue and its lines.
#[derive(Clone, Debug)]
pub struct Station {
    time: TimeBase,
    figures: fn(Rotation) -> Config,
    controller: Controller,
    levels: Levels,
    output: Output,
    /// Whether the controller took the rotation that the host configured last.
    matches_host: bool,
    on_screen: Option<TurnHandle>,
    turns_shown: u32,
}

impl Station {
    /// Around `controller`, which `figures` was asked for. The time base counts up `hz` times a second.
    pub fn new(controller: Controller, figures: fn(Rotation) -> Config, hz: NonZeroU32) -> Self {
        Self {
            time: TimeBase::new(hz),
            figures,
            controller,
            levels: Levels::default(),
            output: Output::default(),
            matches_host: true,
            on_screen: None,
            turns_shown: 0,
        }
    }

    /// Takes `event`, which was queued when the time base showed `count`, or the news that a safety input changed. `levels` are looked
    /// at with every event: a change that woke nobody is seen at the next tick. Each output, two at most, is to
    /// be obeyed in order, after the log that comes with it has been kept.
    pub fn take(&mut self, count: u32, event: Option<Event>, levels: Levels, mut obey: impl FnMut(&Output, &FaultLog)) {
        let now = self.time.advance(count);
        if levels != core::mem::replace(&mut self.levels, levels) {
            let output = self.step(now, Input::Levels(levels));
            obey(&output, self.faults());
        }
        let input = match event {
            None => return,
            Some(Event::Tick(encoder_count)) => Input::Tick { encoder_count },
            Some(Event::Index(count)) => Input::IndexPulse { at: self.time.stamp(count) },
            Some(Event::Frame(count)) => Input::FramePulse { at: self.time.stamp(count) },
            Some(Event::Plane(count)) => Input::PlanePulse { at: self.time.stamp(count) },
            Some(Event::Request(Request::Command(command))) => Input::Command(command),
            Some(Event::Request(Request::TurnReady(turn))) if self.matches_host => Input::TurnReady(turn),
            Some(Event::Request(Request::TurnReady(turn))) => {
                // Cut for another rotation than the controller's: given back unseen.
                obey(&Output { released: [Some(turn), None], armed: None, ..self.output }, self.faults());
                return;
            }
            Some(Event::Request(Request::Configured(rotation, _))) => return self.configure(rotation),
        };
        let output = self.step(now, input);
        obey(&output, self.faults());
    }

    /// How the controller does.
    pub fn report(&self) -> Report {
        let (estimates, slices) = (self.controller.estimates(), self.controller.config().rotation.slices());
        let report = Report::new(self.output.state, self.output.fault, &estimates, slices);
        Report { on_screen: self.on_screen, turns_shown: self.turns_shown, ..report }
    }

    /// Faults so far, also of before a reset.
    pub fn faults(&self) -> &FaultLog {
        self.controller.faults()
    }

    /// What the controller was built with.
    pub fn config(&self) -> &Config {
        self.controller.config()
    }

    /// Another rotation needs another controller. None is put aside while it drives or lights, or holds a fault.
    fn configure(&mut self, rotation: Rotation) {
        let wanted = rotation != self.config().rotation && self.output.state == State::Idle;
        if let Some(Ok(controller)) = wanted.then(|| Controller::after_reset((self.figures)(rotation), *self.faults()))
        {
            // No safety input is active, or the old one would not be idle: there is nothing to tell the new one.
            (self.controller, self.on_screen) = (controller, None);
        }
        self.matches_host = rotation == self.config().rotation;
    }

    fn step(&mut self, now: Nanos, input: Input) -> Output {
        self.output = self.controller.step(now, input);
        let on_screen = match self.output.armed {
            Some(Frame::Slices { turn, .. } | Frame::Still { turn, .. }) => Some(turn),
            Some(Frame::Dark) => None,
            None => self.on_screen,
        };
        if on_screen != core::mem::replace(&mut self.on_screen, on_screen) {
            self.turns_shown = self.turns_shown.saturating_add(on_screen.is_some().into());
        }
        self.output
    }
}

#[cfg(test)]
#[path = "station_tests.rs"]
mod tests;
