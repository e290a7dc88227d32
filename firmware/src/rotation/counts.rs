//! What the encoder's count tells.

use super::{ANGLE, BRAKE, ECCENTRIC_COS, ECCENTRIC_SIN, GATE_SIGMAS, RotationEstimator, SPEED, ZERO};
use crate::angle::{advanced, radians_between};
use crate::probit::inverse_mills;
use crate::single::{at_least, at_most, nearest, root};
use core::f32::consts::TAU;
use protocol::units::Turns;

/// Turns in which the encoder may slip once. What looks like a second slip is a push: between two beats of counts and ticks nothing
/// tells one from the other.
const TURNS_BETWEEN_SLIPS: f32 = 2.0;

impl RotationEstimator {
    pub(super) fn see_count(&mut self, counts: i32, seconds: f32) {
        let (gain, variance) = self.covariance.seen_through([
            (ANGLE, 1.0),
            (ZERO, 1.0),
            (ECCENTRIC_COS, self.cosine),
            (ECCENTRIC_SIN, self.sine),
        ]);
        let eccentric = self.eccentricity[0] * self.cosine + self.eccentricity[1] * self.sine;
        let seen = advanced(self.angle + self.encoder_zero, eccentric);
        let count_start = self.count_start();
        let within = radians_between(count_start, seen);
        let half = 0.5 * self.count_rad;
        let total = variance + self.noise.edge_variance + self.shaking_variance;
        let sigma = root(total);
        let outside = (within - half).abs() - half;
        if outside > GATE_SIGMAS * sigma && outside > 0.25 * self.count_rad {
            self.health.contradicted = true;
            if self.health.radians_since_slip > TURNS_BETWEEN_SLIPS * TAU {
                self.refuse_count(within);
                return;
            }
            self.expect_push(outside * outside);
        }
        self.health.encoder_refused = 0;
        if variance > 0.09 * self.count_rad * self.count_rad {
            if counts != 0 {
                // Just after a slow count the mirror is near the edge that it passed, not in the middle between two.
                let passed = at_most(0.5 * self.speed.abs() * seconds, half);
                let place = if self.speed < 0.0 { self.count_rad - passed } else { passed };
                let total = variance + self.noise.count_variance + self.shaking_variance;
                self.correct(&gain, (place - within) / total, 1.0 / total);
            }
            return;
        }
        // The count says on which side of the nearest edge the mirror is. How far inside, in sigmas:
        let depth = -outside / sigma;
        if depth > 4.0 {
            self.health.ticks_outside = 0;
            return;
        }
        let lower = within < half;
        if counts == 0 && self.health.last_side == lower {
            // The same edge from the same side has the same error as before, and tells nothing new.
            return;
        }
        self.health.last_side = lower;
        let pull = inverse_mills(depth);
        let inward = if lower { 1.0 } else { -1.0 };
        self.correct(&gain, inward * pull / sigma, pull * (pull + depth) / total);
        self.notice_manoeuvre(depth);
    }

    /// Four surprising counts in a row are no noise.
    pub(super) fn notice_manoeuvre(&mut self, depth: f32) {
        self.health.ticks_outside = if depth < -3.0 { self.health.ticks_outside + 1 } else { 0 };
        if self.health.ticks_outside >= 4 {
            self.health.ticks_outside = 0;
            self.health.contradicted = true;
            let surprise = 0.02 * self.count_rad * self.count_rad;
            // While the index comes it will tell of a push soon, and more exactly; so this is rather a slip seen from its near end.
            if self.turns_since_index() < 2.0 {
                self.covariance.widen(ZERO, surprise);
            } else {
                self.expect_push(surprise);
            }
        }
    }

    /// Something that the model does not know has moved the mirror by the root of `surprise` since the last index: learn faster.
    pub(super) fn expect_push(&mut self, surprise: f32) {
        let seconds = (self.health.radians_since_index / at_least(self.speed.abs(), 0.1)).clamp(0.005, 0.2);
        let speed = surprise / (seconds * seconds);
        self.covariance.widen(ANGLE, surprise);
        self.covariance.widen(SPEED, 4.0 * speed);
        self.covariance.widen(BRAKE, 4.0 * speed / (seconds * seconds));
        self.covariance.widen(ZERO, 0.25 * surprise);
    }

    pub(super) fn refuse_count(&mut self, within: f32) {
        self.health.encoder_refused = self.health.encoder_refused.saturating_add(1);
        let half = 0.5 * self.count_rad;
        if self.health.encoder_refused == 8 {
            // No torque moves the mirror by a quarter of a count in a tick: counts were lost or added.
            let slipped = nearest((within - half) / self.count_rad);
            self.encoder_zero = advanced(self.encoder_zero, -slipped * self.count_rad);
            self.covariance.widen(ZERO, 0.1 * self.count_rad * self.count_rad);
            self.health.radians_since_slip = 0.0;
        }
    }

    /// The count within a turn after `counts` more. One turn more or less needs no division, of which a Cortex-M4 has none in 64 bits.
    pub(super) fn wrapped(&self, counts: i32) -> u32 {
        let per_turn = i64::from(self.counts_per_turn.max(1));
        let sum = i64::from(self.count_in_turn) + i64::from(counts);
        let wrapped = match sum {
            _ if sum < -per_turn || sum >= 2 * per_turn => sum.rem_euclid(per_turn),
            _ if sum < 0 => sum + per_turn,
            _ if sum >= per_turn => sum - per_turn,
            _ => sum,
        };
        wrapped as u32
    }

    /// Where the encoder says that the mirror at least is.
    pub(super) fn count_start(&self) -> Turns {
        Turns(((u64::from(self.count_in_turn) * self.count_scale) >> 32) as u32)
    }

    /// More counts than any mirror passes in that time are a glitch of the counter: taken as a slip, not as motion.
    pub(super) fn plausible(&mut self, counts: i32, seconds: f32) -> i32 {
        let most = 3.0 + 4.0 * self.speed_max * seconds / self.count_rad;
        if counts.unsigned_abs() as f32 <= most {
            return counts;
        }
        self.encoder_zero += Turns((i64::from(counts).wrapping_mul((self.count_scale >> 32) as i64)) as u32);
        0
    }
}
