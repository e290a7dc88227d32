//! A frame store in memory: turns, expanded as they come. What the simulator shows, and what the emulated image keeps its planes in.
//!
//! ```text
//! memory: SLOTS x slices marks of 9 bytes (1 where the plane is whole, then its check), then SLOTS x slices planes
//! ```

use crate::plane_store::{PlaneStore, TurnHandle};
pub use protocol::codec::Codebook;
use protocol::codec::{ExpandError, Expander, ImageSize, LearnError, turn_check};
use protocol::message::{EndTurn, Learn, PlaneData, Reason};
use thiserror::Error;

/// Turns that a store holds: one on screen, one to be filled.
pub const SLOTS: usize = 2;
/// Bytes of a plane's mark: whether it is whole, and its check.
const MARK_BYTES: usize = 9;

/// Where a store keeps its planes.
pub trait Memory {
    /// Has `bytes` bytes from now on, whatever they hold; or not so many, and stays as it is.
    fn make_room(&mut self, bytes: usize) -> bool;

    /// All of it.
    fn bytes(&self) -> &[u8];

    /// All of it, and what planes are compressed by.
    fn parts(&mut self) -> (&mut [u8], &mut Codebook);
}

/// Why the store refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum StoreError {
    /// See the message.
    #[error("{SLOTS} turns of {slices} slices of {plane_bytes} bytes do not fit in the memory")]
    TooLarge {
        /// Slices a turn.
        slices: u16,
        /// Bytes of a plane.
        plane_bytes: usize,
    },
    /// See the message.
    #[error("a turn is shown or waits to be shown: the configuration stays")]
    InUse,
    /// See the message.
    #[error("no configuration yet")]
    NotConfigured,
    /// See the message.
    #[error("every slot holds a turn that is shown or waits to be shown")]
    Busy,
    /// See the message.
    #[error("slot {0} is not being filled")]
    NotFilling(u8),
    /// See the message.
    #[error("slot {0} holds no turn that is whole")]
    NotFinished(u8),
    /// See the message.
    #[error("slice {slice} of a turn of {slices}")]
    SliceOutOfRange {
        /// The slice.
        slice: u16,
        /// Slices a turn.
        slices: u16,
    },
    /// See the message.
    #[error("slice {slice}: bytes from {offset} came, bytes from {expected} are next")]
    PartMissing {
        /// The slice.
        slice: u16,
        /// The first byte of the part.
        offset: u32,
        /// The first byte that is missing.
        expected: u32,
    },
    /// See the message.
    #[error("slice {slice}: a part ends at byte {end} of {total}")]
    PartTooLong {
        /// The slice.
        slice: u16,
        /// One past the part's last byte.
        end: u64,
        /// Bytes of the compressed plane.
        total: u32,
    },
    /// See the message.
    #[error("slice {slice}: {error}")]
    Damaged {
        /// The slice.
        slice: u16,
        /// What is wrong with it.
        error: ExpandError,
    },
    /// See the message.
    #[error(transparent)]
    NotLearnt(#[from] LearnError),
    /// See the message.
    #[error("slice {slice} is missing")]
    SliceMissing {
        /// The first slice that is missing.
        slice: u16,
    },
    /// See the message.
    #[error("the turn has check {found:#018x}: {expected:#018x} was sent with it")]
    Check {
        /// What was sent.
        expected: u64,
        /// What the planes have.
        found: u64,
    },
}

impl From<StoreError> for Reason {
    fn from(error: StoreError) -> Self {
        match error {
            StoreError::TooLarge { .. } => Self::Configuration,
            StoreError::InUse | StoreError::Busy => Self::Busy,
            StoreError::NotConfigured => Self::NotConfigured,
            StoreError::NotFilling(_) | StoreError::NotFinished(_) => Self::WrongTurn,
            StoreError::SliceOutOfRange { .. } => Self::SliceOutOfRange,
            StoreError::PartMissing { .. } => Self::PartMissing,
            StoreError::NotLearnt(_) => Self::NotLearnt,
            StoreError::Damaged { error: ExpandError::NotKnown, .. } => Self::NotKnown,
            StoreError::PartTooLong { .. } | StoreError::Damaged { .. } => Self::PlaneDamaged,
            StoreError::SliceMissing { .. } => Self::SliceMissing,
            StoreError::Check { .. } => Self::TurnDamaged,
        }
    }
}

/// An expanded plane.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PlaneRef<'a> {
    size: ImageSize,
    bytes: &'a [u8],
}

impl<'a> PlaneRef<'a> {
    /// Whether pixel (`x`, `y`), from the top left, is lit. Nothing outside the picture is.
    pub fn pixel(&self, x: u32, y: u32) -> bool {
        let at = y as usize * self.size.row_bytes() + x as usize / 8;
        x < self.size.width()
            && y < self.size.height()
            && self.bytes.get(at).is_some_and(|byte| byte >> (x % 8) & 1 != 0)
    }

    /// The picture's size.
    pub fn size(&self) -> ImageSize {
        self.size
    }

    /// The plane in the layout of [`protocol::codec`].
    pub fn bytes(&self) -> &'a [u8] {
        self.bytes
    }
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Use {
    #[default]
    Free,
    Filling,
    /// Shown, or waits to be shown: never written.
    Finished,
}

/// A plane of which some parts have arrived.
#[derive(Debug)]
struct UnderWay {
    turn: TurnHandle,
    slice: u16,
    received: u32,
    expander: Expander,
}

/// How the memory is cut.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Format {
    slices: u16,
    size: ImageSize,
}

impl Format {
    fn planes(self) -> usize {
        SLOTS * usize::from(self.slices)
    }

    fn bytes(self) -> Option<usize> {
        self.planes().checked_mul(self.size.plane_bytes() + MARK_BYTES)
    }

    /// Which plane of all.
    fn place(self, turn: TurnHandle, slice: u16) -> Result<usize, StoreError> {
        let slices = self.slices;
        let place = usize::from(turn.0) * usize::from(slices) + usize::from(slice);
        if slice < slices { Ok(place) } else { Err(StoreError::SliceOutOfRange { slice, slices }) }
    }
}

/// [`SLOTS`] turns in memory.
#[derive(Debug, Default)]
pub struct FrameStore<M> {
    format: Option<Format>,
    slots: [Use; SLOTS],
    under_way: Option<UnderWay>,
    memory: M,
}

impl<M: Memory> FrameStore<M> {
    /// A store without a configuration.
    pub fn new() -> Self
    where
        M: Default,
    {
        Self::default()
    }

    /// The same over `memory`, as a constant.
    pub const fn over(memory: M) -> Self {
        Self { format: None, slots: [Use::Free; SLOTS], under_way: None, memory }
    }

    /// Slice `slice` of the finished turn in `turn`. `None` for any other turn and slice.
    pub fn plane(&self, turn: TurnHandle, slice: u16) -> Option<PlaneRef<'_>> {
        let format = self.format?;
        self.slots.get(usize::from(turn.0)).filter(|&&used| used == Use::Finished)?;
        let size = format.size;
        let planes = self.memory.bytes().get(format.planes() * MARK_BYTES..)?;
        let at = format.place(turn, slice).ok()? * size.plane_bytes();
        Some(PlaneRef { size, bytes: planes.get(at..)?.get(..size.plane_bytes())? })
    }

    /// The check of a plane that is whole.
    fn check(&self, place: usize) -> Option<u64> {
        let (marks, _) = self.memory.bytes().as_chunks::<MARK_BYTES>();
        let [1, check @ ..] = marks.get(place)? else { return None };
        Some(u64::from_le_bytes(*check))
    }

    fn mark(&mut self, place: usize, check: Option<u64>) {
        let (marks, _) = self.memory.parts().0.as_chunks_mut::<MARK_BYTES>();
        if let Some([whole, bytes @ ..]) = marks.get_mut(place) {
            *whole = check.is_some().into();
            *bytes = check.unwrap_or_default().to_le_bytes();
        }
    }

    /// Marks no plane of a slot as whole.
    fn clear(&mut self, format: Format, turn: TurnHandle) {
        for place in (0..format.slices).filter_map(|slice| format.place(turn, slice).ok()) {
            self.mark(place, None);
        }
    }

    fn filling(&mut self, turn: TurnHandle) -> Result<&mut Use, StoreError> {
        let slot = self.slots.get_mut(usize::from(turn.0)).filter(|slot| **slot == Use::Filling);
        slot.ok_or(StoreError::NotFilling(turn.0))
    }

    /// Expands `part` into the plane that is under way; it stays where it is, as it is large for a small stack.
    fn expand(&mut self, format: Format, part: &PlaneData<'_>) -> Result<(), StoreError> {
        let slice = part.slice;
        let missing = StoreError::PartMissing { slice, offset: part.offset, expected: 0 };
        let plane = self.under_way.as_mut().ok_or(missing)?;
        let place = format.place(plane.turn, slice)?;
        let (bytes, book) = plane_of(&mut self.memory, format, place);
        plane.received = part.offset + part.bytes.len() as u32;
        let is_last = plane.received >= part.total;
        let mut expanded = plane.expander.push(part.bytes, book, bytes);
        if expanded.is_ok() && is_last {
            expanded = plane.expander.finish(book, bytes, part.check);
        }
        if is_last || expanded.is_err() {
            self.under_way = None;
        }
        expanded.map_err(|error| StoreError::Damaged { slice, error })?;
        if is_last {
            self.mark(place, Some(part.check));
        }
        Ok(())
    }
}

/// The memory of a plane, and what planes are compressed by.
fn plane_of<M: Memory>(memory: &mut M, format: Format, place: usize) -> (&mut [u8], &Codebook) {
    let bytes = format.size.plane_bytes();
    let at = format.planes() * MARK_BYTES + place * bytes;
    let (memory, book) = memory.parts();
    (memory.get_mut(at..).and_then(|rest| rest.get_mut(..bytes)).unwrap_or_default(), book)
}

/// Copies the plane at `source` to `target`, another one. `None`, and nothing copied, where the memory is too small.
fn copy_plane<M: Memory>(memory: &mut M, format: Format, source: usize, target: usize) -> Option<()> {
    let bytes = format.size.plane_bytes();
    let at = |place: usize| format.planes() * MARK_BYTES + place * bytes;
    let (low, high) = memory.parts().0.split_at_mut_checked(at(source.max(target)))?;
    let low = low.get_mut(at(source.min(target))..)?.get_mut(..bytes)?;
    let high = high.get_mut(..bytes)?;
    let (from, to) = if source < target { (low, high) } else { (high, low) };
    to.iter_mut().zip(from).for_each(|(to, from)| *to = *from);
    Some(())
}

impl<M: Memory> PlaneStore for FrameStore<M> {
    type Error = StoreError;

    fn configure(&mut self, slices: u16, size: ImageSize) -> Result<(), StoreError> {
        let format = Format { slices, size };
        if self.format == Some(format) {
            return Ok(());
        }
        if self.slots.contains(&Use::Finished) {
            return Err(StoreError::InUse);
        }
        if !format.bytes().is_some_and(|bytes| self.memory.make_room(bytes)) {
            return Err(StoreError::TooLarge { slices, plane_bytes: size.plane_bytes() });
        }
        (self.format, self.slots, self.under_way) = (Some(format), [Use::Free; SLOTS], None);
        Ok(())
    }

    fn learn(&mut self, learn: &Learn<'_>) -> Result<(), StoreError> {
        // Half a plane by other codes is no plane.
        self.under_way = None;
        let &Learn { kind, offset, total, bytes } = learn;
        Ok(self.memory.parts().1.learn(kind, [offset.into(), total.into()], bytes)?)
    }

    fn begin(&mut self) -> Result<TurnHandle, StoreError> {
        let format = self.format.ok_or(StoreError::NotConfigured)?;
        let free = (0..).zip(&mut self.slots).find(|(_, slot)| **slot == Use::Free);
        let (turn, slot) = free.map(|(slot, used)| (TurnHandle(slot), used)).ok_or(StoreError::Busy)?;
        *slot = Use::Filling;
        self.clear(format, turn);
        Ok(turn)
    }

    fn write(&mut self, turn: TurnHandle, part: &PlaneData<'_>) -> Result<(), StoreError> {
        let format = self.format.ok_or(StoreError::NotConfigured)?;
        let &PlaneData { slice, offset, total, check, bytes, .. } = part;
        self.filling(turn)?;
        let place = format.place(turn, slice)?;
        let end = u64::from(offset) + bytes.len() as u64;
        if end > u64::from(total) {
            return Err(StoreError::PartTooLong { slice, end, total });
        }
        if self.check(place) == Some(check) {
            return Ok(());
        }
        if offset == 0 {
            self.mark(place, None);
            self.under_way = None;
            self.under_way = Some(UnderWay { turn, slice, received: 0, expander: Expander::new(format.size) });
            return self.expand(format, part);
        }
        let is_same = |plane: &&UnderWay| (plane.turn, plane.slice) == (turn, slice);
        let expected = self.under_way.as_ref().filter(is_same).map(|plane| plane.received);
        match expected {
            Some(expected) if offset == expected => self.expand(format, part),
            // A part that came before is a repeated packet.
            Some(expected) if end <= u64::from(expected) => Ok(()),
            expected => Err(StoreError::PartMissing { slice, offset, expected: expected.unwrap_or(0) }),
        }
    }

    fn keep(&mut self, turn: TurnHandle, of: TurnHandle, from: u16, to: u16) -> Result<(), StoreError> {
        let format = self.format.ok_or(StoreError::NotConfigured)?;
        self.filling(turn)?;
        if self.slots.get(usize::from(of.0)) != Some(&Use::Finished) {
            return Err(StoreError::NotFinished(of.0));
        }
        for slice in from..to {
            let [source, target] = [format.place(of, slice)?, format.place(turn, slice)?];
            self.under_way.take_if(|plane| (plane.turn, plane.slice) == (turn, slice));
            self.mark(target, None);
            copy_plane(&mut self.memory, format, source, target).ok_or(StoreError::NotFinished(of.0))?;
            let check = self.check(source);
            self.mark(target, check);
        }
        Ok(())
    }

    fn finish(&mut self, turn: TurnHandle, end: &EndTurn) -> Result<(), StoreError> {
        let format = self.format.ok_or(StoreError::NotConfigured)?;
        self.filling(turn)?;
        let check = |slice| format.place(turn, slice).ok().and_then(|place| self.check(place));
        if let Some(slice) = (0..format.slices).find(|&slice| check(slice).is_none()) {
            return Err(StoreError::SliceMissing { slice });
        }
        let found = turn_check(end.turn, (0..format.slices).filter_map(check));
        if found != end.check {
            return Err(StoreError::Check { expected: end.check, found });
        }
        *self.filling(turn)? = Use::Finished;
        Ok(())
    }

    fn release(&mut self, turn: TurnHandle) {
        if let Some(slot) = self.slots.get_mut(usize::from(turn.0)) {
            *slot = Use::Free;
            self.under_way.take_if(|plane| plane.turn == turn);
        }
    }
}
