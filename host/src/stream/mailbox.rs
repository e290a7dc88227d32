//! One place for the newest turn, between whoever renders and whoever sends.

use super::TurnPlanes;
use super::live::Source;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// The place. Clones are the same one.
#[derive(Debug)]
pub struct Mailbox<T>(Arc<Inner<T>>);

#[derive(Debug)]
struct Inner<T> {
    slot: Mutex<Slot<T>>,
    taken: Condvar,
}

#[derive(Debug)]
struct Slot<T> {
    turn: Option<T>,
    offered: u64,
    replaced: u64,
    is_closed: bool,
}

impl<T> Clone for Mailbox<T> {
    fn clone(&self) -> Self {
        Self(Arc::clone(&self.0))
    }
}

impl<T> Default for Mailbox<T> {
    fn default() -> Self {
        let slot = Mutex::new(Slot { turn: None, offered: 0, replaced: 0, is_closed: false });
        Self(Arc::new(Inner { slot, taken: Condvar::new() }))
    }
}

impl<T> Mailbox<T> {
    /// Lays a turn down; one that nobody took is dropped.
    pub fn offer(&self, turn: T) {
        let mut slot = self.slot();
        slot.offered += 1;
        slot.replaced += u64::from(slot.turn.replace(turn).is_some());
    }

    /// Waits until the turn was taken, at most for `stale`: then a newer one may as well take its place.
    pub fn wait(&self, stale: Duration) {
        let end = Instant::now() + stale;
        let mut slot = self.slot();
        while slot.turn.is_some() && !slot.is_closed {
            let left = end.saturating_duration_since(Instant::now());
            if left.is_zero() {
                break;
            }
            slot = self.0.taken.wait_timeout(slot, left).unwrap_or_else(PoisonError::into_inner).0;
        }
    }

    /// Whether a turn lies there.
    pub fn is_full(&self) -> bool {
        self.slot().turn.is_some()
    }

    /// No more turns come, or are wanted.
    pub fn close(&self) {
        self.slot().is_closed = true;
        self.0.taken.notify_all();
    }

    /// Whether no more turns come.
    pub fn is_closed(&self) -> bool {
        self.slot().is_closed
    }

    /// Turns that were laid down, and those of them that were dropped for newer ones.
    pub fn counts(&self) -> [u64; 2] {
        let slot = self.slot();
        [slot.offered, slot.replaced]
    }

    fn slot(&self) -> MutexGuard<'_, Slot<T>> {
        self.0.slot.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl<T: TurnPlanes> Source for Mailbox<T> {
    type Turn = T;

    fn take(&mut self, _now: Duration) -> Option<T> {
        let turn = self.slot().turn.take();
        self.0.taken.notify_all();
        turn
    }

    fn has_newer(&mut self, _now: Duration) -> bool {
        self.slot().turn.is_some()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A turn without planes.
    #[derive(Debug, PartialEq)]
    struct Empty(u32);

    impl TurnPlanes for Empty {
        fn slices(&self) -> u32 {
            0
        }

        fn plane_bytes(&self, _slice: u32) -> &[u8] {
            &[]
        }
    }

    #[test]
    fn the_newest_wins_and_the_others_are_counted() {
        let mut mailbox = Mailbox::default();
        assert_eq!(mailbox.take(Duration::ZERO), None);
        (0..3).for_each(|number| mailbox.offer(Empty(number)));
        assert!(mailbox.has_newer(Duration::ZERO));
        assert_eq!(mailbox.take(Duration::ZERO), Some(Empty(2)));
        assert!(!mailbox.has_newer(Duration::ZERO));
        assert_eq!(mailbox.counts(), [3, 2]);
    }

    #[test]
    fn whoever_renders_waits_until_the_turn_is_taken_or_the_end() {
        let mailbox = Mailbox::default();
        mailbox.offer(Empty(1));
        std::thread::scope(|scope| {
            let waiting = scope.spawn(|| mailbox.wait(Duration::from_secs(3_600)));
            assert_eq!(mailbox.clone().take(Duration::ZERO), Some(Empty(1)));
            waiting.join().unwrap();
            assert!(!mailbox.is_full());
            mailbox.offer(Empty(2));
            let waiting = scope.spawn(|| mailbox.wait(Duration::from_secs(3_600)));
            mailbox.close();
            waiting.join().unwrap();
        });
        assert!(mailbox.is_full() && mailbox.is_closed());
        mailbox.wait(Duration::ZERO);
    }
}
