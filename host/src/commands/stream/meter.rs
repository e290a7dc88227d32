//! How a stream does, while it runs: a line that is written over, or lines of JSON.

use super::{Display, Picture};
use crate::commands::say;
use crate::stream::Statistics;
use crate::stream::mailbox::Mailbox;
use indicatif::{ProgressBar, ProgressStyle};
use protocol::message::{State, Status};
use protocol::rig::Rig;
use serde_json::json;
use std::collections::VecDeque;
use std::time::Duration;

/// How often the line is written anew.
const LINE_EVERY: Duration = Duration::from_millis(250);
/// How often a line of JSON is printed.
const JSON_EVERY: Duration = Duration::from_secs(1);
/// Rates are of so long a time.
const WINDOW: Duration = Duration::from_secs(1);

/// What was counted at a moment.
#[derive(Clone, Copy, Debug, Default)]
struct Mark {
    at: Duration,
    delivered: u64,
    statistics: Statistics,
}

/// Rates between two moments.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Rates {
    pub turns_per_second: f64,
    pub bytes_per_second: f64,
    /// Bytes of planes by bytes on the wire; nothing where nothing was sent.
    pub ratio: Option<f64>,
}

/// The meter.
pub(super) struct Meter {
    bar: ProgressBar,
    is_json: bool,
    turns_per_second: f64,
    slices: f64,
    told_at: Option<Duration>,
    marks: VecDeque<Mark>,
    began: Mark,
    shown_before: u32,
    /// How often the device was lost, as far as that was said.
    pub losses: u64,
}

impl Meter {
    pub(super) fn new(is_json: bool, rig: &Rig, now: Duration) -> Self {
        let style = ProgressStyle::with_template("{msg}").expect("a fixed template");
        Self {
            bar: if is_json { ProgressBar::hidden() } else { ProgressBar::new_spinner().with_style(style) },
            is_json,
            turns_per_second: rig.turns_per_second(),
            slices: f64::from(rig.rotation.slices),
            told_at: None,
            marks: VecDeque::new(),
            began: Mark { at: now, ..Mark::default() },
            shown_before: 0,
            losses: 0,
        }
    }

    /// The mirror is in step: counts from here on.
    pub(super) fn start(&mut self, display: &Display) {
        self.began = mark(display);
        self.shown_before = display.status().map_or(0, |status| status.turns_shown);
        self.marks.push_back(self.began);
    }

    /// Tells how fast the mirror is on its way.
    pub(super) fn spinning_up(&mut self, display: &Display) {
        if let Some(status) = display.status().filter(|_| self.is_due(display.now(), LINE_EVERY) && !self.is_json) {
            let share = f64::from(status.speed_microhertz) / 1e6 / self.turns_per_second;
            self.bar.set_message(format!(
                "{:<9} {:>3.0} % of {} turns/s",
                word(status.state),
                share * 100.0,
                self.turns_per_second
            ));
        }
    }

    /// Tells how it goes, where it is time.
    pub(super) fn tell(&mut self, display: &Display, mailbox: &Mailbox<Picture>) {
        if !self.is_due(display.now(), if self.is_json { JSON_EVERY } else { LINE_EVERY }) {
            return;
        }
        let now = mark(display);
        self.marks.push_back(now);
        while self.marks.len() > 2 && now.at.saturating_sub(self.marks[1].at) >= WINDOW {
            self.marks.pop_front();
        }
        let rates = rates(&self.marks[0], &now);
        let dropped = dropped(display, mailbox);
        let status = display.status().filter(|_| display.is_connected());
        if self.is_json {
            return say(json!({
                "seconds": now.at.saturating_sub(self.began.at).as_secs_f64(),
                "state": status.map(|status| status.state),
                "phase_error_slices": status.map(|status| self.error_slices(status)),
                "turns_per_second": rates.turns_per_second, "bytes_per_second": rates.bytes_per_second, "ratio": rates.ratio,
                "turns": now.delivered, "dropped": dropped,
            }));
        }
        let lock = status.map_or("away".to_string(), |status| {
            format!("{:<9} {:>+7.4}", word(status.state), self.error_slices(status))
        });
        let ratio = rates.ratio.map_or("     -  ".to_string(), |ratio| format!("{ratio:>6.1}:1"));
        self.bar.set_message(format!(
            "{lock:<17} {:>5.1} turns/s {:>5.1} MB/s {ratio} {:>6} sent {dropped:>4} dropped",
            rates.turns_per_second,
            rates.bytes_per_second / 1e6,
            now.delivered,
        ));
    }

    /// Takes the line away.
    pub(super) fn clear(&self) {
        self.bar.finish_and_clear();
    }

    /// Rates since the mirror came into step, how long that is in seconds, and how many turns came on screen since.
    pub(super) fn overall(&self, display: &Display) -> (Rates, f64, u32) {
        let now = mark(display);
        let shown = display.status().map_or(0, |status| status.turns_shown.saturating_sub(self.shown_before));
        (rates(&self.began, &now), now.at.saturating_sub(self.began.at).as_secs_f64(), shown)
    }

    /// The mirror's angle ahead of its place.
    pub(super) fn error_slices(&self, status: &Status) -> f64 {
        f64::from(status.phase_error) / 4_294_967_296.0 * self.slices
    }

    fn is_due(&mut self, now: Duration, every: Duration) -> bool {
        let due = self.told_at.is_none_or(|told| now.saturating_sub(told) >= every);
        if due {
            self.told_at = Some(now);
        }
        due
    }
}

/// Turns that were rendered and not delivered.
pub(super) fn dropped(display: &Display, mailbox: &Mailbox<Picture>) -> u64 {
    let ([_, replaced], totals) = (mailbox.counts(), display.totals());
    replaced + totals.late + totals.failed
}

fn mark(display: &Display) -> Mark {
    Mark { at: display.now(), delivered: display.totals().delivered, statistics: display.statistics() }
}

fn rates(from: &Mark, to: &Mark) -> Rates {
    let seconds = to.at.saturating_sub(from.at).as_secs_f64();
    let wire = (to.statistics.bytes_on_wire - from.statistics.bytes_on_wire) as f64;
    let raw = (to.statistics.bytes_raw - from.statistics.bytes_raw) as f64;
    let per_second = |amount: f64| if seconds > 0.0 { amount / seconds } else { 0.0 };
    Rates {
        turns_per_second: per_second((to.delivered - from.delivered) as f64),
        bytes_per_second: per_second(wire),
        ratio: (wire > 0.0 && raw > 0.0).then(|| raw / wire),
    }
}

/// A state as people say it.
pub(in crate::commands) fn word(state: State) -> &'static str {
    match state {
        State::Idle => "idle",
        State::SpinUp => "spin-up",
        State::Acquire => "acquire",
        State::Locked => "locked",
        State::Holdover => "holdover",
        State::Fault => "fault",
        State::Service => "service",
        State::OpenLoop => "open loop",
    }
}
