//! A port of a UNIX. `serialport` sets it up and holds its lock; bytes go past it, as its writes wait for the last byte to fit: a terminal
//! that is not told otherwise does not write in part.

use super::{no_port, refused, refused_by_port};
use crate::link::LinkError;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fs::OFlags;
use rustix::io::Errno;
use serialport::{ClearBuffer, SerialPort, TTYPort};
use std::fs::{File, OpenOptions};
use std::io::{self, IsTerminal, Read, Write};
use std::os::unix::fs::{FileTypeExt, OpenOptionsExt};
use std::time::Duration;

/// What the system says of a port that was unplugged, and of the end of a pseudo-terminal whose other end is closed.
pub const GONE: [i32; 3] = [Errno::IO.raw_os_error(), Errno::NXIO.raw_os_error(), Errno::NODEV.raw_os_error()];

/// An open port.
#[derive(Debug)]
pub struct Line {
    file: File,
    /// Its lock ends with it.
    _port: TTYPort,
}

impl Line {
    pub fn open(port: &str, baud: u32) -> Result<Self, LinkError> {
        match std::fs::metadata(port).map(|there| there.file_type()) {
            Ok(kind) if kind.is_dir() => return Err(no_port(port, "a folder and no serial port")),
            Ok(kind) if !kind.is_char_device() => return Err(no_port(port, "a file and no serial port")),
            // What cannot be looked at cannot be opened, and that says why.
            _ => {}
        }
        let flags = OFlags::NONBLOCK | OFlags::NOCTTY;
        let opened = OpenOptions::new().read(true).write(true).custom_flags(flags.bits() as i32).open(port);
        let file = opened.map_err(|error| refused(port, error))?;
        if !file.is_terminal() {
            return Err(no_port(port, "a device and no serial port"));
        }
        let set_up = TTYPort::open(&serialport::new(port, baud)).map_err(|error| refused_by_port(port, baud, error))?;
        // What waits there is an earlier conversation's.
        let _ = set_up.clear(ClearBuffer::Input);
        Ok(Self { file, _port: set_up })
    }

    /// Writes what fits now.
    pub fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.file.write(bytes)
    }

    /// Reads what is there, waiting at most `wait` for the first byte.
    pub fn read(&mut self, into: &mut [u8], wait: Duration) -> io::Result<usize> {
        let timeout = Timespec { tv_sec: wait.as_secs().min(1 << 30) as i64, tv_nsec: wait.subsec_nanos().into() };
        if poll(&mut [PollFd::new(&self.file, PollFlags::IN)], Some(&timeout))? == 0 {
            return Err(io::ErrorKind::TimedOut.into());
        }
        match self.file.read(into)? {
            // A terminal that hung up has an end, as files have.
            0 => Err(io::ErrorKind::BrokenPipe.into()),
            count => Ok(count),
        }
    }
}
