//! Ways to a controller: bytes out, bytes in. What the bytes mean is [`stream`](crate::stream)'s matter.

use std::time::Duration;
use thiserror::Error;

pub mod address;
pub mod serial;
pub mod sim;
pub mod usb;

/// Why a device cannot be reached, or does not carry bytes.
#[derive(Debug, Error)]
pub enum LinkError {
    /// There is none.
    #[error("no device {name}: {remedy}")]
    Absent {
        /// What was asked for.
        name: String,
        /// What to do.
        remedy: String,
    },
    /// It is something else.
    #[error("{name} is {what}: {remedy}")]
    Other {
        /// What was asked for.
        name: String,
        /// What it is, and is not.
        what: &'static str,
        /// What to do.
        remedy: String,
    },
    /// There is more than one.
    #[error("{name} is more than one device: name one of {}", found.join(", "))]
    Several {
        /// What was asked for.
        name: String,
        /// The names of those that there are.
        found: Vec<String>,
    },
    /// It is not this user's to open.
    #[error("this user may not open {name}: {remedy}")]
    Forbidden {
        /// What was asked for.
        name: String,
        /// What to do.
        remedy: String,
    },
    /// Somebody else has it.
    #[error("{name} is in use: end the other program that has it open")]
    InUse {
        /// What was asked for.
        name: String,
    },
    /// The device went away.
    #[error("the device went away")]
    Gone,
    /// See the message.
    #[error("the link failed: {0}")]
    Io(#[from] std::io::Error),
}

impl LinkError {
    /// Whether the message begins with the name of the device, or has it in its place.
    pub fn names_device(&self) -> bool {
        !matches!(self, Self::Gone | Self::Io(_))
    }
}

/// A stream of bytes in each direction. Bytes may be lost, changed or repeated; packets are checked.
pub trait Link {
    /// Takes as many of `bytes`, from the first on, as fit without waiting, and returns how many; 0 where none fits now.
    fn send(&mut self, bytes: &[u8]) -> Result<usize, LinkError>;

    /// Appends what the device sent to `into` and returns how many bytes; waits at most `wait` for the first one.
    fn receive(&mut self, into: &mut Vec<u8>, wait: Duration) -> Result<usize, LinkError>;

    /// Time since some fixed moment: the clock of the device's world, which a simulation's is not the wall's.
    fn now(&self) -> Duration;

    /// The most bytes a second that it carries to the device, where that is known: how long an answer may take hangs on it.
    fn bytes_per_second(&self) -> Option<f64> {
        None
    }
}

/// A device that can be reached again after its link was lost.
pub trait Connect {
    /// What carries the bytes.
    type Link: Link;

    /// A new link to it.
    fn connect(&mut self) -> Result<Self::Link, LinkError>;

    /// Lets `time` pass on the clock of the device's world, while there is no link.
    fn wait(&mut self, time: Duration) {
        std::thread::sleep(time);
    }
}

impl<C: Connect + ?Sized> Connect for Box<C> {
    type Link = C::Link;

    fn connect(&mut self) -> Result<Self::Link, LinkError> {
        (**self).connect()
    }

    fn wait(&mut self, time: Duration) {
        (**self).wait(time);
    }
}

impl<L: Link + ?Sized> Link for &mut L {
    fn send(&mut self, bytes: &[u8]) -> Result<usize, LinkError> {
        (**self).send(bytes)
    }

    fn receive(&mut self, into: &mut Vec<u8>, wait: Duration) -> Result<usize, LinkError> {
        (**self).receive(into, wait)
    }

    fn now(&self) -> Duration {
        (**self).now()
    }

    fn bytes_per_second(&self) -> Option<f64> {
        (**self).bytes_per_second()
    }
}

impl<L: Link + ?Sized> Link for Box<L> {
    fn send(&mut self, bytes: &[u8]) -> Result<usize, LinkError> {
        (**self).send(bytes)
    }

    fn receive(&mut self, into: &mut Vec<u8>, wait: Duration) -> Result<usize, LinkError> {
        (**self).receive(into, wait)
    }

    fn now(&self) -> Duration {
        (**self).now()
    }

    fn bytes_per_second(&self) -> Option<f64> {
        (**self).bytes_per_second()
    }
}
