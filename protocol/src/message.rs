//! What host and controller say to each other: the wire as one table, and the words it uses.
//!
//! Payloads are postcard. Both ends compute [`SCHEMA`] from the table and the words, exchange it first ([`Hello`],
//! [`HelloReply`]) and refuse each other where it differs. Identifier and payload of those two never change, so that
//! programs of any two versions can name both.

use crate::codec::{ImageSize, ImageSizeError};
use crate::timing::{Direction, Rotation, RotationError};
use crate::units::Turns;
use postcard::ser_flavors::Flavor;
use serde::{Deserialize, Serialize, Serializer};
use thiserror::Error;

mod words;

pub use words::{Command, Fault, Knowledge, Quantity, Reason, State, VOCABULARY};

/// The version of this protocol: counts up where the meaning of a message changes and its form does not.
pub const VERSION: u16 = 1;

/// The most compressed bytes of a plane in one [`PlaneData`].
pub const PLANE_PART_BYTES: usize = 16 * 1024;

/// The most bytes of one [`Learn`]: few enough to come through a link that damages one byte in a thousand.
pub const LEARN_PART_BYTES: usize = 512;

/// The most planes of one [`KeepPlanes`]: a device copies them before it hears the next packet.
pub const KEEP_PLANES_MAX: u16 = 32;

/// What a controller says for the number of a turn whose frames come as video.
pub const VIDEO_TURN: u32 = u32::MAX;

/// Which end receives a message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Receiver {
    /// The controller.
    Device,
    /// The host.
    Host,
}

/// A row of the wire's table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Entry {
    /// The byte that names the message in a packet's header.
    pub id: u8,
    /// The message's name.
    pub name: &'static str,
    /// What it is for: lines that begin with a space. Controllers do without.
    #[cfg(feature = "std")]
    pub about: &'static str,
    /// The same of each field: its name, its type, what it is.
    #[cfg(feature = "std")]
    pub fields: &'static [[&'static str; 3]],
    /// Who receives it.
    pub receiver: Receiver,
    /// The payload: fields and their types.
    pub payload: &'static str,
    /// The most bytes of a payload.
    pub bytes_max: usize,
}

/// Why a message cannot be written or read.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum MessageError {
    /// See the message.
    #[error("message id {id:#04x} is not in protocol version {VERSION}")]
    Unknown {
        /// The identifier.
        id: u8,
    },
    /// See the message.
    #[error("{name} has a payload of {bytes} bytes: at most {bytes_max}")]
    TooLong {
        /// The message.
        name: &'static str,
        /// Its payload.
        bytes: usize,
        /// What the table allows.
        bytes_max: usize,
    },
    /// See the message.
    #[error("the payload of {name} does not have the form of the table")]
    Malformed {
        /// The message.
        name: &'static str,
    },
}

/// Defines the payloads, [`Message`] and [`TABLE`] from the rows of the wire.
macro_rules! wire {
    ($(
        $(#[doc = $about:literal])+
        $id:literal $name:ident $(<$life:lifetime>)? to $receiver:ident, at most $bytes_max:expr;
        { $( $(#[doc = $field_about:literal])+ $field:ident: $kind:ty $(as $with:literal)? ),* $(,)? }
    )+) => {
        /// Every message, in the order of identifiers.
        pub const TABLE: &[Entry] = &[$( Entry {
            id: $id,
            name: stringify!($name),
            #[cfg(feature = "std")]
            about: concat!($($about),+),
            #[cfg(feature = "std")]
            fields: &[$( [stringify!($field), stringify!($kind), concat!($($field_about),+)] ),*],
            receiver: Receiver::$receiver,
            payload: stringify!($($field: $kind),*),
            bytes_max: $bytes_max,
        } ),+];

        $(
            $(#[doc = $about])+
            #[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
            pub struct $name $(<$life>)? {
                $( $(#[doc = $field_about])+ $(#[serde(serialize_with = $with)])? pub $field: $kind ),*
            }
        )+

        /// Any message. Borrows from the packet that it was read from.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub enum Message<'a> { $( $(#[doc = $about])+ $name($name $(<$life>)?) ),+ }

        impl<'a> Message<'a> {
            /// The row of this message.
            pub fn entry(&self) -> &'static Entry {
                let id = match self { $( Self::$name(_) => $id ),+ };
                // Present: id is a literal of the same table.
                TABLE.iter().find(|entry| entry.id == id).unwrap_or(&TABLE[0])
            }

            /// Reads the payload of message `id`; every byte must belong to it.
            pub fn decode(id: u8, payload: &'a [u8]) -> Result<Self, MessageError> {
                match id {
                    $( $id => read(stringify!($name), $bytes_max, payload).map(Self::$name), )+
                    _ => Err(MessageError::Unknown { id }),
                }
            }

            /// Writes the payload into `flavor`.
            pub(crate) fn serialize<F: Flavor>(&self, flavor: F) -> postcard::Result<F::Output> {
                match self { $( Self::$name(payload) => postcard::serialize_with_flavor(payload, flavor) ),+ }
            }
        }

        $( impl<'a> From<$name $(<$life>)?> for Message<'a> {
            fn from(payload: $name $(<$life>)?) -> Self { Self::$name(payload) }
        } )+
    };
}

wire! {
    /// The first message of a host, and after any loss of the link. An unfinished turn stays until another is begun: see [`AskMissing`].
    0x01 Hello to Device, at most 16; {
        /// [`VERSION`] of the host.
        version: u16,
        /// [`SCHEMA`] of the host.
        schema: u64,
    }
    /// The device's answer to [`Hello`].
    0x02 HelloReply to Host, at most 24; {
        /// The sequence number of the packet that is answered.
        answers: u32,
        /// [`VERSION`] of the device.
        version: u16,
        /// [`SCHEMA`] of the device.
        schema: u64,
    }
    /// How a turn is cut and how large its pictures are. Another configuration than the present one is refused while a
    /// turn is shown or waits to be shown. Where the mirror is at rest, such turns are given up then: the next one is taken.
    0x03 Configure to Device, at most 32; {
        /// Slices a turn.
        slices: u16,
        /// Planes a frame.
        planes_per_frame: u16,
        /// Frames in 10⁶ seconds.
        refresh_microhertz: u64,
        /// Mirror angle at the index pulse, in 2⁻³² turn.
        phase_offset: u32,
        /// The way in which the mirror turns, seen from above.
        clockwise: bool,
        /// Pixels of a row.
        width: u16,
        /// Rows.
        height: u16,
    }
    /// A new turn. One that was begun before and not ended is abandoned.
    0x04 BeginTurn to Device, at most 8; {
        /// The host's number of the turn; another than the last one's.
        turn: u32,
        /// How many slices follow: those of the configuration.
        slices: u16,
    }
    /// Some of a plane's compressed bytes. The parts of a plane follow each other; offset 0 starts it again.
    0x05 PlaneData<'a> to Device, at most PLANE_PART_BYTES + 36; {
        /// The turn that was begun.
        turn: u32,
        /// The slice that this plane is.
        slice: u16,
        /// Where `bytes` begins among the plane's compressed bytes.
        offset: u32,
        /// The plane's compressed bytes altogether.
        total: u32,
        /// [`plane_check`](crate::codec::plane_check) of the expanded plane.
        check: u64,
        /// At most [`PLANE_PART_BYTES`].
        bytes: &'a [u8] as "as_bytes",
    }
    /// All planes were sent: the turn may be shown if its check is right.
    0x06 EndTurn to Device, at most 16; {
        /// The turn.
        turn: u32,
        /// [`turn_check`](crate::codec::turn_check) of its planes.
        check: u64,
    }
    /// An order of the host.
    0x07 Control to Device, at most 16; {
        /// The order.
        command: Command,
    }
    /// The packet was understood and what it asks for is done.
    0x08 Ack to Host, at most 8; {
        /// The sequence number of the packet that is answered.
        answers: u32,
    }
    /// The packet was understood and refused.
    0x09 Nack to Host, at most 8; {
        /// The sequence number of the packet that is answered.
        answers: u32,
        /// Why.
        reason: Reason,
    }
    /// How the controller does; unasked, at the controller's own pace.
    0x0a Status to Host, at most 64; {
        /// What it is doing.
        state: State,
        /// Why it stopped.
        fault: Option<Fault>,
        /// Whether anything measures the mirror. If not, the phase error is 0 and the speed the one that the drive was told.
        measured: bool,
        /// The mirror's angle ahead of the projector's picture, in 2⁻³² turn.
        phase_error: i32,
        /// The mirror's speed, turns in 10⁶ seconds.
        speed_microhertz: u32,
        /// Turns that came on screen.
        turns_shown: u32,
        /// The host's number of the turn on screen; 4294967295 where its frames come as video.
        turn_on_screen: Option<u32>,
        /// Turns that arrived whole.
        turns_received: u32,
        /// Turns that were begun and never became whole.
        turns_abandoned: u32,
        /// Packets that arrived whole.
        packets: u32,
        /// Packets that arrived damaged.
        packets_damaged: u32,
    }
    /// Faults, also of before a reset; unasked, after a hello and where something changed.
    0x0b Faults to Host, at most 64; {
        /// The fault that stays until [`Command::ClearFault`].
        latched: Option<Fault>,
        /// What was measured when the last fault was found.
        quantity: Quantity,
        /// The value that was measured, in 10⁻⁶ of its unit.
        value_micro: u64,
        /// The value that is allowed, in 10⁻⁶ of its unit.
        limit_micro: u64,
        /// When, in microseconds since the controller was switched on.
        at_us: u64,
        /// How often each of [`Fault::ALL`] was latched; stops at the largest number.
        counts: [u16; 9],
    }
    /// What planes are compressed by from now on: see [`codec`](crate::codec). It is known until the device is reset.
    0x0c Learn<'a> to Device, at most LEARN_PART_BYTES + 12; {
        /// What `bytes` are.
        kind: Knowledge,
        /// Where `bytes` begins. Parts follow each other; offset 0 starts again.
        offset: u16,
        /// Bytes altogether.
        total: u16,
        /// See [`Knowledge`]; at most [`LEARN_PART_BYTES`].
        bytes: &'a [u8] as "as_bytes",
    }
    /// Planes that are those of an earlier turn, which the device still has: they are not sent again.
    0x0d KeepPlanes to Device, at most 16; {
        /// The turn that was begun.
        turn: u32,
        /// The turn that has them: on screen, or whole and waiting.
        of: u32,
        /// The first slice.
        from: u16,
        /// One past the last: at most [`KEEP_PLANES_MAX`] more than `from`.
        to: u16,
    }
    /// Which slices of a turn did not arrive: asked after a [`Hello`], to go on where a link was lost.
    0x0e AskMissing to Device, at most 8; {
        /// The turn that was begun. One that is whole misses nothing.
        turn: u32,
        /// Slices before this one are not asked for.
        from: u16,
    }
    /// The device's answer to [`AskMissing`]: the first slices in a row that are missing. The next ones are asked for from `to` on.
    0x0f Missing to Host, at most 12; {
        /// The sequence number of the packet that is answered.
        answers: u32,
        /// The first slice.
        from: u16,
        /// One past the last; `from`, where none is missing.
        to: u16,
    }
}

impl Faults {
    /// What was measured and what is allowed, for people; empty for a level.
    pub fn cause(&self) -> impl core::fmt::Display + use<> {
        Cause(*self)
    }

    /// How often `fault` was latched.
    pub fn count(&self, fault: Fault) -> u16 {
        self.counts[usize::from(fault.code())]
    }
}

/// Prints a cause.
struct Cause(Faults);

impl core::fmt::Display for Cause {
    fn fmt(&self, formatter: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        let Faults { quantity, value_micro, limit_micro, .. } = self.0;
        if quantity == Quantity::Level {
            return Ok(());
        }
        let unit = quantity.unit();
        let [value, limit] = [value_micro, limit_micro].map(|micro| micro as f64 * 1e-6);
        write!(formatter, "{value:.4} {unit} where {limit:.4} {unit} are allowed")
    }
}

/// FNV-1a, 64 bits, of the version, the table and its words. Spaces do not count: compilers differ in where `stringify!` puts them.
pub const SCHEMA: u64 = {
    let mut hash = fnv(0xcbf2_9ce4_8422_2325, &VERSION.to_le_bytes());
    let mut row = 0;
    while row < TABLE.len() {
        let entry = &TABLE[row];
        let limit = entry.bytes_max as u32;
        hash = fnv(hash, &[entry.id, entry.receiver as u8]);
        hash = fnv(fnv(hash, entry.name.as_bytes()), entry.payload.as_bytes());
        hash = fnv(hash, &limit.to_le_bytes());
        row += 1;
    }
    let mut word = 0;
    while word < VOCABULARY.len() {
        hash = fnv(hash, VOCABULARY[word].as_bytes());
        word += 1;
    }
    hash
};

/// The longest payload of the table, in bytes.
pub const PAYLOAD_BYTES_MAX: usize = {
    let (mut longest, mut row) = (0, 0);
    while row < TABLE.len() {
        if TABLE[row].bytes_max > longest {
            longest = TABLE[row].bytes_max;
        }
        row += 1;
    }
    longest
};

const fn fnv(mut hash: u64, bytes: &[u8]) -> u64 {
    let mut at = 0;
    while at < bytes.len() {
        if bytes[at] != b' ' && bytes[at] != b'\n' {
            hash = (hash ^ bytes[at] as u64).wrapping_mul(0x0000_0100_0000_01b3);
        }
        at += 1;
    }
    hash
}

fn as_bytes<S: Serializer>(bytes: &&[u8], serializer: S) -> Result<S::Ok, S::Error> {
    serializer.serialize_bytes(bytes)
}

fn read<'a, T: Deserialize<'a>>(name: &'static str, bytes_max: usize, payload: &'a [u8]) -> Result<T, MessageError> {
    if payload.len() > bytes_max {
        return Err(MessageError::TooLong { name, bytes: payload.len(), bytes_max });
    }
    match postcard::take_from_bytes(payload) {
        Ok((message, [])) => Ok(message),
        _ => Err(MessageError::Malformed { name }),
    }
}

/// Why a [`Configure`] is impossible.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum ConfigureError {
    /// See the message.
    #[error(transparent)]
    Rotation(#[from] RotationError),
    /// See the message.
    #[error(transparent)]
    Size(#[from] ImageSizeError),
}

impl Configure {
    /// The message for this rotation and image size.
    pub fn new(rotation: &Rotation, size: ImageSize) -> Self {
        Self {
            slices: rotation.slices() as u16,
            planes_per_frame: rotation.planes_per_frame() as u16,
            refresh_microhertz: rotation.refresh_microhertz(),
            phase_offset: rotation.phase_offset().0,
            clockwise: rotation.direction() == Direction::Clockwise,
            width: size.width() as u16,
            height: size.height() as u16,
        }
    }

    /// The rotation and the image size, checked: fields came over a wire.
    pub fn parts(&self) -> Result<(Rotation, ImageSize), ConfigureError> {
        let direction = if self.clockwise { Direction::Clockwise } else { Direction::CounterClockwise };
        let (slices, planes) = (self.slices.into(), self.planes_per_frame.into());
        let rotation = Rotation::new(slices, planes, self.refresh_microhertz, Turns(self.phase_offset), direction)?;
        Ok((rotation, ImageSize::new(self.width.into(), self.height.into())?))
    }
}

#[cfg(test)]
mod tests;
