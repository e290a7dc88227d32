//! How the mirror moves between two observations, and what is known of its motor.

use super::{
    ANGLE, BRAKE, DRAG, ECCENTRIC_COS, ECCENTRIC_SIN, IMBALANCE_COS, IMBALANCE_SIN, RotationEstimator, SPEED, STATES,
    YIELD, ZERO,
};
use crate::angle::{advanced, sin_cos};
use crate::covariance::Covariance;
use crate::single::{at_least, root};
use protocol::units::Turns;

/// What may be expected of any motor: ripple as a share of the torque given, cogging as a share of the most, and their periods a turn.
const RIPPLE_SHARE: f32 = 0.04;
const RIPPLE_PER_TURN: f32 = 6.0;
const COGGING_SHARE: f32 = 0.025;
const COGGING_PER_TURN: f32 = 12.0;

impl RotationEstimator {
    /// Acceleration per torque, 1 / (kg m²).
    pub fn acceleration_per_torque(&self) -> f32 {
        self.nominal_yield * self.relative_yield
    }

    /// Whether what was learnt is true of no motor: friction that surely drives, and by more than 2 % of the torque there is, or a drag at the end of its
    /// scale. A motor with half the torque that was named is first explained so; light was then half a slice off.
    pub fn model_is_impossible(&self) -> bool {
        let drives = self.brake < -0.02 * self.strength && self.brake < -2.0 * self.sigma_brake();
        drives || !(-0.5..=4.5).contains(&self.relative_drag)
    }

    /// The standard deviation of the brake by itself, rad/s².
    fn sigma_brake(&self) -> f32 {
        let [per_yield, per_drag] = self.centre;
        let (_, variance) = self.covariance.seen_through([(BRAKE, 1.0), (YIELD, per_yield), (DRAG, per_drag)]);
        root(variance)
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

    pub(super) fn predict(&mut self, seconds: f32, torque_nm: f32) {
        let speed = self.speed;
        self.shake(seconds, torque_nm);
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
            self.recentre([against * per_yield, against * per_drag]);
            self.covariance.shear(
                SPEED,
                [
                    (BRAKE, -against * seconds),
                    (IMBALANCE_COS, -self.cosine * seconds),
                    (IMBALANCE_SIN, -self.sine * seconds),
                ],
            );
        } else {
            self.covariance.shear(SPEED, [(BRAKE, -against * seconds)]);
            // Without the index nothing tells imbalance, inertia and friction apart: one quickly changing brake stands for all.
            self.covariance.widen(BRAKE, 0.3 * self.strength * self.strength * seconds);
        }
        self.covariance.shear(ANGLE, [(SPEED, seconds)]);
        self.drift(seconds);
    }

    /// Keeps the covariance of the brake for the brake less what inertia and drag make of the torque and speed there are now.
    ///
    /// At one speed only their sum is seen, and seen well; kept apart they are uncertain and all but cancel, which single precision
    /// does not bear for long: one start in a thousand on the second motor then lit planes 0.6 slices off, seconds after its lock.
    fn recentre(&mut self, centre: [f32; 2]) {
        let [from_yield, from_drag] = self.centre;
        self.covariance.shear(BRAKE, [(YIELD, from_yield - centre[0]), (DRAG, from_drag - centre[1])]);
        self.centre = centre;
    }

    /// How far ripple and cogging move the mirror back and forth about the motion that is modelled: by their acceleration over their
    /// frequency squared. To the counts that is noise, and the same for a radian of it, so that its variance counts that many times.
    fn shake(&mut self, seconds: f32, torque_nm: f32) {
        let speed = at_least(self.speed.abs(), 1.0);
        let ripple = speed * RIPPLE_PER_TURN;
        let cogging = speed * COGGING_PER_TURN;
        let per_nm = RIPPLE_SHARE * self.acceleration_per_torque();
        let from_ripple = per_nm * torque_nm.abs() / (ripple * ripple);
        let from_cogging = COGGING_SHARE * self.strength / (cogging * cogging);
        self.shaking_rad = from_ripple + from_cogging;
        self.shaking_variance =
            self.shaking_rad * self.shaking_rad * at_least(1.0 / (ripple * at_least(seconds, 1e-5)), 1.0);
        // A torque that changes in the middle of a ripple leaves a change of speed behind.
        let kick = per_nm * (torque_nm - self.torque_nm) / ripple;
        self.covariance.widen(SPEED, kick * kick);
    }

    /// What the model leaves out, as random walks; torques in proportion to what the motor can do.
    ///
    /// At 240 Hz over 120 seeds, 20 s each, these walks give at worst 0.0028 slices RMS and 0.0147 peak; 1e-9 of speed with 2e-4 of the brake
    /// gave 0.0034 and 0.0186: an index that comes five sigmas late is then believed too much.
    pub(super) fn drift(&mut self, seconds: f32) {
        let strength = self.strength * self.strength * seconds;
        // Cogging and ripple move the speed by their torque over their frequency, and do not add up.
        self.covariance.widen(SPEED, 2e-10 * strength);
        // Friction changes with speed in ways that no figure names.
        let brake = 4e-5 * self.strength + 0.005 * self.acceleration.abs();
        self.covariance.widen(BRAKE, brake * brake * seconds);
        if self.anchored {
            self.covariance.widen(YIELD, 1e-7 * seconds);
            self.covariance.widen(DRAG, 1e-6 * seconds);
            for state in [ZERO, ECCENTRIC_COS, ECCENTRIC_SIN] {
                self.covariance.widen(state, 1e-11 * seconds);
            }
            for state in [IMBALANCE_COS, IMBALANCE_SIN] {
                self.covariance.widen(state, 1e-10 * strength);
            }
        }
    }

    pub(super) fn wobble(&self, sine: f32, cosine: f32) -> f32 {
        self.imbalance[0] * cosine + self.imbalance[1] * sine
    }

    /// Friction as named, and the inertia that then explains the acceleration: where the filter starts to tell them apart.
    pub(super) fn guess_inertia(&mut self) {
        let drag_nm = (self.viscous + self.drag * self.speed.abs()) * self.speed;
        let per_yield = self.nominal_yield * (self.torque_nm - drag_nm);
        let pushed = self.relative_yield * per_yield - self.brake;
        self.relative_drag = 1.0;
        self.brake = self.nominal_brake;
        if per_yield.abs() > 4.0 * self.nominal_brake {
            self.relative_yield = ((pushed + self.brake) / per_yield).clamp(0.2, 5.0);
        }
    }

    pub(super) fn correct(&mut self, gain: &[f32; STATES], amount: f32, share: f32) {
        self.angle = advanced(self.angle, gain[ANGLE] * amount);
        self.encoder_zero = advanced(self.encoder_zero, gain[ZERO] * amount);
        self.speed += gain[SPEED] * amount;
        self.brake += (gain[BRAKE] + self.centre[0] * gain[YIELD] + self.centre[1] * gain[DRAG]) * amount;
        self.relative_yield = (self.relative_yield + gain[YIELD] * amount).clamp(0.2, 5.0);
        self.relative_drag = (self.relative_drag + gain[DRAG] * amount).clamp(-1.0, 5.0);
        self.eccentricity[0] += gain[ECCENTRIC_COS] * amount;
        self.eccentricity[1] += gain[ECCENTRIC_SIN] * amount;
        self.imbalance[0] += gain[IMBALANCE_COS] * amount;
        self.imbalance[1] += gain[IMBALANCE_SIN] * amount;
        self.covariance.reduce(gain, share, &self.noise.floor);
    }

    /// No input may leave a state that is no number, or one that no mirror has.
    pub(super) fn check_sanity(&mut self) {
        let known = self.covariance.is_finite() && self.speed.abs() < 10.0 * self.speed_max && self.brake.is_finite();
        if !known {
            self.relative_yield = 1.0;
            self.relative_drag = 1.0;
            self.eccentricity = [0.0; 2];
            self.imbalance = [0.0; 2];
            self.covariance = Covariance::diagonal([0.0; STATES]);
            self.centre = [0.0; 2];
            self.rest();
        }
    }
}
