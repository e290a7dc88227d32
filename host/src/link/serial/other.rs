//! A port of a system that is no UNIX, by `serialport` alone. Not tried: see "What runs where" in README.

use super::refused_by_port;
use crate::link::LinkError;
use serialport::SerialPort;
use std::io;
use std::time::Duration;

/// What the system says of a port that was unplugged: access denied, and a request that a device does not know.
pub const GONE: [i32; 2] = [5, 22];

/// A write takes at most so long: the port takes what fits, and says how much.
const WRITE_WAIT: Duration = Duration::from_millis(1);

/// An open port.
pub struct Line(Box<dyn SerialPort>);

impl std::fmt::Debug for Line {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.debug_tuple("Line").field(&self.0.name()).finish()
    }
}

impl Line {
    pub fn open(port: &str, baud: u32) -> Result<Self, LinkError> {
        serialport::new(port, baud).open().map(Self).map_err(|error| refused_by_port(port, baud, error))
    }

    /// Writes what fits now.
    pub fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.set_timeout(WRITE_WAIT)?;
        self.0.write(bytes)
    }

    /// Reads what is there, waiting at most `wait` for the first byte.
    pub fn read(&mut self, into: &mut [u8], wait: Duration) -> io::Result<usize> {
        self.0.set_timeout(wait)?;
        self.0.read(into)
    }
}
