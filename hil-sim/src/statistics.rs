//! What is worth knowing of a run, collected plane by plane in bounded memory.

use crate::checkers::Verdict;
use protocol::message::{Fault, State};
use serde::Serialize;

/// A summary of a run. Phase errors are the true mirror angle against where the plane on screen belongs, modulo a frame, in slices; of a mirror
/// that nothing measures, less their mean over the first turn that is lit.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LockStatistics {
    /// Simulated seconds.
    pub seconds: f64,
    /// Of these, in [`State::Locked`] or [`State::OpenLoop`].
    pub locked_seconds: f64,
    /// Root mean square phase error while locked and not in doubt, slices.
    pub rms_slices: f64,
    /// Its 99th percentile.
    pub p99_slices: f64,
    /// Its largest value.
    pub peak_slices: f64,
    /// When that was, seconds.
    pub peak_at_s: f64,
    /// The same as time, microseconds.
    pub rms_us: f64,
    /// The same as time, microseconds.
    pub p99_us: f64,
    /// The same as time, microseconds.
    pub peak_us: f64,
    /// What disturbed the mirror, and how it came back; the first is the start.
    pub recoveries: Vec<Recovery>,
    /// Planes that the projector's clock had.
    pub planes: u64,
    /// Of these, planes in which nothing was lit.
    pub dark: u64,
    /// When the controller changed its state, seconds, and to what. At most 1000.
    pub states: Vec<(f64, State)>,
    /// Faults, with their times. At most 1000.
    pub faults: Vec<(f64, Fault)>,
    /// What the checkers found.
    pub verdict: Verdict,
}

/// One disturbance and its end.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Recovery {
    /// What happened.
    pub cause: String,
    /// When, seconds.
    pub at_s: f64,
    /// How long until the phase error stayed within 0.1 slice, seconds, and planes were lit where the projector follows. `None`: it did not.
    pub settled_s: Option<f64>,
    /// How long full torque takes from the speed then to the projector's speed, seconds.
    pub torque_limited_s: f64,
    /// Largest phase error while planes might be lit, slices.
    pub peak_slices: f64,
}

impl Recovery {
    /// Time to settle over the torque-limited time.
    pub fn ratio(&self) -> Option<f64> {
        self.settled_s.map(|settled_s| settled_s / self.torque_limited_s)
    }
}

/// In step means this close.
const SETTLED_SLICES: f64 = 0.1;
const BINS_PER_SLICE: f64 = 2_000.0;
const LIST_MAX: usize = 1_000;

/// Collects [`LockStatistics`].
#[derive(Clone, Debug)]
pub struct Collector {
    locked_ns: f64,
    count: u64,
    squares: f64,
    peak: f64,
    peak_at_s: f64,
    bins: Vec<u32>,
    plane_ns: f64,
    planes: u64,
    dark: u64,
    recoveries: Vec<Recovery>,
    last_outside_s: f64,
    stopped: bool,
    follows: bool,
    waits_for_light: bool,
    states: Vec<(f64, State)>,
    faults: Vec<(f64, Fault)>,
}

impl Default for Collector {
    fn default() -> Self {
        Self {
            locked_ns: 0.0,
            count: 0,
            squares: 0.0,
            peak: 0.0,
            peak_at_s: 0.0,
            bins: vec![0; (12.0 * BINS_PER_SLICE) as usize + 1],
            plane_ns: 0.0,
            planes: 0,
            dark: 0,
            recoveries: Vec::new(),
            last_outside_s: 0.0,
            stopped: false,
            follows: false,
            waits_for_light: false,
            states: vec![(0.0, State::Idle)],
            faults: Vec::new(),
        }
    }
}

impl Collector {
    /// For a projector that follows an estimate of the mirror: its planes are always where they belong, so that in step means lit as well.
    pub fn following() -> Self {
        Self { follows: true, ..Self::default() }
    }

    /// A plane started at `at_s`, `error_slices` off, `plane_ns` long; `light`: it may be lit.
    pub fn plane(&mut self, at_s: f64, error_slices: f64, plane_ns: f64, state: State, light: bool) {
        self.planes += 1;
        let size = error_slices.abs();
        if size > SETTLED_SLICES || (self.follows && !light) {
            self.last_outside_s = at_s;
        }
        self.waits_for_light &= !light;
        if let (true, Some(recovery)) = (light, self.recoveries.last_mut()) {
            recovery.peak_slices = recovery.peak_slices.max(size);
        }
        let in_step = matches!(state, State::Locked | State::OpenLoop);
        if in_step {
            self.locked_ns += plane_ns;
        }
        if in_step && light {
            self.plane_ns = plane_ns;
            self.count += 1;
            self.squares += size * size;
            if size > self.peak {
                (self.peak, self.peak_at_s) = (size, at_s);
            }
            let last = self.bins.len() - 1;
            self.bins[((size * BINS_PER_SLICE) as usize).min(last)] += 1;
        }
    }

    /// Planes so far.
    pub fn planes(&self) -> u64 {
        self.planes
    }

    /// A plane passed without light.
    pub fn dark_plane(&mut self) {
        self.dark += 1;
    }

    /// Something disturbs the mirror at `at_s`; full torque takes `torque_limited_s` to bring it back.
    pub fn disturbed(&mut self, cause: String, at_s: f64, torque_limited_s: f64) {
        self.settle(at_s);
        if self.recoveries.len() < LIST_MAX {
            self.recoveries.push(Recovery { cause, at_s, settled_s: None, torque_limited_s, peak_slices: 0.0 });
        }
        self.last_outside_s = at_s;
        self.waits_for_light = self.follows;
        self.stopped = false;
    }

    /// The host stopped the mirror at `at_s`: what it leaves from then on it leaves on purpose.
    pub fn stopped(&mut self, at_s: f64) {
        self.settle(at_s);
        self.stopped = true;
    }

    /// The controller changed its state or reported a fault.
    pub fn state(&mut self, at_s: f64, state: State, fault: Option<Fault>) {
        if self.states.last().is_none_or(|&(_, last)| last != state) && self.states.len() < LIST_MAX {
            self.states.push((at_s, state));
            if let (State::Fault, Some(fault)) = (state, fault) {
                self.faults.push((at_s, fault));
            }
        }
    }

    /// What has been collected until `seconds`.
    pub fn summary(&self, seconds: f64, verdict: Verdict) -> LockStatistics {
        let mut settled = self.clone();
        settled.settle(seconds);
        let count = self.count.max(1) as f64;
        let (rms, p99) = ((self.squares / count).sqrt(), self.percentile(0.99));
        let to_us = self.plane_ns * 1e-3;
        LockStatistics {
            seconds,
            locked_seconds: self.locked_ns * 1e-9,
            rms_slices: rms,
            p99_slices: p99,
            peak_slices: self.peak,
            peak_at_s: self.peak_at_s,
            rms_us: rms * to_us,
            p99_us: p99 * to_us,
            peak_us: self.peak * to_us,
            recoveries: settled.recoveries,
            planes: self.planes,
            dark: self.dark,
            states: self.states.clone(),
            faults: self.faults.clone(),
            verdict,
        }
    }

    fn settle(&mut self, now_s: f64) {
        if let (false, Some(recovery)) = (self.stopped, self.recoveries.last_mut()) {
            // A mirror that slides through the right place is not in step: it must have been there for a while.
            let stays = now_s - self.last_outside_s > 0.02 && !self.waits_for_light;
            recovery.settled_s = stays.then_some(self.last_outside_s - recovery.at_s);
        }
    }

    fn percentile(&self, share: f64) -> f64 {
        let wanted = (self.count as f64 * share) as u64;
        let mut seen = 0;
        for (i, &bin) in self.bins.iter().enumerate() {
            seen += u64::from(bin);
            if seen > wanted {
                return (i + 1) as f64 / BINS_PER_SLICE;
            }
        }
        0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_known_series_has_known_figures() {
        let mut collector = Collector::default();
        collector.disturbed("start".to_owned(), 0.0, 1.0);
        for i in 0..1_000 {
            let at_s = f64::from(i) * 1e-3;
            let error = if i < 500 { 1.0 } else { 0.01 };
            let state = if i < 600 { State::Acquire } else { State::Locked };
            collector.state(at_s, state, None);
            collector.plane(at_s, if i == 999 { -0.05 } else { error }, 1e6, state, true);
        }
        let summary = collector.summary(1.0, Verdict::default());
        assert_eq!(summary.recoveries[0].settled_s, Some(0.499));
        assert_eq!(summary.recoveries[0].ratio(), Some(0.499));
        assert_eq!(summary.peak_slices, 0.05);
        assert!((summary.rms_slices - ((399.0 * 1e-4 + 0.0025) / 400.0f64).sqrt()).abs() < 1e-12);
        assert!((summary.p99_slices - 0.0105).abs() < 1e-9);
        assert!((summary.locked_seconds - 0.4).abs() < 1e-9);
        assert_eq!(summary.states.len(), 3);
    }

    #[test]
    fn a_projector_that_follows_is_in_step_when_it_is_lit() {
        let mut collector = Collector::following();
        let play = |from_ms: u32, to_ms: u32, light: bool, collector: &mut Collector| {
            for ms in from_ms..to_ms {
                collector.plane(f64::from(ms) * 1e-3, 0.01, 1e6, State::Locked, light);
            }
        };
        collector.disturbed("start".to_owned(), 0.0, 1.0);
        play(0, 500, false, &mut collector);
        play(500, 1_000, true, &mut collector);
        collector.disturbed("stop".to_owned(), 1.0, 1.0);
        let recoveries = collector.summary(2.0, Verdict::default()).recoveries;
        let settled: Vec<_> = recoveries.iter().map(|recovery| recovery.settled_s).collect();
        assert_eq!(settled, [Some(0.499), None]);
    }

    #[test]
    fn a_stop_closes_the_recovery_and_a_start_opens_another() {
        let mut collector = Collector::default();
        let play = |from_ms: u32, to_ms: u32, error: f64, collector: &mut Collector| {
            for ms in from_ms..to_ms {
                collector.plane(f64::from(ms) * 1e-3, error, 1e6, State::Locked, true);
            }
        };
        collector.disturbed("start".to_owned(), 0.0, 1.0);
        play(0, 500, 1.0, &mut collector);
        play(500, 1_000, 0.01, &mut collector);
        collector.stopped(1.0);
        play(1_000, 2_000, 3.0, &mut collector);
        assert_eq!(collector.summary(2.0, Verdict::default()).recoveries[0].settled_s, Some(0.499));
        collector.disturbed("start".to_owned(), 2.0, 1.0);
        play(2_000, 2_100, 3.0, &mut collector);
        collector.stopped(2.1);
        play(2_100, 3_000, 0.0, &mut collector);
        let recoveries = collector.summary(3.0, Verdict::default()).recoveries;
        let settled: Vec<_> = recoveries.iter().map(|recovery| recovery.settled_s).collect();
        assert_eq!(settled, [Some(0.499), None]);
    }
}
