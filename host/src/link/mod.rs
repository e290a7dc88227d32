//! Ways to a controller: bytes out, bytes in. What the bytes mean is [`stream`](crate::stream)'s matter.

use std::time::Duration;
use thiserror::Error;

#[cfg(test)]
pub mod faulty;
pub mod sim;

/// Why a link does not carry bytes.
#[derive(Debug, Error)]
pub enum LinkError {
    /// The device went away.
    #[error("the device went away")]
    Gone,
    /// See the message.
    #[error("the link failed: {0}")]
    Io(#[from] std::io::Error),
}

/// A stream of bytes in each direction. Bytes may be lost, changed or repeated; packets are checked.
pub trait Link {
    /// Takes as many of `bytes`, from the first on, as fit without waiting, and returns how many; 0 where none fits now.
    fn send(&mut self, bytes: &[u8]) -> Result<usize, LinkError>;

    /// Appends what the device sent to `into` and returns how many bytes; waits at most `wait` for the first one.
    fn receive(&mut self, into: &mut Vec<u8>, wait: Duration) -> Result<usize, LinkError>;

    /// Time since some fixed moment: the clock of the device's world, which a simulation's is not the wall's.
    fn now(&self) -> Duration;
}
