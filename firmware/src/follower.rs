//! The projector follows the mirror: when each frame is to begin, and whether it did.
//!
//! A frame is asked for once the mirror is a tick or two from where it starts: later no board could obey, earlier more of what moves the
//! mirror would not be known yet. What the projector then says by its pulses must agree.

use crate::angle::{advanced, nanos_to_f32, radians_between};
use crate::config::Config;
use crate::frames::Frames;
use crate::projector_sync::ClockReading;
use crate::rotation::RotationEstimator;
use crate::velocity_lock::Reference;
use protocol::units::{Nanos, Turns};
use serde::{Deserialize, Serialize};

/// One frame of a projector that begins it when told.
///
/// Each plane's light is to be over after [`LIT_SHARE`] of the interval, so that a frame may begin a little before its time.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Trigger {
    /// How long after the time of the step that asks for it the trigger line is to be pulled, ns; the first plane follows after the latency.
    pub wait_ns: u32,
    /// From the start of a plane to the start of the next one, ns.
    pub plane_ns: f32,
}

/// What a frame's trigger is for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Asked {
    /// To be obeyed.
    pub trigger: Trigger,
    /// Which frame of the turn it begins.
    pub frame: u32,
    /// Whether it comes right after the one asked for before.
    pub in_order: bool,
}

/// A frame that was asked for.
#[derive(Clone, Copy, Debug)]
struct Shown {
    serial: u32,
    frame: u32,
    start: Nanos,
    plane_ns: f32,
    begun: bool,
}

/// Of a plane's interval, how much its light may take.
pub const LIT_SHARE: f32 = 0.95;
/// By what share of a plane's interval a frame may begin before the last one's time is over: half of what is dark. The other half is the
/// projector's jitter's.
const EARLY_SHARE: f32 = 0.5 * (1.0 - LIT_SHARE);
/// A frame that would have to begin later than this share of a plane after its place is left out.
const LATE_SHARE: f32 = 0.1;
/// When a trigger is given, in control ticks before it is due: never later than the first, not before the second.
const LEAD_TICKS: [f32; 2] = [0.25, 1.5];
/// Indices that must have agreed with the encoder before planes are placed by it.
const INDICES: u32 = 3;
/// Frames in a row that the projector must have begun as told.
const AGREEING: u32 = 3;
/// The speeds that a projector can follow, of the rig's: the same as a clock may run at.
const SPEEDS: [f32; 2] = [0.25, 4.0];
/// Pulses further from their place than so many sigmas are no noise.
const GATE_SIGMAS: f32 = 6.0;

/// Asks for frames and watches them.
///
/// Nothing of it is inlined: in the step of the mode that does not use it, 100 instructions more went into saving registers.
#[derive(Clone, Debug)]
pub struct Follower {
    frames: Frames,
    planes: u32,
    frame_rad: f32,
    latency_ns: u64,
    tick_ns: f32,
    jitter_ns: f32,
    nominal_speed: f32,
    nominal_frame_ns: f32,
    clock: Turns,
    on_screen: Option<Shown>,
    coming: Option<Shown>,
    next_plane: u32,
    agreed: u32,
    missing: u32,
    doubtful: bool,
    contradicted: bool,
    proven: bool,
}

impl Follower {
    /// Has asked for nothing yet.
    pub fn new(config: &Config) -> Self {
        Self {
            frames: Frames::of(&config.rotation),
            planes: config.rotation.planes_per_frame(),
            frame_rad: config.frame_rad(),
            latency_ns: config.clock.frame_latency.0,
            tick_ns: 1e9 / config.control_rate_hz,
            jitter_ns: config.clock.frame_jitter_ns,
            nominal_speed: config.nominal_speed_rad_s(),
            nominal_frame_ns: config.rotation.frame_nanos() as f32,
            clock: Turns::ZERO,
            on_screen: None,
            coming: None,
            next_plane: 0,
            agreed: 0,
            missing: 0,
            doubtful: false,
            contradicted: false,
            proven: false,
        }
    }

    /// What the mirror is to follow where nothing holds it back: the rig's speed, by the controller's own clock. Call once a tick.
    #[inline(never)]
    pub fn reference(&mut self) -> Reference {
        self.clock = advanced(self.clock, self.nominal_speed * self.tick_ns * 1e-9);
        Reference { angle: self.clock, speed: self.nominal_speed }
    }

    /// Forgets what was asked for: the mirror is let go.
    pub fn release(&mut self) {
        (self.on_screen, self.coming, self.next_plane) = (None, None, 0);
        (self.agreed, self.missing, self.doubtful, self.contradicted, self.proven) = (0, 0, false, false, false);
    }

    /// The mirror has been in step with the controller's clock: what the estimator has learnt of it is true.
    pub fn prove(&mut self) {
        self.proven = true;
    }

    /// Whether it has been since it was let go.
    pub fn is_proven(&self) -> bool {
        self.proven
    }

    /// Lets time pass. Call at every control tick.
    #[inline(never)]
    pub fn coast(&mut self, now: Nanos) {
        self.promote(now, 0.0);
        if let Some(shown) = self.on_screen.filter(|shown| !shown.begun) {
            self.doubtful |= nanos_to_f32(now.signed_since(shown.start)) > shown.plane_ns;
        }
    }

    /// The frame to ask for now, if one is due: it begins when `mirror`, which was seen at `now`, passes its start.
    pub fn ask(&mut self, now: Nanos, mirror: &RotationEstimator) -> Option<Asked> {
        let (speed, acceleration) = (mirror.speed(), mirror.acceleration());
        let [least, most] = SPEEDS.map(|share| share * self.nominal_speed);
        if !mirror.is_anchored(INDICES) || !(least..=most).contains(&speed) {
            return None;
        }
        let latency_ns = self.latency_ns as f32;
        let [latest_ns, earliest_ns] = LEAD_TICKS.map(|ticks| ticks * self.tick_ns + latency_ns);
        let until_ns = |way: f32| seconds_for(way, speed, acceleration) * 1e9;
        let ahead_s = earliest_ns * 1e-9;
        let frame = self.frames.at(advanced(mirror.angle(), (speed + 0.5 * acceleration * ahead_s) * ahead_s));
        let way = radians_between(mirror.angle(), self.frames.start(frame));
        let place_ns = until_ns(way);
        if !(latest_ns..=earliest_ns).contains(&place_ns) {
            return None;
        }
        let last = self.coming.or(self.on_screen);
        let free_ns = last.map_or(0.0, |last| {
            let length = (self.planes as f32 - EARLY_SHARE) * last.plane_ns;
            length - nanos_to_f32(now.signed_since(last.start))
        });
        let start_ns = place_ns.max(free_ns);
        let plane_ns = (until_ns(way + self.frame_rad) - start_ns) / self.planes as f32;
        // Asked for already, or crowded out; or frames follow each other faster than they can be armed.
        let possible = start_ns - place_ns < LATE_SHARE * plane_ns && plane_ns * self.planes as f32 > earliest_ns;
        possible.then(|| {
            let in_order = last.is_some_and(|last| frame == self.frames.after(last.frame, 1));
            Asked { trigger: self.add(now, start_ns, plane_ns, frame), frame, in_order }
        })
    }

    /// The same without a mirror that turns: frames one after the other at the rig's rate.
    pub fn ask_parked(&mut self, now: Nanos) -> Option<Trigger> {
        let [latest_ns, earliest_ns] = LEAD_TICKS.map(|ticks| ticks * self.tick_ns + self.latency_ns as f32);
        let last = self.coming.or(self.on_screen);
        let free_ns = last.map_or(0.0, |last| self.nominal_frame_ns - nanos_to_f32(now.signed_since(last.start)));
        let due = free_ns <= earliest_ns;
        due.then(|| self.add(now, free_ns.max(latest_ns), self.nominal_frame_ns / self.planes as f32, 0))
    }

    fn add(&mut self, now: Nanos, start_ns: f32, plane_ns: f32, frame: u32) -> Trigger {
        let start = now + Nanos(start_ns as u64);
        let last = self.coming.or(self.on_screen);
        let serial = last.map_or(0, |last| last.serial.wrapping_add(1));
        self.coming = Some(Shown { serial, frame, start, plane_ns, begun: false });
        Trigger { wait_ns: (start_ns as u32).saturating_sub(self.latency_ns as u32), plane_ns }
    }

    /// The projector says that it began a frame at `at`, whose first plane follows after the latency.
    #[inline(never)]
    pub fn frame_pulse(&mut self, at: Nanos) {
        let (latency_ns, tolerance) = (self.latency_ns, self.tolerance_ns());
        self.promote(at, tolerance);
        let near = |shown: &Shown| nanos_to_f32((at + Nanos(latency_ns)).signed_since(shown.start)).abs() <= tolerance;
        if let Some(coming) = self.coming.as_mut().filter(|coming| near(coming)) {
            coming.begun = true;
        } else if self.on_screen.as_ref().is_some_and(near) {
            self.confirm(at);
        } else {
            self.contradict();
        }
    }

    /// The projector says that it began a plane at `at`.
    #[inline(never)]
    pub fn plane_pulse(&mut self, at: Nanos) {
        if let Some(coming) = self.coming {
            self.promote(at, 0.5 * coming.plane_ns);
        }
        let Some(shown) = self.on_screen else {
            return self.contradict();
        };
        let planes = nanos_to_f32(at.signed_since(shown.start)) / shown.plane_ns;
        let plane = libm::roundf(planes);
        let astray = libm::fabsf(planes - plane) * shown.plane_ns > self.tolerance_ns()
            || !(0.0..self.planes as f32).contains(&plane);
        // An echo is the same plane again; any other out of order says that one before it did not come.
        let plane = plane.clamp(0.0, 255.0) as u32;
        let gap = plane != self.next_plane && plane + 1 != self.next_plane;
        self.next_plane = plane + 1;
        if astray || gap {
            self.contradict();
        } else if plane == 0 {
            self.confirm(at);
        }
    }

    /// What is on screen at `at`, by what was asked for.
    #[inline(never)]
    pub fn reading(&self, at: Nanos) -> Option<ClockReading> {
        let shown = self.on_screen?;
        let fraction = nanos_to_f32(at.signed_since(shown.start)) / (shown.plane_ns * self.planes as f32);
        // A pulse may come a little before its time, and the frame after this one begin a little late.
        let plane = 1.0 / self.planes as f32;
        let fraction_on = fraction.clamp(0.0, 0.999_999_9);
        let on = (-plane..1.0 + plane).contains(&fraction);
        on.then_some(ClockReading { serial: shown.serial, frame: shown.frame, fraction: fraction_on })
    }

    /// Whether a frame was on screen not long ago: where the mirror was pushed one or two may be left out.
    pub fn is_on(&self, at: Nanos) -> bool {
        let since = |shown: &Shown| nanos_to_f32(at.signed_since(shown.start));
        self.on_screen.is_some_and(|shown| since(&shown) < 3.0 * shown.plane_ns * self.planes as f32)
    }

    /// How fast a mirror must turn for what is on screen, rad/s.
    pub fn speed(&self) -> f32 {
        let frame_ns = self.on_screen.map_or(self.nominal_frame_ns, |shown| shown.plane_ns * self.planes as f32);
        self.frame_rad * 1e9 / frame_ns
    }

    /// Whether pulses have contradicted what was asked for, or not confirmed it.
    pub fn is_doubtful(&self) -> bool {
        self.doubtful || !self.is_known()
    }

    /// Whether the projector has begun frames as told.
    pub fn is_known(&self) -> bool {
        self.agreed >= AGREEING
    }

    /// Frames that were asked for since the last one that the projector began.
    pub fn frames_missing(&self) -> u32 {
        self.missing
    }

    /// How far from its place a pulse is noise, ns: not less than a tenth of a plane at the rig's speed, nor so much that one is half off.
    fn tolerance_ns(&self) -> f32 {
        let plane_ns = self.nominal_frame_ns / self.planes as f32;
        (GATE_SIGMAS * self.jitter_ns).max(0.1 * plane_ns).min(0.45 * plane_ns)
    }

    /// What was to come is on screen at `at`, or within `early_ns`.
    fn promote(&mut self, at: Nanos, early_ns: f32) {
        let due = |coming: &Shown| nanos_to_f32(at.signed_since(coming.start)) >= -early_ns;
        let Some(coming) = self.coming.filter(due) else {
            return;
        };
        // A line without any pulse is dead, which is no contradiction; one that stopped is.
        if self.on_screen.is_some() && self.next_plane != 0 && self.next_plane != self.planes {
            self.contradict();
        }
        (self.on_screen, self.coming, self.next_plane) = (Some(Shown { begun: false, ..coming }), None, 0);
        self.missing = self.missing.saturating_add(1);
        if coming.begun {
            self.confirm(at);
        }
    }

    /// The frame on screen began as told, as is known at `at`. Where that is after its start, what was in doubt before stays so in it: light
    /// that came back at its second plane would begin a turn there.
    fn confirm(&mut self, at: Nanos) {
        let tolerance = self.tolerance_ns();
        if let Some(shown) = self.on_screen.as_mut().filter(|shown| !shown.begun) {
            shown.begun = true;
            self.missing = 0;
            self.agreed = self.agreed.saturating_add(1);
            let late = nanos_to_f32(at.signed_since(shown.start)) > tolerance;
            self.doubtful = core::mem::take(&mut self.contradicted) || (self.doubtful && late);
        }
    }

    fn contradict(&mut self) {
        self.doubtful = true;
        self.contradicted = true;
    }
}

/// How long `way` radians take from `speed` rad/s, positive, at `acceleration` rad/s²: the root of `speed t + acceleration t² / 2 = way`, found by
/// repetition, which for what a motor does within a frame of 30 degrees errs by less than 1e-5 of it.
fn seconds_for(way: f32, speed: f32, acceleration: f32) -> f32 {
    let better = |seconds: f32| way / (speed + 0.5 * acceleration * seconds).max(0.5 * speed);
    better(better(better(way / speed)))
}

#[cfg(test)]
#[path = "follower_tests.rs"]
mod tests;
