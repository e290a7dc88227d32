//! The thread that shows turns on a monitor: the newest one from each turn's start on, the same again where there is none.

use super::hub::{Hub, Picture};
use super::latency::Latency;
use super::telemetry::{EventKind, VideoOutput};
use crate::render::turn::Turn;
use crate::stream::live::Source;
use crate::stream::mailbox::Mailbox;
use crate::video::pace::{Counts, Pacer};
use crate::video::x11::{Monitor, Said, Window};
use crate::video::{VideoError, bytes_of};
use protocol::rig::Rig;
use std::collections::VecDeque;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Frames are handed over so many refreshes before their own: so long may this thread be kept from its work.
const AHEAD: u32 = 3;
/// Without a word for so long the monitor is looked for anew.
const SILENCE: Duration = Duration::from_secs(3);
/// How often this thread looks up without one.
const LOOK_UP: Duration = Duration::from_millis(100);
/// How long to wait before a monitor that cannot be used is tried again.
const TRY_AGAIN: Duration = Duration::from_secs(2);
/// Rates are of so long a time.
const WINDOW: Duration = Duration::from_secs(1);

/// What the thread has at hand.
pub struct Video {
    hub: Arc<Hub>,
    rig: Arc<Rig>,
    /// The monitor's name.
    name: String,
    mailbox: Mailbox<Picture>,
    latency: Latency,
    /// Counts of before the monitor was opened.
    before: Counts,
    known_error: Option<VideoError>,
}

/// What is on its way to the monitor, or on it.
struct Playing {
    window: Window,
    pacer: Pacer,
    /// The refresh that is shown.
    now: u64,
    picture: Option<Picture>,
    on_screen: Option<Arc<Turn>>,
    /// Pictures that were handed over, by the refresh of their first frame.
    begun: VecDeque<(u64, Picture)>,
    marks: VecDeque<(Instant, u64)>,
    heard_at: Instant,
    was_covered: bool,
    was_copied: bool,
}

impl Video {
    /// A thread's worth of them.
    pub fn new(hub: Arc<Hub>, rig: Arc<Rig>, name: String, mailbox: Mailbox<Picture>) -> Self {
        let latency = Latency::default();
        Self { hub, rig, name, mailbox, latency, before: Counts::default(), known_error: None }
    }

    /// Shows until the daemon ends; looks for a monitor that went away.
    pub fn run(mut self) {
        while !self.hub.is_stopping() {
            let outcome = self.open().and_then(|mut playing| {
                let outcome = self.play(&mut playing);
                let Counts { shown, late } = playing.pacer.counts();
                self.before = Counts { shown: self.before.shown + shown, late: self.before.late + late };
                outcome
            });
            if let Err(error) = outcome {
                self.away(error);
            }
        }
    }

    fn open(&mut self) -> Result<Playing, VideoError> {
        let monitor = Monitor::find(&self.name, &self.rig)?;
        self.hub.event(EventKind::Note, format!("video on monitor {} at {:.2} Hz", self.name, monitor.refresh_hz));
        for doubt in &monitor.doubts {
            self.hub.event(EventKind::Warning, format!("monitor {}: {doubt}", self.name));
        }
        let (window, now) = monitor.open(AHEAD)?;
        self.known_error = None;
        Ok(Playing {
            window,
            pacer: Pacer::new(self.rig.rotation().frames(), AHEAD),
            now,
            picture: None,
            on_screen: None,
            begun: VecDeque::new(),
            marks: VecDeque::new(),
            heard_at: Instant::now(),
            was_covered: false,
            was_copied: false,
        })
    }

    fn play(&mut self, playing: &mut Playing) -> Result<(), VideoError> {
        while !self.hub.is_stopping() {
            while playing.window.has_room()
                && let Some(due) = playing.pacer.due(playing.now)
            {
                if due.begins_turn
                    && let Some(picture) = self.mailbox.take(Duration::ZERO)
                {
                    playing.begun.push_back((due.target, picture.clone()));
                    playing.picture = Some(picture);
                }
                let turn = playing.picture.as_ref().map(|picture| &*picture.planes.turn);
                playing.window.show(&due, &bytes_of(turn, &self.rig, due.frame))?;
            }
            for said in playing.window.listen(LOOK_UP)? {
                self.hear(said, playing);
            }
            if playing.heard_at.elapsed() > SILENCE {
                return Err(VideoError::Silent(SILENCE.as_secs()));
            }
            self.tell(playing);
        }
        Ok(())
    }

    fn hear(&mut self, said: Said, playing: &mut Playing) {
        let warn = |is_known: &mut bool, text: &str| {
            if !std::mem::replace(is_known, true) {
                self.hub.event(EventKind::Warning, format!("monitor {}: {text}", self.name));
            }
        };
        let Said::Shown { serial, at, copied } = said else {
            warn(&mut playing.was_covered, "something lies above the picture: end it, or move it away");
            return;
        };
        playing.heard_at = Instant::now();
        playing.now = playing.now.max(at.unwrap_or(0));
        let target = playing.pacer.completed(serial, at);
        if copied {
            warn(&mut playing.was_copied, "the X server copies frames to the screen, where they may tear: no flips");
        }
        let is_over = |(begins, _): &(u64, Picture)| target.is_some_and(|target| *begins <= target);
        while let Some((_, picture)) = playing.begun.pop_front_if(|begun| is_over(begun)) {
            if let Some(seen_at) = picture.seen_at {
                self.latency.observe(&self.hub, seen_at.elapsed());
            }
            playing.on_screen = Some(picture.planes.turn);
        }
    }

    /// Brings counts and rates to where people read them.
    fn tell(&mut self, playing: &mut Playing) {
        let (now, Counts { shown, late }) = (Instant::now(), playing.pacer.counts());
        playing.marks.push_back((now, shown));
        while playing.marks.len() > 2 && now - playing.marks[1].0 >= WINDOW {
            playing.marks.pop_front();
        }
        let (since, shown_then) = playing.marks[0];
        let told = VideoOutput {
            monitor: self.name.clone(),
            refresh_hz: Some(playing.window.monitor().refresh_hz),
            frames_per_second: (shown - shown_then) as f64 / (now - since).as_secs_f64().max(1e-3),
            frames_shown: self.before.shown + shown,
            frames_late: self.before.late + late,
            error: None,
        };
        for (outcome, count) in [("shown", told.frames_shown), ("late", told.frames_late)] {
            let counter = self.hub.metrics.video_frames.get_or_create(&[("outcome", outcome)]);
            counter.inc_by(count.saturating_sub(counter.get()));
        }
        let mut is_lit = false;
        self.hub.tell(|telemetry| {
            telemetry.video = Some(told);
            is_lit = telemetry.lit;
        });
        // The projector's light is the controller's.
        self.hub.show(playing.on_screen.clone().filter(|_| is_lit));
    }

    /// There is no monitor, or none that can be used.
    fn away(&mut self, error: VideoError) {
        let told = VideoOutput {
            monitor: self.name.clone(),
            refresh_hz: None,
            frames_per_second: 0.0,
            frames_shown: self.before.shown,
            frames_late: self.before.late,
            error: Some(error.to_string()),
        };
        self.hub.tell(|telemetry| telemetry.video = Some(told));
        self.hub.show(None);
        if self.known_error.as_ref() != Some(&error) {
            self.hub.event(EventKind::Warning, format!("video: {error}"));
            self.known_error = Some(error);
        }
        let until = Instant::now() + TRY_AGAIN;
        while Instant::now() < until && !self.hub.is_stopping() {
            std::thread::sleep(LOOK_UP);
        }
    }
}
