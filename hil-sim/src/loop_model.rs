//! The lock as a linear loop: plant, drive, observer and feedback at one frequency; its margins, and where it becomes unstable.
//!
//! Broken at the drive's input, where everything that no model knows acts. The plant is s⁻² (inertia divided out, friction fed forward), the
//! drive A = e^(-sT) / (1 + s lag) with half a tick of hold in T, the observer that of [`Observer`], the feedback F = (ω², 2ζω, 1) on its
//! angle, speed and disturbance. The observer knows its own commands through the same A, hence for an observer with characteristic D:
//! ℓ = s⁻² A F(y → x̂) / (1 + A F(u → x̂)).

use serde::Serialize;
use std::f64::consts::{PI, TAU};
use std::ops::{Add, Div, Mul};

/// The ratio to which a boundary is found.
const WITHIN: f64 = 1.0001;

/// A complex number, as much of one as a frequency response needs.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Complex {
    re: f64,
    im: f64,
}

impl Complex {
    const ONE: Self = Self { re: 1.0, im: 0.0 };

    fn polar(size: f64, angle: f64) -> Self {
        Self { re: size * angle.cos(), im: size * angle.sin() }
    }

    fn size(self) -> f64 {
        self.re.hypot(self.im)
    }

    fn angle(self) -> f64 {
        self.im.atan2(self.re)
    }

    fn times(self, factor: f64) -> Self {
        Self { re: self.re * factor, im: self.im * factor }
    }
}

impl Add for Complex {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self { re: self.re + other.re, im: self.im + other.im }
    }
}

impl Mul for Complex {
    type Output = Self;

    fn mul(self, other: Self) -> Self {
        Self { re: self.re * other.re - self.im * other.im, im: self.re * other.im + self.im * other.re }
    }
}

impl Div for Complex {
    type Output = Self;

    fn div(self, other: Self) -> Self {
        let square = other.re * other.re + other.im * other.im;
        (self * Self { re: other.re, im: -other.im }).times(1.0 / square)
    }
}

/// An observer of angle, speed and disturbance: by how much a second of one radian's innovation moves each (1/s, 1/s², 1/s³).
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Observer {
    /// Of the angle, 1/s.
    pub angle: f64,
    /// Of the speed, 1/s².
    pub speed: f64,
    /// Of the disturbance, 1/s³.
    pub disturbance: f64,
}

/// From a torque command to its effect.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Drive {
    /// The command's delay, seconds.
    pub delay_s: f64,
    /// The torque loop's lag, first order, seconds.
    pub lag_s: f64,
    /// A control tick, seconds: half of it is the hold's.
    pub tick_s: f64,
}

/// The feedback: natural frequency and damping of the loop without delay.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Feedback {
    /// Hz.
    pub bandwidth_hz: f64,
    /// Damping ratio.
    pub damping: f64,
}

/// The loop.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct LoopModel {
    /// The drive.
    pub drive: Drive,
    /// The observer.
    pub observer: Observer,
    /// The feedback.
    pub feedback: Feedback,
}

/// How far the loop is from instability.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Margins {
    /// The least distance of the phase from ±180° where the loop's gain is 1, degrees; its negative where the loop is unstable.
    pub phase_deg: f64,
    /// By what the gain may grow, dB.
    pub gain_up_db: f64,
    /// By what the gain may fall, dB: the disturbance's integrator makes the loop unstable below. Infinite where nothing does.
    pub gain_down_db: f64,
    /// The highest frequency at which the loop's gain is 1, Hz.
    pub crossover_hz: f64,
}

impl Drive {
    fn response(&self, omega: f64) -> Complex {
        let lag = Complex { re: 1.0, im: omega * self.lag_s };
        Complex::polar(1.0, -omega * (self.delay_s + 0.5 * self.tick_s)) / lag
    }
}

impl LoopModel {
    /// The same with another bandwidth, Hz.
    pub fn at(self, bandwidth_hz: f64) -> Self {
        Self { feedback: Feedback { bandwidth_hz, ..self.feedback }, ..self }
    }

    /// The loop's gain at `omega` rad/s.
    fn gain(&self, omega: f64) -> Complex {
        let s = Complex { re: 0.0, im: omega };
        let real = |re: f64| Complex { re, im: 0.0 };
        let Observer { angle: l1, speed: l2, disturbance: l3 } = self.observer;
        let natural = TAU * self.feedback.bandwidth_hz;
        let (k1, k2) = (natural * natural, 2.0 * self.feedback.damping * natural);
        let square = s * s;
        let characteristic = square * s + square.times(l1) + s.times(l2) + real(l3);
        let from_angle = (square.times(l1) + s.times(l2) + real(l3)).times(k1)
            + (square.times(l2) + s.times(l3)).times(k2)
            + square.times(l3);
        let from_torque = s.times(k1) + (square + s.times(l1)).times(k2) + real(-l3);
        let drive = self.drive.response(omega);
        drive * from_angle / characteristic / square / (Complex::ONE + drive * from_torque / characteristic)
    }

    /// The margins, on a grid of 800 frequencies a decade.
    pub fn margins(&self) -> Margins {
        let mut margins = Margins {
            phase_deg: f64::INFINITY,
            gain_up_db: f64::INFINITY,
            gain_down_db: f64::INFINITY,
            crossover_hz: 0.0,
        };
        let mut nearest = f64::INFINITY;
        let mut before = self.gain(1e-2);
        for step in 1..=4_800 {
            let omega = 1e-2 * 10f64.powf(f64::from(step) / 800.0);
            let here = self.gain(omega);
            if (before.size() - 1.0) * (here.size() - 1.0) <= 0.0 {
                // Angles are about -180°, of which the part above is the margin.
                let above = if here.angle() < 0.0 { here.angle() + PI } else { here.angle() - PI };
                nearest = nearest.min(above.to_degrees().abs());
                margins.crossover_hz = omega / TAU;
            }
            if here.re < 0.0 && before.im * here.im <= 0.0 {
                let db = 20.0 * here.size().log10();
                if db < 0.0 {
                    margins.gain_up_db = margins.gain_up_db.min(-db);
                } else {
                    margins.gain_down_db = margins.gain_down_db.min(db);
                }
            }
            before = here;
        }
        let stable = self.feedback.bandwidth_hz < self.boundary_hz();
        Margins { phase_deg: if stable { nearest } else { -nearest }, ..margins }
    }

    /// The bandwidth at which the phase margin is 0, Hz; the loop is stable below.
    ///
    /// An observer that knows the plant does not move it: closed, the loop's characteristic is the observer's times that of the feedback
    /// with the drive alone, (k₂ s + k₁) A / s², whose phase is a closed form.
    pub fn boundary_hz(&self) -> f64 {
        let Drive { delay_s, lag_s, tick_s } = self.drive;
        bisect(1e-2, 1e4, WITHIN, |bandwidth_hz| {
            let natural = TAU * bandwidth_hz;
            let ahead = |omega: f64| 2.0 * self.feedback.damping * omega / natural;
            let is_above_1 =
                |omega: f64| natural.powi(2) * ahead(omega).hypot(1.0) > omega * omega * (omega * lag_s).hypot(1.0);
            let crossing = bisect(0.1 * natural, 100.0 * natural, WITHIN, is_above_1);
            ahead(crossing).atan() > crossing * (delay_s + 0.5 * tick_s) + (crossing * lag_s).atan()
        })
    }
}

/// Where between `low` and `high` (both positive) `holds` ends, to a ratio of `within`.
pub fn bisect(mut low: f64, mut high: f64, within: f64, holds: impl Fn(f64) -> bool) -> f64 {
    while high / low > within {
        let middle = (low * high).sqrt();
        if holds(middle) { low = middle } else { high = middle }
    }
    (low * high).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn model() -> LoopModel {
        LoopModel {
            drive: Drive { delay_s: 500e-6, lag_s: 1.0 / (TAU * 300.0), tick_s: 250e-6 },
            observer: Observer { angle: 40.0, speed: 800.0, disturbance: 6_000.0 },
            feedback: Feedback { bandwidth_hz: 6.0, damping: 0.9 },
        }
    }

    #[test]
    fn a_loop_without_delay_is_a_closed_form() {
        // With an observer much faster than the loop, ℓ is (k₂ s + k₁) / s²: crossover ω √(2ζ² + √(4ζ⁴ + 1)), phase margin atan(k₂ c / k₁).
        let fast = Observer { angle: 3e5, speed: 3e10, disturbance: 1e9 };
        let drive = Drive { delay_s: 0.0, lag_s: 0.0, tick_s: 0.0 };
        let margins = LoopModel { drive, observer: fast, ..model() }.margins();
        let damping = 0.9f64;
        let times = (2.0 * damping.powi(2) + (4.0 * damping.powi(4) + 1.0).sqrt()).sqrt();
        assert!((margins.crossover_hz / (6.0 * times) - 1.0).abs() < 0.01, "{margins:?}");
        assert!((margins.phase_deg - (2.0 * damping * times).atan().to_degrees()).abs() < 0.5, "{margins:?}");
    }

    #[test]
    fn at_the_boundary_the_whole_loop_passes_through_minus_one() {
        for observer in [model().observer, Observer { angle: 100.0, speed: 5_000.0, disturbance: 100_000.0 }] {
            for delay_s in [0.0, 5e-4, 3e-3] {
                let model = LoopModel { observer, drive: Drive { delay_s, ..model().drive }, ..model() };
                let boundary_hz = model.boundary_hz();
                let nearest = |model: LoopModel| {
                    let omegas = (0..100_000).map(|step| 10.0 * 1e4f64.powf(f64::from(step) / 1e5));
                    omegas.map(|omega| (model.gain(omega) + Complex::ONE).size()).fold(f64::INFINITY, f64::min)
                };
                let [below, at, above] = [0.9, 1.0, 1.1].map(|part| nearest(model.at(part * boundary_hz)));
                assert!(at < 0.1 * below.min(above), "{observer:?} {delay_s}: {below} {at} {above}");
                assert!(model.at(0.9 * boundary_hz).margins().phase_deg > 0.0);
                assert!(model.at(1.1 * boundary_hz).margins().phase_deg < 0.0);
            }
        }
    }

    #[test]
    fn more_delay_is_less_margin() {
        let slower = LoopModel { drive: Drive { delay_s: 2e-3, ..model().drive }, ..model() };
        assert!(slower.margins().phase_deg < model().margins().phase_deg);
        let ratio = slower.boundary_hz() / model().boundary_hz();
        assert!((0.2..0.6).contains(&ratio), "{ratio}");
    }
}
