//! What may be seen of a world from outside.

use super::{Recording, Sample, World};
use crate::checkers::{Flash, Verdict};
use crate::statistics::LockStatistics;
use firmware::controller::Estimates;
use firmware::hosted::Screen;
use firmware::plane_store::TurnHandle;
use protocol::message::{Fault, Faults, State};
use protocol::timing::Rotation;
use protocol::units::Nanos;

impl World {
    /// What to keep from now on.
    pub fn record(&mut self, recording: Recording) {
        self.recording = recording;
    }

    /// Slots that may be filled again, in order, since the last call.
    pub fn take_released(&mut self) -> Vec<TurnHandle> {
        std::mem::take(&mut self.released)
    }

    /// Recorded flashes since the last call.
    pub fn take_flashes(&mut self) -> Vec<Flash> {
        self.flashes.drain(..).collect()
    }

    /// Recorded samples since the last call.
    pub fn take_samples(&mut self) -> Vec<Sample> {
        std::mem::take(&mut self.samples)
    }

    /// Simulated time.
    pub fn now(&self) -> Nanos {
        Nanos(self.now as u64)
    }

    /// What the controller says that it is doing.
    pub fn state(&self) -> State {
        self.output.state
    }

    /// Why the controller stopped.
    pub fn fault(&self) -> Option<Fault> {
        self.output.fault
    }

    /// Faults so far, with what was measured.
    pub fn faults(&self) -> Faults {
        self.core.faults()
    }

    /// What is armed, as the controller's host is told of it.
    pub fn screen(&self) -> Screen {
        self.screen
    }

    /// The controller's time.
    pub fn controller_time(&self) -> Nanos {
        self.stamp(self.now)
    }

    /// What the controller believes.
    pub fn estimates(&self) -> Estimates {
        self.core.estimates()
    }

    /// How a turn is cut.
    pub fn rotation(&self) -> &Rotation {
        &self.rotation
    }

    /// The true mirror angle, radians counter-clockwise, unwrapped.
    pub fn true_angle(&self) -> f64 {
        self.plant.angle()
    }

    /// The true speed, rad/s.
    pub fn true_speed(&self) -> f64 {
        self.plant.speed()
    }

    /// How far the pictures of a mirror that nothing measures are from where they belong, turns in the rig's direction; `None` until a turn
    /// has been lit.
    pub fn constant_phase(&self) -> Option<f64> {
        self.checkers.phase()
    }

    /// What was wrong so far with what was shown.
    pub fn verdict(&self) -> &Verdict {
        self.checkers.verdict()
    }

    /// What the run has been so far.
    pub fn statistics(&self) -> LockStatistics {
        self.collector.summary(self.now * 1e-9, self.checkers.verdict().clone())
    }
}
