//! Planned ways of the phase error to zero, within an acceleration that the motor can give.

use crate::single::{at_least, floor, root};

/// A way from a phase error (radians, and its rate in rad/s) to zero at zero rate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Trajectory {
    /// At the rate that there is for a while, then constant acceleration until the speed is right, taken back linearly at the end.
    Landing {
        /// rad/s, as the way begins.
        rate: f32,
        /// rad/s², signed.
        acceleration: f32,
        /// How long the acceleration takes to fall to zero, seconds.
        ramp_s: f32,
        /// All of it, seconds.
        duration_s: f32,
    },
    /// A polynomial of fifth degree in time: acceleration starts and ends at zero.
    Glide {
        /// Coefficients of the powers 0 to 5 of time over duration, radians.
        coefficients: [f32; 6],
        /// All of it, seconds.
        duration_s: f32,
    },
}

/// Where a trajectory is at one time.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Waypoint {
    /// Phase error, radians, unwrapped.
    pub error: f32,
    /// Its rate, rad/s.
    pub rate: f32,
    /// Its acceleration, rad/s².
    pub acceleration: f32,
}

/// From full acceleration to none. Shorter saves nothing (half of it is lost time), longer lets the torque loop follow.
const RAMP_S: f32 = 0.015;

impl Trajectory {
    /// Plans a landing from `rate` (rad/s, negative when too slow) on one of the places that lie `spacing` radians apart, one of them
    /// `error` away. Uses at most `limit` (rad/s², positive). Returns the way, which starts at a multiple of `spacing` from `error`.
    /// `None` where the rate is too small to need one.
    pub fn landing(error: f32, rate: f32, spacing: f32, limit: f32) -> Option<Self> {
        if !(limit > 0.0 && rate.abs() > limit * RAMP_S) {
            return None;
        }
        // The phase that passes until the rate is zero: rate² / 2a + a ramp² / 24, against the sign of the rate.
        let shortest = rate * rate / (2.0 * limit) + limit * RAMP_S * RAMP_S / 24.0;
        let offered = if rate < 0.0 { error } else { -error };
        let excess = (offered - shortest) / spacing;
        // Passed at full rate the rest of the way takes half the time of an acceleration that is less by as much.
        let wait_s = (excess - floor(excess)) * spacing / rate.abs();
        let acceleration = if rate < 0.0 { limit } else { -limit };
        Some(Self::Landing {
            rate,
            acceleration,
            ramp_s: RAMP_S,
            duration_s: wait_s + rate.abs() / limit + 0.5 * RAMP_S,
        })
    }

    /// Plans a smooth way from (`error`, `rate`) to zero that asks for at most `limit` (rad/s²).
    pub fn glide(error: f32, rate: f32, limit: f32) -> Self {
        // Peaks of the second derivative: 5.774 error / duration² and 3.94 rate / duration; their sum bounds that of both.
        let (from_error, from_rate) = (5.774 * error.abs(), 3.94 * rate.abs());
        let root = root(from_rate * from_rate + 4.0 * limit * from_error);
        Self::glide_lasting(error, rate, ((from_rate + root) / (2.0 * limit)).clamp(0.02, 20.0))
    }

    /// A smooth way from (`error`, `rate`) to zero in `duration_s`, several turns long if `error` is; its rate peaks at 1.875 of the mean.
    pub fn excursion(error: f32, rate: f32, duration_s: f32) -> Self {
        Self::glide_lasting(error, rate, duration_s.clamp(0.02, 20.0))
    }

    fn glide_lasting(error: f32, rate: f32, duration_s: f32) -> Self {
        // p(0) = error, p'(0) = rate, p''(0) = 0; p, p', p'' are 0 at the end.
        let slope = rate * duration_s;
        let coefficients =
            [error, slope, 0.0, -10.0 * error - 6.0 * slope, 15.0 * error + 8.0 * slope, -6.0 * error - 3.0 * slope];
        Self::Glide { coefficients, duration_s }
    }

    /// All of it, seconds.
    pub fn duration_s(&self) -> f32 {
        match *self {
            Self::Landing { duration_s, .. } | Self::Glide { duration_s, .. } => duration_s,
        }
    }

    /// Where it is `elapsed_s` after its start; at rest at zero after its end.
    pub fn at(&self, elapsed_s: f32) -> Waypoint {
        let left = self.duration_s() - elapsed_s;
        if left <= 0.0 {
            return Waypoint::default();
        }
        match *self {
            Self::Landing { rate, acceleration, ramp_s, .. } if left >= ramp_s => {
                let wait_s = at_least(left - 0.5 * ramp_s + rate / acceleration, 0.0);
                let centre = left - 0.5 * ramp_s - wait_s;
                Waypoint {
                    error: 0.5 * acceleration * (centre * centre + ramp_s * ramp_s / 12.0) - rate * wait_s,
                    rate: -acceleration * centre,
                    acceleration: if wait_s > 0.0 { 0.0 } else { acceleration },
                }
            }
            Self::Landing { acceleration, ramp_s, .. } => {
                let part = left / ramp_s;
                Waypoint {
                    error: acceleration * part * left * left / 6.0,
                    rate: -0.5 * acceleration * part * left,
                    acceleration: acceleration * part,
                }
            }
            Self::Glide { coefficients: [c0, c1, c2, c3, c4, c5], duration_s } => {
                let t = at_least(elapsed_s, 0.0) / duration_s;
                let first = c1 + t * (2.0 * c2 + t * (3.0 * c3 + t * (4.0 * c4 + t * 5.0 * c5)));
                let second = 2.0 * c2 + t * (6.0 * c3 + t * (12.0 * c4 + t * 20.0 * c5));
                Waypoint {
                    error: c0 + t * (c1 + t * (c2 + t * (c3 + t * (c4 + t * c5)))),
                    rate: first / duration_s,
                    acceleration: second / (duration_s * duration_s),
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn is_consistent(way: &Trajectory) {
        let step = way.duration_s() * 1e-3;
        for i in 1..999 {
            let at = |offset: f32| way.at((i as f32 + offset) * step);
            let (before, here, after) = (at(-1.0), at(0.0), at(1.0));
            let scale = way.at(0.0).rate.abs() + way.at(0.0).error.abs() / way.duration_s();
            assert!(((after.error - before.error) / (2.0 * step) - here.rate).abs() < 0.01 * scale + 0.02);
            let change = (after.rate - before.rate) / (2.0 * step);
            let bend = (after.acceleration - before.acceleration).abs();
            let allowed = bend + 0.05 * scale / way.duration_s() + 0.5;
            assert!((change - here.acceleration).abs() < allowed, "{change} {here:?}");
        }
    }

    proptest! {
        #[test]
        fn a_landing_starts_here_and_ends_on_a_place(
            error in -3.0f32..3.0, rate in 5.0f32..200.0, fast: bool, spacing in 0.03f32..6.3, limit in 20.0f32..100.0,
        ) {
            let rate = if fast { rate } else { -rate };
            let way = Trajectory::landing(error, rate, spacing, limit).unwrap();
            let start = way.at(0.0);
            prop_assert!((start.rate - rate).abs() < 1e-3 * rate.abs());
            prop_assert!(start.acceleration.abs() <= limit * 1.001);
            let places = (start.error - error) / spacing;
            prop_assert!((places - places.round()).abs() * spacing < 1e-4 * start.error.abs() + 1e-4);
            prop_assert_eq!(way.at(way.duration_s()), Waypoint::default());
            is_consistent(&way);
        }

        #[test]
        fn a_glide_starts_here_and_keeps_the_limit(error in -3.0f32..3.0, rate in -3.0f32..3.0, limit in 20.0f32..100.0) {
            let way = Trajectory::glide(error, rate, limit);
            prop_assert_eq!(way.at(0.0).error, error);
            prop_assert!((way.at(0.0).rate - rate).abs() < 1e-4);
            for i in 0..100 {
                prop_assert!(way.at(way.duration_s() * i as f32 * 0.01).acceleration.abs() < 1.05 * limit);
            }
            is_consistent(&way);
        }
    }

    #[test]
    fn a_small_rate_needs_no_landing() {
        assert_eq!(Trajectory::landing(0.1, 0.5, 0.5, 80.0), None);
        assert_eq!(Trajectory::landing(0.1, 50.0, 0.5, f32::NAN), None);
    }
}
