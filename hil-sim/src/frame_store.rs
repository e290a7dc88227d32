//! The frame store of the simulated controller: turns in memory, expanded, as the projector shows them.

use firmware::plane_store::{PlaneStore, TurnHandle};
use protocol::codec::{ExpandError, Expander, ImageSize, turn_check};
use protocol::message::{EndTurn, PlaneData, Reason};
use thiserror::Error;

/// Turns that a store holds: one on screen, one to be filled.
pub const SLOTS: usize = 2;

/// The memory that a store takes at most: two turns of 288 slices of 4096 x 4096 pixels take 1.2 GB.
pub const BYTES_MAX: u64 = 4 << 30;

/// Why the store refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum StoreError {
    /// See the message.
    #[error("{SLOTS} turns of {slices} slices of {plane_bytes} bytes do not fit in {BYTES_MAX} bytes")]
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
            StoreError::NotFilling(_) => Self::WrongTurn,
            StoreError::SliceOutOfRange { .. } => Self::SliceOutOfRange,
            StoreError::PartMissing { .. } => Self::PartMissing,
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
        x < self.size.width() && y < self.size.height() && self.bytes[at] >> (x % 8) & 1 != 0
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

#[derive(Debug, Default)]
struct Slot {
    used: Use,
    planes: Vec<StoredPlane>,
}

/// Memory is taken when a plane first arrives and kept for the planes after it.
#[derive(Clone, Debug, Default)]
struct StoredPlane {
    bytes: Vec<u8>,
    /// The check of what `bytes` holds; `None` where it holds no whole plane of this turn.
    check: Option<u64>,
}

/// A plane of which some parts have arrived.
#[derive(Debug)]
struct UnderWay {
    turn: TurnHandle,
    slice: u16,
    received: u32,
    expander: Expander,
}

/// [`SLOTS`] turns in memory.
#[derive(Debug, Default)]
pub struct MemoryStore {
    format: Option<(u16, ImageSize)>,
    slots: [Slot; SLOTS],
    under_way: Option<UnderWay>,
}

impl MemoryStore {
    /// A store without a configuration.
    pub fn new() -> Self {
        Self::default()
    }

    /// Slice `slice` of the finished turn in `turn`. `None` for any other turn and slice.
    pub fn plane(&self, turn: TurnHandle, slice: u16) -> Option<PlaneRef<'_>> {
        let (_, size) = self.format?;
        let slot = self.slots.get(usize::from(turn.0)).filter(|slot| slot.used == Use::Finished)?;
        Some(PlaneRef { size, bytes: &slot.planes.get(usize::from(slice))?.bytes })
    }

    fn filling(&mut self, turn: TurnHandle) -> Result<&mut Slot, StoreError> {
        let slot = self.slots.get_mut(usize::from(turn.0)).filter(|slot| slot.used == Use::Filling);
        slot.ok_or(StoreError::NotFilling(turn.0))
    }

    fn expand(&mut self, mut plane: UnderWay, size: ImageSize, part: &PlaneData<'_>) -> Result<(), StoreError> {
        let slice = part.slice;
        let stored = &mut self.filling(plane.turn)?.planes[usize::from(slice)];
        let damaged = |error| StoreError::Damaged { slice, error };
        stored.bytes.resize(size.plane_bytes(), 0);
        plane.expander.push(part.bytes, &mut stored.bytes).map_err(damaged)?;
        plane.received = part.offset + part.bytes.len() as u32;
        if plane.received < part.total {
            self.under_way = Some(plane);
            return Ok(());
        }
        plane.expander.finish(&stored.bytes, part.check).map_err(damaged)?;
        stored.check = Some(part.check);
        Ok(())
    }
}

impl PlaneStore for MemoryStore {
    type Error = StoreError;

    fn configure(&mut self, slices: u16, size: ImageSize) -> Result<(), StoreError> {
        if self.format == Some((slices, size)) {
            return Ok(());
        }
        if self.slots.iter().any(|slot| slot.used == Use::Finished) {
            return Err(StoreError::InUse);
        }
        let plane_bytes = size.plane_bytes();
        if SLOTS as u64 * u64::from(slices) * plane_bytes as u64 > BYTES_MAX {
            return Err(StoreError::TooLarge { slices, plane_bytes });
        }
        *self = Self { format: Some((slices, size)), ..Self::default() };
        self.slots.iter_mut().for_each(|slot| slot.planes = vec![StoredPlane::default(); slices.into()]);
        Ok(())
    }

    fn begin(&mut self) -> Result<TurnHandle, StoreError> {
        self.format.ok_or(StoreError::NotConfigured)?;
        let free = self.slots.iter().position(|slot| slot.used == Use::Free).ok_or(StoreError::Busy)?;
        let slot = &mut self.slots[free];
        slot.used = Use::Filling;
        slot.planes.iter_mut().for_each(|plane| plane.check = None);
        Ok(TurnHandle(free as u8))
    }

    fn write(&mut self, turn: TurnHandle, part: &PlaneData<'_>) -> Result<(), StoreError> {
        let (slices, size) = self.format.ok_or(StoreError::NotConfigured)?;
        let &PlaneData { slice, offset, total, check, bytes, .. } = part;
        let planes = &mut self.filling(turn)?.planes;
        let stored = planes.get_mut(usize::from(slice)).ok_or(StoreError::SliceOutOfRange { slice, slices })?;
        let end = u64::from(offset) + bytes.len() as u64;
        if end > u64::from(total) {
            return Err(StoreError::PartTooLong { slice, end, total });
        }
        if stored.check == Some(check) {
            return Ok(());
        }
        if offset == 0 {
            stored.check = None;
            self.under_way = None;
            return self.expand(UnderWay { turn, slice, received: 0, expander: Expander::new(size) }, size, part);
        }
        let same = self.under_way.take_if(|plane| (plane.turn, plane.slice) == (turn, slice));
        let plane = same.ok_or(StoreError::PartMissing { slice, offset, expected: 0 })?;
        let expected = plane.received;
        if offset == expected {
            return self.expand(plane, size, part);
        }
        self.under_way = Some(plane);
        // A part that came before is a repeated packet.
        if end <= u64::from(expected) { Ok(()) } else { Err(StoreError::PartMissing { slice, offset, expected }) }
    }

    fn finish(&mut self, turn: TurnHandle, end: &EndTurn) -> Result<(), StoreError> {
        let slot = self.filling(turn)?;
        if let Some(slice) = slot.planes.iter().position(|plane| plane.check.is_none()) {
            return Err(StoreError::SliceMissing { slice: slice as u16 });
        }
        let found = turn_check(end.turn, slot.planes.iter().filter_map(|plane| plane.check));
        if found != end.check {
            return Err(StoreError::Check { expected: end.check, found });
        }
        slot.used = Use::Finished;
        Ok(())
    }

    fn release(&mut self, turn: TurnHandle) {
        if let Some(slot) = self.slots.get_mut(usize::from(turn.0)) {
            slot.used = Use::Free;
            self.under_way.take_if(|plane| plane.turn == turn);
        }
    }
}

#[cfg(test)]
mod tests;
