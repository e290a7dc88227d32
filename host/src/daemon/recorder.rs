//! Who records what happens: each has a queue of their own, and a daemon that waits for nobody.

use crate::recording::Entry;
use crate::recording::file::Timed;
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Instant, SystemTime, UNIX_EPOCH};

/// So many entries may wait for one who records: some ten seconds' worth.
const WAITING_MAX: usize = 4096;

/// One who records.
struct Queue {
    to: SyncSender<Arc<Timed>>,
    lost: u64,
}

/// Those who record.
pub struct Recorders {
    /// And how many there have ever been.
    queues: Mutex<(Vec<Queue>, u64)>,
    start: Instant,
    /// When that was.
    start_unix_ns: u64,
}

impl Recorders {
    /// Nobody; times count from `start`, which is now.
    pub fn new(start: Instant) -> Self {
        let unix = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        Self { queues: Mutex::default(), start, start_unix_ns: unix.as_nanos() as u64 }
    }

    /// When times began, nanoseconds since 1970.
    pub fn start_unix_ns(&self) -> u64 {
        self.start_unix_ns
    }

    fn lock(&self) -> MutexGuard<'_, (Vec<Queue>, u64)> {
        self.queues.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn now_ns(&self) -> u64 {
        self.start_unix_ns + self.start.elapsed().as_nanos() as u64
    }

    /// How many there have been so far.
    pub fn count(&self) -> u64 {
        self.lock().1
    }

    /// One more, whose first entry is `first`.
    pub fn begin(&self, first: Entry) -> Receiver<Arc<Timed>> {
        let (to, from) = sync_channel(WAITING_MAX);
        let mut queues = self.lock();
        // There is room for it.
        let _ = to.try_send(Arc::new((self.now_ns(), first)));
        queues.0.push(Queue { to, lost: 0 });
        queues.1 += 1;
        from
    }

    /// Something happened. It is asked what it was only where somebody records.
    pub fn record(&self, entry: impl FnOnce() -> Entry) {
        if self.lock().0.is_empty() {
            return;
        }
        // Nobody waits for this lock meanwhile: checksums take milliseconds.
        let entry = entry();
        let mut queues = self.lock();
        let timed = Arc::new((self.now_ns(), entry));
        queues.0.retain_mut(|queue| queue.take(&timed));
    }
}

impl Queue {
    /// Whether somebody still takes what comes.
    fn take(&mut self, timed: &Arc<Timed>) -> bool {
        if self.lost > 0 {
            let lost = Arc::new((timed.0, Entry::Lost { entries: self.lost }));
            match self.to.try_send(lost) {
                Ok(()) => self.lost = 0,
                Err(TrySendError::Full(_)) => self.lost += 1,
                Err(TrySendError::Disconnected(_)) => return false,
            }
            if self.lost > 0 {
                return true;
            }
        }
        match self.to.try_send(Arc::clone(timed)) {
            Ok(()) => true,
            Err(TrySendError::Full(_)) => {
                self.lost += 1;
                true
            }
            Err(TrySendError::Disconnected(_)) => false,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn entry(number: u64) -> Entry {
        Entry::Lost { entries: 1_000_000 + number }
    }

    #[test]
    fn each_gets_what_happens_from_its_beginning_on() {
        let recorders = Recorders::new(Instant::now());
        recorders.record(|| unreachable!("nobody records"));
        let first = recorders.begin(entry(1));
        recorders.record(|| entry(2));
        let second = recorders.begin(entry(3));
        recorders.record(|| entry(4));
        let entries = |from: &Receiver<Arc<Timed>>| Vec::from_iter(from.try_iter().map(|timed| timed.1.clone()));
        assert_eq!(entries(&first), [1, 2, 4].map(entry));
        assert_eq!(entries(&second), [3, 4].map(entry));
        drop((first, second));
        recorders.record(|| entry(5));
        recorders.record(|| unreachable!("nobody records any more"));
        assert_eq!(recorders.count(), 2);
    }

    #[test]
    fn who_is_slow_is_told_what_they_missed() {
        let recorders = Recorders::new(Instant::now());
        let slow = recorders.begin(entry(0));
        (0..WAITING_MAX as u64 + 9).for_each(|number| recorders.record(|| entry(number)));
        assert_eq!(slow.try_iter().count(), WAITING_MAX);
        recorders.record(|| entry(77));
        let after: Vec<_> = slow.try_iter().map(|timed| timed.1.clone()).collect();
        assert_eq!(after, [Entry::Lost { entries: 10 }, entry(77)]);
    }
}
