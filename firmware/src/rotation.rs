//! Index and encoder to mirror angle and speed.
//!
//! An extended Kalman filter whose states are the mirror's angle and speed, what brakes it, its inertia, and what is systematic once
//! a turn: the encoder's eccentricity and the mirror's imbalance. The spin-up separates them: the motion that an imbalance makes falls
//! with the square of speed, eccentricity stays. In step with a clock the encoder's counts beat slowly against the control ticks, so
//! that averaging does not help; there a count only tells on which side of an edge the mirror is, and is used as exactly that.

use crate::angle::{advanced, radians_between, sin_cos};
use crate::config::Config;
use crate::covariance::Covariance;
use crate::probit::inverse_mills;
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
    /// The first one since the mirror began to turn, or the third in a row that agrees on another origin.
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
    torque_max_nm: f32,

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
    index_refused: u32,
    index_accepted: u32,
    last_refused: Turns,
    radians_since_index: f32,
    counts_expected: f32,
}

/// A count further outside than this many sigmas is no noise.
const GATE_SIGMAS: f32 = 6.0;
/// Closer than this to where it was expected, an index pulse is believed whatever the estimate says: chance would put one of 300 here.
const NEAR_INDEX_RAD: f32 = 0.01;
/// Turns in which the encoder may slip once. What looks like a second slip is a push: between two beats of counts and ticks nothing
/// tells one from the other.
const TURNS_BETWEEN_SLIPS: f32 = 2.0;
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
            count_scale: u64::MAX / u64::from(sensors.encoder_counts_per_turn),
            count_rad,
            nominal_yield,
            viscous: motor.viscous_friction_nm_s,
            drag: motor.air_drag_nm_s2,
            nominal_brake: motor.coulomb_friction_nm * nominal_yield,
            torque_max_nm: motor.torque_max_nm,
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
        let seconds = (now.signed_since(self.tick_at).clamp(0, 20_000_000)) as f32 * 1e-9;
        self.tick_at = now;
        let per_turn = i64::from(self.counts_per_turn);
        self.count_in_turn = (i64::from(self.count_in_turn) + i64::from(counts)).rem_euclid(per_turn) as u32;
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
    }

    /// Takes an index pulse captured at `at`.
    pub fn index(&mut self, at: Nanos) -> Index {
        let since_tick = (at.signed_since(self.tick_at)).clamp(-20_000_000, 20_000_000) as f32 * 1e-9;
        let moved = (self.speed + 0.5 * self.acceleration * since_tick) * since_tick;
        let angle = advanced(self.angle, moved);
        if !self.moving || !self.anchored {
            self.anchor(angle);
            return Index::Anchored;
        }
        let innovation = -radians_between(Turns::ZERO, angle);
        let jitter = self.noise.index_jitter_s * self.speed.abs();
        // A mirror that hardly moves jitters by the width of the index mark, not by its time.
        let noise = jitter * jitter + 1e-10;
        let terms = [(ANGLE, 1.0), (SPEED, since_tick)];
        let (mut gain, mut variance) = self.covariance.seen_through(terms);
        let surprise = innovation * innovation;
        if surprise > GATE_SIGMAS * GATE_SIGMAS * (variance + noise) + 4e-10 {
            // A pulse that means nothing hardly ever comes within a count of where the index is: this one is real, and something has
            // pushed the mirror since the last one.
            if innovation.abs() > NEAR_INDEX_RAD {
                return self.refuse_index(angle);
            }
            self.expect_push(surprise);
            (gain, variance) = self.covariance.seen_through(terms);
        }
        let total = variance + noise;
        self.correct(&gain, innovation / total, 1.0 / total);
        self.health.index_refused = 0;
        self.health.index_accepted = self.health.index_accepted.saturating_add(1);
        self.health.radians_since_index = 0.0;
        Index::Accepted
    }

    /// Mirror angle at the last tick, as progress since the index.
    pub fn angle(&self) -> Turns {
        self.angle
    }

    /// Its standard deviation, radians. Only differences count before [`RotationEstimator::is_anchored`].
    pub fn sigma_rad(&self) -> f32 {
        libm::sqrtf(self.covariance.variance(ANGLE).max(0.0))
    }

    /// Speed at the last tick, rad/s, positive in the rig's direction.
    pub fn speed(&self) -> f32 {
        self.speed
    }

    #[doc(hidden)]
    pub fn debug(&self) -> std::string::String {
        let sd: std::vec::Vec<f32> =
            (0..10).map(|i| self.covariance.variance(i).sqrt()).map(|v| (v * 1e6).round() * 1e-6).collect();
        std::format!(
            "brake {:.3} yield {:.4} zero {:.4} ecc {:?} imb {:?} anch {} idx {} ref {} | sd {:?}",
            self.brake,
            self.relative_yield,
            self.encoder_zero.turns() * 288.0,
            self.eccentricity,
            self.imbalance,
            self.anchored,
            self.health.index_accepted,
            self.health.encoder_refused,
            sd
        )
    }

    /// The relative standard deviation of the estimated inertia.
    pub fn sigma_inertia(&self) -> f32 {
        libm::sqrtf(self.covariance.variance(YIELD).max(0.0)) / self.relative_yield
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

    /// Turns since the last index that was believed.
    pub fn turns_since_index(&self) -> f32 {
        self.health.radians_since_index / core::f32::consts::TAU
    }

    /// Speed from encoder counts alone over the last 32 ticks, rad/s: independent of the filter, resolved to one count.
    pub fn counted_speed(&self) -> f32 {
        self.window.speed()
    }

    /// Acceleration per torque, 1 / (kg m²).
    pub fn acceleration_per_torque(&self) -> f32 {
        self.nominal_yield * self.relative_yield
    }

    /// The torque that keeps acceleration at `acceleration` rad/s² while turning at `speed` rad/s at angle `angle`, N m: friction and
    /// imbalance included.
    pub fn torque_for(&self, acceleration: f32, speed: f32, angle: Turns) -> f32 {
        let (sine, cosine) = sin_cos(angle);
        let against = if speed < 0.0 { -1.0 } else { 1.0 };
        let wanted = acceleration + against * self.brake + self.wobble(sine, cosine);
        wanted / self.acceleration_per_torque() + self.relative_drag * (self.viscous + self.drag * speed.abs()) * speed
    }

    /// The acceleration that `torque_nm` makes at `speed`, rad/s², without imbalance.
    pub fn acceleration_for(&self, torque_nm: f32, speed: f32) -> f32 {
        let against = if speed < 0.0 { -1.0 } else { 1.0 };
        let net_nm = torque_nm - self.relative_drag * (self.viscous + self.drag * speed.abs()) * speed;
        net_nm * self.acceleration_per_torque() - against * self.brake
    }

    fn predict(&mut self, seconds: f32, torque_nm: f32) {
        let speed = self.speed;
        self.torque_nm = torque_nm;
        let nominal_drag_nm = (self.viscous + self.drag * speed.abs()) * speed;
        let per_yield = self.nominal_yield * (torque_nm - self.relative_drag * nominal_drag_nm);
        let per_drag = -self.acceleration_per_torque() * nominal_drag_nm;
        let against = if speed < 0.0 { -1.0 } else { 1.0 };
        self.acceleration =
            self.relative_yield * per_yield - against * self.brake - self.wobble(self.sine, self.cosine);
        self.angle = advanced(self.angle, (speed + 0.5 * self.acceleration * seconds) * seconds);
        self.speed += self.acceleration * seconds;
        self.health.radians_since_index += speed.abs() * seconds;
        self.health.radians_since_slip += speed.abs() * seconds;
        (self.sine, self.cosine) = sin_cos(self.angle);
        if self.anchored {
            self.covariance.shear(
                SPEED,
                [
                    (BRAKE, -against * seconds),
                    (YIELD, per_yield * seconds),
                    (DRAG, per_drag * seconds),
                    (IMBALANCE_COS, -self.cosine * seconds),
                    (IMBALANCE_SIN, -self.sine * seconds),
                ],
            );
        } else {
            self.covariance.shear(SPEED, [(BRAKE, -against * seconds)]);
            // Without the index nothing tells imbalance, inertia and friction apart: one quickly changing brake stands for all.
            self.covariance.widen(BRAKE, 3e3 * seconds);
        }
        self.covariance.shear(ANGLE, [(SPEED, seconds)]);
        self.drift(seconds);
    }

    /// What the model leaves out, as random walks.
    fn drift(&mut self, seconds: f32) {
        // Cogging and ripple move the speed by their torque over their frequency, and do not add up.
        self.covariance.widen(SPEED, 4e-5 * seconds);
        // Friction changes with speed in ways that no figure names.
        let brake = 0.03 + 0.005 * self.acceleration.abs();
        self.covariance.widen(BRAKE, brake * brake * seconds);
        if self.anchored {
            self.covariance.widen(YIELD, 1e-7 * seconds);
            self.covariance.widen(DRAG, 1e-6 * seconds);
            self.covariance.widen(ZERO, 1e-11 * seconds);
            for state in [ECCENTRIC_COS, ECCENTRIC_SIN] {
                self.covariance.widen(state, 1e-11 * seconds);
            }
            for state in [IMBALANCE_COS, IMBALANCE_SIN] {
                self.covariance.widen(state, 1e-6 * seconds);
            }
        }
    }

    fn see_count(&mut self, counts: i32, seconds: f32) {
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
        let total = variance + self.noise.edge_variance;
        let sigma = libm::sqrtf(total);
        let outside = (within - half).abs() - half;
        if outside > GATE_SIGMAS * sigma && outside > 0.25 * self.count_rad {
            if self.health.radians_since_slip > TURNS_BETWEEN_SLIPS * core::f32::consts::TAU {
                self.refuse_count(within);
                return;
            }
            self.expect_push(outside * outside);
        }
        self.health.encoder_refused = 0;
        if variance > 0.09 * self.count_rad * self.count_rad {
            if counts != 0 {
                // Just after a slow count the mirror is near the edge that it passed, not in the middle between two.
                let passed = half.min(0.5 * self.speed.abs() * seconds);
                let place = if self.speed < 0.0 { self.count_rad - passed } else { passed };
                let total = variance + self.noise.count_variance;
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
    fn notice_manoeuvre(&mut self, depth: f32) {
        self.health.ticks_outside = if depth < -3.0 { self.health.ticks_outside + 1 } else { 0 };
        if self.health.ticks_outside >= 4 {
            self.health.ticks_outside = 0;
            self.expect_push(0.01 * self.count_rad * self.count_rad);
        }
    }

    /// Something that the model does not know has moved the mirror by the root of `surprise` since the last index: learn faster.
    fn expect_push(&mut self, surprise: f32) {
        let seconds = (self.health.radians_since_index / self.speed.abs().max(0.1)).clamp(0.005, 0.2);
        let speed = surprise / (seconds * seconds);
        self.covariance.widen(ANGLE, surprise);
        self.covariance.widen(SPEED, 4.0 * speed);
        self.covariance.widen(BRAKE, 4.0 * speed / (seconds * seconds));
        self.covariance.widen(ZERO, 0.25 * surprise);
    }

    fn refuse_count(&mut self, within: f32) {
        self.health.encoder_refused += 1;
        let half = 0.5 * self.count_rad;
        if self.health.encoder_refused == 8 {
            // No torque moves the mirror by a quarter of a count in a tick: counts were lost or added.
            let slipped = libm::roundf((within - half) / self.count_rad);
            self.encoder_zero = advanced(self.encoder_zero, -slipped * self.count_rad);
            self.covariance.widen(ZERO, 0.1 * self.count_rad * self.count_rad);
            self.health.radians_since_slip = 0.0;
        }
    }

    fn refuse_index(&mut self, angle: Turns) -> Index {
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
    fn anchor(&mut self, angle: Turns) {
        self.angle -= angle;
        self.encoder_zero += angle;
        (self.sine, self.cosine) = sin_cos(self.angle);
        self.health.index_refused = 0;
        self.health.radians_since_index = 0.0;
        if !self.moving {
            return;
        }
        if !self.anchored {
            self.guess_inertia();
        }
        self.health.index_accepted = 0;
        self.anchored = true;
        self.eccentricity = [0.0; 2];
        self.imbalance = [0.0; 2];
        let count = self.count_rad * self.count_rad;
        let brake = 0.5 * self.nominal_brake + 1.0;
        self.covariance = Covariance::diagonal([1e-8, 0.25, brake * brake, 0.3, count, 4e-6, 4e-6, 9.0, 9.0, 0.25]);
    }

    /// Friction as named, and the inertia that then explains the acceleration: where the filter starts to tell them apart.
    fn guess_inertia(&mut self) {
        let drag_nm = (self.viscous + self.drag * self.speed.abs()) * self.speed;
        let per_yield = self.nominal_yield * (self.torque_nm - drag_nm);
        let pushed = self.relative_yield * per_yield - self.brake;
        self.relative_drag = 1.0;
        self.brake = self.nominal_brake;
        if per_yield.abs() > 4.0 * self.nominal_brake {
            self.relative_yield = ((pushed + self.brake) / per_yield).clamp(0.2, 5.0);
        }
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
        let push = (torque_nm * self.nominal_yield - self.nominal_brake).max(0.0);
        let from_torque = libm::sqrtf(2.0 * push * 3.0 * self.count_rad);
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
        let brake = self.nominal_yield * self.torque_max_nm;
        self.covariance =
            Covariance::diagonal([count, sigma * sigma, brake * brake, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
    }

    fn correct(&mut self, gain: &[f32; STATES], amount: f32, share: f32) {
        self.angle = advanced(self.angle, gain[ANGLE] * amount);
        self.encoder_zero = advanced(self.encoder_zero, gain[ZERO] * amount);
        self.speed += gain[SPEED] * amount;
        self.brake += gain[BRAKE] * amount;
        self.relative_yield = (self.relative_yield + gain[YIELD] * amount).clamp(0.2, 5.0);
        self.relative_drag = (self.relative_drag + gain[DRAG] * amount).clamp(-1.0, 5.0);
        self.eccentricity[0] += gain[ECCENTRIC_COS] * amount;
        self.eccentricity[1] += gain[ECCENTRIC_SIN] * amount;
        self.imbalance[0] += gain[IMBALANCE_COS] * amount;
        self.imbalance[1] += gain[IMBALANCE_SIN] * amount;
        self.covariance.reduce(gain, share, &self.noise.floor);
    }

    /// Where the encoder says that the mirror at least is.
    fn count_start(&self) -> Turns {
        Turns(((u64::from(self.count_in_turn) * self.count_scale) >> 32) as u32)
    }

    fn wobble(&self, sine: f32, cosine: f32) -> f32 {
        self.imbalance[0] * cosine + self.imbalance[1] * sine
    }
}
