//! One head: a Kalman filter of constant velocity, its prediction, and a gate for what no head does.
//!
//! The model: acceleration is white noise of [`RESTLESSNESS`], a reading has noise of [`NOISE_M`] on each axis; all three axes share one
//! covariance. A prediction's velocity fades by [`FADE_S`], as people stop and turn round, and counts the less the more it may be noise:
//! who stands still stays still. All times come from outside.
//!
//! Chosen by measurement (`cargo test -p host --lib -- tracking::filter::compare --nocapture`): millimetres RMS between a head's
//! predicted and its real place, the mean over readings at 30, 60 and 240 Hz and predictions 60, 100 and 150 ms ahead. *Walking* circles the
//! display at 0.8 m/s, stops, and turns round, *nodding* nods, looks aside and stoops, *standing* sways.
//!
//! | mm RMS | walking, 1 mm of noise | 5 mm | nodding, 1 mm | 5 mm | standing, 1 mm | 5 mm | mean |
//! |---|---|---|---|---|---|---|---|
//! | the last reading | 80.7 | 81.2 | 30.1 | 31.3 | 2.0 | 8.7 | 39.0 |
//! | one-euro | 85.6 | 85.9 | 33.9 | 34.0 | 1.6 | 3.3 | 40.7 |
//! | one-euro and its velocity | 55.1 | 56.3 | 40.7 | 41.7 | 5.5 | 11.4 | 35.1 |
//! | alpha-beta, 0.3 and 0.04 | 33.2 | 35.5 | 30.2 | 32.6 | 2.0 | 9.2 | 23.8 |
//! | this | 22.1 | 25.6 | 17.7 | 20.3 | 1.4 | 7.6 | 15.8 |

use glam::DVec3;
use serde::{Deserialize, Serialize};
use std::time::Duration;
use thiserror::Error;

/// Acceleration's power density, m²/s³: a person who walks, nods and stoops, traded against the tracker's noise.
const RESTLESSNESS: f64 = 0.1;
/// A reading's noise on each axis, metres: magnetic trackers and good cameras have 1 mm, poor ones 5 mm.
const NOISE_M: f64 = 3e-3;
/// A predicted velocity falls to 1/e in so many seconds.
const FADE_S: f64 = 0.5;
/// A velocity v of variance σ² an axis counts as v v² / (v² + 8 σ²): of noise alone, whose v² is 3 σ², a quarter is left.
const DOUBT: f64 = 8.0;
/// What velocity somebody may have who appears, m/s.
const FIRST_SPEED: f64 = 0.5;
/// A head moves no faster, m/s: running is 3, and a nod adds 1.
const SPEED_MAX: f64 = 4.0;
/// And a reading errs no more, metres.
const ERROR_MAX_M: f64 = 0.1;
/// So many readings in a row that agree with each other and not with the head's path are where it really is.
const STRAYS_MAX: u32 = 5;

/// Why a reading is not taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum Refused {
    /// Not later than the one before.
    #[error("its time is not later than the last one's")]
    Backwards,
    /// Farther than a head goes in the time.
    #[error("it is farther away than a head goes meanwhile")]
    Jump,
}

/// A head's path so far.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Filter {
    at: Duration,
    position: DVec3,
    velocity: DVec3,
    /// Of position, of both, of velocity: m², m²/s, m²/s².
    covariance: [f64; 3],
    stray: Option<Stray>,
}

/// Readings that agree with each other only.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
struct Stray {
    at: Duration,
    position: DVec3,
    count: u32,
}

impl Filter {
    /// A head that appears at `position` (metres) at `at`.
    pub fn new(position: DVec3, at: Duration) -> Self {
        let covariance = [NOISE_M * NOISE_M, 0.0, FIRST_SPEED * FIRST_SPEED];
        Self { at, position, velocity: DVec3::ZERO, covariance, stray: None }
    }

    /// When the last reading was taken.
    pub fn at(&self) -> Duration {
        self.at
    }

    /// Takes a reading of `position` (metres) at `at`, or says why not. After [`STRAYS_MAX`] jumps in a row that agree with each
    /// other the path begins anew there.
    pub fn take(&mut self, position: DVec3, at: Duration) -> Result<(), Refused> {
        let step = at.checked_sub(self.at).filter(|step| !step.is_zero()).ok_or(Refused::Backwards)?.as_secs_f64();
        if position.distance(self.moved(step)) > ERROR_MAX_M + SPEED_MAX * step {
            return self.stray(position, at);
        }
        self.stray = None;
        self.advance(step);
        let [pp, pv, vv] = self.covariance;
        let variance = pp + NOISE_M * NOISE_M;
        let [gain, velocity_gain] = [pp / variance, pv / variance];
        let innovation = position - self.position;
        self.position += gain * innovation;
        self.velocity += velocity_gain * innovation;
        self.covariance = [pp * (1.0 - gain), pv * (1.0 - gain), vv - velocity_gain * pv];
        self.at = at;
        Ok(())
    }

    fn stray(&mut self, position: DVec3, at: Duration) -> Result<(), Refused> {
        let agrees = |last: &Stray| {
            let step = at.checked_sub(last.at).filter(|step| !step.is_zero())?.as_secs_f64();
            (position.distance(last.position) <= ERROR_MAX_M + SPEED_MAX * step).then_some(last.count + 1)
        };
        let count = self.stray.as_ref().and_then(agrees).unwrap_or(1);
        if count >= STRAYS_MAX {
            *self = Self::new(position, at);
            return Ok(());
        }
        self.stray = Some(Stray { at, position, count });
        Err(Refused::Jump)
    }

    /// Position and covariance `step` seconds later.
    fn advance(&mut self, step: f64) {
        let [pp, pv, vv] = self.covariance;
        self.position += self.velocity * step;
        self.covariance = [
            pp + 2.0 * step * pv + step * step * vv + RESTLESSNESS * step.powi(3) / 3.0,
            pv + step * vv + RESTLESSNESS * step * step / 2.0,
            vv + RESTLESSNESS * step,
        ];
    }

    /// The place `step` seconds after the last reading, the velocity fading.
    fn moved(&self, step: f64) -> DVec3 {
        let square = self.velocity.length_squared();
        let trust = square / (square + DOUBT * self.covariance[2]);
        self.position + self.velocity * trust * FADE_S * -(-step / FADE_S).exp_m1()
    }

    /// Where the head is at `at`, metres; for a time before the last reading, where that left it.
    pub fn predicted(&self, at: Duration) -> DVec3 {
        self.moved(at.saturating_sub(self.at).as_secs_f64())
    }
}

#[cfg(test)]
mod compare;
#[cfg(test)]
mod tests;
