//! Figures for Prometheus.

use prometheus_client::encoding::text::encode;
use prometheus_client::metrics::counter::Counter;
use prometheus_client::metrics::family::Family;
use prometheus_client::metrics::gauge::Gauge;
use prometheus_client::metrics::histogram::Histogram;
use prometheus_client::registry::{Registry, Unit};
use std::sync::atomic::AtomicU64;

/// A label and its value.
pub type Labels = [(&'static str, &'static str); 1];

/// The figures. Names begin with `praxi_`.
pub struct Metrics {
    registry: Registry,
    /// |mirror's angle ahead of its place|, in slices, at each status of a locked controller.
    pub lock_phase_slices: Histogram,
    /// What a turn took to render.
    pub render_seconds: Histogram,
    /// From a tracker's reading to the first lit plane that follows it.
    pub latency_seconds: Histogram,
    /// Turns by what became of them: delivered, replaced, late, failed.
    pub turns: Family<Labels, Counter>,
    /// Refreshes of a monitor by what they showed: shown, late.
    pub video_frames: Family<Labels, Counter>,
    /// Bytes on the wire.
    pub wire_bytes: Counter,
    /// How often the controller went away and came back.
    pub reconnects: Counter,
    /// Faults of the controller by name.
    pub faults: Family<[(&'static str, String); 1], Counter>,
    /// Requests that were refused, by why.
    pub refused: Family<Labels, Counter>,
    /// Readings of trackers by what became of them: taken, malformed, absurd, outside, backwards, jump, too_many.
    pub readings: Family<Labels, Counter>,
    /// 1 where a controller is connected.
    pub connected: Gauge,
    /// 1 where planes are lit.
    pub lit: Gauge,
    /// What is allowed as error, in projector pixels.
    pub budget_px: Gauge<f64, AtomicU64>,
}

impl Metrics {
    /// All at zero.
    pub fn new() -> Self {
        let milliseconds = |steps: &[f64]| Histogram::new(steps.iter().map(|ms| ms / 1e3).collect::<Vec<_>>());
        let metrics = Self {
            registry: Registry::with_prefix("praxi"),
            lock_phase_slices: Histogram::new([0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0]),
            render_seconds: milliseconds(&[5.0, 10.0, 20.0, 35.0, 50.0, 75.0, 100.0, 150.0, 250.0, 500.0, 1e3]),
            latency_seconds: milliseconds(&[
                20.0, 35.0, 50.0, 65.0, 80.0, 100.0, 125.0, 150.0, 200.0, 300.0, 500.0, 1e3,
            ]),
            turns: Family::default(),
            video_frames: Family::default(),
            wire_bytes: Counter::default(),
            reconnects: Counter::default(),
            faults: Family::default(),
            refused: Family::default(),
            readings: Family::default(),
            connected: Gauge::default(),
            lit: Gauge::default(),
            budget_px: Gauge::default(),
        };
        metrics.registered()
    }

    fn registered(mut self) -> Self {
        let registry = &mut self.registry;
        registry.register("lock_phase_slices", "Distance of the mirror from its place", self.lock_phase_slices.clone());
        let seconds = Unit::Seconds;
        registry.register_with_unit("render", "Time to render a turn", seconds, self.render_seconds.clone());
        let help = "From a tracker's reading to the first lit plane that follows it";
        registry.register_with_unit("tracker_to_light", help, Unit::Seconds, self.latency_seconds.clone());
        registry.register("turns", "Turns by what became of them", self.turns.clone());
        registry.register("video_frames", "Refreshes of the monitor by what they showed", self.video_frames.clone());
        registry.register_with_unit("wire", "Bytes on the wire", Unit::Bytes, self.wire_bytes.clone());
        registry.register("reconnects", "The controller went away and came back", self.reconnects.clone());
        registry.register("faults", "Faults of the controller", self.faults.clone());
        registry.register("refused_requests", "Requests that were refused", self.refused.clone());
        registry.register("tracker_readings", "Readings of trackers", self.readings.clone());
        registry.register("connected", "Whether a controller is connected", self.connected.clone());
        registry.register("lit", "Whether planes are lit", self.lit.clone());
        registry.register("budget_px", "Error that is allowed, projector pixels", self.budget_px.clone());
        self
    }

    /// As OpenMetrics text.
    pub fn text(&self) -> String {
        let mut text = String::new();
        // Writing into memory does not fail.
        let _ = encode(&mut text, &self.registry);
        text
    }
}

impl Default for Metrics {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_name_begins_with_praxi() {
        let metrics = Metrics::new();
        metrics.turns.get_or_create(&[("outcome", "late")]).inc();
        metrics.lock_phase_slices.observe(0.004);
        let text = metrics.text();
        let names = text.lines().filter(|line| !line.starts_with('#'));
        assert!(names.clone().count() > 10 && names.clone().all(|line| line.starts_with("praxi_")), "{text}");
        assert!(text.contains("praxi_turns_total{outcome=\"late\"} 1"), "{text}");
        assert!(text.contains("praxi_lock_phase_slices_bucket{le=\"0.005\"} 1"), "{text}");
    }
}
