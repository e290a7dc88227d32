//! `praxi sim --serve serial`: the simulated controller behind a pseudo-terminal, as another program meets it.

use crate::commands::{Failure, say, until_interrupted};
use hil_sim::device::Endpoint;
use hil_sim::paced::{Pace, Paced, Traffic};
use hil_sim::served::{Pump, STEP};
use hil_sim::simulator::Simulator;
use rustix::fs::{OFlags, fcntl_setfl};
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{OptionalActions, tcgetattr, tcsetattr};
use serde_json::{Value, json};
use std::convert::Infallible;
use std::fs::File;
use std::io::{self, ErrorKind, Read, Write};
use std::os::unix::fs::OpenOptionsExt;
use std::sync::atomic::Ordering;
use std::time::Instant;

/// What waits for a host that does not read: as much as Linux keeps for a terminal. The rest is lost, as on any serial line.
const UNREAD_MAX: usize = 64 * 1024;
/// Bytes that are read at once.
const CHUNK: usize = 4096;

/// Serves `simulator` at `baud` bits a second until it is told to end; says where, and when a host came or went.
pub(super) fn serve(simulator: Simulator, baud: u32, as_json: bool) -> Result<(), Failure> {
    let pace = Pace::serial(baud);
    let mut terminal = Terminal::open().map_err(|error| Failure(format!("no pseudo-terminal: {error}")))?;
    let mut line = Paced::new(simulator, pace);
    let tell = |text: String, value: Value| say(if as_json { value.to_string() } else { text });
    let path = &terminal.path.clone();
    tell(
        format!(
            "serving the simulated controller at {baud} baud: open {path}, as in praxi doctor --device {path}@{baud}"
        ),
        json!({ "event": "ready", "path": path, "baud": baud }),
    );
    let (start, mut pump, interrupted) = (Instant::now(), Pump::new(), until_interrupted());
    while !interrupted.load(Ordering::Relaxed) {
        let had_host = terminal.has_host;
        let Ok(()) = pump.catch_up(start.elapsed(), &mut line, |line| {
            terminal.exchange(line);
            Ok::<_, Infallible>(())
        });
        match (had_host, terminal.has_host) {
            (false, true) => tell(format!("a host opened {path}"), json!({ "event": "opened" })),
            (true, false) => {
                let [heard, said] = line.traffic();
                line.forget_traffic();
                tell(
                    farewell(path, pace, heard, said),
                    json!({ "event": "closed", "heard": figures(heard, pace), "said": figures(said, pace) }),
                );
            }
            _ => {}
        }
        std::thread::sleep(STEP);
    }
    Ok(())
}

/// The share of the line's rate that was used from the first byte to the last.
fn share(traffic: Traffic, pace: Pace) -> f64 {
    traffic.bytes_per_second() / pace.bytes_per_second
}

fn figures(traffic: Traffic, pace: Pace) -> Value {
    json!({ "bytes": traffic.bytes, "bytes_per_second": traffic.bytes_per_second(), "share": share(traffic, pace) })
}

fn farewell(path: &str, pace: Pace, heard: Traffic, said: Traffic) -> String {
    format!(
        "the host closed {path}: {} bytes came, {:.1} % of what the line carries; {} bytes went",
        heard.bytes,
        100.0 * share(heard, pace),
        said.bytes
    )
}

/// Our end of a pseudo-terminal. Reads and writes do not wait.
struct Terminal {
    master: File,
    /// The other end.
    path: String,
    has_host: bool,
    heard: Vec<u8>,
    unread: Vec<u8>,
}

impl Terminal {
    fn open() -> io::Result<Self> {
        let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY)?;
        grantpt(&master)?;
        unlockpt(&master)?;
        let path = ptsname(&master, Vec::new())?.to_string_lossy().into_owned();
        // Raw, so that nothing is echoed before a host sets its port up. Opened and closed once, the other end counts as closed from then on.
        let flags = OFlags::NOCTTY.bits() as i32;
        let other = File::options().read(true).write(true).custom_flags(flags).open(&path)?;
        let mut settings = tcgetattr(&other)?;
        settings.make_raw();
        tcsetattr(&other, OptionalActions::Now, &settings)?;
        fcntl_setfl(&master, OFlags::NONBLOCK)?;
        Ok(Self { master: master.into(), path, has_host: false, heard: Vec::new(), unread: Vec::new() })
    }

    /// Moves what fits both ways.
    fn exchange(&mut self, line: &mut impl Endpoint) {
        if self.heard.is_empty() {
            self.heard.resize(CHUNK, 0);
            let read = self.master.read(&mut self.heard);
            self.heard.truncate(*read.as_ref().unwrap_or(&0));
            // A terminal whose other end nobody has open fails to be read.
            self.has_host = match read {
                Ok(count) => count > 0,
                Err(error) => matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted),
            };
        }
        let taken = line.receive(&self.heard);
        self.heard.drain(..taken);
        self.unread.extend(line.transmit());
        if !self.has_host {
            self.unread.clear();
        }
        if !self.unread.is_empty() {
            let written = self.master.write(&self.unread).unwrap_or(0);
            self.unread.drain(..written);
            self.unread.truncate(UNREAD_MAX);
        }
    }
}
