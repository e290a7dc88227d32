//! The phase-locked loop that turns the mirror in step with the projector.
//!
//! Phase error is mirror less projector, in radians of the mirror. Until the mirror is in step the loop follows a planned way of the
//! error to zero; what it feeds forward is the estimated inertia, friction and imbalance, so feedback only sees what is left. There is
//! no integrator to wind up: what an integrator would hold is the estimator's friction, and that is learnt from the torque that the
//! motor was really given.

use crate::angle::{advanced, radians_between};
use crate::config::Config;
use crate::frames::Frames;
use crate::pacing::Pacing;
use crate::rotation::RotationEstimator;
use crate::single::{at_least, at_most, nearest, root};
use crate::trajectory::{Trajectory, Waypoint};
use core::f32::consts::TAU;
use protocol::units::Turns;

/// What the mirror is to follow, now.
#[derive(Clone, Copy, Debug)]
pub struct Reference {
    /// Where the plane on screen belongs, as progress since the index, for slot 0.
    pub angle: Turns,
    /// How fast that moves, rad/s.
    pub speed: f32,
}

/// What the loop is doing.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Phase {
    /// No torque.
    Off,
    /// As much torque as there is, until it is worth planning.
    Rush,
    /// On a way that was planned with `limit` rad/s².
    Follow { way: Trajectory, elapsed_s: f32, limit: f32 },
    /// In step.
    Track,
}

/// The loop.
#[derive(Clone, Debug)]
pub struct VelocityLock {
    torque_max_nm: f32,
    frames: Frames,
    slice_rad: f32,
    tick_s: f32,
    gain_error: f32,
    gain_rate: f32,
    phase: Phase,
    slot: u32,
    error: f32,
    rate: f32,
    probe_left_s: f32,
    turn_rad: f32,
    swings: u32,
}

/// Shares of the torque limit: of a rush, of a planned way, the rest being for feedback.
const RUSH_SHARE: f32 = 0.98;
const PLAN_SHARE: f32 = 0.97;
/// A landing is planned when this share of the speed is left. Earlier wastes torque that drag does not need yet; later leaves fewer
/// places to choose from.
const PLAN_BELOW: f32 = 0.3;
/// Inertia and friction look the same under constant torque, and a landing that mistakes one for the other is off by as much as the
/// torque changes. So a rush dips to this share for a moment where inertia is not known to this relative precision: just before the landing,
/// at the speed that matters. With 40 % of the speed left, 6 of 3,000 starts with half the inertia took 1.18 to 1.23 x, now 1.09 at most.
const PROBE_SHARE: f32 = 0.5;
const PROBE_S: f32 = 0.025;
const PROBE_PRECISION: f32 = 0.015;
/// And not before the landing takes this long at the least torque there is on the way, or passes this many places: where drag leaves
/// little at the end, a rush still has much. At 60 turns a second a landing from 30 % below took 11 s of 15.
const LANDING_S: f32 = 0.5;
const LANDING_PLACES: f32 = 6.0;
/// Indices that must have agreed with the encoder before a landing is planned.
const INDICES_BEFORE_PLAN: u32 = 3;
/// A way with more than this to go is planned anew where twice the acceleration turns out to be there. After a push the estimator takes much
/// of it for friction at first: one load of 20 % of the torque in a hundred was made good in 1.8 s, not 0.2 s.
const TIMID_S: f32 = 0.1;
/// A place that would be missed by no more than this is kept: feedback makes it good sooner than another place comes.
const REACH_SLICES: f32 = 0.5;
/// From this many slices away a mirror in step is brought back on a planned way.
const REPLAN_SLICES: f32 = 1.0;
/// At one speed imbalance and eccentricity look the same to encoder and index. Where the spin-up was too short to tell them apart (at 5
/// turns a second it is one turn) the mirror swings: it falls back by so many turns, by this share of its speed at most, and an
/// imbalance then moves it 4.9 times as far. Until the eccentricity is known to this part of a slice, or so often.
const SWING_TURNS: f32 = 3.0;
const SWING_SHARE: f32 = 0.55;
const SWING_ABOVE_SLICES: f32 = 0.015;
const SWINGS_MAX: u32 = 3;

impl VelocityLock {
    /// Off.
    pub fn new(config: &Config) -> Self {
        Self {
            torque_max_nm: config.motor.torque_max_nm,
            // Frames that have numbers belong in one place each.
            frames: match config.pacing {
                Pacing::VideoLocked => Frames::ONE,
                _ => Frames::of(&config.rotation),
            },
            slice_rad: config.slice_rad(),
            tick_s: 1.0 / config.control_rate_hz,
            gain_error: config.gains.bandwidth_rad_s * config.gains.bandwidth_rad_s,
            gain_rate: 2.0 * config.gains.damping * config.gains.bandwidth_rad_s,
            phase: Phase::Off,
            slot: 0,
            error: 0.0,
            rate: 0.0,
            probe_left_s: 0.0,
            turn_rad: 0.0,
            swings: 0,
        }
    }

    /// Lets go of the mirror.
    pub fn release(&mut self) {
        self.phase = Phase::Off;
    }

    /// Whether the planned way is done and the mirror is kept in step.
    pub fn is_tracking(&self) -> bool {
        self.phase == Phase::Track
    }

    /// By how many frames of a turn the mirror's place is ahead of the projector's count of frames.
    pub fn slot(&self) -> u32 {
        self.slot
    }

    /// Estimated phase error, slices; meaningful while tracking.
    pub fn error_slices(&self) -> f32 {
        self.error / self.slice_rad
    }

    /// Estimated rate of the phase error, slices a second.
    pub fn rate_slices_s(&self) -> f32 {
        self.rate / self.slice_rad
    }

    /// The torque for the coming tick, N m in the mirror's direction, within the limit. `lead_s`: how long before its effect a torque
    /// is commanded. Without a reference the mirror is left alone. `may_swing`: nothing is lit, so that it may leave its place to learn.
    pub fn torque(
        &mut self,
        mirror: &RotationEstimator,
        reference: Option<Reference>,
        lead_s: f32,
        may_swing: bool,
    ) -> f32 {
        let Some(reference) = reference else {
            self.phase = Phase::Off;
            return 0.0;
        };
        self.error = radians_between(reference.angle + self.frames.start(self.slot), mirror.angle());
        self.rate = mirror.speed() - reference.speed;
        self.change_phase(mirror, reference);
        self.swing_where_unsure(mirror, may_swing);
        let wanted = match self.phase {
            Phase::Off => 0.0,
            Phase::Rush => self.rush(mirror, reference),
            Phase::Follow { way, elapsed_s, limit } => {
                self.phase = Phase::Follow { way, elapsed_s: elapsed_s + self.tick_s, limit };
                self.follow(mirror, reference, way.at(elapsed_s), way.at(elapsed_s + lead_s), lead_s)
            }
            Phase::Track => self.follow(mirror, reference, Waypoint::default(), Waypoint::default(), lead_s),
        };
        if wanted.is_finite() { at_most(at_least(wanted, -self.torque_max_nm), self.torque_max_nm) } else { 0.0 }
    }

    fn change_phase(&mut self, mirror: &RotationEstimator, reference: Reference) {
        match self.phase {
            Phase::Off => {
                self.phase = Phase::Rush;
                self.probe_left_s = PROBE_S;
            }
            Phase::Rush => {
                let near = self.rate.abs() < self.plan_below(mirror, reference);
                let probing = self.wants_probe(mirror, reference);
                if probing {
                    self.probe_left_s -= self.tick_s;
                } else if near && mirror.is_anchored(INDICES_BEFORE_PLAN) {
                    self.plan(mirror, reference);
                }
            }
            Phase::Follow { way, elapsed_s, limit } => {
                let left_s = way.duration_s() - elapsed_s;
                let timid = left_s > TIMID_S && self.acceleration_limit(PLAN_SHARE, mirror, reference) > 2.0 * limit;
                if left_s <= 0.0 {
                    self.phase = Phase::Track;
                } else {
                    let place = way.at(elapsed_s);
                    if timid || self.is_out_of_reach(place, mirror, reference) || self.has_strayed(place) {
                        self.plan(mirror, reference);
                    }
                }
            }
            Phase::Track => {
                if self.has_strayed(Waypoint::default()) {
                    self.plan(mirror, reference);
                }
            }
        }
    }

    /// By how much the speed is wrong when a landing is planned.
    fn plan_below(&self, mirror: &RotationEstimator, reference: Reference) -> f32 {
        let limit = at_least(self.acceleration_limit(PLAN_SHARE, mirror, reference), 1.0);
        let spacing = TAU / self.frames.count() as f32;
        let long = at_least(LANDING_S * limit, root(2.0 * LANDING_PLACES * spacing * limit));
        at_most(PLAN_BELOW * reference.speed.abs(), long)
    }

    /// Turn by turn, once it is in step.
    fn swing_where_unsure(&mut self, mirror: &RotationEstimator, may_swing: bool) {
        if self.phase != Phase::Track || !may_swing {
            if !matches!(self.phase, Phase::Track | Phase::Follow { .. }) {
                self.swings = 0;
            }
            self.turn_rad = 0.0;
            return;
        }
        self.turn_rad += mirror.speed().abs() * self.tick_s;
        if self.turn_rad < TAU {
            return;
        }
        self.turn_rad = 0.0;
        let unsure = mirror.sigma_eccentricity_rad() > SWING_ABOVE_SLICES * self.slice_rad;
        if unsure && self.swings < SWINGS_MAX {
            self.swings += 1;
            let way = Trajectory::excursion(
                self.error + SWING_TURNS * TAU,
                self.rate,
                1.875 * SWING_TURNS * TAU / (SWING_SHARE * at_least(mirror.speed().abs(), 0.1)),
            );
            self.phase = Phase::Follow { way, elapsed_s: 0.0, limit: f32::INFINITY };
        }
    }

    fn wants_probe(&self, mirror: &RotationEstimator, reference: Reference) -> bool {
        let rate = self.rate.abs();
        let begun = self.probe_left_s < PROBE_S;
        let due = begun || (rate < PLAN_BELOW * reference.speed && mirror.sigma_inertia() > PROBE_PRECISION);
        due && self.probe_left_s > 0.0 && rate > 0.1 * reference.speed && mirror.is_anchored(1)
    }

    /// How far the mirror is from where its way has it, radians.
    fn off(&self, place: Waypoint) -> f32 {
        radians_between(advanced(Turns::ZERO, place.error), advanced(Turns::ZERO, self.error))
    }

    fn has_strayed(&self, place: Waypoint) -> bool {
        let off = self.off(place);
        let allowed = REPLAN_SLICES * self.slice_rad;
        // Far from the end the estimate still moves, and there is time.
        off.abs() > allowed + 0.05 * place.error.abs() || (self.rate - place.rate).abs() > 2.0 + 0.1 * place.rate.abs()
    }

    /// Whether all the torque there is would not bring the mirror to rest where the way ends.
    ///
    /// That the torque is at its limit says less: ways are planned so close to it that an imbalance, or a rate of the clock that has just
    /// been learnt, saturates it. Planned anew for that, one step in eight from 240 to 200 Hz passed by its place, and took 1.27 x, not 1.10.
    fn is_out_of_reach(&self, place: Waypoint, mirror: &RotationEstimator, reference: Reference) -> bool {
        let left = place.error + self.off(place);
        let way = left.abs() + REACH_SLICES * self.slice_rad;
        left * self.rate < 0.0 && self.rate * self.rate > 2.0 * way * self.acceleration_limit(1.0, mirror, reference)
    }

    /// The acceleration that a share of the torque allows on the way to the reference's speed, both ways.
    fn acceleration_limit(&self, share: f32, mirror: &RotationEstimator, reference: Reference) -> f32 {
        let torque = share * self.torque_max_nm;
        if self.rate < 0.0 {
            mirror.acceleration_for(torque, reference.speed)
        } else {
            -mirror.acceleration_for(-torque, reference.speed)
        }
    }

    fn plan(&mut self, mirror: &RotationEstimator, reference: Reference) {
        if self.rate.abs() > self.plan_below(mirror, reference) * 1.5 + 5.0 {
            self.phase = Phase::Rush;
            return;
        }
        let limit = at_least(self.acceleration_limit(PLAN_SHARE, mirror, reference), 1.0);
        let spacing = TAU / self.frames.count() as f32;
        let landing = Trajectory::landing(self.error, self.rate, spacing, limit);
        let way = match landing {
            Some(way) if self.frames != Frames::ONE => way,
            _ => {
                // Where the mirror would come to rest by itself decides which place is nearest.
                let ahead = self.error + 0.1 * self.rate;
                let start = self.error - spacing * nearest(ahead / spacing);
                let glide = Trajectory::glide(start, self.rate, 0.7 * limit);
                // To a place a whole turn from the next one the speed that is wrong would take 2.3 s from 240 to 235 Hz.
                landing.filter(|way| way.duration_s() < glide.duration_s()).unwrap_or(glide)
            }
        };
        let places = nearest((self.error - way.at(0.0).error) / spacing) as i32;
        self.slot = self.frames.moved(self.slot, places);
        self.error -= places as f32 * spacing;
        self.phase = Phase::Follow { way, elapsed_s: 0.0, limit };
    }

    fn rush(&self, mirror: &RotationEstimator, reference: Reference) -> f32 {
        // Also where the plan has to wait (no index yet): full torque far from the speed, less near it.
        let near = at_most(
            0.05 * reference.speed,
            0.1 * at_least(self.acceleration_limit(PLAN_SHARE, mirror, reference), 1.0),
        );
        let share = (-self.rate / near).clamp(-1.0, 1.0);
        if share.abs() < 1.0 {
            let holding = mirror.torque_for(0.0, mirror.speed(), mirror.angle());
            return holding + share * at_least(RUSH_SHARE * self.torque_max_nm - holding.abs(), 0.0);
        }
        let probing = if self.wants_probe(mirror, reference) { PROBE_SHARE } else { 1.0 };
        share * probing * RUSH_SHARE * self.torque_max_nm
    }

    fn follow(
        &self,
        mirror: &RotationEstimator,
        reference: Reference,
        now: Waypoint,
        soon: Waypoint,
        lead_s: f32,
    ) -> f32 {
        let feedback = -self.gain_error * self.off(now) - self.gain_rate * (self.rate - now.rate);
        let angle = advanced(mirror.angle(), mirror.speed() * lead_s);
        mirror.torque_for(soon.acceleration + feedback, reference.speed + soon.rate, angle)
    }
}
