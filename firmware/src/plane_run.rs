//! Plane pulses that follow each other at one interval.

use crate::angle::nanos_to_f32;
use protocol::units::Nanos;

/// Intervals that must agree before they are believed.
const AGREEING: u32 = 8;
/// A run is begun anew after so many, so that one at an old rate does not last into a new one that is almost the same.
const LONGEST: u32 = 24;

/// The run that the last pulse belongs to.
#[derive(Clone, Copy, Debug, Default)]
pub struct PlaneRun {
    start: Nanos,
    last: Nanos,
    intervals: u32,
}

impl PlaneRun {
    /// Takes a pulse captured at `at`; one whose interval differs from the run's mean by more than `tolerance_ns` begins another run.
    pub fn add(&mut self, at: Nanos, tolerance_ns: f32) {
        let interval = nanos_to_f32(at.signed_since(self.last));
        let agrees = self.intervals > 0 && (interval - self.mean_ns()).abs() < tolerance_ns;
        if !agrees || self.intervals == LONGEST {
            (self.start, self.intervals) = (self.last, 0);
        }
        self.intervals += 1;
        self.last = at;
    }

    /// The first pulse of the run and the mean interval, ns, where enough have agreed.
    pub fn agreed(&self) -> Option<(Nanos, f32)> {
        (self.intervals >= AGREEING).then(|| (self.start, self.mean_ns()))
    }

    /// The variance of the mean interval, for pulses that have `jitter_variance`, ns².
    pub fn variance(&self, jitter_variance: f32) -> f32 {
        let intervals = self.intervals.max(1) as f32;
        2.0 * jitter_variance / (intervals * intervals)
    }

    fn mean_ns(&self) -> f32 {
        nanos_to_f32(self.last.signed_since(self.start)) / self.intervals.max(1) as f32
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_new_rate_is_a_run_from_its_first_plane_on() {
        let mut run = PlaneRun::default();
        for plane in 0..=10 {
            run.add(Nanos(1_000_000 + plane * 173_611), 17_000.0);
        }
        assert_eq!(run.agreed().unwrap().0, Nanos(1_000_000));
        let change = 1_000_000 + 10 * 173_611;
        for plane in 1..=8 {
            assert!(plane == 1 || run.agreed().is_none());
            run.add(Nanos(change + plane * 231_481), 17_000.0);
        }
        let (start, interval) = run.agreed().unwrap();
        assert_eq!((start, interval), (Nanos(change), 231_481.0));
        assert_eq!(run.variance(4e6), 8e6 / 64.0);
    }
}
