//! A turn on its way: what is kept, what is sent, what did not arrive.

use super::conversation::{Answer, Outcome};
use super::{Sent, Stream, StreamError, TurnPlanes};
use crate::link::Link;
use protocol::codec::{Compressor, turn_check};
use protocol::message::{AskMissing, BeginTurn, EndTurn, KEEP_PLANES_MAX, KeepPlanes, Message, PlaneData, Reason};
use std::ops::Range;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread::{Scope, available_parallelism, scope};
use std::time::Duration;

/// How often the planes that did not arrive are sent again.
const ROUNDS: usize = 20;
/// How long to wait before a device that is busy is asked again.
const BUSY_WAIT: Duration = Duration::from_millis(2);

/// Compressors at work at most: each does 30 turns a second of a scene that fills the display.
const COMPRESSORS: usize = 4;
/// Planes that each may have ready before they are sent.
const AHEAD: usize = 16;

/// What is to come of a slice.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Want {
    /// The device copies it from the turn before.
    Keep,
    Send,
    Arrived,
}

/// A turn that is sent.
struct Job<'a, T> {
    turn: &'a T,
    number: u32,
    checks: &'a [u64],
    /// The turn that kept planes come from.
    of: u32,
    wants: Vec<Want>,
}

impl<T> Job<'_, T> {
    /// Slices that did not arrive.
    fn left(&self) -> usize {
        self.wants.iter().filter(|want| **want != Want::Arrived).count()
    }
}

impl<L: Link> Stream<L> {
    /// Sends a turn whose planes have `checks`; its number.
    pub(super) fn send_turn(
        &mut self,
        turn: &impl TurnPlanes,
        checks: Vec<u64>,
        mut is_late: impl FnMut(Duration) -> bool,
    ) -> Result<u32, StreamError> {
        let (number, wants) = self.open_turn(&checks, &mut is_late)?;
        let begun = self.conversation.link.now();
        let of = self.last.as_ref().map_or(number, |last| last.number);
        let mut job = Job { turn, number, checks: &checks, of, wants };
        for round in 0..ROUNDS {
            let left = job.left();
            if left == 0 {
                break;
            }
            self.conversation.statistics.retries += if round > 0 { left as u64 } else { 0 };
            self.send_round(&mut job, &mut is_late)?;
        }
        if job.left() > 0 {
            return Err(StreamError::PlanesLost { turn: number, planes: job.left(), attempts: ROUNDS });
        }
        let check = turn_check(number, checks.iter().copied());
        self.conversation.ask(&EndTurn { turn: number, check }.into())?;
        self.conversation.statistics.sending += self.conversation.link.now().saturating_sub(begun);
        self.unfinished = None;
        self.last = Some(Sent { number, checks });
        Ok(number)
    }

    /// Begins a turn, or goes on with it where the device has some of it: its number, and what is to come of each slice.
    fn open_turn(
        &mut self,
        checks: &[u64],
        is_late: &mut impl FnMut(Duration) -> bool,
    ) -> Result<(u32, Vec<Want>), StreamError> {
        let number = self.turn;
        if self.unfinished.is_some()
            && let Some(wants) = self.missing(number)?
        {
            return Ok((number, wants));
        }
        let stays = |slice: usize| self.last.as_ref().is_some_and(|last| last.checks.get(slice) == checks.get(slice));
        let wants = (0..checks.len()).map(|slice| if stays(slice) { Want::Keep } else { Want::Send }).collect();
        self.begin(number, is_late)?;
        self.unfinished = Some(Sent { number, checks: checks.to_vec() });
        Ok((number, wants))
    }

    /// What a device still needs of turn `number`, with which it was begun before the link was lost; nothing where it knows no such
    /// turn.
    fn missing(&mut self, number: u32) -> Result<Option<Vec<Want>>, StreamError> {
        let slices = self.rotation.slices() as u16;
        let mut wants = vec![Want::Arrived; slices.into()];
        let mut next = 0;
        while next < slices {
            let message = Message::from(AskMissing { turn: number, from: next });
            match self.conversation.request(&message)? {
                Answer::Missing { from, to } if next <= from && from < to && to <= slices => {
                    wants[from.into()..to.into()].fill(Want::Send);
                    next = to;
                }
                Answer::Nack(Reason::WrongTurn) => return Ok(None),
                answer => {
                    self.conversation.accepted(&message, answer)?;
                    break;
                }
            }
        }
        let arrived = wants.iter().filter(|want| **want == Want::Arrived).count();
        self.conversation.statistics.planes_resumed += arrived as u64;
        Ok(Some(wants))
    }

    fn begin(&mut self, turn: u32, is_late: &mut impl FnMut(Duration) -> bool) -> Result<(), StreamError> {
        let message = Message::from(BeginTurn { turn, slices: self.rotation.slices() as u16 });
        let turn_time = Duration::from_nanos(self.rotation.planes_nanos(self.rotation.slices()));
        let start = self.conversation.link.now();
        loop {
            match self.conversation.request(&message)? {
                Answer::Nack(Reason::Busy) => {}
                answer => return self.conversation.accepted(&message, answer),
            }
            let now = self.conversation.link.now();
            let waited = now.saturating_sub(start);
            if is_late(now) {
                return Err(StreamError::Left { turn });
            }
            if waited > 4 * turn_time + Duration::from_secs(1) {
                return Err(StreamError::Busy { waited, state: self.conversation.status.map(|status| status.state) });
            }
            self.conversation.listen(BUSY_WAIT)?;
        }
    }

    /// Sends once whatever did not arrive, while what follows is compressed.
    fn send_round<T: TurnPlanes>(
        &mut self,
        job: &mut Job<'_, T>,
        is_late: &mut impl FnMut(Duration) -> bool,
    ) -> Result<(), StreamError> {
        let compressor = self.compressor.clone();
        scope(|scope| {
            let mut ahead = Ahead::new(scope, &compressor, job);
            let mut slice = 0;
            while slice < job.wants.len() {
                if is_late(self.conversation.link.now()) {
                    return Err(StreamError::Left { turn: job.number });
                }
                slice = match job.wants[slice] {
                    Want::Arrived => slice + 1,
                    Want::Keep => self.keep(job, slice)?,
                    Want::Send => {
                        self.send_plane(job, slice as u16, &ahead.next())?;
                        slice + 1
                    }
                };
            }
            let outcomes = self.conversation.settle()?;
            self.note(job, &outcomes)
        })
    }

    /// Has the device copy the planes from slice `from` on that stay as they are; the slice after them.
    fn keep<T>(&mut self, job: &mut Job<'_, T>, from: usize) -> Result<usize, StreamError> {
        let most = usize::from(KEEP_PLANES_MAX);
        let planes = job.wants[from..].iter().take(most).take_while(|want| **want == Want::Keep).count();
        let slices = from as u16..(from + planes) as u16;
        let message = KeepPlanes { turn: job.number, of: job.of, from: slices.start, to: slices.end };
        let outcomes = self.conversation.send_next(&message.into(), slices)?;
        self.note(job, &outcomes)?;
        Ok(from + planes)
    }

    fn send_plane<T>(&mut self, job: &mut Job<'_, T>, slice: u16, compressed: &[u8]) -> Result<(), StreamError> {
        let (turn, check) = (job.number, job.checks[usize::from(slice)]);
        let part_bytes = self.conversation.part_bytes();
        let total = compressed.len() as u32;
        for (offset, bytes) in (0..).step_by(part_bytes).zip(compressed.chunks(part_bytes)) {
            let message = PlaneData { turn, slice, offset, total, check, bytes };
            let is_last = offset + bytes.len() as u32 == total;
            let outcomes = self.conversation.send_next(&message.into(), slice..slice + u16::from(is_last))?;
            self.note(job, &outcomes)?;
        }
        Ok(())
    }

    /// Takes down what the device said of packets of planes.
    fn note<T>(&mut self, job: &mut Job<'_, T>, outcomes: &[Outcome]) -> Result<(), StreamError> {
        for Outcome { slices: Range { start, end }, answer } in outcomes {
            let wants = &mut job.wants[usize::from(*start)..usize::from(*end)];
            match answer {
                Answer::Nack(_) if wants.first() == Some(&Want::Keep) => {
                    // Without the earlier turn the planes themselves are needed.
                    self.conversation.statistics.refused += 1;
                    wants.fill(Want::Send);
                }
                Answer::Nack(reason) => self.conversation.refused_plane(*reason)?,
                _ => {
                    let kept = wants.iter().filter(|want| **want == Want::Keep).count();
                    self.conversation.statistics.planes_kept += kept as u64;
                    wants.fill(Want::Arrived);
                }
            }
        }
        Ok(())
    }
}

/// Planes that are compressed before the wire wants them, in threads of their own: among the tasks of a renderer they would wait for its turn
/// to end, and the wire with them.
struct Ahead {
    /// The planes in turns, one from each.
    compressed: Vec<Receiver<Vec<u8>>>,
    next: usize,
}

impl Ahead {
    /// Those of `job` that are to be sent now, in order. The threads end when they are done, or this is dropped.
    fn new<'scope, T: TurnPlanes>(
        scope: &'scope Scope<'scope, '_>,
        compressor: &'scope Compressor,
        job: &Job<'scope, T>,
    ) -> Self {
        let is_wanted = |slice: &u16| job.wants[usize::from(*slice)] == Want::Send;
        let slices: Vec<u16> = (0..job.wants.len() as u16).filter(is_wanted).collect();
        let threads = available_parallelism().map_or(1, usize::from).min(COMPRESSORS).min(slices.len());
        let thread = |first: usize| {
            let (out, compressed) = sync_channel(AHEAD);
            let (turn, slices) = (job.turn, slices.iter().copied().skip(first).step_by(threads).collect());
            scope.spawn(move || compress(compressor.clone(), turn, slices, &out));
            compressed
        };
        Self { compressed: (0..threads).map(thread).collect(), next: 0 }
    }

    /// The next plane.
    fn next(&mut self) -> Vec<u8> {
        let next = self.next % self.compressed.len();
        self.next += 1;
        // Where a thread has panicked, so does its scope.
        self.compressed[next].recv().unwrap_or_default()
    }
}

/// Compresses `slices` of `turn` one after the other, as long as somebody wants them.
fn compress(mut compressor: Compressor, turn: &impl TurnPlanes, slices: Vec<u16>, out: &SyncSender<Vec<u8>>) {
    for slice in slices.into_iter().map(u32::from) {
        let mut compressed = Vec::new();
        compressor.compress(turn.plane_bytes(slice), turn.hint(slice), &mut compressed);
        if out.send(compressed).is_err() {
            return;
        }
    }
}
