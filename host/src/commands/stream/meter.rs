//! How a stream does, while it runs: a line that is written over, or lines of JSON.

use super::{Display, Picture};
use crate::commands::say;
use crate::stream::Statistics;
use crate::stream::live::{Progress, Totals};
use crate::stream::mailbox::Mailbox;
use indicatif::{ProgressBar, ProgressStyle};
use protocol::message::Status;
use protocol::rig::Rig;
use serde_json::json;
use std::collections::VecDeque;
use std::time::{Duration, Instant};

/// How often the line is written anew.
const LINE_EVERY: Duration = Duration::from_millis(250);
/// How often a line of JSON is printed.
const JSON_EVERY: Duration = Duration::from_secs(1);
/// Rates are of so long a time.
const WINDOW: Duration = Duration::from_secs(1);

/// What was counted at a moment.
#[derive(Clone, Copy, Debug)]
struct Mark {
    at: Instant,
    statistics: Statistics,
}

/// Rates between two moments, by the wall's clock.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Rates {
    pub turns_per_second: f64,
    pub bytes_per_second: f64,
    /// Bytes of planes by bytes on the wire; nothing where nothing was sent.
    pub ratio: Option<f64>,
}

impl Rates {
    fn new(seconds: f64, turns: f64, bytes_raw: f64, bytes_on_wire: f64) -> Self {
        let per_second = |amount: f64| if seconds > 0.0 { amount / seconds } else { 0.0 };
        Self {
            turns_per_second: per_second(turns),
            bytes_per_second: per_second(bytes_on_wire),
            ratio: (bytes_on_wire > 0.0 && bytes_raw > 0.0).then(|| bytes_raw / bytes_on_wire),
        }
    }
}

/// What there is since the mirror came into step.
pub(super) struct Overall {
    pub rates: Rates,
    /// By the wall's clock.
    pub seconds: f64,
    /// By the link's, which a simulated device's is not the wall's.
    pub link_seconds: f64,
    /// Turns that came on screen.
    pub shown: u32,
}

/// The meter.
pub(super) struct Meter {
    bar: ProgressBar,
    is_json: bool,
    turns_per_second: f64,
    slices: u32,
    turn_bytes: f64,
    told_at: Option<Instant>,
    marks: VecDeque<Mark>,
    began: Mark,
    /// The link's time then.
    began_on_link: Duration,
    shown_before: u32,
    totals: Totals,
    /// Whether the mirror came into step, and turns were sent.
    pub has_begun: bool,
    /// How often the device was lost, as far as that was said.
    pub losses: u64,
}

impl Meter {
    pub(super) fn new(is_json: bool, rig: &Rig, plane_bytes: usize, display: &Display) -> Self {
        let style = ProgressStyle::with_template("{msg}").expect("a fixed template");
        let slices = rig.rotation.slices;
        Self {
            bar: if is_json { ProgressBar::hidden() } else { ProgressBar::new_spinner().with_style(style) },
            is_json,
            turns_per_second: rig.turns_per_second(),
            slices,
            turn_bytes: f64::from(slices) * plane_bytes as f64,
            told_at: None,
            marks: VecDeque::new(),
            began: Mark { at: Instant::now(), statistics: display.statistics() },
            began_on_link: display.now(),
            shown_before: 0,
            totals: Totals::default(),
            has_begun: false,
            losses: 0,
        }
    }

    /// The mirror is in step: counts from here on.
    pub(super) fn start(&mut self, display: &Display) {
        self.began = Mark { at: Instant::now(), statistics: display.statistics() };
        self.began_on_link = display.now();
        self.shown_before = display.status().map_or(0, |status| status.turns_shown);
        self.marks.push_back(self.began);
        self.has_begun = true;
    }

    /// Tells how fast the mirror is on its way.
    pub(super) fn spinning_up(&mut self, display: &Display) {
        if let Some(status) = display.status().filter(|_| !self.is_json && self.is_due(LINE_EVERY)) {
            let share = f64::from(status.speed_microhertz) / 1e6 / self.turns_per_second;
            self.bar.set_message(format!(
                "{:<9} {:>3.0} % of {} turns/s",
                status.state.name(),
                share * 100.0,
                self.turns_per_second
            ));
        }
    }

    /// Tells how it goes between two turns, where it is time.
    pub(super) fn tell(&mut self, display: &Display, mailbox: &Mailbox<Picture>) {
        self.totals = display.totals();
        let status = display.status().filter(|_| display.is_connected());
        self.write(&display.statistics(), status, 0, mailbox);
    }

    /// Tells how the turn does that is under way, where it is time.
    pub(super) fn watch(&mut self, progress: &Progress, mailbox: &Mailbox<Picture>) {
        self.write(&progress.statistics, progress.status.as_ref(), progress.planes, mailbox);
    }

    fn write(&mut self, statistics: &Statistics, status: Option<&Status>, planes: u64, mailbox: &Mailbox<Picture>) {
        if !self.is_due(if self.is_json { JSON_EVERY } else { LINE_EVERY }) {
            return;
        }
        let now = Mark { at: Instant::now(), statistics: *statistics };
        self.marks.push_back(now);
        while self.marks.len() > 2 && now.at - self.marks[1].at >= WINDOW {
            self.marks.pop_front();
        }
        let rates = self.rates(&self.marks[0], &now);
        let (delivered, dropped) = (self.totals.delivered, dropped(self.totals, mailbox));
        if self.is_json {
            return say(json!({
                "seconds": (now.at - self.began.at).as_secs_f64(),
                "state": status.map(|status| status.state),
                "phase_error_slices": status.map(|status| self.error_slices(status)),
                "turns_per_second": rates.turns_per_second, "bytes_per_second": rates.bytes_per_second, "ratio": rates.ratio,
                "turns": delivered, "turn_under_way": { "planes": planes, "of": self.slices }, "dropped": dropped,
            }));
        }
        let lock = status.map_or("away".to_string(), |status| {
            format!("{:<9} {:>+7.4}", status.state.name(), self.error_slices(status))
        });
        let ratio = rates.ratio.map_or("    -  ".to_string(), |ratio| format!("{ratio:>5.1}:1"));
        let under_way = format!("+{planes}/{}", self.slices);
        self.bar.set_message(format!(
            "{lock:<17} {:>5.2} turns/s {} {ratio} {delivered:>5}{under_way:<8} sent {dropped:>3} drop",
            rates.turns_per_second,
            speed(rates.bytes_per_second),
        ));
    }

    /// Takes the line away.
    pub(super) fn clear(&self) {
        self.bar.finish_and_clear();
    }

    /// What there is since the mirror came into step.
    pub(super) fn overall(&self, display: &Display) -> Overall {
        let (statistics, began) = (display.statistics(), &self.began.statistics);
        let seconds = self.began.at.elapsed().as_secs_f64();
        let raw = (statistics.bytes_raw - began.bytes_raw) as f64;
        let wire = (statistics.bytes_on_wire - began.bytes_on_wire) as f64;
        Overall {
            rates: Rates::new(seconds, display.totals().delivered as f64, raw, wire),
            seconds,
            link_seconds: display.now().saturating_sub(self.began_on_link).as_secs_f64(),
            shown: display.status().map_or(0, |status| status.turns_shown.saturating_sub(self.shown_before)),
        }
    }

    /// The mirror's angle ahead of its place.
    pub(super) fn error_slices(&self, status: &Status) -> f64 {
        f64::from(status.phase_error) / 4_294_967_296.0 * f64::from(self.slices)
    }

    /// By planes: on a slow line a turn takes longer than rates are of.
    fn rates(&self, from: &Mark, to: &Mark) -> Rates {
        let turns = (to.statistics.planes - from.statistics.planes) as f64 / f64::from(self.slices);
        let wire = (to.statistics.bytes_on_wire - from.statistics.bytes_on_wire) as f64;
        Rates::new((to.at - from.at).as_secs_f64(), turns, turns * self.turn_bytes, wire)
    }

    fn is_due(&mut self, every: Duration) -> bool {
        let due = self.told_at.is_none_or(|told| told.elapsed() >= every);
        if due {
            self.told_at = Some(Instant::now());
        }
        due
    }
}

/// Bytes a second, in eleven columns.
fn speed(bytes_per_second: f64) -> String {
    let (rate, unit) =
        if bytes_per_second < 1e6 { (bytes_per_second / 1e3, "kB") } else { (bytes_per_second / 1e6, "MB") };
    format!("{rate:>5.1} {unit}/s")
}

/// Turns that were rendered and not delivered.
pub(super) fn dropped(totals: Totals, mailbox: &Mailbox<Picture>) -> u64 {
    mailbox.counts()[1] + totals.late + totals.failed
}
