//! Where the planes of a turn live. A turn is 21 MB and a controller has kilobytes, so pixels never pass through the core:
//! it moves handles, and the store (memory in the simulator, an FPGA's frame store on a board) keeps and expands the planes.

use protocol::codec::ImageSize;
use protocol::message::{EndTurn, Learn, PlaneData, Reason};

/// One of the store's slots for a turn.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
pub struct TurnHandle(pub u8);

impl TurnHandle {
    /// In no slot of a store: the turn without an end that comes as video.
    pub const VIDEO: Self = Self(u8::MAX);
}

/// What the projector shows during one plane.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Plane {
    /// Nothing.
    #[default]
    Dark,
    /// Slice `slice` of the turn in slot `turn`.
    Slice {
        /// The slot.
        turn: TurnHandle,
        /// The slice, below the rotation's `slices`.
        slice: u16,
    },
}

/// Two turns, one of which may be on screen while the other is filled.
///
/// The order of a turn's life: [`begin`](Self::begin), [`write`](Self::write) for every slice, [`finish`](Self::finish), then the
/// sequencer shows it from the next index on, and hands the slot of the turn before it back through [`release`](Self::release).
/// A slot on screen is never written.
pub trait PlaneStore {
    /// Why a plane or a turn was refused; the host is told the nearest reason.
    type Error: Into<Reason>;

    /// Turns of `slices` slices of `size` from now on. What was there is gone, unless the format is the same. Refused while a turn is
    /// finished and not released.
    fn configure(&mut self, slices: u16, size: ImageSize) -> Result<(), Self::Error>;

    /// Keeps what planes are compressed by; refused where there is no room for it, or where it is none.
    fn learn(&mut self, learn: &Learn<'_>) -> Result<(), Self::Error>;

    /// A slot for a new turn.
    fn begin(&mut self) -> Result<TurnHandle, Self::Error>;

    /// Expands some of a plane's compressed bytes into the turn in `turn`. With the last of them the plane is checked.
    fn write(&mut self, turn: TurnHandle, part: &PlaneData<'_>) -> Result<(), Self::Error>;

    /// Copies slices `from` to `to`, without the last, of the finished turn in `of` into the turn in `turn`.
    fn keep(&mut self, turn: TurnHandle, of: TurnHandle, from: u16, to: u16) -> Result<(), Self::Error>;

    /// The turn may be shown. Refused where a slice is missing or the planes are not those of the turn's check.
    fn finish(&mut self, turn: TurnHandle, end: &EndTurn) -> Result<(), Self::Error>;

    /// The slot may be filled again.
    fn release(&mut self, turn: TurnHandle);
}
