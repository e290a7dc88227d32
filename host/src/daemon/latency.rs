//! From a tracker's reading to the first lit plane that follows it.

use super::hub::Hub;
use std::collections::VecDeque;
use std::time::Duration;

/// The median is of so many.
const LATENCIES: usize = 100;

/// The last of them, in milliseconds.
#[derive(Clone, Debug, Default)]
pub struct Latency(VecDeque<f64>);

impl Latency {
    /// One more, for those who read it.
    pub fn observe(&mut self, hub: &Hub, latency: Duration) {
        hub.metrics.latency_seconds.observe(latency.as_secs_f64());
        self.0.push_back(latency.as_secs_f64() * 1e3);
        if self.0.len() > LATENCIES {
            self.0.pop_front();
        }
        let mut sorted: Vec<_> = self.0.iter().copied().collect();
        sorted.sort_by(f64::total_cmp);
        let median = sorted[sorted.len() / 2];
        hub.tell(|telemetry| telemetry.latency_ms = Some(median));
    }
}
