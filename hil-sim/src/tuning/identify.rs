//! From a run to a motor's figures.
//!
//! In weak form: Newton's law is multiplied by a smooth window φ and integrated by parts, so that no count is differentiated:
//! ∫φ″θ = (1/J) ∫φτ - (c/J) - (v/J) ∫φω - (d/J) ∫φω² + ripple, cogging, imbalance and, of the disc, ∫φ″ of its eccentricity. All of it is
//! linear in what is sought but for the delay of τ, which is searched.

use super::Unidentifiable;
use super::experiment::{Recording, Told};
use super::regression::{Fit, Regression, dot};
use serde::Serialize;
use std::f64::consts::TAU;

/// A figure and its standard deviation, in the same unit.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Estimate {
    /// The figure.
    pub value: f64,
    /// Its standard deviation.
    pub sigma: f64,
}

/// A harmonic of the torque.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct HarmonicFound {
    /// Periods a turn.
    pub per_turn: u32,
    /// Whether its size is a share of the torque commanded; else it is N m.
    pub of_torque: bool,
    /// Its amplitude.
    pub size: Estimate,
}

/// What was identified.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Identified {
    /// Moment of inertia, kg m².
    pub inertia_kg_m2: Estimate,
    /// Friction at low speed, N m.
    pub coulomb_friction_nm: Estimate,
    /// Friction per speed, N m s.
    pub viscous_friction_nm_s: Estimate,
    /// Drag per speed squared, N m s².
    pub air_drag_nm_s2: Estimate,
    /// From a command to the start of its effect, seconds.
    pub command_delay_s: Estimate,
    /// The encoder's eccentricity, radians.
    pub eccentricity_rad: Estimate,
    /// Imbalance, N m.
    pub once_per_turn_nm: Estimate,
    /// Ripple and cogging that stand out, the strongest first.
    pub harmonics: Vec<HarmonicFound>,
}

/// The windows' length: long against counts, short against a turn at low speed.
const WINDOW_S: f64 = 0.08;
const STRIDES: usize = 8;
/// What is closer together in time errs together.
const CLUSTER_S: f64 = 0.5;
const DELAY_MAX_S: f64 = 8e-3;
const COGGING_MAX_PER_TURN: u32 = 48;
const RIPPLE_MAX_PER_TURN: u32 = 24;
const HARMONICS_MAX: usize = 6;
/// A harmonic stands out from here on, in standard deviations: of 70 candidates chance gives one above 4 in two hundred runs.
const STANDS_OUT: f64 = 5.0;

/// Columns of the base fit, in this order.
const YIELD: usize = 0;
const COULOMB: usize = 1;
const VISCOUS: usize = 2;
const DRAG: usize = 3;
const ECCENTRIC: usize = 4;
const IMBALANCE: usize = 6;
const DELAY: usize = 8;

/// The run cut into windows in which the mirror turns.
struct Windows<'a> {
    told: &'a Told,
    recording: &'a Recording,
    angles: Vec<f64>,
    speeds: Vec<f64>,
    starts: Vec<usize>,
    /// φ and its derivatives times a tick, at the ticks; φ between them.
    weights: [Vec<f64>; 3],
    between: Vec<f64>,
}

impl<'a> Windows<'a> {
    fn new(told: &'a Told, recording: &'a Recording) -> Self {
        let count_rad = TAU / f64::from(told.counts_per_turn);
        let angles: Vec<f64> = recording.counts.iter().map(|count| f64::from(*count) * count_rad).collect();
        let (length, last) = ((WINDOW_S * told.rate_hz) as usize, angles.len().saturating_sub(1));
        let reach = (0.02 * told.rate_hz) as usize;
        let speed = |tick: usize| {
            let (from, to) = (tick.saturating_sub(reach), (tick + reach).min(last));
            (angles[to] - angles[from]) * told.rate_hz / (to - from).max(1) as f64
        };
        let turns = |start: &usize| {
            (0..4).all(|quarter| {
                let from = start + quarter * length / 4;
                recording.counts[from + length / 4] > recording.counts[from]
            })
        };
        let starts = (0..angles.len().saturating_sub(length + 1)).step_by(length / STRIDES).filter(turns).collect();
        let (n, seconds) = (length as f64, length as f64 / told.rate_hz);
        let sample = |f: &dyn Fn(f64) -> f64, offset: f64, scale: f64| -> Vec<f64> {
            (0..=length).map(|i| f((i as f64 + offset) / n) * scale / n).collect()
        };
        let window = |x: f64| 140.0 * (x * (1.0 - x)).max(0.0).powi(3);
        let slope = |x: f64| 420.0 * (x * (1.0 - x)).powi(2) * (1.0 - 2.0 * x);
        let bend = |x: f64| 840.0 * x * (1.0 - x) * (1.0 - 5.0 * x + 5.0 * x * x);
        Self {
            speeds: (0..angles.len()).map(speed).collect(),
            weights: [
                sample(&window, 0.0, 1.0),
                sample(&slope, 0.0, 1.0 / seconds),
                sample(&bend, 0.0, 1.0 / (seconds * seconds)),
            ],
            between: sample(&window, 0.5, 1.0),
            told,
            recording,
            starts,
            angles,
        }
    }

    /// The integral of `samples`, one a tick, with each window.
    fn integrals(&self, weights: &[f64], samples: &[f64]) -> Vec<f64> {
        self.starts.iter().map(|&start| dot(weights, &samples[start..start + weights.len()])).collect()
    }

    /// The mean acceleration in the window at `start`. Angles are taken from the window's middle: a sum over ticks is no integral, and 1,000 rad
    /// times the difference would be 200 rad/s².
    fn acceleration(&self, start: usize) -> f64 {
        let bend = &self.weights[2];
        let angles = &self.angles[start..start + bend.len()];
        let middle = angles[bend.len() / 2];
        bend.iter().zip(angles).map(|(weight, angle)| weight * (angle - middle)).sum()
    }

    /// The torque that acts if commands act after `delay_s`: its mean in each tick.
    fn torques(&self, delay_s: f64) -> Vec<f64> {
        let ticks = delay_s * self.told.rate_hz;
        let (whole, part) = (ticks as usize, ticks.fract());
        let decay = (-TAU * self.told.torque_bandwidth_hz / self.told.rate_hz).exp();
        let commanded =
            |tick: usize, back: usize| tick.checked_sub(back).map_or(0.0, |at| self.recording.torques_nm[at]);
        let mut torque = 0.0;
        let mean = |tick: usize| {
            let input = (1.0 - part) * commanded(tick, whole) + part * commanded(tick, whole + 1);
            let before = torque;
            torque = input + (before - input) * decay;
            0.5 * (before + torque)
        };
        (0..self.angles.len()).map(mean).collect()
    }

    /// Cosine and sine of `per_turn` times the angle, times `of`, with each window.
    fn harmonic(&self, weights: &[f64], per_turn: u32, of: Option<&[f64]>) -> [Vec<f64>; 2] {
        let part = |wave: fn(f64) -> f64| {
            let samples: Vec<f64> = match of {
                None => self.angles.iter().map(|angle| wave(f64::from(per_turn) * angle)).collect(),
                Some(of) => {
                    self.angles.iter().zip(of).map(|(angle, of)| of * wave(f64::from(per_turn) * angle)).collect()
                }
            };
            self.integrals(weights, &samples)
        };
        [part(f64::cos), part(f64::sin)]
    }

    /// All but the delay and the harmonics.
    fn base(&self) -> Regression {
        let [window, slope, bend] = &self.weights;
        let squares: Vec<f64> = self.speeds.iter().map(|speed| -speed * speed).collect();
        let cluster = (CLUSTER_S * self.told.rate_hz) as usize;
        let mut columns = vec![
            Vec::new(),
            vec![-1.0; self.starts.len()],
            self.integrals(slope, &self.angles),
            self.integrals(window, &squares),
        ];
        columns.extend(self.harmonic(bend, 1, None));
        columns.extend(self.harmonic(window, 1, None));
        Regression {
            columns,
            target: self.starts.iter().map(|&start| self.acceleration(start)).collect(),
            cluster: self.starts.iter().map(|start| start / cluster).collect(),
        }
    }

    fn with_delay(&self, base: &Regression, delay_s: f64) -> Regression {
        let mut regression = base.clone();
        regression.columns[YIELD] = self.integrals(&self.between, &self.torques(delay_s));
        regression
    }

    /// The delay with the least squares: on a grid, then by thirds.
    fn find_delay(&self, base: &Regression) -> Option<f64> {
        let squares = |delay_s: f64| self.with_delay(base, delay_s).fit().map_or(f64::INFINITY, |fit| fit.squares());
        let step = DELAY_MAX_S / 16.0;
        let best = (0..=16).map(|i| f64::from(i) * step).min_by(|a, b| squares(*a).total_cmp(&squares(*b)))?;
        let (mut low, mut high) = ((best - step).max(0.0), best + step);
        while high - low > 2e-6 {
            let third = (high - low) / 3.0;
            if squares(low + third) < squares(high - third) { high -= third } else { low += third }
        }
        Some(0.5 * (low + high))
    }
}

/// Identifies the motor of `recording`.
pub fn identify(told: &Told, recording: &Recording) -> Result<Identified, Unidentifiable> {
    let windows = Windows::new(told, recording);
    let poor = Unidentifiable::Vague { what: "inertia" };
    if windows.starts.len() < 400 {
        return Err(Unidentifiable::NotTurning);
    }
    let base = windows.base();
    let delay_s = windows.find_delay(&base).ok_or(poor.clone())?;
    let mut regression = windows.with_delay(&base, delay_s);
    let first = regression.fit().ok_or(poor.clone())?;
    let nudge = 2e-5;
    let [later, sooner] = [delay_s + nudge, (delay_s - nudge).max(0.0)]
        .map(|delay_s| windows.integrals(&windows.between, &windows.torques(delay_s)));
    let per_second = first.coefficients[YIELD] / (delay_s + nudge - (delay_s - nudge).max(0.0));
    regression.columns.push(later.iter().zip(sooner).map(|(later, sooner)| per_second * (later - sooner)).collect());
    let harmonics = add_harmonics(&windows, &mut regression, delay_s);
    let fit = regression.fit().ok_or(poor.clone())?;
    let identified = figures(&fit, delay_s, &harmonics);
    let Estimate { value, sigma } = identified.inertia_kg_m2;
    if value > 0.0 && sigma < 0.1 * value { Ok(identified) } else { Err(poor) }
}

/// Adds the harmonics that stand out, the strongest first; returns them in the order of their columns.
fn add_harmonics(windows: &Windows<'_>, regression: &mut Regression, delay_s: f64) -> Vec<(u32, bool)> {
    let torques = windows.torques(delay_s);
    let cogging = (2..=COGGING_MAX_PER_TURN).map(|per_turn| (per_turn, false));
    let ripple = (1..=RIPPLE_MAX_PER_TURN).map(|per_turn| (per_turn, true));
    let columns_of = |(per_turn, of_torque): (u32, bool)| {
        windows.harmonic(&windows.weights[0], per_turn, of_torque.then_some(torques.as_slice()))
    };
    let candidates: Vec<_> = cogging.chain(ripple).map(|which| (which, columns_of(which))).collect();
    let mut found = Vec::new();
    while let Some(fit) = regression.fit().filter(|_| found.len() < HARMONICS_MAX) {
        let gain = |columns: &[Vec<f64>; 2]| -> f64 {
            columns.iter().map(|column| dot(column, &fit.residuals).powi(2) / dot(column, column).max(1e-30)).sum()
        };
        let rest = candidates.iter().filter(|(which, _)| !found.contains(which));
        let Some((which, columns)) = rest.max_by(|a, b| gain(&a.1).total_cmp(&gain(&b.1))) else { break };
        regression.columns.extend(columns.iter().cloned());
        let stands_out = regression.fit().is_some_and(|fit| {
            let (size, sigma) = fit.size(regression.columns.len() - 2);
            size > STANDS_OUT * sigma
        });
        if !stands_out {
            regression.columns.truncate(regression.columns.len() - 2);
            break;
        }
        found.push(*which);
    }
    found
}

fn figures(fit: &Fit, delay_s: f64, harmonics: &[(u32, bool)]) -> Identified {
    let inertia = 1.0 / fit.coefficients[YIELD];
    let inertia_sigma = inertia * inertia * fit.covariance[YIELD][YIELD].sqrt();
    let torque = |column: usize| {
        let (value, sigma) = fit.ratio(column, YIELD);
        Estimate { value, sigma }
    };
    let size = |column: usize, factor: f64| {
        let (size, sigma) = fit.size(column);
        Estimate { value: size * factor, sigma: sigma * factor.abs() }
    };
    let found = harmonics.iter().enumerate().map(|(place, &(per_turn, of_torque))| HarmonicFound {
        per_turn,
        of_torque,
        size: size(DELAY + 1 + 2 * place, inertia),
    });
    Identified {
        inertia_kg_m2: Estimate { value: inertia, sigma: inertia_sigma },
        coulomb_friction_nm: torque(COULOMB),
        viscous_friction_nm_s: torque(VISCOUS),
        air_drag_nm_s2: torque(DRAG),
        command_delay_s: Estimate {
            value: (delay_s + fit.coefficients[DELAY]).max(0.0),
            sigma: fit.covariance[DELAY][DELAY].sqrt(),
        },
        eccentricity_rad: size(ECCENTRIC, 1.0),
        once_per_turn_nm: size(IMBALANCE, inertia),
        harmonics: found.collect(),
    }
}
