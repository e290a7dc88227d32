//! Index and encoder to mirror angle and speed.
//!
//! An extended Kalman filter whose states are the mirror's angle and speed, what brakes it, its inertia, and what is systematic once
//! a turn: the encoder's eccentricity and the mirror's imbalance. The spin-up separates them: the motion that an imbalance makes falls
//! with the square of speed, eccentricity stays. In step with a clock the encoder's counts beat slowly against the control ticks, so
//! that averaging does not help; there a count only tells on which side of an edge the mirror is, and is used as exactly that.

mod counts;
mod index;
mod motion;

use crate::angle::{advanced, nanos_to_f32};
use crate::config::Config;
use crate::covariance::Covariance;
use crate::single::{at_least, root};
use crate::speed_window::SpeedWindow;
use protocol::timing::Direction;
use protocol::units::{Nanos, Turns};

const ANGLE: usize = 0;
const SPEED: usize = 1;
const BRAKE: usize = 2;
const YIELD: usize = 3;
const ZERO: usize = 4;
const ECCENTRIC_COS: usize = 5;
const ECCENTRIC_SIN: usize = 6;
const IMBALANCE_COS: usize = 7;
const IMBALANCE_SIN: usize = 8;
const DRAG: usize = 9;
const STATES: usize = 10;

/// What an index pulse meant.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Index {
    /// The first one since the mirror began to turn, or the fourth in a row that agrees on another origin.
    Anchored,
    /// It came where it was expected.
    Accepted,
    /// It did not.
    Refused,
}

/// The estimator.
#[derive(Clone, Debug)]
pub struct RotationEstimator {
    noise: Noise,
    sign: i32,
    counts_per_turn: u32,
    count_scale: u64,
    count_rad: f32,
    nominal_yield: f32,
    viscous: f32,
    drag: f32,
    nominal_brake: f32,
    /// Full torque on the nominal inertia, rad/s²: the scale of all accelerations.
    strength: f32,
    speed_max: f32,

    started: bool,
    moving: bool,
    anchored: bool,
    tick_at: Nanos,
    last_count: u32,
    count_in_turn: u32,
    angle: Turns,
    encoder_zero: Turns,
    speed: f32,
    brake: f32,
    relative_yield: f32,
    relative_drag: f32,
    eccentricity: [f32; 2],
    imbalance: [f32; 2],
    sine: f32,
    cosine: f32,
    acceleration: f32,
    torque_nm: f32,
    shaking_rad: f32,
    shaking_variance: f32,
    /// What [`BRAKE`]'s covariance leaves out, per relative yield and drag, rad/s².
    centre: [f32; 2],
    covariance: Covariance<STATES>,

    health: Health,
    window: SpeedWindow,
}

/// Variances that follow from the configuration.
#[derive(Clone, Debug)]
struct Noise {
    edge_variance: f32,
    count_variance: f32,
    index_jitter_s: f32,
    floor: [f32; STATES],
}

/// How well the sensors agree with the model.
#[derive(Clone, Debug, Default)]
struct Health {
    ticks_outside: u32,
    encoder_refused: u32,
    last_side: bool,
    radians_since_slip: f32,
    index_scatter: f32,
    index_surprise: f32,
    index_refused: u32,
    index_accepted: u32,
    last_refused: Turns,
    radians_since_index: f32,
    counts_expected: f32,
    contradicted: bool,
}

/// A count further outside than this many sigmas is no noise.
const GATE_SIGMAS: f32 = 6.0;
/// Counts that must have been expected and have not come, for the encoder to count as silent.
const SILENT_COUNTS: f32 = 12.0;

impl RotationEstimator {
    /// At rest, at an unknown angle.
    pub fn new(config: &Config) -> Self {
        let (motor, sensors) = (&config.motor, &config.sensors);
        let count_rad = core::f32::consts::TAU / sensors.encoder_counts_per_turn as f32;
        let edge = sensors.encoder_edge_noise_rad.max(0.01 * count_rad);
        let nominal_yield = 1.0 / motor.inertia_kg_m2;
        let mut estimator = Self {
            noise: Noise {
                edge_variance: edge * edge,
                // Three times that of a uniform error: where a whole number of counts passes in a tick the error stays for many of them.
                count_variance: count_rad * count_rad / 4.0 + edge * edge,
                index_jitter_s: sensors.index_jitter_s.max(2e-8),
                floor: [1e-13, 1e-10, 1e-9, 1e-9, 1e-13, 1e-13, 1e-13, 1e-9, 1e-9, 1e-9],
            },
            sign: match config.rotation.direction() {
                Direction::CounterClockwise => 1,
                Direction::Clockwise => -1,
            },
            counts_per_turn: sensors.encoder_counts_per_turn,
            count_scale: u64::MAX / u64::from(sensors.encoder_counts_per_turn.max(1)),
            count_rad,
            nominal_yield,
            viscous: motor.viscous_friction_nm_s,
            drag: motor.air_drag_nm_s2,
            nominal_brake: motor.coulomb_friction_nm * nominal_yield,
            strength: motor.torque_max_nm * nominal_yield,
            speed_max: config.limits.speed_max_rad_s,
            started: false,
            moving: false,
            anchored: false,
            tick_at: Nanos::ZERO,
            last_count: 0,
            count_in_turn: 0,
            angle: Turns::ZERO,
            encoder_zero: Turns::ZERO,
            speed: 0.0,
            brake: 0.0,
            relative_yield: 1.0,
            relative_drag: 1.0,
            eccentricity: [0.0; 2],
            imbalance: [0.0; 2],
            sine: 0.0,
            cosine: 1.0,
            acceleration: 0.0,
            torque_nm: 0.0,
            shaking_rad: 0.0,
            shaking_variance: 0.0,
            centre: [0.0; 2],
            covariance: Covariance::diagonal([0.0; STATES]),
            health: Health::default(),
            window: SpeedWindow::default(),
        };
        estimator.rest();
        estimator
    }

    /// Takes the encoder's latched count at `now`; `torque_nm` is the mean torque since the last tick, in the mirror's direction.
    pub fn tick(&mut self, now: Nanos, count: u32, torque_nm: f32) {
        let counts = (count.wrapping_sub(self.last_count) as i32).wrapping_mul(self.sign);
        self.last_count = count;
        if !self.started {
            self.started = true;
            self.tick_at = now;
            return;
        }
        let seconds = nanos_to_f32(now.signed_since(self.tick_at).clamp(0, 20_000_000)) * 1e-9;
        self.tick_at = now;
        self.count_in_turn = self.wrapped(counts);
        let counts = self.plausible(counts, seconds);
        self.window.add(counts, seconds, self.count_rad);
        if !self.moving {
            self.wait_for_motion(counts, torque_nm);
            return;
        }
        self.predict(seconds, torque_nm);
        self.health.counts_expected =
            if counts != 0 { 0.0 } else { self.health.counts_expected + self.speed.abs() * seconds / self.count_rad };
        if self.window.is_still() && self.speed.abs() < 3.0 {
            self.rest();
        } else if !self.encoder_is_silent() {
            self.see_count(counts, seconds);
        }
        self.check_sanity();
    }

    /// Takes an index pulse captured at `at`.
    pub fn index(&mut self, at: Nanos) -> Index {
        let index = self.see_index(at);
        self.check_sanity();
        index
    }

    /// Mirror angle at the last tick, as progress since the index.
    pub fn angle(&self) -> Turns {
        self.angle
    }

    /// Its standard deviation, radians. Only differences count before [`RotationEstimator::is_anchored`].
    pub fn sigma_rad(&self) -> f32 {
        root(self.covariance.variance(ANGLE) + self.shaking_rad * self.shaking_rad)
    }

    /// How far off the last index pulses were, root mean square, radians: what the filter thinks of itself not taken into account.
    pub fn index_scatter_rad(&self) -> f32 {
        root(self.health.index_scatter)
    }

    /// Speed at the last tick, rad/s, positive in the rig's direction.
    pub fn speed(&self) -> f32 {
        self.speed
    }

    /// Acceleration over the last tick, rad/s², positive in the rig's direction.
    pub fn acceleration(&self) -> f32 {
        self.acceleration
    }

    /// The relative standard deviation of the estimated inertia.
    pub fn sigma_inertia(&self) -> f32 {
        root(self.covariance.variance(YIELD)) / self.relative_yield
    }

    /// The standard deviation of the encoder's eccentricity, radians: what is left of the doubt whether it or an imbalance is seen.
    pub fn sigma_eccentricity_rad(&self) -> f32 {
        root(at_least(self.covariance.variance(ECCENTRIC_COS), self.covariance.variance(ECCENTRIC_SIN)))
    }

    /// Whether the mirror turns.
    pub fn is_moving(&self) -> bool {
        self.moving
    }

    /// Whether the index has said where the mirror is, `indices` times at least.
    pub fn is_anchored(&self, indices: u32) -> bool {
        self.anchored && self.health.index_accepted + 1 >= indices
    }

    /// Whether the encoder stands still although the mirror should have passed many counts.
    pub fn encoder_is_silent(&self) -> bool {
        self.moving && self.health.counts_expected > SILENT_COUNTS
    }

    /// Whether counts have contradicted the estimate since the last index: they slipped, or something pushed the mirror.
    pub fn is_contradicted(&self) -> bool {
        self.health.contradicted
    }

    /// Turns since the last index that was believed.
    pub fn turns_since_index(&self) -> f32 {
        self.health.radians_since_index / core::f32::consts::TAU
    }

    /// Speed from encoder counts alone over the last 32 ticks, rad/s: independent of the filter, resolved to one count.
    pub fn counted_speed(&self) -> f32 {
        self.window.speed()
    }

    fn rest(&mut self) {
        self.moving = false;
        self.anchored = false;
        self.speed = 0.0;
        self.acceleration = 0.0;
        self.health = Health::default();
        // Encoder and angle agree by definition until the index says where the mirror is.
        self.encoder_zero = Turns::ZERO;
        self.angle = self.count_start();
    }

    fn wait_for_motion(&mut self, counts: i32, torque_nm: f32) {
        self.angle = advanced(self.angle, counts as f32 * self.count_rad);
        self.health.counts_expected += counts.abs() as f32;
        if self.health.counts_expected < 3.0 {
            return;
        }
        // From rest under a known torque three counts have been passed at a speed that follows; else the counts must tell.
        let push = at_least(torque_nm * self.nominal_yield - self.nominal_brake, 0.0);
        let from_torque = root(2.0 * push * 3.0 * self.count_rad);
        let direction = if counts < 0 { -1.0 } else { 1.0 };
        let from_counts = self.window.speed();
        let speed = if from_counts.abs() > from_torque { from_counts } else { direction * from_torque };
        self.restart_moving(speed, 1.0 + 0.3 * speed.abs());
    }

    fn restart_moving(&mut self, speed: f32, sigma: f32) {
        self.moving = true;
        self.anchored = false;
        self.speed = speed;
        self.brake = self.nominal_brake;
        self.health = Health::default();
        let count = self.count_rad * self.count_rad;
        // The brake also stands for an inertia that is half of what was said.
        let brake = self.strength;
        self.centre = [0.0; 2];
        self.covariance =
            Covariance::diagonal([count, sigma * sigma, brake * brake, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
    }
}
