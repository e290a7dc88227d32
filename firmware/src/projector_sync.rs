//! Frame pulses to a disciplined clock: where in which frame the projector is.
//!
//! A two-state Kalman filter (edge, period) behind a 6 sigma gate. A lost pulse costs nothing, an extra one is refused, and three
//! intervals that agree with each other but not with the filter restart it on the new rate.
//!
//! Frame pulses discipline the clock; plane pulses, 24 times as many, contradict it within a plane where the rate steps in the middle
//! of nowhere: from 240 to 180 Hz the frame pulse comes when 18 planes have been shown in the wrong place, the first plane pulse when
//! one is a third of a slice late.

mod filter;

use crate::angle::nanos_to_f32;
use crate::config::Config;
use crate::frames::Frames;
use crate::plane_run::PlaneRun;
use crate::single::{floor, nearest, root};
use filter::{Filter, Fine};
use protocol::units::Nanos;

/// What a pulse meant.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pulse {
    /// The clock is not known yet.
    Searching,
    /// It agreed with the clock.
    Accepted,
    /// It did not; the clock runs on as before.
    Refused,
    /// It started the clock, or started it anew at another rate or phase.
    Restarted,
}

/// The first frame's serial number: it wraps 3 s later at 240 Hz, when the mirror is in step, so that every run shows that nothing hangs on it.
const FIRST_SERIAL: u32 = 0u32.wrapping_sub(720);

/// A place in the projector's sequence of frames, as far as light goes: latency is taken off.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ClockReading {
    /// The frame on screen, counted without end; wraps.
    pub serial: u32,
    /// The same, counted modulo the frames of a turn from an arbitrary start.
    pub frame: u32,
    /// How much of it has passed, 0 ≤ fraction < 1.
    pub fraction: f32,
}

const GATE_SIGMAS: f32 = 6.0;
/// Of one pulse in what they are seen to scatter: a fifth of a second at 240 Hz.
const SCATTER_SHARE: f32 = 0.02;
/// Intervals that must agree before they are believed.
const AGREEING: usize = 3;

/// The filter.
#[derive(Clone, Debug)]
pub struct ProjectorSync {
    frames: Frames,
    latency_ns: u64,
    nominal_ns: f32,
    told_variance: f32,
    scatter: f32,
    last_innovation: f32,
    jitter_variance: f32,
    wander_per_sqrt_s: f32,
    /// The last ones, the newest last; how many of them there are.
    stamps: [Nanos; AGREEING + 1],
    stamped: usize,
    tracking: bool,
    filter: Filter,
    frame: u32,
    serial: u32,
    frames_since_pulse: u32,
    refused: u32,
    doubtful: bool,
    contradicted: bool,
    last_plane: Option<Nanos>,
    run: PlaneRun,
    planes: f32,
}

impl ProjectorSync {
    /// Knows nothing yet.
    pub fn new(config: &Config) -> Self {
        // A capture timer resolves a few nanoseconds; a clock said to be perfect is not believed beyond that.
        let jitter_ns = config.clock.frame_jitter_ns.max(10.0);
        Self {
            frames: Frames::of(&config.rotation),
            latency_ns: config.clock.frame_latency.0,
            nominal_ns: config.rotation.frame_nanos() as f32,
            told_variance: jitter_ns * jitter_ns,
            scatter: jitter_ns * jitter_ns,
            last_innovation: 0.0,
            jitter_variance: jitter_ns * jitter_ns,
            wander_per_sqrt_s: config.clock.wander_ppm_per_sqrt_s.max(0.05) * 1e-6,
            stamps: [Nanos::ZERO; AGREEING + 1],
            stamped: 0,
            tracking: false,
            filter: Filter::default(),
            frame: 0,
            serial: FIRST_SERIAL,
            frames_since_pulse: 0,
            refused: 0,
            doubtful: false,
            contradicted: false,
            last_plane: None,
            run: PlaneRun::default(),
            planes: config.rotation.planes_per_frame() as f32,
        }
    }

    /// Whether the clock is known.
    pub fn is_tracking(&self) -> bool {
        self.tracking
    }

    /// Whether the last pulse contradicted the clock, so that what is on screen is not known until the next one.
    pub fn is_doubtful(&self) -> bool {
        self.doubtful
    }

    /// Frames since the last accepted pulse.
    pub fn frames_missing(&self) -> u32 {
        self.frames_since_pulse
    }

    /// The duration of a frame, ns; the nominal one while nothing is known.
    pub fn period_ns(&self) -> f32 {
        if self.tracking { self.filter.period.nanos() } else { self.nominal_ns }
    }

    /// The standard deviation of the clock's phase now, in frames.
    pub fn sigma_frames(&self) -> f32 {
        root(self.filter.variance_edge) / self.period_ns()
    }

    /// Forgets the clock, as after a long silence.
    pub fn forget(&mut self) {
        self.tracking = false;
        self.stamped = 0;
        self.doubtful = false;
        self.contradicted = false;
    }

    /// Takes a frame pulse captured at `at`.
    pub fn pulse(&mut self, at: Nanos) -> Pulse {
        if self.stamped > 0 && at.signed_since(self.stamps[AGREEING]) <= 0 {
            return Pulse::Refused;
        }
        for i in 0..AGREEING {
            self.stamps[i] = self.stamps[i + 1];
        }
        self.stamps[AGREEING] = at;
        self.stamped = (self.stamped + 1).min(self.stamps.len());
        let accepted = self.tracking && self.accept(at);
        if let Some(period_ns) = self.agreed_period()
            && (!self.tracking || self.refused >= AGREEING as u32 || self.is_another_rate(period_ns))
        {
            self.restart(at, period_ns);
            return Pulse::Restarted;
        }
        match (self.tracking, accepted) {
            (false, _) => Pulse::Searching,
            (true, true) => Pulse::Accepted,
            (true, false) => Pulse::Refused,
        }
    }

    /// Takes a plane pulse captured at `at`. One that falls between the planes of the clock, or that comes when one before it has
    /// not come, makes the clock doubtful until frame and plane pulses have agreed for a frame.
    pub fn plane_pulse(&mut self, at: Nanos) {
        let last = self.last_plane.replace(at);
        self.run.add(at, self.interval_tolerance_ns(self.period_ns() / self.planes));
        if !self.tracking {
            return;
        }
        let planes = self.filter.edge.plus(self.latency_ns, 0.0).until(at) / self.period_ns() * self.planes;
        let astray = (planes - nearest(planes)).abs() > self.plane_tolerance();
        let gap = last.is_some_and(|last| nanos_to_f32(at.signed_since(last)) * self.planes > 1.5 * self.period_ns());
        self.contradicted |= astray || gap;
        self.doubtful |= self.contradicted;
        if self.contradicted {
            self.follow_planes();
        }
    }

    /// Takes up the rate of the planes where they have agreed on one since the first plane of the last frame that pulsed. Two frames
    /// earlier than frame pulses can agree, of the 24 that a mirror with half the inertia takes from 240 to 180 Hz.
    fn follow_planes(&mut self) {
        let Some((start, plane_ns)) = self.run.agreed() else {
            return;
        };
        let period_ns = plane_ns * self.planes;
        let off_ns = self.filter.edge.plus(self.latency_ns, 0.0).until(start);
        // Eight sigmas of the period that eight intervals tell: a plane pulse that was lost is no new rate.
        let new = (period_ns - self.period_ns()).abs() > 4.0 * self.interval_tolerance_ns(period_ns);
        if self.frames_since_pulse > 0 || off_ns.abs() > 0.25 * plane_ns || !(new && self.is_possible(period_ns)) {
            return;
        }
        self.filter.period = Fine::default().plus(0, period_ns);
        self.filter.variance_period = self.planes * self.planes * self.run.variance(self.jitter_variance);
        self.filter.covariance = 0.0;
        self.contradicted = false;
    }

    /// A projector may run at a quarter or at four times the rate that the rig names; anything else is no frame clock.
    fn is_possible(&self, period_ns: f32) -> bool {
        period_ns > 0.25 * self.nominal_ns && period_ns < 4.0 * self.nominal_ns
    }

    /// Lets the clock run on to `now` without a pulse. Call at every control tick.
    pub fn coast(&mut self, now: Nanos) {
        // Half a frame of grace, so that a pulse that is a little late still meets the edge that it belongs to.
        for _ in 0..4 {
            if !self.tracking || self.filter.edge.until(now) < 1.5 * self.period_ns() {
                return;
            }
            self.filter.next_frame(self.wander_per_sqrt_s);
            self.count_frames(1);
        }
        if self.filter.edge.until(now) > 1e3 * self.period_ns() {
            self.forget();
        }
    }

    /// Which frame is on screen at `at`, which must be near now.
    pub fn reading(&self, at: Nanos) -> Option<ClockReading> {
        if !self.tracking {
            return None;
        }
        let frames = self.filter.edge.plus(self.latency_ns, 0.0).until(at) / self.period_ns();
        let whole = floor(frames);
        let (serial, frame) = self.counted(whole as i32);
        Some(ClockReading { serial, frame, fraction: (frames - whole).clamp(0.0, 0.999_999_9) })
    }

    /// The frame after the one whose pulse, not light, was nearest to `at`: counted as in a [`ClockReading`].
    pub fn after_pulse(&self, at: Nanos) -> Option<(u32, u32)> {
        let frames = nearest(self.filter.edge.until(at) / self.period_ns());
        self.tracking.then(|| self.counted(frames as i32 + 1))
    }

    /// The serial number and the place of the frame that is so many after the last edge's.
    fn counted(&self, frames: i32) -> (u32, u32) {
        (self.serial.wrapping_add_signed(frames), self.frames.moved(self.frame, frames))
    }

    fn accept(&mut self, at: Nanos) -> bool {
        let since = self.filter.edge.until(at);
        let frames = nearest(since / self.period_ns());
        if !(1.0..=4.0).contains(&frames) {
            // A second pulse at an edge that was already seen tells nothing new; elsewhere it contradicts the clock.
            let at_edge = since.abs() < GATE_SIGMAS * root(self.filter.variance_edge + self.jitter_variance);
            self.doubtful |= !at_edge;
            return false;
        }
        let frames = frames as u32;
        let mut ahead = self.filter;
        for _ in 0..frames {
            ahead.next_frame(self.wander_per_sqrt_s);
        }
        let innovation = ahead.edge.until(at);
        self.learn_jitter(innovation);
        let variance = ahead.variance_edge + self.jitter_variance;
        if innovation * innovation > GATE_SIGMAS * GATE_SIGMAS * variance {
            self.refused = self.refused.saturating_add(1);
            self.doubtful = true;
            return false;
        }
        ahead.correct(innovation, variance);
        self.filter = ahead;
        self.count_frames(frames);
        self.refused = 0;
        self.doubtful = self.contradicted;
        self.contradicted = false;
        self.frames_since_pulse = 0;
        true
    }

    /// What pulses scatter, where it is more than was told. By the change from pulse to pulse: a clock that drifts moves them all one way,
    /// and taken for scatter 100 ppm went unnoticed until planes were 0.46 slices off. From pulses within a quarter of a plane of their
    /// place; others mean something else.
    fn learn_jitter(&mut self, innovation: f32) {
        if innovation.abs() * self.planes < 0.25 * self.period_ns() {
            let change = innovation - core::mem::replace(&mut self.last_innovation, innovation);
            self.scatter += SCATTER_SHARE * (0.5 * change * change - self.scatter);
            let more = self.scatter > 2.0 * self.told_variance;
            self.jitter_variance = if more { self.scatter } else { self.told_variance };
        }
    }

    /// How far from its place, in planes, a plane pulse is believed to be noise: 6 sigma, but not less than what a slight rate error
    /// makes of a frame, nor so much that a plane is half off.
    fn plane_tolerance(&self) -> f32 {
        (GATE_SIGMAS * root(self.jitter_variance) * self.planes / self.nominal_ns).clamp(0.1, 0.45)
    }

    fn count_frames(&mut self, frames: u32) {
        self.frame = self.frames.after(self.frame, frames);
        self.serial = self.serial.wrapping_add(frames);
        self.frames_since_pulse = self.frames_since_pulse.saturating_add(frames);
    }

    /// The period in which the last intervals agree, if they do.
    fn agreed_period(&self) -> Option<f32> {
        if self.stamped < self.stamps.len() {
            return None;
        }
        let [oldest, later @ ..] = self.stamps;
        let mean = nanos_to_f32(self.stamps[AGREEING].signed_since(oldest)) / AGREEING as f32;
        let mut intervals = self.stamps.iter().zip(later).map(|(from, to)| nanos_to_f32(to.signed_since(*from)));
        let tolerance_ns = self.interval_tolerance_ns(mean);
        let agree = intervals.all(|interval| (interval - mean).abs() < tolerance_ns);
        (agree && self.is_possible(mean)).then_some(mean)
    }

    fn is_another_rate(&self, period_ns: f32) -> bool {
        (period_ns - self.period_ns()).abs() > self.interval_tolerance_ns(period_ns)
    }

    fn interval_tolerance_ns(&self, interval_ns: f32) -> f32 {
        GATE_SIGMAS * root(2.0 * self.jitter_variance) + 1e-4 * interval_ns
    }

    fn restart(&mut self, at: Nanos, period_ns: f32) {
        if self.tracking {
            // Numbering goes on with the pulses that were refused, so that a slight change of rate keeps the picture where it is.
            self.frame = self.frames.after(self.frame, self.refused);
            self.serial = self.serial.wrapping_add(self.refused).wrapping_add(1);
        }
        self.tracking = true;
        self.filter.edge = Fine::at(at);
        self.filter.period = Fine::default().plus(0, period_ns);
        self.filter.variance_edge = self.jitter_variance;
        self.filter.covariance = self.jitter_variance / AGREEING as f32;
        self.filter.variance_period = 2.0 * self.jitter_variance / (AGREEING * AGREEING) as f32;
        self.refused = 0;
        self.contradicted = false;
        // Until a pulse confirms it.
        self.doubtful = true;
        self.frames_since_pulse = 0;
    }
}

#[cfg(test)]
#[path = "projector_sync_tests.rs"]
mod tests;
