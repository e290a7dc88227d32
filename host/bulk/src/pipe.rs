//! The transfers of one endpoint: which are free, which are in flight and in what order.

use crate::{Bus, Error, Size, Transfer};
use std::collections::VecDeque;
use std::time::{Duration, Instant};

/// How long transfers that are ended early may take for it. A device that is there lets go of them within milliseconds.
const END_WITHIN: Duration = Duration::from_secs(1);

pub(crate) struct Pipe<T> {
    endpoint: u8,
    free: Vec<T>,
    /// In the order of their submission, which is that of their bytes.
    flying: VecDeque<T>,
}

impl<T: Transfer> Pipe<T> {
    pub(crate) fn new(bus: &impl Bus<Transfer = T>, size: Size) -> Result<Self, Error> {
        let free = (0..size.transfers).map(|_| bus.transfer(size.endpoint, size.bytes)).collect::<Result<_, _>>()?;
        Ok(Self { endpoint: size.endpoint, free, flying: VecDeque::with_capacity(size.transfers) })
    }

    pub(crate) fn has_room(&self) -> bool {
        !self.free.is_empty()
    }

    pub(crate) fn in_flight(&self) -> usize {
        self.flying.len()
    }

    /// One to be filled and submitted.
    pub(crate) fn take(&mut self) -> Option<T> {
        self.free.pop()
    }

    pub(crate) fn submit(&mut self, mut transfer: T, length: usize) -> Result<(), Error> {
        let submitted = transfer.submit(length);
        match submitted {
            Ok(()) => self.flying.push_back(transfer),
            Err(_) => self.free.push(transfer),
        }
        submitted
    }

    /// How the oldest one ended; `None` where it has not.
    pub(crate) fn oldest(&self) -> Option<Result<usize, Error>> {
        self.flying.front()?.outcome()
    }

    /// What the oldest one, which has ended, brought.
    pub(crate) fn oldest_bytes(&mut self, count: usize) -> &[u8] {
        let buffer = self.flying.front_mut().map_or(&mut [][..], Transfer::buffer);
        &buffer[..count.min(buffer.len())]
    }

    /// The oldest one, which has ended, is free again.
    pub(crate) fn recycle(&mut self) {
        self.free.extend(self.flying.pop_front());
    }

    /// After `error` of the oldest one: ends the others, and a stall. The error that is to be told.
    pub(crate) fn mend(&mut self, bus: &impl Bus<Transfer = T>, error: Error) -> Error {
        self.end(bus);
        match error {
            Error::Pipe => bus.clear_halt(self.endpoint).err().unwrap_or(error),
            _ => error,
        }
    }

    /// Ends all transfers. One that does not end stays in flight, and is lost with the pipe.
    pub(crate) fn end(&mut self, bus: &impl Bus<Transfer = T>) {
        // The youngest first, so that none begins because the one before it has ended.
        self.flying.iter_mut().rev().filter(|transfer| transfer.outcome().is_none()).for_each(Transfer::cancel);
        let since = Instant::now();
        loop {
            while self.oldest().is_some() {
                self.recycle();
            }
            let left = END_WITHIN.saturating_sub(since.elapsed());
            if self.flying.is_empty() || left.is_zero() || bus.handle_events(left).is_err() {
                return;
            }
        }
    }
}
