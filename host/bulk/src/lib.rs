//! A stream of bytes each way over two USB bulk endpoints, with several transfers in flight: a bus that waits for its host after each
//! transfer is idle in between, and `rusb` itself waits.
//!
//! [`Bulk`] keeps the books and is safe code over the small trait [`Bus`]; [`Usb`] is that trait over libusb. All `unsafe` is in
//! `transfer.rs`. Nothing here has a thread: libusb's events are handled while its caller sends or receives.

mod pipe;
mod transfer;
mod usb;

use pipe::Pipe;
pub use rusb::Error;
use std::time::{Duration, Instant};
pub use usb::Usb;

/// So many transfers in flight keep the wire busy; while they do, what comes gathers in the next one.
const AHEAD: usize = 2;

/// A transfer and its buffer. Dropped in flight, it must neither be freed nor close its device.
pub trait Transfer {
    /// The buffer. Not to be called in flight.
    fn buffer(&mut self) -> &mut [u8];

    /// Sends the first `length` bytes of the buffer, or asks for so many.
    fn submit(&mut self, length: usize) -> Result<(), Error>;

    /// How many bytes went the last time, or why not all did; `None` while it is in flight.
    fn outcome(&self) -> Option<Result<usize, Error>>;

    /// Asks for an early end, which comes as an outcome.
    fn cancel(&mut self);
}

/// An opened device.
pub trait Bus {
    /// What goes to and from it.
    type Transfer: Transfer;

    /// A transfer with a buffer of `bytes` bytes for the endpoint of that address.
    fn transfer(&self, endpoint: u8, bytes: usize) -> Result<Self::Transfer, Error>;

    /// Learns which transfers have ended; where none has, waits up to `wait` for one.
    fn handle_events(&self, wait: Duration) -> Result<(), Error>;

    /// Makes a stalled endpoint work again.
    fn clear_halt(&self, endpoint: u8) -> Result<(), Error>;
}

/// Which endpoint, and its transfers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Size {
    /// The endpoint's address.
    pub endpoint: u8,
    /// Transfers in flight at most.
    pub transfers: usize,
    /// Bytes of each.
    pub bytes: usize,
}

/// A stream of bytes each way.
///
/// An error ends all transfers of its direction, whose bytes are lost, and is told once; afterwards, as far as the device is still there,
/// everything works again, a halted endpoint too.
pub struct Bulk<B: Bus = Usb> {
    bus: B,
    outward: Pipe<B::Transfer>,
    /// Bytes that are not under way yet, and how many.
    gathering: Option<(B::Transfer, usize)>,
    inward: Pipe<B::Transfer>,
}

impl<B: Bus> std::fmt::Debug for Bulk<B> {
    fn fmt(&self, to: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let gathered = self.gathering.as_ref().map_or(0, |(_, length)| *length);
        to.debug_struct("Bulk").field("gathered", &gathered).finish_non_exhaustive()
    }
}

impl<B: Bus> Bulk<B> {
    /// Over two endpoints of `bus`, whose interface is claimed. An inward transfer ends when its buffer is full or with a packet that is
    /// not: where a device may end with full packets, only buffers of one packet give everything at once.
    pub fn new(bus: B, outward: Size, inward: Size) -> Result<Self, Error> {
        let (outward, inward) = (Pipe::new(&bus, outward)?, Pipe::new(&bus, inward)?);
        Ok(Self { bus, outward, gathering: None, inward })
    }

    /// Takes as many of `bytes`, from the first on, as there is room for, and returns how many. They leave at once where little is in
    /// flight, else with what comes next: at the latest when the caller waits in [`receive`](Self::receive).
    pub fn send(&mut self, bytes: &[u8]) -> Result<usize, Error> {
        self.bus.handle_events(Duration::ZERO)?;
        self.finish_sent()?;
        let mut rest = bytes;
        while !rest.is_empty() {
            let Some((mut transfer, length)) =
                self.gathering.take().or_else(|| self.outward.take().map(|transfer| (transfer, 0)))
            else {
                break;
            };
            let room = &mut transfer.buffer()[length..];
            let count = rest.len().min(room.len());
            room[..count].copy_from_slice(&rest[..count]);
            let is_full = count == room.len();
            rest = &rest[count..];
            self.gathering = Some((transfer, length + count));
            if is_full {
                self.flush()?;
            }
            self.keep_busy()?;
        }
        Ok(bytes.len() - rest.len())
    }

    /// Appends what the device sent to `into` and returns how many bytes. Waits at most `wait` for the first one, and not where
    /// [`send`](Self::send) had no room and has some now.
    pub fn receive(&mut self, into: &mut Vec<u8>, wait: Duration) -> Result<usize, Error> {
        if !wait.is_zero() {
            self.flush()?;
        }
        let since = Instant::now();
        let had_room = self.has_room();
        let mut is_last = false;
        loop {
            self.listen()?;
            self.finish_sent()?;
            self.keep_busy()?;
            let count = self.finish_received(into)?;
            if count > 0 || is_last || (!had_room && self.has_room()) {
                return Ok(count);
            }
            let left = wait.saturating_sub(since.elapsed());
            is_last = left.is_zero();
            self.bus.handle_events(left)?;
        }
    }

    fn has_room(&self) -> bool {
        self.gathering.is_some() || self.outward.has_room()
    }

    /// What was gathered leaves where little is in flight.
    fn keep_busy(&mut self) -> Result<(), Error> {
        if self.outward.in_flight() < AHEAD { self.flush() } else { Ok(()) }
    }

    /// What was gathered leaves.
    fn flush(&mut self) -> Result<(), Error> {
        match self.gathering.take() {
            Some((transfer, length)) => self.outward.submit(transfer, length),
            None => Ok(()),
        }
    }

    fn listen(&mut self) -> Result<(), Error> {
        while let Some(mut transfer) = self.inward.take() {
            let length = transfer.buffer().len();
            self.inward.submit(transfer, length)?;
        }
        Ok(())
    }

    fn finish_sent(&mut self) -> Result<(), Error> {
        while let Some(outcome) = self.outward.oldest() {
            match outcome {
                Ok(_) => self.outward.recycle(),
                Err(error) => return Err(self.outward.mend(&self.bus, error)),
            }
        }
        Ok(())
    }

    fn finish_received(&mut self, into: &mut Vec<u8>) -> Result<usize, Error> {
        let before = into.len();
        while let Some(outcome) = self.inward.oldest() {
            match outcome {
                Ok(count) => {
                    into.extend_from_slice(self.inward.oldest_bytes(count));
                    self.inward.recycle();
                    self.listen()?;
                }
                // What came before it is told first.
                Err(_) if into.len() > before => break,
                Err(error) => return Err(self.inward.mend(&self.bus, error)),
            }
        }
        Ok(into.len() - before)
    }
}

impl<B: Bus> Drop for Bulk<B> {
    fn drop(&mut self) {
        self.outward.end(&self.bus);
        self.inward.end(&self.bus);
    }
}

#[cfg(test)]
mod tests;
