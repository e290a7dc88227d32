//! A controller on a serial port.

use super::{Connect, Link, LinkError};
use line::Line;
use std::io::{self, ErrorKind};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

#[cfg_attr(unix, path = "serial/unix.rs")]
#[cfg_attr(not(unix), path = "serial/other.rs")]
mod line;

/// Bits a second where nobody says another rate: what common USB bridges reach (FT232R, CP2102N). A port that is USB itself takes any.
pub const BAUD: u32 = 3_000_000;

/// Bytes that are read at once.
const CHUNK: usize = 4096;

/// A port's name and rate.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SerialConnect {
    /// The port as the system calls it, as in /dev/ttyUSB0 or COM3.
    pub port: String,
    /// Bits a second.
    pub baud: u32,
}

impl Connect for SerialConnect {
    type Link = SerialLink;

    fn connect(&mut self) -> Result<SerialLink, LinkError> {
        SerialLink::open(&self.port, self.baud)
    }
}

/// An open port: 8 data bits, no parity, one stop bit, no flow control. Modem lines are left as the system sets them.
#[derive(Debug)]
pub struct SerialLink {
    line: Line,
    baud: u32,
    opened: Instant,
    /// UNIX time then: numbers of packets follow from it, and another program's must differ.
    opened_at: Duration,
}

impl SerialLink {
    /// Opens `port` for this program alone.
    pub fn open(port: &str, baud: u32) -> Result<Self, LinkError> {
        let line = Line::open(port, baud)?;
        let opened_at = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        Ok(Self { line, baud, opened: Instant::now(), opened_at })
    }
}

impl Link for SerialLink {
    fn send(&mut self, bytes: &[u8]) -> Result<usize, LinkError> {
        carried(self.line.write(bytes))
    }

    fn receive(&mut self, into: &mut Vec<u8>, wait: Duration) -> Result<usize, LinkError> {
        let before = into.len();
        let mut wait = wait;
        loop {
            let end = into.len();
            into.resize(end + CHUNK, 0);
            let read = carried(self.line.read(&mut into[end..], wait));
            into.truncate(end + *read.as_ref().unwrap_or(&0));
            let is_full = into.len() == end + CHUNK;
            match read {
                Ok(_) if is_full => wait = Duration::ZERO,
                // What came before the port vanished is whole.
                Err(_) if into.len() > before => return Ok(into.len() - before),
                read => return read.map(|_| into.len() - before),
            }
        }
    }

    fn now(&self) -> Duration {
        self.opened_at + self.opened.elapsed()
    }

    fn bytes_per_second(&self) -> Option<f64> {
        Some(f64::from(self.baud) / 10.0)
    }
}

/// Bytes moved: 0 where none could be now. A port that was unplugged says so in several ways.
fn carried(moved: io::Result<usize>) -> Result<usize, LinkError> {
    match moved {
        Ok(count) => Ok(count),
        Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted) => {
            Ok(0)
        }
        Err(error) if matches!(error.kind(), ErrorKind::BrokenPipe | ErrorKind::NotFound) => Err(LinkError::Gone),
        Err(error) if error.raw_os_error().is_some_and(|code| line::GONE.contains(&code)) => Err(LinkError::Gone),
        Err(error) => Err(LinkError::Io(error)),
    }
}

/// Why `port` did not open.
fn refused(port: &str, error: io::Error) -> LinkError {
    let name = port.to_string();
    match error.kind() {
        ErrorKind::NotFound => LinkError::Absent { name, remedy: there_are(&ports()) },
        ErrorKind::PermissionDenied => {
            let remedy = "join the group that owns it (Debian, Ubuntu: sudo usermod -aG dialout $USER; Arch: uucp) and log in again".into();
            LinkError::Forbidden { name, remedy }
        }
        ErrorKind::ResourceBusy => LinkError::InUse { name },
        _ if error.raw_os_error().is_some_and(|code| line::GONE.contains(&code)) => {
            LinkError::Absent { name, remedy: format!("nothing answers there ({error}); {}", there_are(&ports())) }
        }
        _ => LinkError::Io(error),
    }
}

/// As [`refused`], for what `serialport` says.
fn refused_by_port(port: &str, baud: u32, error: serialport::Error) -> LinkError {
    match error.kind {
        // What it says of a port that is locked.
        serialport::ErrorKind::NoDevice => LinkError::InUse { name: port.into() },
        serialport::ErrorKind::Io(kind) => refused(port, io::Error::new(kind, error.description)),
        _ => LinkError::Io(io::Error::other(format!("at {baud} baud: {error}"))),
    }
}

/// `port` is something that is no serial port.
fn no_port(port: &str, what: &'static str) -> LinkError {
    let remedy = match &ports()[..] {
        [] => "plug the controller in; praxi devices lists the ports then".into(),
        ports => format!("name a serial port: there is {}", ports.join(", ")),
    };
    LinkError::Other { name: port.into(), what, remedy }
}

/// Where there is something to choose from.
fn there_are(ports: &[String]) -> String {
    match ports {
        [] => "there is no serial port: plug the controller in and look with praxi devices".into(),
        ports => format!("there is {}", ports.join(", ")),
    }
}

/// The names of this machine's serial ports, as far as the system lists them; pseudo-terminals are not among them.
pub fn ports() -> Vec<String> {
    let mut names: Vec<String> =
        serialport::available_ports().unwrap_or_default().into_iter().map(|port| port.port_name).collect();
    names.sort();
    names
}

#[cfg(all(test, unix))]
mod tests;
