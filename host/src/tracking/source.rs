//! The threads that wait for trackers' bytes, and nothing else: a socket or a port, a clock, and whoever takes what came.

use super::patriot::{COMMANDS, Lines};
use super::{ParseError, Pose, Reading, freed, opentrack};
use crate::link::serial::SerialLink;
use crate::link::{Link, LinkError};
use protocol::rig::TrackerSource;
use std::io::{self, ErrorKind};
use std::net::{SocketAddr, UdpSocket};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

/// A thread asks at least so often whether it is to end.
const LOOK: Duration = Duration::from_millis(100);
/// What vanished is looked for again after this, then twice as long each time up to [`WAIT_MAX`].
const WAIT_MIN: Duration = Duration::from_millis(100);
/// The longest wait between two looks.
const WAIT_MAX: Duration = Duration::from_secs(5);
/// A Patriot that is silent for so long is told again what to do: somebody may have switched it on only now.
const SILENCE: Duration = Duration::from_secs(2);
/// No tracker's datagram is longer; what is longer is read in part and refused.
const DATAGRAM_BYTES: usize = 2048;

/// How a source is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum State {
    /// It is open, at this address or port; whether anything comes is told by the counters.
    Open(String),
    /// It is not, for this reason, and is tried again.
    Closed(String),
}

/// A thread that brings readings, until it is dropped.
#[derive(Debug)]
pub struct Follower {
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
}

#[derive(Debug)]
struct Shared {
    ends: AtomicBool,
    state: Mutex<State>,
}

impl Shared {
    fn ends(&self) -> bool {
        self.ends.load(Ordering::Relaxed)
    }

    fn say(&self, state: State) {
        *self.state.lock().unwrap_or_else(PoisonError::into_inner) = state;
    }
}

impl Follower {
    /// Starts a thread for `source`, which is the `number`th of its rig. Time counts from `epoch`. `sink` gets what comes, on that thread; what
    /// is no packet too, to be counted.
    pub fn start(
        source: &TrackerSource,
        number: u8,
        epoch: Instant,
        mut sink: impl FnMut(Result<Reading, ParseError>) + Send + 'static,
    ) -> io::Result<Self> {
        let state = Mutex::new(State::Closed("not opened yet".into()));
        let shared = Arc::new(Shared { ends: AtomicBool::new(false), state });
        let (source, of_thread) = (source.clone(), Arc::clone(&shared));
        let thread = thread::Builder::new().name(source.to_string()).spawn(move || {
            let mut bring = |pose: Result<Pose, ParseError>, at| sink(pose.map(|pose| Reading::new(number, &pose, at)));
            follow(&source, &of_thread, epoch, &mut bring);
        })?;
        Ok(Self { shared, thread: Some(thread) })
    }

    /// How the source is now.
    pub fn state(&self) -> State {
        self.shared.state.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }
}

impl Drop for Follower {
    fn drop(&mut self) {
        self.shared.ends.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            thread.thread().unpark();
            // A sink that panicked has said so.
            let _ = thread.join();
        }
    }
}

type Bring<'a> = dyn FnMut(Result<Pose, ParseError>, Duration) + 'a;

/// Opens `source` and brings what it sends, again and again.
fn follow(source: &TrackerSource, shared: &Shared, epoch: Instant, bring: &mut Bring<'_>) {
    let mut wait = WAIT_MIN;
    while !shared.ends() {
        let mut was_heard = false;
        let mut heard = |pose: Result<Pose, ParseError>, at: Duration| {
            was_heard |= pose.is_ok();
            bring(pose, at);
        };
        let closed = match source {
            TrackerSource::Opentrack(address) => datagrams(*address, opentrack::parse, shared, epoch, &mut heard)
                .map_err(|error| refused(source, &error)),
            TrackerSource::FreeD(address) => {
                datagrams(*address, freed::parse, shared, epoch, &mut heard).map_err(|error| refused(source, &error))
            }
            TrackerSource::Patriot { port, baud } => {
                lines(port, *baud, shared, epoch, &mut heard).map_err(|error| error.to_string())
            }
        };
        let Err(why) = closed else { return };
        shared.say(State::Closed(why));
        wait = if was_heard { WAIT_MIN } else { wait };
        thread::park_timeout(wait);
        wait = WAIT_MAX.min(2 * wait);
    }
}

fn refused(source: &TrackerSource, error: &io::Error) -> String {
    match error.kind() {
        ErrorKind::AddrInUse => format!("{source}: another program listens there: end it, or choose another port"),
        ErrorKind::AddrNotAvailable => format!("{source}: this machine has no such address"),
        ErrorKind::PermissionDenied => format!("{source}: this user may not listen there: choose a port from 1024 on"),
        _ => format!("{source}: {error}"),
    }
}

/// Brings a socket's datagrams until the thread is to end.
fn datagrams(
    address: SocketAddr,
    parse: fn(&[u8]) -> Result<Pose, ParseError>,
    shared: &Shared,
    epoch: Instant,
    bring: &mut Bring<'_>,
) -> io::Result<()> {
    let socket = UdpSocket::bind(address)?;
    socket.set_read_timeout(Some(LOOK))?;
    shared.say(State::Open(socket.local_addr()?.to_string()));
    let mut datagram = [0; DATAGRAM_BYTES];
    while !shared.ends() {
        match socket.recv(&mut datagram) {
            Ok(count) => bring(parse(&datagram[..count]), epoch.elapsed()),
            Err(error) if is_nothing(error.kind()) => {}
            Err(error) => return Err(error),
        }
    }
    Ok(())
}

/// Nothing came in time, or, on some systems, something that this socket sent earlier found nobody.
fn is_nothing(kind: ErrorKind) -> bool {
    use ErrorKind::{ConnectionRefused, ConnectionReset, Interrupted, TimedOut, WouldBlock};
    matches!(kind, WouldBlock | TimedOut | Interrupted | ConnectionReset | ConnectionRefused)
}

/// Brings a Patriot's lines until the thread is to end.
fn lines(port: &str, baud: u32, shared: &Shared, epoch: Instant, bring: &mut Bring<'_>) -> Result<(), LinkError> {
    let mut link = SerialLink::open(port, baud)?;
    shared.say(State::Open(port.into()));
    let mut lines = Lines::new();
    let mut bytes = Vec::new();
    let mut heard: Option<Duration> = None;
    while !shared.ends() {
        let now = epoch.elapsed();
        if heard.is_none_or(|heard| now - heard > SILENCE) {
            command(&mut link)?;
            heard = Some(now);
        }
        bytes.clear();
        link.receive(&mut bytes, LOOK)?;
        let now = epoch.elapsed();
        lines.take(&bytes, |pose, after| {
            if pose.is_ok() {
                heard = Some(now);
            }
            // What came after its end took ten bits a byte: several lines that are read at once have times of their own.
            bring(pose, now.saturating_sub(Duration::from_secs_f64(10.0 * after as f64 / f64::from(baud))));
        });
    }
    Ok(())
}

/// Tells a Patriot what to send. A line that takes nothing now takes it when it is told again.
fn command(link: &mut SerialLink) -> Result<(), LinkError> {
    let mut left = COMMANDS;
    for _ in 0..COMMANDS.len() {
        left = &left[link.send(left)?..];
        if left.is_empty() {
            break;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests;
