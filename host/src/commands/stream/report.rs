//! How a stream did, when it is over.

use super::meter::{Meter, Overall, dropped};
use super::program::Rendering;
use super::{Args, Display, Failure, Picture};
use crate::link::address::Address;
use crate::stream::Statistics;
use crate::stream::live::Totals;
use crate::stream::mailbox::Mailbox;
use serde_json::{Value, json};

/// The figures.
pub(super) struct Report {
    device: String,
    totals: Totals,
    statistics: Statistics,
    overall: Overall,
    /// Whether the link's time is a simulation's.
    is_simulated: bool,
    /// What ended it, if it was no order.
    error: Option<String>,
    replaced: u64,
    dropped: u64,
    /// Sent while two waited, of which the device shows the newer one; or not shown as the mirror fell out of step.
    passed_over: u64,
    rendering: Rendering,
    error_slices: Option<f64>,
}

impl Report {
    pub(super) fn new(
        args: &Args,
        display: &Display,
        mailbox: &Mailbox<Picture>,
        meter: &Meter,
        rendering: Rendering,
        error: Option<&Failure>,
    ) -> Self {
        let overall = meter.overall(display);
        let passed_over = display.totals().delivered.saturating_sub(overall.shown.into());
        Self {
            device: args.device.to_string(),
            totals: display.totals(),
            statistics: display.statistics(),
            overall,
            is_simulated: matches!(args.device, Address::Sim(_)),
            error: error.map(|Failure(text)| text.clone()),
            replaced: mailbox.counts()[1],
            dropped: dropped(display.totals(), mailbox) + passed_over,
            passed_over,
            rendering,
            error_slices: display.status().filter(|status| status.measured).map(|status| meter.error_slices(status)),
        }
    }

    /// Turns a second that are compressed and carried, if that was so few that it can be told.
    fn keeps_up(&self) -> Option<f64> {
        let seconds = self.statistics.sending.as_secs_f64() / self.simulated_share().unwrap_or(1.0);
        (seconds > 1e-3).then(|| self.statistics.turns as f64 / seconds)
    }

    /// How much of the wall's time passed in the simulation, if there is one: it may be slower.
    fn simulated_share(&self) -> Option<f64> {
        let Overall { seconds, link_seconds, .. } = self.overall;
        (self.is_simulated && seconds > 0.0 && link_seconds > 0.0).then(|| link_seconds / seconds)
    }

    /// Turns a second that were rendered; nothing for one picture.
    fn renders(&self) -> Option<f64> {
        let Rendering { turns, time } = self.rendering;
        (turns > 1).then(|| turns as f64 / time.as_secs_f64())
    }

    pub(super) fn as_json(&self) -> Value {
        let Self { totals, statistics, overall: Overall { rates, seconds, link_seconds, shown }, .. } = self;
        json!({
            "end": true, "error": self.error, "device": self.device,
            "seconds": seconds, "simulated_seconds": self.is_simulated.then_some(link_seconds),
            "turns": totals.delivered, "turns_shown": shown, "turns_rendered": self.rendering.turns,
            "turns_per_second": rates.turns_per_second,
            "link_turns_per_second": self.keeps_up(), "rendered_turns_per_second": self.renders(),
            "dropped": { "all": self.dropped, "replaced": self.replaced, "late": totals.late, "failed": totals.failed, "passed_over": self.passed_over },
            "reconnects": totals.reconnects,
            "bytes_raw": statistics.bytes_raw, "bytes_on_wire": statistics.bytes_on_wire, "ratio": rates.ratio,
            "bytes_per_second": rates.bytes_per_second, "packets": statistics.packets, "retries": statistics.retries,
            "planes_kept": statistics.planes_kept, "planes_resumed": statistics.planes_resumed,
            "phase_error_slices": self.error_slices,
        })
    }

    pub(super) fn as_text(&self) -> String {
        let Self { totals, statistics, overall: Overall { rates, seconds, shown, .. }, .. } = self;
        let megabytes = |bytes: u64| bytes as f64 / 1e6;
        let ratio = rates.ratio.map(|ratio| format!(", {ratio:.1}:1")).unwrap_or_default();
        let rate = |rate: Option<f64>| rate.map_or("any number of".into(), |rate| format!("{rate:.1}"));
        let mut lines = vec![
            format!(
                "turns    {} sent in {seconds:.1} s, {:.2} a second; {shown} came on screen",
                totals.delivered, rates.turns_per_second
            ),
            format!(
                "wire     {:.1} MB of planes as {:.2} MB{ratio}, {} packets sent again",
                megabytes(statistics.bytes_raw),
                megabytes(statistics.bytes_on_wire),
                statistics.retries
            ),
            format!("keeps up {} turns a second, compressed and sent on this machine", rate(self.keeps_up())),
        ];
        if let Some(renders) = self.renders() {
            lines.push(format!("         {renders:.1} turns a second by rendering"));
        }
        lines.push(format!(
            "dropped  {}: {} for newer ones, {} late, {} not taken, {} passed over",
            self.dropped, self.replaced, totals.late, totals.failed, self.passed_over
        ));
        if statistics.planes_kept > 0 {
            lines.push(format!("kept     {} planes stayed as they were and were not sent", statistics.planes_kept));
        }
        if totals.reconnects > 0 {
            lines.push(format!("lost     the device went away and came back {} time(s)", totals.reconnects));
        }
        if let Some(share) = self.simulated_share() {
            let percent = 100.0 * share;
            lines.push(format!("clock    all seconds are the wall's; the simulation ran at {percent:.0} % of that"));
        }
        lines.extend(self.error_slices.map(|error| format!("lock     {error:+.4} slices at the end")));
        lines.join("\n")
    }
}
