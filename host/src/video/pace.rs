//! Which frame belongs to which refresh of the monitor, and which came late.
//!
//! The monitor counts its refreshes (Present's MSC: media stream counter), and the frame for refresh m is frame m modulo the frames of a
//! turn. So the mirror, which follows the refreshes, need not move for a frame that was late or for a host that begins anew: the next frame
//! is again the one that belongs there.

use std::collections::VecDeque;

/// A frame that is to be handed over.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Due {
    /// The refresh that it is for.
    pub target: u64,
    /// Its number in the turn.
    pub frame: u32,
    /// Whether no frame of its turn was handed over before: another picture may begin.
    pub begins_turn: bool,
}

impl Due {
    /// What the display server calls it by: it takes no more than 32 bits.
    pub fn serial(&self) -> u32 {
        self.target as u32
    }
}

/// Refreshes by what they showed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// The frame that belonged there.
    pub shown: u64,
    /// Another one.
    pub late: u64,
}

/// Hands frames out for coming refreshes, and hears when they were shown.
#[derive(Clone, Debug)]
pub struct Pacer {
    frames: u64,
    ahead: u64,
    next: Option<u64>,
    turn: Option<u64>,
    /// Refreshes whose frames were handed over and not shown yet.
    flight: VecDeque<u64>,
    /// The refresh of the last one that was shown too late.
    behind: Option<u64>,
    counts: Counts,
}

impl Pacer {
    /// For turns of `frames` frames; each is handed over up to `ahead` refreshes before its own.
    pub fn new(frames: u32, ahead: u32) -> Self {
        let (frames, ahead) = (u64::from(frames.max(1)), u64::from(ahead.max(1)));
        let (next, turn, flight, behind) = (None, None, VecDeque::new(), None);
        Self { frames, ahead, next, turn, flight, behind, counts: Counts::default() }
    }

    /// The next frame to be handed over during refresh `now`, where there is one. Call it when all that is known was
    /// [told](Self::completed), until there is none.
    pub fn due(&mut self, now: u64) -> Option<Due> {
        let next = self.next.unwrap_or(now + self.ahead);
        // Frames on their way behind one that was late are late as well, where each is shown for a refresh: one is left out for each
        // refresh that was lost.
        let queued = self.behind.take().map_or(0, |shown| shown + self.flight.len() as u64);
        let target = next.max(now + 1).max(queued + 1);
        self.counts.late += target - next;
        self.next = Some(target);
        if target > now + self.ahead {
            return None;
        }
        self.next = Some(target + 1);
        self.flight.push_back(target);
        let turn = target / self.frames;
        let begins_turn = self.turn.replace(turn) != Some(turn);
        Some(Due { target, frame: (target % self.frames) as u32, begins_turn })
    }

    /// The frame that was handed over as `serial` is on screen since refresh `at`, or was left out by the server; which refresh it was for.
    pub fn completed(&mut self, serial: u32, at: Option<u64>) -> Option<u64> {
        let place = self.flight.iter().position(|target| *target as u32 == serial)?;
        let target = self.flight.remove(place)?;
        if at == Some(target) {
            self.counts.shown += 1;
        } else {
            self.counts.late += 1;
            self.behind = at.filter(|at| *at > target).or(self.behind);
        }
        Some(target)
    }

    /// How refreshes went so far.
    pub fn counts(&self) -> Counts {
        self.counts
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn a_frame_belongs_to_its_refresh_whenever_one_begins() {
        for start in [0, 5, 1_000_003] {
            let mut pacer = Pacer::new(12, 3);
            let due: Vec<_> = std::iter::from_fn(|| pacer.due(start)).collect();
            assert_eq!(due.iter().map(|due| due.target).collect::<Vec<_>>(), [start + 3]);
            assert_eq!((due[0].frame, due[0].begins_turn), (((start + 3) % 12) as u32, true));
            let later: Vec<_> = std::iter::from_fn(|| pacer.due(start + 2)).map(|due| due.target).collect();
            assert_eq!(later, [start + 4, start + 5]);
        }
    }

    #[test]
    fn a_picture_begins_with_its_turn_even_where_its_first_frame_is_left_out() {
        let mut pacer = Pacer::new(4, 1);
        let mut begins = |now| pacer.due(now).map(|due| (due.frame, due.begins_turn));
        assert_eq!(begins(1), Some((2, true)));
        assert_eq!(begins(2), Some((3, false)));
        assert_eq!(begins(5), Some((2, true)));
        assert_eq!(begins(6), Some((3, false)));
        assert_eq!(begins(7), Some((0, true)));
        assert_eq!(pacer.counts().late, 2);
    }

    /// A display server and its monitor: one frame a refresh at most, the oldest that is due, or the newest where it leaves others out.
    struct Server {
        queue: VecDeque<Due>,
        leaves_out: bool,
        on_screen: Option<u64>,
    }

    impl Server {
        /// Refresh `now` begins, and what is due comes on screen; whether something did.
        fn refresh(&mut self, now: u64, pacer: &mut Pacer) -> bool {
            while let Some(due) = self.queue.pop_front_if(|due| due.target <= now) {
                let is_last = self.queue.front().is_none_or(|next| next.target > now);
                if self.leaves_out && !is_last {
                    pacer.completed(due.serial(), None);
                    continue;
                }
                self.on_screen = Some(due.target);
                pacer.completed(due.serial(), Some(now));
                return true;
            }
            false
        }
    }

    /// What goes wrong in a refresh.
    #[derive(Clone, Copy, Debug, PartialEq)]
    enum Fault {
        Nothing,
        /// The monitor shows once more what it showed.
        Stall,
        /// The host does not get to it.
        Doze,
    }

    proptest! {
        #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

        /// However host and server dawdle: each refresh is counted once, as what was on screen in it; and once they keep up again, so do the
        /// frames.
        #[test]
        fn every_refresh_is_counted(
            frames in 1u32..14, ahead in 1u32..5, start in 0u64..1 << 40, leaves_out: bool,
            faults in prop::collection::vec(
                prop_oneof![6 => Just(Fault::Nothing), 1 => Just(Fault::Stall), 1 => Just(Fault::Doze)], 1..200,
            ),
        ) {
            let mut pacer = Pacer::new(frames, ahead);
            let mut server = Server { queue: VecDeque::new(), leaves_out, on_screen: None };
            let (mut known, mut first, mut right) = (start, None, 0);
            let end = start + faults.len() as u64 + 4 * u64::from(ahead) + 4;
            for now in start..end {
                let fault = faults.get((now - start) as usize).copied().unwrap_or(Fault::Nothing);
                if fault != Fault::Stall && server.refresh(now, &mut pacer) {
                    known = now;
                }
                right += u64::from(server.on_screen == Some(now));
                prop_assert!(now + 2 < end || server.on_screen == Some(now), "refresh {} of {}", now - start, end - start);
                if fault != Fault::Doze {
                    let due: Vec<_> = std::iter::from_fn(|| pacer.due(known)).collect();
                    first = first.or(due.first().map(|due| due.target));
                    prop_assert!(due.iter().all(|due| u64::from(due.frame) == due.target % u64::from(frames)));
                    server.queue.extend(due);
                }
                prop_assert!(server.queue.len() <= ahead as usize);
            }
            let Counts { shown, late } = pacer.counts();
            prop_assert_eq!((shown, shown + late), (right, end - first.unwrap_or(end)));
        }
    }
}
