//! What the daemon's threads share: the wish, what is known, what happened.

use super::metrics::Metrics;
use super::recorder::Recorders;
use super::telemetry::{Event, EventKind, Telemetry};
use super::wish::Wish;
use crate::halftoned::Halftoned;
use crate::recording::file::Timed;
use crate::recording::{Arrived, Entry, Expected, Eye, Setup};
use crate::render::turn::Turn;
use crate::stream::TurnPlanes;
use crate::tracking::viewers::Counters;
use crate::tracking::{ParseError, Reading, Refusal, Viewer, Viewers};
use protocol::codec::Hint;
use protocol::message::Command;
use protocol::rig::Tracking;
use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::Receiver;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

/// So many events are remembered.
const EVENTS_MAX: usize = 500;

/// A turn as it is sent.
#[derive(Clone, Debug)]
pub struct Picture {
    /// The planes.
    pub planes: Halftoned<Arc<Turn>>,
    /// When the newest of the tracker's readings was taken by which it was rendered, where that is news.
    pub seen_at: Option<Instant>,
    /// Its number among those that were painted.
    pub stroke: u64,
}

impl TurnPlanes for Picture {
    fn slices(&self) -> u32 {
        self.planes.slices()
    }

    fn plane_bytes(&self, slice: u32) -> &[u8] {
        self.planes.plane_bytes(slice)
    }

    fn hint(&self, slice: u32) -> Hint {
        self.planes.hint(slice)
    }

    fn mask_ranks(&self) -> &[u16] {
        self.planes.mask_ranks()
    }
}

/// What all threads know.
pub struct Hub {
    wish: Mutex<(Wish, u64)>,
    changed: Condvar,
    telemetry: Mutex<Telemetry>,
    events: Mutex<VecDeque<Event>>,
    orders: Mutex<VecDeque<Command>>,
    on_screen: Mutex<Option<Arc<Turn>>>,
    viewers: Mutex<Viewers>,
    delay_s: Mutex<f64>,
    heartbeat: AtomicU64,
    stopping: AtomicBool,
    start: Instant,
    recorders: Recorders,
    /// What Prometheus asks for.
    pub metrics: Metrics,
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    // Every value is whole between two statements: whoever panicked left a good one.
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Hub {
    /// At the start, with what was wished and what happened before.
    pub fn new(wish: Wish, telemetry: Telemetry, events: Vec<Event>, tracking: &Tracking) -> Self {
        let start = Instant::now();
        Self {
            wish: Mutex::new((wish, 0)),
            changed: Condvar::new(),
            telemetry: Mutex::new(telemetry),
            events: Mutex::new(events.into()),
            orders: Mutex::default(),
            on_screen: Mutex::default(),
            viewers: Mutex::new(Viewers::new(tracking)),
            delay_s: Mutex::default(),
            heartbeat: AtomicU64::new(0),
            stopping: AtomicBool::new(false),
            start,
            recorders: Recorders::new(start),
            metrics: Metrics::new(),
        }
    }

    /// The wish, and how often it was changed.
    pub fn wish(&self) -> (Wish, u64) {
        lock(&self.wish).clone()
    }

    /// Another wish, made from the present one.
    pub fn change_wish<E>(&self, change: impl FnOnce(&Wish) -> Result<Wish, E>) -> Result<Wish, E> {
        let mut wish = lock(&self.wish);
        let changed = change(&wish.0)?;
        if changed != wish.0 {
            *wish = (changed, wish.1 + 1);
            self.record(|| Entry::Wish(Box::new(wish.0.clone())));
            self.changed.notify_all();
        }
        Ok(wish.0.clone())
    }

    /// Waits until the wish is another one than that of `version`, or somebody [wakes](Self::wake), for at most `time`.
    pub fn wait_for_change(&self, version: u64, time: Duration) {
        let wish = lock(&self.wish);
        if wish.1 == version && !self.is_stopping() {
            let _ = self.changed.wait_timeout(wish, time);
        }
    }

    /// Wakes whoever waits for a change.
    pub fn wake(&self) {
        self.changed.notify_all();
    }

    /// What is known now.
    pub fn telemetry(&self) -> Telemetry {
        let mut telemetry = lock(&self.telemetry).clone();
        telemetry.uptime_s = self.start.elapsed().as_secs_f64();
        telemetry
    }

    /// Adds to what is known.
    pub fn tell(&self, change: impl FnOnce(&mut Telemetry)) {
        change(&mut lock(&self.telemetry));
    }

    /// Something happened: for the timeline and the log.
    pub fn event(&self, kind: EventKind, text: impl Into<String>) {
        let text = text.into();
        match kind {
            EventKind::Note => tracing::info!("{text}"),
            EventKind::Warning => tracing::warn!("{text}"),
            EventKind::Fault => tracing::error!("{text}"),
        }
        let mut events = lock(&self.events);
        let number = events.back().map_or(1, |event| event.number + 1);
        if events.len() == EVENTS_MAX {
            events.pop_front();
        }
        let unix_s = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0.0, |time| time.as_secs_f64());
        let event = Event { number, unix_s, kind, text };
        self.record(|| Entry::Event(event.clone()));
        events.push_back(event);
        drop(events);
        self.tell(|telemetry| telemetry.events = number);
    }

    /// What happened after event `number`, the oldest first.
    pub fn events_after(&self, number: u64) -> Vec<Event> {
        lock(&self.events).iter().filter(|event| event.number > number).cloned().collect()
    }

    /// The controller is to be told this.
    pub fn order(&self, command: Command) {
        lock(&self.orders).push_back(command);
    }

    /// The next order.
    pub fn next_order(&self) -> Option<Command> {
        lock(&self.orders).pop_front()
    }

    /// Whether there is an order that cannot wait until a turn is over.
    pub fn has_orders(&self) -> bool {
        !lock(&self.orders).is_empty() || self.is_stopping()
    }

    /// The turn that is on screen; nothing where the display is dark.
    pub fn on_screen(&self) -> Option<Arc<Turn>> {
        lock(&self.on_screen).clone()
    }

    /// Another turn is on screen.
    pub fn show(&self, turn: Option<Arc<Turn>>) {
        *lock(&self.on_screen) = turn;
    }

    /// When the daemon began: times of viewers count from here.
    pub fn start(&self) -> Instant {
        self.start
    }

    /// What came from trackers so far.
    pub fn viewer_counters(&self) -> Counters {
        lock(&self.viewers).counters()
    }

    /// Takes what a tracker's thread brings.
    pub fn arrive(&self, arrived: Result<Reading, ParseError>) -> Result<(), Refusal> {
        let mut viewers = lock(&self.viewers);
        let what = arrived.as_ref().ok().copied();
        let taken = viewers.arrive(arrived);
        self.record(|| Entry::Reading(Arrived::new(what, taken)));
        drop(viewers);
        taken.inspect(|()| self.wake())
    }

    /// Takes where somebody says that an eye was.
    pub fn arrive_eye(&self, eye: Eye) -> Result<(), Refusal> {
        let mut viewers = lock(&self.viewers);
        let taken = viewers.take_eye(eye.id, eye.position_m, eye.at);
        self.record(|| Entry::Eye(Arrived::new(Some(eye), taken)));
        drop(viewers);
        taken.inspect(|()| self.wake())
    }

    /// Who is expected to be where when light leaves at `light_at`, since the daemon began.
    pub fn viewers_at(&self, light_at: Duration) -> Vec<Viewer> {
        let mut all = lock(&self.viewers);
        let viewers = all.at(light_at);
        if !viewers.is_empty() {
            self.record(|| Entry::Viewers(Expected { light_at, viewers: viewers.clone() }));
        }
        viewers
    }

    /// Something happened: for those who record.
    pub fn record(&self, entry: impl FnOnce() -> Entry) {
        self.recorders.record(entry);
    }

    /// What happens from now on, after a first entry that `setup` makes of who is followed and when the daemon began.
    pub fn begin_recording(&self, setup: impl FnOnce(&Viewers, u64) -> Setup) -> Receiver<Arc<Timed>> {
        let viewers = lock(&self.viewers);
        let recording = self.recorders.begin(Entry::Setup(Box::new(setup(&viewers, self.recorders.start_unix_ns()))));
        drop(viewers);
        self.wake();
        recording
    }

    /// How many recordings there have been.
    pub fn recordings(&self) -> u64 {
        self.recorders.count()
    }

    /// Turns are to be rendered so many seconds later than before, or sooner.
    pub fn delay_turns(&self, seconds: f64) {
        *lock(&self.delay_s) += seconds;
    }

    /// By how many seconds, since it was asked last.
    pub fn take_delay_s(&self) -> f64 {
        std::mem::take(&mut lock(&self.delay_s))
    }

    /// The thread that talks to the controller is alive.
    pub fn beat(&self) {
        self.heartbeat.store(self.start.elapsed().as_millis() as u64, Ordering::Relaxed);
    }

    /// How long ago that thread was alive.
    pub fn silent_for(&self) -> Duration {
        self.start.elapsed().saturating_sub(Duration::from_millis(self.heartbeat.load(Ordering::Relaxed)))
    }

    /// Everything is to end.
    pub fn stop(&self) {
        self.stopping.store(true, Ordering::Relaxed);
        self.wake();
    }

    /// Whether everything is to end.
    pub fn is_stopping(&self) -> bool {
        self.stopping.load(Ordering::Relaxed)
    }
}
