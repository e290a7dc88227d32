//! The mirror as it really turns.

use crate::motor::{Cogging, PlantFigures, Ripple};
use crate::noise::{Noise, Source};
use std::f64::consts::TAU;

/// A harmonic of the torque with its phase.
#[derive(Clone, Copy, Debug)]
struct Harmonic {
    size: f64,
    per_turn: f64,
    phase: f64,
}

/// Mirror, motor and drive. Angles in radians counter-clockwise, unwrapped; torques counter-clockwise.
#[derive(Clone, Debug)]
pub struct Plant {
    inertia: f64,
    viscous: f64,
    coulomb: f64,
    drag: f64,
    torque_max: f64,
    /// The share of it that the drive gives now.
    torque_share: f64,
    lag_s: f64,
    ripple: Harmonic,
    harmonics: Vec<Harmonic>,
    most_per_turn: f64,
    load: f64,
    command: f64,
    torque: f64,
    angle: f64,
    speed: f64,
    last: Stretch,
}

/// The motion over the last step, for every moment in it.
#[derive(Clone, Copy, Debug, Default)]
pub struct Stretch {
    duration: f64,
    angles: [f64; 2],
    speeds: [f64; 2],
}

impl Stretch {
    /// The angle `elapsed` seconds after the stretch began, by cubic Hermite interpolation.
    ///
    /// Its error is h⁴/384 of the fourth derivative of angle; for the reference motor's cogging at 20 turns a second 4e-11 rad.
    pub fn angle(&self, elapsed: f64) -> f64 {
        if self.duration <= 0.0 {
            return self.angles[1];
        }
        let t = elapsed / self.duration;
        let [from, to] = self.angles;
        let [slope_from, slope_to] = self.speeds.map(|speed| speed * self.duration);
        let (back, square) = (1.0 - t, t * t);
        from + (to - from) * square * (3.0 - 2.0 * t) + slope_from * t * back * back - slope_to * square * back
    }

    /// When, in seconds after the stretch began, the angle `target` is passed; `target` lies between its ends.
    pub fn time_of(&self, target: f64) -> f64 {
        let [from, to] = self.angles;
        let mut elapsed = self.duration * (target - from) / (to - from);
        let mean_speed = (to - from) / self.duration;
        for _ in 0..4 {
            elapsed -= (self.angle(elapsed) - target) / mean_speed;
        }
        elapsed.clamp(0.0, self.duration)
    }

    /// The angles at both ends.
    pub fn ends(&self) -> [f64; 2] {
        self.angles
    }
}

impl Plant {
    /// At rest, with phases and place from `seed`.
    pub fn new(figures: &PlantFigures, seed: u64) -> Self {
        let mut phases = Noise::new(seed, Source::PlantPhases);
        let Ripple { share, per_turn } = figures.torque_ripple;
        let mut harmonic =
            |size, per_turn: u32| Harmonic { size, per_turn: f64::from(per_turn), phase: phases.uniform() * TAU };
        let ripple = harmonic(share, per_turn);
        let imbalance = harmonic(figures.once_per_turn_nm, 1);
        let cogging = figures.cogging.iter().map(|&Cogging { torque_nm, per_turn }| harmonic(torque_nm, per_turn));
        let harmonics: Vec<Harmonic> = std::iter::once(imbalance).chain(cogging).collect();
        let most_per_turn = harmonics.iter().map(|harmonic| harmonic.per_turn).fold(ripple.per_turn, f64::max);
        let angle = Noise::new(seed, Source::Start).uniform() * TAU;
        Self {
            inertia: figures.inertia_kg_m2,
            viscous: figures.viscous_friction_nm_s,
            coulomb: figures.coulomb_friction_nm,
            drag: figures.air_drag_nm_s2,
            torque_max: figures.max_torque_nm,
            torque_share: 1.0,
            lag_s: 1.0 / (TAU * figures.torque_loop_bandwidth_hz),
            ripple,
            harmonics,
            most_per_turn,
            load: 0.0,
            command: 0.0,
            torque: 0.0,
            angle,
            speed: 0.0,
            last: Stretch { duration: 0.0, angles: [angle; 2], speeds: [0.0; 2] },
        }
    }

    /// Multiplies inertia and all friction.
    pub fn scale(&mut self, inertia: f64, friction: f64) {
        self.inertia *= inertia;
        self.viscous *= friction;
        self.coulomb *= friction;
        self.drag *= friction;
    }

    /// A constant torque from outside, N m.
    pub fn set_load(&mut self, torque_nm: f64) {
        self.load = torque_nm;
    }

    /// The drive gives `share` of its torque from now on.
    pub fn limit_torque(&mut self, share: f64) {
        self.torque_share = share;
        self.set_command(self.command);
    }

    /// What the drive is told from now on, N m.
    pub fn set_command(&mut self, torque_nm: f64) {
        let most = self.torque_share * self.torque_max;
        self.command = torque_nm.clamp(-most, most);
    }

    /// Radians, unwrapped.
    pub fn angle(&self) -> f64 {
        self.angle
    }

    /// rad/s.
    pub fn speed(&self) -> f64 {
        self.speed
    }

    /// The longest step that keeps integration accurate now: 0.8 rad of the finest harmonic, where a Runge-Kutta step of fourth order
    /// errs by 1e-4 of that harmonic's own motion, which is 3e-8 rad for the reference motor.
    pub fn longest_step(&self) -> f64 {
        0.8 / (self.most_per_turn * self.speed.abs()).max(1e-3)
    }

    /// Moves on by `seconds`, at most [`Plant::longest_step`], under a constant command.
    pub fn advance(&mut self, seconds: f64) -> Stretch {
        let from = (self.angle, self.speed);
        let halfway = (-0.5 * seconds / self.lag_s).exp();
        let torque_after = |decay: f64| self.command + (self.torque - self.command) * decay;
        let torques = [self.torque, torque_after(halfway), torque_after(halfway * halfway)];
        let pushed = self.driving_torque(self.angle, torques[1]);
        let held = self.speed == 0.0 && pushed.abs() <= self.coulomb;
        if !held {
            let direction = if self.speed == 0.0 { pushed.signum() } else { self.speed.signum() };
            self.integrate(seconds, torques, direction);
            if self.speed * direction < 0.0 {
                // Friction stops a mirror, and turns none around; what would push it back shows at the next step.
                self.speed = 0.0;
            }
        }
        self.torque = torques[2];
        self.last = Stretch { duration: seconds, angles: [from.0, self.angle], speeds: [from.1, self.speed] };
        self.last
    }

    fn integrate(&mut self, h: f64, torques: [f64; 3], direction: f64) {
        let (angle, speed) = (self.angle, self.speed);
        let acceleration = |angle: f64, speed: f64, torque: f64| {
            let brake = direction * self.coulomb + (self.viscous + self.drag * speed.abs()) * speed;
            (self.driving_torque(angle, torque) - brake) / self.inertia
        };
        let a1 = acceleration(angle, speed, torques[0]);
        let v2 = speed + 0.5 * h * a1;
        let a2 = acceleration(angle + 0.5 * h * speed, v2, torques[1]);
        let v3 = speed + 0.5 * h * a2;
        let a3 = acceleration(angle + 0.5 * h * v2, v3, torques[1]);
        let v4 = speed + h * a3;
        let a4 = acceleration(angle + h * v3, v4, torques[2]);
        self.angle = angle + h / 6.0 * (speed + 2.0 * v2 + 2.0 * v3 + v4);
        self.speed = speed + h / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4);
    }

    fn driving_torque(&self, angle: f64, torque: f64) -> f64 {
        let at = |harmonic: &Harmonic| harmonic.size * (harmonic.per_turn * angle + harmonic.phase).sin();
        let disturbance: f64 = self.harmonics.iter().filter(|harmonic| harmonic.size != 0.0).map(at).sum();
        torque * (1.0 + at(&self.ripple)) + disturbance + self.load
    }

    /// How long full torque takes from the present speed to `speed`, seconds, without ripple, delay or lag: what no controller beats.
    /// Infinite where the motor cannot.
    pub fn torque_limited_seconds(&self, speed: f64) -> f64 {
        let (mut at, mut seconds) = (self.speed, 0.0);
        let step = (speed - at) / 2_000.0;
        let towards = step.signum();
        for _ in 0..2_000 {
            let middle = at + 0.5 * step;
            let friction = self.coulomb * middle.signum() + (self.viscous + self.drag * middle.abs()) * middle;
            let acceleration = (towards * self.torque_share * self.torque_max + self.load - friction) / self.inertia;
            if acceleration * towards <= 0.0 {
                return f64::INFINITY;
            }
            seconds += step / acceleration;
            at += step;
        }
        seconds
    }
}

#[cfg(test)]
#[path = "plant_tests.rs"]
mod tests;
