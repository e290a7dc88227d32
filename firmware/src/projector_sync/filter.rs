//! The two-state Kalman filter itself: when the last edge was, and how long a frame lasts.

use crate::angle::nanos_to_f32;
use crate::single::{nearest, whole};
use protocol::units::Nanos;

/// Nanoseconds with a fraction: whole ones never lose digits, however long the controller runs.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Fine {
    whole: u64,
    rest: f32,
}

impl Fine {
    pub(super) fn at(at: Nanos) -> Self {
        Self { whole: at.0, rest: 0.0 }
    }

    pub(super) fn plus(self, nanos: u64, rest: f32) -> Self {
        let sum = self.rest + rest;
        let carried = nearest(sum);
        Self { whole: self.whole.wrapping_add(nanos).wrapping_add(whole(carried) as u64), rest: sum - carried }
    }

    /// `at - self` in nanoseconds.
    pub(super) fn until(self, at: Nanos) -> f32 {
        nanos_to_f32(at.0.wrapping_sub(self.whole) as i64) - self.rest
    }

    /// As a duration, in nanoseconds.
    pub(super) fn nanos(self) -> f32 {
        nanos_to_f32(self.whole as i64) + self.rest
    }
}

/// Its state.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Filter {
    pub(super) edge: Fine,
    pub(super) period: Fine,
    // Of (edge, period), in ns².
    pub(super) variance_edge: f32,
    pub(super) covariance: f32,
    pub(super) variance_period: f32,
}

impl Filter {
    /// One frame on; `wander_per_sqrt_s` is by what share the period wanders in a second.
    pub(super) fn next_frame(&mut self, wander_per_sqrt_s: f32) {
        let period_ns = self.period.nanos();
        let wander_ns = wander_per_sqrt_s * period_ns;
        self.edge = self.edge.plus(self.period.whole, self.period.rest);
        self.variance_edge += 2.0 * self.covariance + self.variance_period;
        self.covariance += self.variance_period;
        self.variance_period += wander_ns * wander_ns * period_ns * 1e-9;
    }

    /// An edge was seen `innovation` ns late; `variance` is what was to be expected of that.
    pub(super) fn correct(&mut self, innovation: f32, variance: f32) {
        let (gain_edge, gain_period) = (self.variance_edge / variance, self.covariance / variance);
        self.edge = self.edge.plus(0, gain_edge * innovation);
        self.period = self.period.plus(0, gain_period * innovation);
        self.variance_period -= gain_period * self.covariance;
        self.covariance *= 1.0 - gain_edge;
        self.variance_edge *= 1.0 - gain_edge;
    }
}
