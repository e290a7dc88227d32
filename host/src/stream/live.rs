//! Turns that never stop: the newest one wins, a lost device is looked for, and every turn is delivered or counted as dropped.

use super::{Statistics, Stream, StreamError, Ticket, TurnPlanes};
use crate::link::{Connect, Link, LinkError};
use protocol::codec::ImageSize;
use protocol::message::{Command, Faults, Reason, Status};
use protocol::timing::Rotation;
use std::marker::PhantomData;
use std::time::Duration;

/// How long a stream without a turn listens at once.
const LISTEN: Duration = Duration::from_millis(5);
/// How long to wait before a device that went away is looked for again: at first, and at most.
const BACK_OFF: [Duration; 2] = [Duration::from_millis(50), Duration::from_secs(2)];

/// Where turns come from.
pub trait Source {
    /// What it gives.
    type Turn: TurnPlanes;

    /// The newest turn at `now`, the link's time, if it was not taken yet. Older ones are gone.
    fn take(&mut self, now: Duration) -> Option<Self::Turn>;

    /// Whether [`take`](Self::take) would give one.
    fn has_newer(&mut self, now: Duration) -> bool;

    /// Whether nobody wants turns any more: the one that is under way is left.
    fn is_over(&mut self) -> bool {
        false
    }

    /// Told every now and then how the turn that is under way does.
    fn watch(&mut self, _progress: &Progress) {}
}

/// A source that gives no turns.
#[derive(Clone, Copy, Debug)]
pub struct Nothing<T>(PhantomData<T>);

impl<T> Default for Nothing<T> {
    fn default() -> Self {
        Self(PhantomData)
    }
}

impl<T: TurnPlanes> Source for Nothing<T> {
    type Turn = T;

    fn take(&mut self, _now: Duration) -> Option<T> {
        None
    }

    fn has_newer(&mut self, _now: Duration) -> bool {
        false
    }
}

/// How a turn that is under way does.
#[derive(Clone, Copy, Debug)]
pub struct Progress {
    /// Planes of it that the device has.
    pub planes: u64,
    /// What went over the wire.
    pub statistics: Statistics,
    /// The latest status that came.
    pub status: Option<Status>,
}

impl Progress {
    /// Of a turn that began to be sent, or went on, at `begun`.
    fn since(begun: &Statistics, (statistics, status): (Statistics, Option<Status>)) -> Self {
        let arrived = |statistics: &Statistics| statistics.planes + statistics.planes_resumed;
        Self { planes: arrived(&statistics).saturating_sub(arrived(begun)), statistics, status }
    }
}

/// What became of the turns that were taken from a source.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Totals {
    /// The device has them whole.
    pub delivered: u64,
    /// Left for newer ones.
    pub late: u64,
    /// Not taken by the device: damaged on the way too often, or no room as the mirror stands still.
    pub failed: u64,
    /// How often the device was found again after it went away.
    pub reconnects: u64,
}

/// What a step came to.
#[derive(Debug)]
pub enum Step {
    /// The device has a turn whole.
    Delivered(Ticket),
    /// A turn was dropped.
    Dropped(StreamError),
    /// There was no turn.
    Idle,
    /// The device is away.
    Away(StreamError),
    /// The device is back.
    Back,
}

/// What is shown when no turns come.
#[derive(Clone, Debug)]
pub struct Standby<T> {
    /// After so long without a turn.
    pub after: Duration,
    /// The turn that stands then.
    pub turn: T,
}

/// A link that can be let go of: while a device is looked for, nobody may hold it, not even this program.
struct Held<L> {
    link: Option<L>,
    /// When it was let go of.
    until: Duration,
}

impl<L: Link> Held<L> {
    fn new(link: L) -> Self {
        Self { link: Some(link), until: Duration::ZERO }
    }

    fn let_go(&mut self) {
        self.until = self.now();
        self.link = None;
    }
}

impl<L: Link> Link for Held<L> {
    fn send(&mut self, bytes: &[u8]) -> Result<usize, LinkError> {
        self.link.as_mut().map_or(Err(LinkError::Gone), |link| link.send(bytes))
    }

    fn receive(&mut self, into: &mut Vec<u8>, wait: Duration) -> Result<usize, LinkError> {
        self.link.as_mut().map_or(Err(LinkError::Gone), |link| link.receive(into, wait))
    }

    fn now(&self) -> Duration {
        self.link.as_ref().map_or(self.until, Link::now)
    }

    fn bytes_per_second(&self) -> Option<f64> {
        self.link.as_ref().and_then(Link::bytes_per_second)
    }
}

/// A stream that goes on.
pub struct Live<C: Connect, T> {
    connect: C,
    stream: Stream<Held<C::Link>>,
    /// A turn is left for a newer one when it was taken this long ago, or three times as long as the last one took if that is longer: on a
    /// slow link the next one would not be there sooner.
    deadline: Duration,
    /// What the last turn took; nothing where there was none.
    took: Option<Duration>,
    /// How long a device is looked for.
    look_for: Duration,
    standby: Option<Standby<T>>,
    /// The turn that is being sent, and since when.
    current: Option<(T, Duration)>,
    /// When the last turn came; nothing while the standby stands.
    fed_at: Option<Duration>,
    /// The last turn that was delivered.
    last: Option<Ticket>,
    /// How long the device has been away, and how long to wait next.
    away: Option<[Duration; 2]>,
    totals: Totals,
}

impl<C: Connect, T: TurnPlanes> Live<C, T> {
    /// Connects to the device. A turn that is under way for `deadline` is left where there is a newer one; a device that goes away is
    /// looked for, for `look_for`.
    pub fn new(
        mut connect: C,
        rotation: &Rotation,
        size: ImageSize,
        [deadline, look_for]: [Duration; 2],
    ) -> Result<Self, StreamError> {
        let stream = Stream::new(Held::new(connect.connect()?), rotation, size)?;
        let fed_at = Some(stream.link().now());
        let (took, standby, current, last, away, totals) = (None, None, None, None, None, Totals::default());
        Ok(Self { connect, stream, deadline, took, look_for, standby, current, fed_at, last, away, totals })
    }

    /// What is shown when no turns come; without it, the last one stays.
    pub fn set_standby(&mut self, standby: Standby<T>) {
        self.standby = Some(standby);
    }

    /// Does the next thing: sends the newest turn of `source`, or listens for a moment, or looks for the device.
    ///
    /// Fails where it would fail again: a device of another schema or too small, a turn of another size, a device that is away for too
    /// long.
    pub fn step(&mut self, source: &mut impl Source<Turn = T>) -> Result<Step, StreamError> {
        if let Some([away, wait]) = self.away {
            return self.look(away, wait);
        }
        let now = self.stream.link().now();
        if self.current.is_none() {
            self.current = source.take(now).map(|turn| (turn, now));
        }
        let Some((turn, since)) = &self.current else { return self.stand_by(now) };
        let (deadline, since) = (self.took.map(|took| self.deadline.max(3 * took)), *since);
        let (begun, news) = (self.stream.statistics(), self.stream.news());
        let is_late = |now: Duration| {
            source.watch(&Progress::since(&begun, news.latest()));
            let is_due = deadline.is_some_and(|deadline| now.saturating_sub(since) > deadline);
            source.is_over() || is_due && source.has_newer(now)
        };
        let sent = self.stream.submit_unless(turn, is_late);
        let now = self.stream.link().now();
        (self.fed_at, self.took) = (Some(now), Some(now.saturating_sub(since)));
        match sent {
            Ok(ticket) => {
                self.current = None;
                self.last = Some(ticket);
                self.totals.delivered += 1;
                Ok(Step::Delivered(ticket))
            }
            Err(error) => self.cope(error),
        }
    }

    /// Gives the controller an order. The device going away meanwhile is no error: see [`step`](Self::step).
    pub fn command(&mut self, command: Command) -> Result<(), StreamError> {
        match self.stream.command(command) {
            Err(error) if is_away(&error) => self.lose(),
            outcome => outcome?,
        }
        Ok(())
    }

    /// The latest status that came.
    pub fn status(&self) -> Option<&Status> {
        self.stream.status()
    }

    /// What the device remembers of its faults, if it has told.
    pub fn faults(&self) -> Option<&Faults> {
        self.stream.faults()
    }

    /// What went over the wire.
    pub fn statistics(&self) -> Statistics {
        self.stream.statistics()
    }

    /// What became of the turns.
    pub fn totals(&self) -> Totals {
        self.totals
    }

    /// Whether the standby is on the device.
    pub fn stands_by(&self) -> bool {
        self.fed_at.is_none()
    }

    /// Whether the last turn that was delivered has come on screen.
    pub fn shows_last(&self) -> bool {
        let on_screen = self.stream.status().and_then(|status| status.turn_on_screen);
        self.last.is_none_or(|last| on_screen == Some(last.turn))
    }

    /// The link's time.
    pub fn now(&self) -> Duration {
        self.stream.link().now()
    }

    /// Whether there is a device.
    pub fn is_connected(&self) -> bool {
        self.away.is_none()
    }

    fn lose(&mut self) {
        self.stream.link_mut().let_go();
        self.away = Some([Duration::ZERO, BACK_OFF[0]]);
    }

    /// After an error while a turn was sent.
    fn cope(&mut self, error: StreamError) -> Result<Step, StreamError> {
        if is_away(&error) {
            self.lose();
            return Ok(Step::Away(error));
        }
        self.current = None;
        match error {
            StreamError::Left { .. } => self.totals.late += 1,
            error if is_final(&error) => return Err(error),
            _ => self.totals.failed += 1,
        }
        Ok(Step::Dropped(error))
    }

    /// Looks for a device that has been `away`; waits for `wait` where it is not there.
    fn look(&mut self, away: Duration, wait: Duration) -> Result<Step, StreamError> {
        let link = self.connect.connect().map_err(StreamError::from);
        let back = link.and_then(|link| self.stream.reconnect(Held::new(link)));
        if back.is_err() {
            self.stream.link_mut().let_go();
        }
        match back {
            Ok(()) => {
                self.away = None;
                self.totals.reconnects += 1;
                Ok(Step::Back)
            }
            Err(error) if away >= self.look_for || is_final(&error) => Err(error),
            Err(error) => {
                self.connect.wait(wait);
                self.away = Some([away + wait, BACK_OFF[1].min(2 * wait)]);
                Ok(Step::Away(error))
            }
        }
    }

    /// Listens, and sends what is to be shown when no turns come.
    fn stand_by(&mut self, now: Duration) -> Result<Step, StreamError> {
        let is_due = |standby: &&Standby<T>| self.fed_at.is_some_and(|at| now.saturating_sub(at) >= standby.after);
        let outcome = match self.standby.as_ref().filter(is_due) {
            Some(standby) => self.stream.submit(&standby.turn).map(|_| self.fed_at = None),
            None => self.stream.poll(LISTEN).map(drop),
        };
        match outcome {
            Ok(()) => Ok(Step::Idle),
            Err(error) if is_away(&error) => {
                self.lose();
                Ok(Step::Away(error))
            }
            Err(error) if is_final(&error) => Err(error),
            Err(_) => Ok(Step::Idle),
        }
    }
}

/// Whether connecting again may help.
fn is_away(error: &StreamError) -> bool {
    match error {
        StreamError::Link(_) | StreamError::NoAnswer { .. } => true,
        StreamError::Refused { reason, .. } => {
            matches!(reason, Reason::NotConnected | Reason::NotConfigured | Reason::NotKnown)
        }
        _ => false,
    }
}

/// Whether it would fail again.
fn is_final(error: &StreamError) -> bool {
    match error {
        StreamError::Schema { .. }
        | StreamError::Packet(_)
        | StreamError::Slices { .. }
        | StreamError::PlaneBytes { .. } => true,
        StreamError::Refused { reason, .. } => matches!(reason, Reason::Configuration | Reason::NotUnderstood),
        _ => false,
    }
}
