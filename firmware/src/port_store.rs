//! A frame store behind a serial port: a board's FPGA, which expands the planes, checks them and drives the projector.
//!
//! Two ports lead there, because two things speak at different times: the bulk port below carries planes at the pace of the host; the
//! armed frame goes by [`arm_word`] through a port of its own, whose owner is the control task.
//!
//! ```text
//! head, 24 bytes, little-endian        answer, 4 bytes
//!  0  u8   command                      0  u8  status: 0xa0 done, 0xa1 busy, 0xa2 refused
//!  1  u8   slot                         1  u8  the slot (Begin), why (refused: REFUSALS), else 0
//!  2  u16  slice; slices (Configure)    2  u8  status, inverted
//!  4  u32  offset; width; turn's number 3  u8  value, inverted
//!          one past the last (Keep)
//!  8  u32  total; height; the slot to copy from (Keep)
//! 12  u64  check of the plane or turn
//! 20  u16  bytes that follow the head
//! 22  u16  CRC-16/IBM-3740 of the 22 bytes before
//! ```
//!
//! After a head and its bytes the answer is asked for, with the head of [`Operation::Answer`], until it is not busy. A damaged head is
//! refused; bytes are checked by the plane's own check.

use crate::plane_store::{PlaneStore, TurnHandle};
use crate::sequencer::Frame;
use crc::{CRC_16_IBM_3740, Crc, Table};
use protocol::codec::ImageSize;
use protocol::message::{EndTurn, Learn, PlaneData, Reason};
use thiserror::Error;

static CRC_16: Crc<u16, Table<1>> = Crc::<u16, Table<1>>::new(&CRC_16_IBM_3740);

/// Bytes of a head.
pub const HEAD_BYTES: usize = 24;

/// Bytes of an answer.
pub const ANSWER_BYTES: usize = 4;

/// How often a busy store is asked, until it counts as silent. A question and its answer are 28 bytes: 45 ms in all on a port of 50 MHz.
/// In this time it has a part of at most 16 KiB to expand.
pub const ASKED_MAX: u32 = 10_000;

/// Status bytes of an answer. Neither is what a dead line gives.
const DONE: u8 = 0xa0;
const BUSY: u8 = 0xa1;
const REFUSED: u8 = 0xa2;

/// Why a store refuses, in the order of the wire.
pub const REFUSALS: [Reason; 10] = [
    Reason::NotUnderstood,
    Reason::Configuration,
    Reason::NotConfigured,
    Reason::Busy,
    Reason::WrongTurn,
    Reason::SliceOutOfRange,
    Reason::PartMissing,
    Reason::PlaneDamaged,
    Reason::SliceMissing,
    Reason::TurnDamaged,
];

/// What a head asks for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Operation {
    /// The answer to what came before.
    Answer = 0x10,
    /// [`PlaneStore::configure`].
    Configure,
    /// [`PlaneStore::begin`].
    Begin,
    /// [`PlaneStore::write`]; the compressed bytes follow.
    Write,
    /// [`PlaneStore::finish`].
    Finish,
    /// [`PlaneStore::release`].
    Release,
    /// [`PlaneStore::keep`].
    Keep,
}

/// The fields of a head; see the module. Those that an operation has no use for are 0.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Fields {
    /// Byte 1.
    pub slot: u8,
    /// Bytes 2 and 3.
    pub slice: u16,
    /// Bytes 4 to 7.
    pub offset: u32,
    /// Bytes 8 to 11.
    pub total: u32,
    /// Bytes 12 to 19.
    pub check: u64,
    /// Bytes 20 and 21.
    pub length: u16,
}

/// The head for `operation`.
pub fn head(operation: Operation, fields: &Fields) -> [u8; HEAD_BYTES] {
    let mut bytes = [0; HEAD_BYTES];
    let Fields { slot, slice, offset, total, check, length } = *fields;
    let mut rest = bytes.iter_mut();
    let mut put = |field: &[u8]| field.iter().zip(&mut rest).for_each(|(&byte, place)| *place = byte);
    put(&[operation as u8, slot]);
    put(&slice.to_le_bytes());
    put(&offset.to_le_bytes());
    put(&total.to_le_bytes());
    put(&check.to_le_bytes());
    put(&length.to_le_bytes());
    let crc = CRC_16.checksum(&bytes[..HEAD_BYTES - 2]);
    bytes[HEAD_BYTES - 2..].copy_from_slice(&crc.to_le_bytes());
    bytes
}

/// The eight bytes that arm a frame: kind (0 dark, 1 slices, 2 still), slot, frame or slice (u16), and the same inverted. A word that
/// does not arrive like this arms nothing, and a frame for which nothing was armed is dark.
pub fn arm_word(frame: Frame) -> [u8; 8] {
    let (kind, turn, number) = match frame {
        Frame::Dark => (0, TurnHandle(0), 0),
        Frame::Slices { turn, frame } => (1, turn, frame),
        Frame::Still { turn, slice } => (2, turn, slice),
    };
    let [low, high] = number.to_le_bytes();
    [kind, turn.0, low, high, !kind, !turn.0, !low, !high]
}

/// One exchange with a store.
pub trait Port {
    /// Why the port itself failed.
    type Error;

    /// Sends `head`, then `bytes`, then takes `answer`, which is empty but for [`Operation::Answer`].
    fn exchange(&mut self, head: &[u8], bytes: &[u8], answer: &mut [u8]) -> Result<(), Self::Error>;
}

/// Why a store behind a port did not do it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum PortError<E> {
    /// The port failed.
    #[error("the port to the frame store failed")]
    Port(E),
    /// No answer in time, or none that can be one.
    #[error("the frame store does not answer")]
    Silent,
    /// The store refused.
    #[error("{0}")]
    Refused(Reason),
}

impl<E> From<PortError<E>> for Reason {
    /// A store that is not there holds nothing, so that this is what the host is told.
    fn from(error: PortError<E>) -> Self {
        match error {
            PortError::Refused(reason) => reason,
            PortError::Port(_) | PortError::Silent => Self::Configuration,
        }
    }
}

/// The store behind `P`.
#[derive(Debug)]
pub struct PortStore<P> {
    port: P,
}

impl<P: Port> PortStore<P> {
    /// Nothing is sent yet.
    pub const fn new(port: P) -> Self {
        Self { port }
    }

    fn ask(&mut self, operation: Operation, fields: &Fields, bytes: &[u8]) -> Result<u8, PortError<P::Error>> {
        self.port.exchange(&head(operation, fields), bytes, &mut []).map_err(PortError::Port)?;
        let question = head(Operation::Answer, &Fields::default());
        for _ in 0..ASKED_MAX {
            let mut answer = [0; ANSWER_BYTES];
            self.port.exchange(&question, &[], &mut answer).map_err(PortError::Port)?;
            let [status, value, not_status, not_value] = answer;
            match status {
                _ if [!status, !value] != [not_status, not_value] => return Err(PortError::Silent),
                BUSY => {}
                DONE => return Ok(value),
                REFUSED => {
                    let reason = REFUSALS.get(usize::from(value));
                    return Err(reason.map_or(PortError::Silent, |&reason| PortError::Refused(reason)));
                }
                _ => return Err(PortError::Silent),
            }
        }
        Err(PortError::Silent)
    }
}

impl<P: Port> PlaneStore for PortStore<P> {
    type Error = PortError<P::Error>;

    fn configure(&mut self, slices: u16, size: ImageSize) -> Result<(), Self::Error> {
        let fields = Fields { slice: slices, offset: size.width(), total: size.height(), ..Fields::default() };
        self.ask(Operation::Configure, &fields, &[]).map(drop)
    }

    /// No store behind a port knows masks or codes yet: planes come as runs.
    fn learn(&mut self, _: &Learn<'_>) -> Result<(), Self::Error> {
        Err(PortError::Refused(Reason::NotLearnt))
    }

    fn begin(&mut self) -> Result<TurnHandle, Self::Error> {
        self.ask(Operation::Begin, &Fields::default(), &[]).map(TurnHandle)
    }

    fn write(&mut self, turn: TurnHandle, part: &PlaneData<'_>) -> Result<(), Self::Error> {
        let &PlaneData { slice, offset, total, check, bytes, .. } = part;
        let length = u16::try_from(bytes.len()).map_err(|_| PortError::Refused(Reason::NotUnderstood))?;
        self.ask(Operation::Write, &Fields { slot: turn.0, slice, offset, total, check, length }, bytes).map(drop)
    }

    fn keep(&mut self, turn: TurnHandle, of: TurnHandle, from: u16, to: u16) -> Result<(), Self::Error> {
        let fields = Fields { slot: turn.0, slice: from, offset: to.into(), total: of.0.into(), ..Fields::default() };
        self.ask(Operation::Keep, &fields, &[]).map(drop)
    }

    fn finish(&mut self, turn: TurnHandle, end: &EndTurn) -> Result<(), Self::Error> {
        let fields = Fields { slot: turn.0, offset: end.turn, check: end.check, ..Fields::default() };
        self.ask(Operation::Finish, &fields, &[]).map(drop)
    }

    /// A store that does not answer refuses the next turn, so that nothing is lost here.
    fn release(&mut self, turn: TurnHandle) {
        let _ = self.ask(Operation::Release, &Fields { slot: turn.0, ..Fields::default() }, &[]);
    }
}
