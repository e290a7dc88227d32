//! How long an answer takes, and when it counts as lost.

use std::time::Duration;

/// The smallest time after which an answer counts as lost: a host that was put aside for a moment has not lost one.
const LEAST: Duration = Duration::from_millis(20);

/// The estimate of RFC 6298 (Paxson, Allman, Chu and Sargent 2011), section 2: a packet that is lost is missed a few round trips later,
/// and not half a second, which is ten turns.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct RoundTrip {
    /// Smoothed time and its deviation, seconds.
    estimate: Option<[f64; 2]>,
    /// How often in a row nothing came in time.
    lost: u32,
}

impl RoundTrip {
    /// An answer came after `time`.
    pub(super) fn answered(&mut self, time: Duration) {
        let time = time.as_secs_f64();
        self.lost = 0;
        self.estimate = Some(match self.estimate {
            None => [time, time / 2.0],
            Some([smoothed, deviation]) => {
                [0.875 * smoothed + 0.125 * time, 0.75 * deviation + 0.25 * (smoothed - time).abs()]
            }
        });
    }

    /// None came in time.
    pub(super) fn lost(&mut self) {
        self.lost = (self.lost + 1).min(16);
    }

    /// When an answer counts as lost; at most `most`.
    pub(super) fn timeout(&self, most: Duration) -> Duration {
        let Some([smoothed, deviation]) = self.estimate else { return most };
        (LEAST.max(Duration::from_secs_f64(smoothed + 4.0 * deviation)) * (1 << self.lost)).min(most)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MOST: Duration = Duration::from_millis(500);

    #[test]
    fn an_answer_is_missed_soon_on_a_fast_line_and_late_on_one_that_is_slow_or_unsteady() {
        let mut trip = RoundTrip::default();
        assert_eq!(trip.timeout(MOST), MOST);
        (0..100).for_each(|_| trip.answered(Duration::from_millis(1)));
        assert_eq!(trip.timeout(MOST), LEAST);
        (0..100).for_each(|_| trip.answered(Duration::from_millis(100)));
        let steady = trip.timeout(MOST);
        assert!((0.0999..0.102).contains(&steady.as_secs_f64()), "{steady:?}");
        (0..100).for_each(|at| trip.answered(Duration::from_millis(50 + 100 * (at % 2))));
        assert!(trip.timeout(MOST) > Duration::from_millis(250));
    }

    #[test]
    fn it_waits_twice_as_long_each_time_nothing_comes() {
        let mut trip = RoundTrip::default();
        trip.answered(Duration::from_millis(2));
        let waits: Vec<_> = (0..8)
            .map(|_| {
                let wait = trip.timeout(MOST).as_millis();
                trip.lost();
                wait
            })
            .collect();
        assert_eq!(waits, [20, 40, 80, 160, 320, 500, 500, 500]);
        trip.answered(Duration::from_millis(2));
        assert_eq!(trip.timeout(MOST), LEAST);
    }
}
