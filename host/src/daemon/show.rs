//! The thread that talks to the controller: sends turns, passes orders on, hears how it does, looks for it where it is away.

use super::config::FaultKeys;
use super::hub::{Hub, Picture};
use super::latency::Latency;
use super::notices::{Darkness, InStep};
use super::phase::Phase;
use super::telemetry::EventKind;
use super::wish::Wish;
use crate::link::address::{Address, Way};
use crate::link::sim::Simulated;
use crate::recording::{Controller, Entry, Sent};
use crate::stream::live::{Live, Nothing, Progress, Source, Step, Totals};
use crate::stream::mailbox::Mailbox;
use crate::stream::{Statistics, StreamError};
use protocol::codec::ImageSize;
use protocol::message::{Command, Fault, State, Status, VIDEO_TURN};
use protocol::rig::Rig;
use std::collections::VecDeque;
use std::convert::Infallible;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// A turn that is under way for so long is left where there is a newer one.
const DEADLINE: Duration = Duration::from_secs(1);
/// How long one connection is looked for before its link is made afresh.
const LOOK_FOR: Duration = Duration::from_secs(60);
/// How long to wait before a controller that cannot be used is tried again.
const TRY_AGAIN: Duration = Duration::from_secs(2);
/// How long the mirror has at the end to run out.
const RUN_OUT: Duration = Duration::from_secs(5);
/// How often counts go to the telemetry.
const TELL_EVERY: Duration = Duration::from_millis(50);
/// Rates are of so long a time.
const WINDOW: Duration = Duration::from_secs(1);
/// Turns that may be on the controller or on their way.
const SENT: usize = 4;
const HOUR: Duration = Duration::from_secs(3_600);

/// What the thread has at hand.
pub struct Show {
    hub: Arc<Hub>,
    rig: Arc<Rig>,
    address: Address,
    simulated: Simulated,
    mailbox: Mailbox<Picture>,
    /// Whether turns reach the projector as video: then the controller gets orders alone.
    by_video: bool,
    faults: FaultKeys,
    /// Turns by their numbers, and since when the controller has them.
    sent: VecDeque<(u32, Picture, Instant)>,
    /// What recordings were told last, and how many there had been.
    recorded: Option<(u64, Controller)>,
    on_screen: Option<u32>,
    /// Of video, in a controller that may light.
    darkness: Darkness,
    in_step: InStep,
    marks: VecDeque<(Instant, u64, Statistics)>,
    told_at: Option<Instant>,
    latency: Latency,
    phase: Phase,
    /// The fault that stands, and since when.
    fault: Option<(Fault, Instant)>,
    cleared: VecDeque<Instant>,
    /// Counts of connections that ended: delivered, late, failed, reconnects, bytes on the wire.
    before: [u64; 5],
}

type Display = Live<Way, Picture>;

/// Turns from the mailbox, the last one that was taken, and who hears what the controller says meanwhile.
struct Taken<'a> {
    show: &'a mut Show,
    mailbox: Mailbox<Picture>,
    last: Option<Picture>,
    totals: Totals,
    has_fault: bool,
}

impl Source for Taken<'_> {
    type Turn = Picture;

    fn take(&mut self, now: Duration) -> Option<Picture> {
        let picture = self.mailbox.take(now)?;
        self.last = Some(picture.clone());
        Some(picture)
    }

    fn has_newer(&mut self, now: Duration) -> bool {
        self.mailbox.has_newer(now)
    }

    /// An order does not wait for the end of a turn, which on a serial line is minutes away, and neither does a fault.
    fn is_over(&mut self) -> bool {
        self.show.hub.beat();
        self.show.hub.has_orders() || self.has_fault
    }

    fn watch(&mut self, progress: &Progress) {
        let Some(status) = progress.status else { return };
        self.has_fault = status.state == State::Fault && self.show.fault.is_none();
        if !self.has_fault {
            self.show.hear(Some(&status), "", &self.totals, &progress.statistics);
        }
    }
}

impl Show {
    /// A thread's worth of them. `by_video`: somebody else takes the turns from the mailbox; here they are counted.
    pub fn new(
        hub: Arc<Hub>,
        rig: Arc<Rig>,
        address: Address,
        simulated: Simulated,
        mailbox: Mailbox<Picture>,
        by_video: bool,
        faults: FaultKeys,
    ) -> Self {
        Self {
            hub,
            rig,
            address,
            simulated,
            mailbox,
            by_video,
            faults,
            sent: VecDeque::new(),
            recorded: None,
            on_screen: None,
            darkness: Darkness::default(),
            in_step: InStep::default(),
            marks: VecDeque::new(),
            told_at: None,
            latency: Latency::default(),
            phase: Phase::default(),
            fault: None,
            cleared: VecDeque::new(),
            before: [0; 5],
        }
    }

    /// Shows until the daemon ends; then the mirror runs out.
    pub fn run(mut self) {
        while !self.hub.is_stopping() {
            let outcome = self.connect().and_then(|mut display| {
                self.hub.event(EventKind::Note, format!("{} is connected", self.address));
                let outcome = self.show(&mut display);
                self.keep_counts(&display);
                outcome
            });
            if let Err(error) = outcome {
                self.away(&error.to_string());
                self.pause(TRY_AGAIN);
            }
        }
    }

    fn connect(&mut self) -> Result<Display, StreamError> {
        self.hub.beat();
        let way = self.address.way(&self.simulated)?;
        let size = ImageSize::new(self.rig.projector.width_px, self.rig.projector.height_px);
        // The size was checked when the daemon began.
        let size = size.map_err(|_| StreamError::Slices { slices: 0, expected: 0 })?;
        let display = Live::new(way, &self.rig.rotation(), size, [DEADLINE, LOOK_FOR])?;
        self.sent.clear();
        self.marks.clear();
        self.hub.metrics.connected.set(1);
        self.hub.tell(|telemetry| (telemetry.connected, telemetry.device_error) = (true, None));
        Ok(display)
    }

    /// There is no controller, or none that can be used.
    fn away(&mut self, why: &str) {
        let known = self.hub.telemetry().device_error;
        if known.as_deref() != Some(why) {
            self.hub.event(EventKind::Warning, format!("{}: {why}", self.address));
        }
        self.dark();
        self.tell_recordings(Controller { state: None, fault: None, cause: Some(why.into()) });
        self.hub.metrics.connected.set(0);
        self.hub.tell(|telemetry| {
            (telemetry.connected, telemetry.device_error) = (false, Some(why.into()));
            (telemetry.state, telemetry.phase_error_slices) = (None, None);
            (telemetry.link_turns_per_second, telemetry.link_bytes_per_second) = (0.0, 0.0);
        });
    }

    fn dark(&mut self) {
        self.hub.show(None);
        self.on_screen = None;
        self.light(false);
    }

    fn pause(&self, time: Duration) {
        let until = Instant::now() + time;
        while Instant::now() < until && !self.hub.is_stopping() {
            self.hub.beat();
            // What nobody can be told is not told later.
            while self.hub.next_order().is_some() {}
            std::thread::sleep(Duration::from_millis(50));
        }
    }

    fn show(&mut self, display: &mut Display) -> Result<(), StreamError> {
        let hub = Arc::clone(&self.hub);
        let mailbox = if self.by_video { Mailbox::default() } else { self.mailbox.clone() };
        let totals = display.totals();
        let mut source = Taken { show: self, mailbox, last: None, totals, has_fault: false };
        let mut reconnects = 0;
        while !hub.is_stopping() {
            hub.beat();
            while let Some(order) = hub.next_order() {
                source.show.obey(display, order)?;
            }
            (source.totals, source.has_fault) = (display.totals(), false);
            match display.step(&mut source)? {
                Step::Delivered(ticket) => {
                    let picture = source.last.take();
                    if let Some(Picture { stroke, .. }) = picture {
                        hub.record(|| Entry::Sent(Sent { stroke, turn: ticket.turn }));
                    }
                    source.show.sent.extend(picture.map(|picture| (ticket.turn, picture, Instant::now())));
                    while source.show.sent.len() > SENT {
                        source.show.sent.pop_front();
                    }
                }
                Step::Away(error) if display.totals().reconnects == reconnects => {
                    reconnects += 1;
                    source.show.away(&error.to_string());
                }
                Step::Back => {
                    reconnects = display.totals().reconnects;
                    hub.metrics.connected.set(1);
                    hub.event(EventKind::Note, format!("{} is back", source.show.address));
                    hub.tell(|telemetry| (telemetry.connected, telemetry.device_error) = (true, None));
                }
                Step::Dropped(error @ StreamError::OtherTurns) => return Err(error),
                Step::Dropped(_) | Step::Idle | Step::Away(_) => {}
            }
            source.show.steer(display)?;
            source.show.listen(display);
        }
        source.show.end(display);
        Ok(())
    }

    fn obey(&mut self, display: &mut Display, order: Command) -> Result<(), StreamError> {
        self.hub.record(|| Entry::Order(order));
        match display.command(order) {
            Err(StreamError::Refused { reason, .. }) => {
                self.hub.event(EventKind::Warning, format!("the controller refused {order:?}: {reason}"));
                Ok(())
            }
            outcome => outcome,
        }
    }

    /// Starts or stops the mirror, as is wished.
    fn steer(&mut self, display: &mut Display) -> Result<(), StreamError> {
        let wants_motor = self.hub.wish().0.motor;
        let Some(status) = display.status().copied().filter(|_| display.is_connected()) else { return Ok(()) };
        match (status.state, wants_motor) {
            (State::Idle, true) => self.obey(display, Command::Start),
            (State::Idle | State::Fault, false) => Ok(()),
            (State::Fault, true) => self.clear(display),
            (_, false) => self.obey(display, Command::Stop),
            _ => Ok(()),
        }
    }

    /// Clears a fault that has stood for long enough, where that is wished for and was not done too often.
    fn clear(&mut self, display: &mut Display) -> Result<(), StreamError> {
        let now = Instant::now();
        while self.cleared.front().is_some_and(|at| now - *at > HOUR) {
            self.cleared.pop_front();
        }
        let FaultKeys { clear_after_s, clears_an_hour } = self.faults;
        let is_due = self.fault.is_some_and(|(_, since)| (now - since).as_secs_f64() >= clear_after_s);
        if clear_after_s == 0.0 || !is_due || self.cleared.len() >= clears_an_hour as usize {
            return Ok(());
        }
        self.cleared.push_back(now);
        self.fault = self.fault.map(|(fault, _)| (fault, now));
        self.hub.event(EventKind::Note, "the fault is cleared, as the configuration says");
        self.obey(display, Command::ClearFault)
    }

    /// Takes what the controller said.
    fn listen(&mut self, display: &Display) {
        let status = display.status().filter(|_| display.is_connected());
        let cause = display.faults().map(|faults| faults.cause().to_string()).unwrap_or_default();
        self.hear(status, &cause, &display.totals(), &display.statistics());
    }

    fn hear(&mut self, status: Option<&Status>, cause: &str, totals: &Totals, statistics: &Statistics) {
        let Some(status) = status else {
            self.tell(None, totals, statistics);
            return;
        };
        let said = self.hear_fault(status, cause);
        let notice = self.in_step.hear(status.state, Instant::now());
        notice.into_iter().for_each(|(kind, text)| self.hub.event(kind, text));
        self.tell_recordings(Controller::of(status, cause));
        if self.by_video {
            let (may, is_lit) = (status.state.may_light(), status.turn_on_screen.is_some());
            self.light(may && is_lit);
            if let Some(text) = self.darkness.watch(may && !is_lit, Instant::now()) {
                self.hub.event(EventKind::Warning, text);
            }
        } else if status.turn_on_screen != self.on_screen || !status.state.may_light() {
            self.look_at_screen(status);
        }
        if status.state == State::Locked && status.measured {
            self.hub.metrics.lock_phase_slices.observe(self.error_slices(status).abs());
        }
        self.tell(Some((status, said)), totals, statistics);
    }

    /// Recordings are told what is new, and new ones what is.
    fn tell_recordings(&mut self, controller: Controller) {
        let told = Some((self.hub.recordings(), controller));
        if self.recorded != told {
            self.recorded = told;
            self.hub.record(|| {
                Entry::Controller(self.recorded.clone().map(|(_, controller)| controller).unwrap_or_default())
            });
        }
    }

    /// Tells a fault that is new; what it is called.
    fn hear_fault(&mut self, status: &Status, cause: &str) -> Option<String> {
        let fault = status.fault.filter(|_| status.state == State::Fault);
        let said = fault.map(|fault| if cause.is_empty() { fault.to_string() } else { format!("{fault}: {cause}") });
        match (fault, self.fault) {
            (Some(fault), known) if known.is_none_or(|(known, _)| known != fault) => {
                self.fault = Some((fault, Instant::now()));
                self.hub.metrics.faults.get_or_create(&[("fault", format!("{fault:?}"))]).inc();
                self.hub.event(EventKind::Fault, said.clone().unwrap_or_default());
                self.leave_to_somebody(fault);
            }
            (None, Some(_)) => {
                self.fault = None;
                self.hub.event(EventKind::Note, "the fault is over");
            }
            _ => {}
        }
        said
    }

    /// After somebody stopped the mirror by hand, releasing the switch must not start it again: IEC 60204-1, 9.2.3.4.2.
    fn leave_to_somebody(&self, fault: Fault) {
        if matches!(fault, Fault::EmergencyStop | Fault::GuardOpen) {
            let Ok(_) = self.hub.change_wish(|wish| Ok::<_, Infallible>(Wish { motor: false, ..wish.clone() }));
        }
    }

    /// Another turn is on screen, or none.
    fn look_at_screen(&mut self, status: &Status) {
        let number = status.turn_on_screen.filter(|_| status.state.may_light());
        if number == self.on_screen && number.is_none() {
            return;
        }
        self.on_screen = number;
        let picture = number.and_then(|number| self.sent.iter().find(|(sent, ..)| *sent == number));
        let turn = picture.map(|(_, picture, there_at)| {
            if let Some(seen_at) = picture.seen_at {
                self.latency.observe(&self.hub, seen_at.elapsed());
            }
            if let Some(seconds) = self.phase.after(there_at.elapsed()) {
                self.hub.delay_turns(seconds);
            }
            Arc::clone(&picture.planes.turn)
        });
        self.light(turn.is_some());
        self.hub.show(turn);
    }

    fn light(&self, is_lit: bool) {
        self.hub.metrics.lit.set(i64::from(is_lit));
        self.hub.tell(|telemetry| telemetry.lit = is_lit);
    }

    fn error_slices(&self, status: &Status) -> f64 {
        f64::from(status.phase_error) / 4_294_967_296.0 * f64::from(self.rig.rotation.slices)
    }

    /// Delivered, late, failed, reconnects, bytes on the wire, of all connections.
    fn counts(&self, totals: &Totals, statistics: &Statistics) -> [u64; 5] {
        let now = [totals.delivered, totals.late, totals.failed, totals.reconnects, statistics.bytes_on_wire];
        std::array::from_fn(|place| self.before[place] + now[place])
    }

    fn keep_counts(&mut self, display: &Display) {
        self.before = self.counts(&display.totals(), &display.statistics());
    }

    /// Brings counts and rates to where people read them.
    fn tell(&mut self, heard: Option<(&Status, Option<String>)>, totals: &Totals, statistics: &Statistics) {
        let now = Instant::now();
        if self.told_at.is_some_and(|told| now - told < TELL_EVERY) {
            return;
        }
        self.told_at = Some(now);
        let counts @ [delivered, late, failed, reconnects, _] = self.counts(totals, statistics);
        let replaced = self.mailbox.counts()[1];
        self.count(counts, replaced);
        self.marks.push_back((now, delivered, *statistics));
        while self.marks.len() > 2 && now - self.marks[1].0 >= WINDOW {
            self.marks.pop_front();
        }
        let (since, delivered_then, then) = self.marks[0];
        let seconds = (now - since).as_secs_f64().max(1e-3);
        let [wire, raw] = [statistics.bytes_on_wire - then.bytes_on_wire, statistics.bytes_raw - then.bytes_raw]
            .map(|bytes| bytes as f64);
        let error = heard.as_ref().map(|(status, _)| self.error_slices(status));
        self.hub.tell(|telemetry| {
            telemetry.turns_delivered = delivered;
            telemetry.turns_dropped = replaced + late + failed;
            telemetry.reconnects = reconnects;
            telemetry.link_turns_per_second = (delivered - delivered_then) as f64 / seconds;
            telemetry.link_bytes_per_second = wire / seconds;
            telemetry.link_ratio = (wire > 0.0 && raw > 0.0).then(|| raw / wire);
            if let Some((status, fault)) = heard {
                telemetry.state = Some(status.state.name().into());
                telemetry.fault = fault;
                telemetry.phase_error_slices = error.filter(|_| status.measured && status.state.may_light());
                telemetry.mirror_turns_per_second = f64::from(status.speed_microhertz) / 1e6;
                telemetry.turns_shown = status.turns_shown;
                telemetry.turn_on_screen = status.turn_on_screen.filter(|number| *number != VIDEO_TURN);
            }
        });
    }

    /// Brings the counters for Prometheus up to what was counted.
    fn count(&self, [delivered, late, failed, reconnects, wire]: [u64; 5], replaced: u64) {
        let metrics = &self.hub.metrics;
        for (outcome, count) in [("delivered", delivered), ("late", late), ("failed", failed), ("replaced", replaced)] {
            let counter = metrics.turns.get_or_create(&[("outcome", outcome)]);
            counter.inc_by(count.saturating_sub(counter.get()));
        }
        metrics.reconnects.inc_by(reconnects.saturating_sub(metrics.reconnects.get()));
        metrics.wire_bytes.inc_by(wire.saturating_sub(metrics.wire_bytes.get()));
    }

    /// The mirror runs out, dark.
    fn end(&mut self, display: &mut Display) {
        self.hub.record(|| Entry::Order(Command::Stop));
        let stopped = display.command(Command::Stop);
        let until = Instant::now() + RUN_OUT;
        let mut source = Nothing::default();
        let is_idle = |display: &Display| {
            display.status().is_some_and(|status| matches!(status.state, State::Idle | State::Fault))
        };
        while stopped.is_ok() && display.is_connected() && !is_idle(display) && Instant::now() < until {
            if display.step(&mut source).is_err() {
                break;
            }
        }
        self.dark();
        let how =
            if is_idle(display) { "the mirror is let go, dark" } else { "the controller did not say that it stopped" };
        self.hub.event(if is_idle(display) { EventKind::Note } else { EventKind::Warning }, how);
    }
}
