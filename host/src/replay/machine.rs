//! A simulated controller that is given a recording's orders at their times.

use super::ReplayError;
use crate::link::sim::{Action, Cable, Clock, Endpoint, Injector, Shared, SimConnect, SimLink, Simulated};
use crate::link::{Connect, Link};
use crate::recording::Controller;
use crate::stream::{Stream, StreamError, TurnPlanes};
use protocol::codec::ImageSize;
use protocol::message::{Command, State};
use protocol::rig::Rig;
use serde_json::Value;
use std::sync::Arc;
use std::time::Duration;

/// How long a mirror that was turning when the recording began may take to turn here.
const LOCK_MAX: Duration = Duration::from_secs(120);
/// How long a status is waited for.
const LISTEN: Duration = Duration::from_millis(10);
/// A turn for which there is no room is let go after so long.
const ROOM: Duration = Duration::from_millis(200);

type Way = SimConnect<Box<dyn Endpoint + Send>>;

/// The controller.
pub(super) struct Machine {
    rig: Arc<Rig>,
    size: ImageSize,
    way: Way,
    stream: Stream<SimLink<Shared<Box<dyn Endpoint + Send>>>>,
    injector: Injector,
    /// The controller's time at which the recording began.
    zero: Duration,
    did: Vec<(f64, Controller)>,
    shown_before: Option<u32>,
    shown: u32,
}

impl Machine {
    /// One that nobody has started.
    pub(super) fn new(rig: Arc<Rig>, size: ImageSize, seed: u64, by_video: bool) -> Result<Self, ReplayError> {
        let injector = Injector::default();
        let simulated = Simulated::new(Rig::clone(&rig), seed, Clock::Simulated);
        let simulated = Simulated { injector: injector.clone(), by_video, ..simulated };
        let mut way = simulated.connect_by(Cable::None)?;
        let stream = Stream::new(way.connect()?, &rig.rotation(), size)?;
        let zero = stream.link().now();
        Ok(Self { rig, size, way, stream, injector, zero, did: Vec::new(), shown_before: None, shown: 0 })
    }

    /// Brings it to where a controller was that did `state` when the recording began, which is now. Whether that was on the way to its speed,
    /// where this one has the whole way before it.
    pub(super) fn begin(&mut self, state: &str) -> Result<bool, ReplayError> {
        let is = |states: &[State]| states.iter().any(|one| one.name() == state);
        let is_on_the_way = is(&[State::SpinUp, State::Acquire]);
        if is_on_the_way || is(&[State::Locked, State::Holdover]) {
            self.command(Command::Start)?;
        }
        if is(&[State::Locked, State::Holdover]) {
            self.run_on(|did| did.last().is_some_and(|(_, what)| what.state.as_deref() == Some(State::Locked.name())))?;
        }
        if is_on_the_way {
            self.run_on(|did| did.last().is_some_and(|(_, what)| what.state.as_deref() != Some(State::Idle.name())))?;
        }
        self.zero = self.stream.link().now();
        let last = self.did.pop();
        self.did = last.map(|(_, what)| (0.0, what)).into_iter().collect();
        Ok(is_on_the_way)
    }

    /// Lets time go on until it has done enough, at most for [`LOCK_MAX`].
    pub(super) fn run_on(&mut self, is_enough: impl Fn(&[(f64, Controller)]) -> bool) -> Result<(), ReplayError> {
        let until = self.stream.link().now() + LOCK_MAX;
        while !is_enough(&self.did) && self.stream.link().now() < until {
            self.listen(LISTEN)?;
        }
        Ok(())
    }

    /// Lets time go on until `at_s` of the recording.
    pub(super) fn run_until(&mut self, at_s: f64) -> Result<(), ReplayError> {
        let until = self.zero + Duration::from_secs_f64(at_s);
        loop {
            let left = until.saturating_sub(self.stream.link().now());
            if left.is_zero() {
                return Ok(());
            }
            self.listen(left.min(LISTEN))?;
        }
    }

    /// Gives it an order at `at_s`.
    pub(super) fn order(&mut self, at_s: f64, order: Command) -> Result<(), ReplayError> {
        self.run_until(at_s)?;
        self.command(order)
    }

    /// Lets something happen to it at `at_s`.
    pub(super) fn act(&mut self, at_s: f64, action: &Value) -> Result<(), ReplayError> {
        self.run_until(at_s)?;
        // What another program knows need not be known here.
        if let Ok(action) = serde_json::from_value::<Action>(action.clone()) {
            self.injector.inject(action);
        }
        Ok(())
    }

    /// Gives it a turn at `at_s`; one for which there is no room is let go.
    pub(super) fn send(&mut self, at_s: f64, planes: &impl TurnPlanes) -> Result<(), ReplayError> {
        self.run_until(at_s)?;
        let until = self.stream.link().now() + ROOM;
        let sent = self.stream.submit_unless(planes, |now| now > until).map(drop);
        self.note();
        self.cope(sent)
    }

    /// What it did, and when.
    pub(super) fn did(&self) -> &[(f64, Controller)] {
        &self.did
    }

    /// Turns that came on screen.
    pub(super) fn shown(&self) -> u64 {
        u64::from(self.shown.saturating_sub(self.shown_before.unwrap_or(0)))
    }

    fn command(&mut self, order: Command) -> Result<(), ReplayError> {
        let outcome = self.stream.command(order);
        self.note();
        self.cope(outcome)
    }

    fn listen(&mut self, wait: Duration) -> Result<(), ReplayError> {
        let heard = self.stream.poll(wait).map(drop);
        self.note();
        self.cope(heard)
    }

    /// Orders that are refused were so before; a plug that was pulled comes back.
    fn cope(&mut self, outcome: Result<(), StreamError>) -> Result<(), ReplayError> {
        match outcome {
            Err(StreamError::Link(_)) => {
                self.way.wait(LISTEN);
                if let Ok(link) = self.way.connect() {
                    self.stream = Stream::new(link, &self.rig.rotation(), self.size)?;
                }
                Ok(())
            }
            _ => Ok(()),
        }
    }

    fn note(&mut self) {
        let Some(status) = self.stream.status().copied() else { return };
        self.shown_before.get_or_insert(status.turns_shown);
        self.shown = status.turns_shown;
        let cause = self.stream.faults().map(|faults| faults.cause().to_string()).unwrap_or_default();
        let now = Controller::of(&status, &cause);
        if self.did.last().is_none_or(|(_, last)| *last != now) {
            let at_s = self.stream.link().now().saturating_sub(self.zero).as_secs_f64();
            self.did.push((at_s, now));
        }
    }
}
