//! What the index pulse tells.

use super::{
    ANGLE, DRAG, ECCENTRIC_COS, ECCENTRIC_SIN, GATE_SIGMAS, IMBALANCE_COS, IMBALANCE_SIN, Index, RotationEstimator,
    SPEED, YIELD, ZERO,
};
use crate::angle::{advanced, nanos_to_f32, radians_between, sin_cos};
use crate::covariance::Covariance;
use crate::single::{at_least, at_most};
use protocol::units::{Nanos, Turns};

/// Closer than this to where it was expected, an index pulse is believed whatever the estimate says: chance would put one of 300 here.
const NEAR_INDEX_RAD: f32 = 0.01;

/// So soon after an index that was believed another one is its echo.
const ECHO_RAD: f32 = 0.05;

/// Variances before anything is known: an eccentricity of a tenth of a degree, inertia off by a factor of two, drag by half, an imbalance
/// of 3 % of the torque.
const ECCENTRICITY: f32 = 4e-6;
const INERTIA: f32 = 0.3;
const DRAG_SHARE: f32 = 0.25;
const IMBALANCE_SHARE: f32 = 9e-4;
/// Beyond this squared ratio of an index's error to its sigma the model is doubted, by this factor at most.
const DOUBT_ABOVE: f32 = 4.0;
const DOUBT_MOST: f32 = 16.0;

impl RotationEstimator {
    pub(super) fn see_index(&mut self, at: Nanos) -> Index {
        let since_tick = nanos_to_f32(at.signed_since(self.tick_at).clamp(-20_000_000, 20_000_000)) * 1e-9;
        let moved = (self.speed + 0.5 * self.acceleration * since_tick) * since_tick;
        let angle = advanced(self.angle, moved);
        if !self.moving || !self.anchored {
            self.anchor(angle);
            return Index::Anchored;
        }
        if self.health.index_accepted > 0 && self.health.radians_since_index < ECHO_RAD {
            return Index::Refused;
        }
        let innovation = -radians_between(Turns::ZERO, angle);
        let jitter = self.noise.index_jitter_s * self.speed.abs();
        // A mirror that hardly moves jitters by the width of the index mark, not by its time.
        let noise = jitter * jitter + 1e-10 + self.shaking_rad * self.shaking_rad;
        let terms = [(ANGLE, 1.0), (SPEED, since_tick)];
        let (mut gain, mut variance) = self.covariance.seen_through(terms);
        let surprise = innovation * innovation;
        self.health.index_surprise = surprise / (variance + noise);
        let pushed = surprise > GATE_SIGMAS * GATE_SIGMAS * (variance + noise) + 4e-10;
        if pushed {
            // A pulse that means nothing hardly ever comes within a count of where the index is: this one is real, and something has
            // pushed the mirror since the last one.
            if innovation.abs() > NEAR_INDEX_RAD {
                return self.refuse_index(angle);
            }
            self.expect_push(surprise);
            (gain, variance) = self.covariance.seen_through(terms);
        }
        let total = variance + noise;
        self.health.index_scatter += 0.3 * (surprise - self.health.index_scatter);
        self.correct(&gain, innovation / total, 1.0 / total);
        self.health.index_refused = 0;
        self.health.contradicted = pushed;
        self.health.index_accepted = self.health.index_accepted.saturating_add(1);
        self.health.radians_since_index = 0.0;
        Index::Accepted
    }

    /// An index that came three sigmas from where the model had it says that the model is wrong and does not know it: all of it is less
    /// certain from now on, as much as explains the index, up to what any motor may be expected to be.
    ///
    /// With 500 counts at 5 turns a second, or with half the torque that was named, the first turns made the filter certain of an
    /// eccentricity that was wrong by 20 sigmas, while indices came 0.5 to 2 slices off; it was lit a slice off at last.
    ///
    /// At one speed an imbalance and an eccentricity look alike: doubted without bound, imbalance went to 60 % of the torque in half a minute after
    /// a push of 10 s, an eccentricity hid it, and the mirror, shaken by what was to balance it, was lit 0.6 slices off.
    pub fn doubt_model(&mut self) {
        let surprise = self.health.index_surprise / DOUBT_ABOVE;
        if surprise > 1.0 {
            let expected =
                [(ECCENTRIC_COS, ECCENTRICITY), (ECCENTRIC_SIN, ECCENTRICITY), (YIELD, INERTIA), (DRAG, DRAG_SHARE)];
            let room = expected.map(|(state, most)| most / at_least(self.covariance.variance(state), 1e-12));
            let most = room.into_iter().fold(DOUBT_MOST, at_most);
            let factor = at_least(at_most(surprise, most), 1.0);
            self.covariance.scale(factor);
            self.expect_imbalance();
        }
    }

    /// Where an imbalance is less certain than before anything was known, that is known still: it is measured to be none, by so much as makes it as
    /// certain as that.
    fn expect_imbalance(&mut self) {
        let expected = self.expected_imbalance();
        for (state, part) in [(IMBALANCE_COS, 0), (IMBALANCE_SIN, 1)] {
            let (gain, variance) = self.covariance.seen_through([(state, 1.0)]);
            if variance > 1.01 * expected {
                let share = (variance - expected) / (variance * variance);
                self.correct(&gain, -self.imbalance[part] * share, share);
            }
        }
    }

    /// The variance of an imbalance before anything is known, (rad/s²)².
    fn expected_imbalance(&self) -> f32 {
        IMBALANCE_SHARE * self.strength * self.strength
    }

    pub(super) fn refuse_index(&mut self, angle: Turns) -> Index {
        // A pulse that means nothing does not come at the same angle again.
        let off = radians_between(Turns::ZERO, angle);
        let consistent = radians_between(self.health.last_refused, angle).abs() < 0.05;
        self.health.last_refused = angle;
        self.health.index_refused = if consistent { self.health.index_refused + 1 } else { 1 };
        if self.health.index_refused >= 2 && off.abs() < 0.3 {
            // The estimate is surer of itself than it should be: the next index will be believed.
            self.covariance.widen(ANGLE, off * off);
            self.covariance.widen(ZERO, off * off);
            self.covariance.widen(SPEED, off * off);
        }
        if self.health.index_refused < 4 {
            return Index::Refused;
        }
        self.anchor(angle);
        Index::Anchored
    }

    /// The index is here: whatever the angle was called so far, it is 0.
    pub(super) fn anchor(&mut self, angle: Turns) {
        self.angle -= angle;
        self.encoder_zero += angle;
        (self.sine, self.cosine) = sin_cos(self.angle);
        self.health.index_refused = 0;
        self.health.contradicted = false;
        self.health.radians_since_index = 0.0;
        if !self.moving {
            return;
        }
        if !self.anchored {
            self.guess_inertia();
        }
        self.health.index_accepted = 0;
        self.health.index_scatter = self.count_rad * self.count_rad;
        self.anchored = true;
        self.eccentricity = [0.0; 2];
        self.imbalance = [0.0; 2];
        // What may be expected of any motor: friction off by half, inertia by a factor of two, an imbalance of 3 % of the torque, an
        // eccentricity of a tenth of a degree.
        let count = self.count_rad * self.count_rad;
        let brake = 0.5 * self.nominal_brake + 0.01 * self.strength;
        let imbalance = self.expected_imbalance();
        self.centre = [0.0; 2];
        self.covariance = Covariance::diagonal([
            1e-8,
            0.25,
            brake * brake,
            INERTIA,
            count,
            ECCENTRICITY,
            ECCENTRICITY,
            imbalance,
            imbalance,
            DRAG_SHARE,
        ]);
    }
}
