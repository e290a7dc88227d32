//! The controller with its host: what the wire's requests come to, and what the host is told.

use crate::config::Config;
use crate::controller::{Controller, Input, Output};
use crate::conversation::{Report, Request};
use crate::fault_log::FaultLog;
use crate::plane_store::TurnHandle;
use crate::sequencer::Frame;
use protocol::message::State;
use protocol::timing::Rotation;
use protocol::units::Nanos;

/// What is armed, as a host is told of it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Screen {
    /// The turn on screen.
    pub turn: Option<TurnHandle>,
    /// How many came on screen.
    pub turns_shown: u32,
}

impl Screen {
    /// Takes what a step armed, if it did.
    pub fn take(&mut self, armed: Option<Frame>) {
        let turn = match armed {
            Some(Frame::Slices { turn, .. } | Frame::Still { turn, .. }) => Some(turn),
            Some(Frame::Dark) => None,
            None => return,
        };
        if turn != core::mem::replace(&mut self.turn, turn) {
            self.turns_shown = self.turns_shown.saturating_add(turn.is_some().into());
        }
    }
}

/// The figures of a machine for turns that are cut like this; `None` where it cannot be asked for others.
pub type Figures = fn(Rotation) -> Option<Config>;

/// The controller.
#[derive(Clone, Debug)]
pub struct Hosted {
    figures: Figures,
    controller: Controller,
    output: Output,
    screen: Screen,
    /// Whether the controller took the rotation that the host configured last.
    matches_host: bool,
}

impl Hosted {
    /// Around `controller`, which is replaced by one that `figures` gives where the host wants another rotation.
    pub fn new(controller: Controller, figures: Figures) -> Self {
        Self { figures, controller, output: Output::default(), screen: Screen::default(), matches_host: true }
    }

    /// Takes one input at `now`.
    pub fn step(&mut self, now: Nanos, input: Input) -> Output {
        self.output = self.controller.step(now, input);
        self.screen.take(self.output.armed);
        self.output
    }

    /// Does what the host wants at `now`; what to do then, if anything is to be done.
    pub fn request(&mut self, now: Nanos, request: Request) -> Option<Output> {
        match request {
            Request::Command(command) => Some(self.step(now, Input::Command(command))),
            Request::TurnReady(turn) if self.matches_host => Some(self.step(now, Input::TurnReady(turn))),
            Request::Vacate => Some(self.step(now, Input::Vacate)),
            // Cut for another rotation than the controller's: given back unseen.
            Request::TurnReady(turn) => Some(Output { released: [Some(turn), None], armed: None, ..self.output }),
            Request::Configured(rotation, _) => {
                self.configure(rotation);
                None
            }
        }
    }

    /// How the controller does.
    pub fn report(&self) -> Report {
        let (estimates, slices) = (self.controller.estimates(), self.config().rotation.slices());
        Report::new(self.output.state, self.output.fault, &estimates, slices, self.screen)
    }

    /// The controller.
    pub fn controller(&self) -> &Controller {
        &self.controller
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
        let figures = wanted.then(|| (self.figures)(rotation)).flatten();
        if let Some(Ok(controller)) = figures.map(|config| Controller::after_reset(config, *self.faults())) {
            // No safety input is active, or the old one would not be idle: there is nothing to tell the new one.
            (self.controller, self.screen.turn) = (controller, None);
        }
        self.matches_host = rotation == self.config().rotation;
    }
}
