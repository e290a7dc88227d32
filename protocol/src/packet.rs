//! Packets: a message with a sequence number and a check, framed so that a reader finds the next one after any damage.
//!
//! ```text
//! COBS( sequence u32 | message id u8 | payload | CRC-32 u32 )  0x00        integers little-endian, CRC over all before it
//! ```

use crate::message::{Message, MessageError, PAYLOAD_BYTES_MAX};
use cobs::{CobsEncoder, DecodeResult, DecoderState};
use crc::{CRC_32_ISO_HDLC, Crc, Digest, Table};
use postcard::ser_flavors::Flavor;
use thiserror::Error;

#[cfg(feature = "std")]
type Lanes = Table<16>;
#[cfg(not(feature = "std"))]
type Lanes = Table<1>;
static CRC_32: Crc<u32, Lanes> = Crc::<u32, Lanes>::new(&CRC_32_ISO_HDLC);

const HEADER_BYTES: usize = 5;
const CHECK_BYTES: usize = 4;

/// The longest packet before framing, in bytes: what a [`Decoder`] needs to read every message.
pub const PACKET_BYTES_MAX: usize = HEADER_BYTES + PAYLOAD_BYTES_MAX + CHECK_BYTES;

/// The longest packet on the wire with its delimiter, in bytes: what [`encode`] needs to write every message.
pub const FRAME_BYTES_MAX: usize = cobs::max_encoding_length(PACKET_BYTES_MAX) + 1;

/// Why a packet was not written or read.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum PacketError {
    /// The buffer for a packet to be written is too short.
    #[error("a packet does not fit in {bytes} bytes")]
    NoRoom {
        /// Bytes of the buffer.
        bytes: usize,
    },
    /// The delimiter came where COBS expects something else: bytes are missing or were changed.
    #[error("a packet ends inside a COBS block")]
    Framing,
    /// More came before a delimiter than any packet has.
    #[error("a packet is longer than {bytes_max} bytes")]
    TooLong {
        /// The decoder's buffer.
        bytes_max: usize,
    },
    /// Less came than header and check.
    #[error("a packet has {bytes} bytes: at least {} are needed", HEADER_BYTES + CHECK_BYTES)]
    TooShort {
        /// Bytes between delimiters, unframed.
        bytes: usize,
    },
    /// The CRC-32 differs.
    #[error("a packet has check {found:#010x}: {expected:#010x} was sent with it")]
    Check {
        /// What was sent.
        expected: u32,
        /// What arrived.
        found: u32,
    },
    /// The message does not fit the wire's table.
    #[error(transparent)]
    Message(#[from] MessageError),
}

/// Writes `message` as one packet with its delimiter to the start of `out`. Returns its length in bytes, at most
/// [`FRAME_BYTES_MAX`].
pub fn encode(sequence: u32, message: &Message<'_>, out: &mut [u8]) -> Result<usize, PacketError> {
    let no_room = PacketError::NoRoom { bytes: out.len() };
    let Some((delimiter_room, body)) = out.len().checked_sub(1).map(|room| (room, &mut out[..room])) else {
        return Err(no_room);
    };
    let mut framer = Framer { cobs: CobsEncoder::new(body), digest: CRC_32.digest(), bytes: 0 };
    let header = [&sequence.to_le_bytes()[..], &[message.entry().id]];
    let written = header.iter().try_for_each(|bytes| framer.try_extend(bytes)).and_then(|()| message.serialize(framer));
    let (length, bytes) = written.map_err(|_| no_room)?;
    let (name, bytes, bytes_max) = (message.entry().name, bytes - HEADER_BYTES, message.entry().bytes_max);
    if bytes > bytes_max {
        return Err(MessageError::TooLong { name, bytes, bytes_max }.into());
    }
    // The encoder does not look whether the place that it keeps for the next zero is there.
    if length > delimiter_room {
        return Err(no_room);
    }
    out[length] = 0;
    Ok(length + 1)
}

/// Takes the bytes of a packet, checks and frames them as they come: no second buffer.
struct Framer<'a> {
    cobs: CobsEncoder<'a>,
    digest: Digest<'static, u32, Lanes>,
    bytes: usize,
}

impl Flavor for Framer<'_> {
    /// Bytes written, and bytes before framing without the check.
    type Output = (usize, usize);

    fn try_push(&mut self, byte: u8) -> postcard::Result<()> {
        self.try_extend(&[byte])
    }

    fn try_extend(&mut self, bytes: &[u8]) -> postcard::Result<()> {
        self.digest.update(bytes);
        self.bytes += bytes.len();
        self.cobs.push(bytes).map_err(|_| postcard::Error::SerializeBufferFull)
    }

    fn finalize(mut self) -> postcard::Result<Self::Output> {
        let check = self.digest.clone().finalize().to_le_bytes();
        self.cobs.push(&check).map_err(|_| postcard::Error::SerializeBufferFull)?;
        Ok((self.cobs.finalize(), self.bytes))
    }
}

/// A packet that arrived undamaged.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Packet<'a> {
    /// Counts the packets of the sender.
    pub sequence: u32,
    /// Names the message.
    pub id: u8,
    /// The message's fields.
    pub payload: &'a [u8],
}

impl<'a> Packet<'a> {
    /// The message.
    pub fn message(&self) -> Result<Message<'a>, MessageError> {
        Message::decode(self.id, self.payload)
    }
}

/// What a [`Decoder`] has seen.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Packets that arrived undamaged.
    pub packets: u32,
    /// Ended inside a COBS block.
    pub framing: u32,
    /// Longer than the buffer.
    pub too_long: u32,
    /// Shorter than header and check.
    pub too_short: u32,
    /// Another CRC-32.
    pub check: u32,
}

impl Counts {
    /// Packets that arrived damaged, in any way.
    pub const fn damaged(&self) -> u32 {
        self.framing.saturating_add(self.too_long).saturating_add(self.too_short).saturating_add(self.check)
    }
}

/// Finds packets in a stream of bytes. `N`: the longest packet before framing, at most [`PACKET_BYTES_MAX`] is of use.
///
/// Any bytes may come in pieces of any length. After damage the next delimiter is where reading goes on.
#[derive(Debug)]
pub struct Decoder<const N: usize> {
    buffer: [u8; N],
    length: usize,
    cobs: DecoderState,
    skipping: bool,
    counts: Counts,
}

impl<const N: usize> Default for Decoder<N> {
    fn default() -> Self {
        Self::new()
    }
}

impl<const N: usize> Decoder<N> {
    /// At the start of a stream.
    pub const fn new() -> Self {
        Self { buffer: [0; N], length: 0, cobs: DecoderState::Idle, skipping: false, counts: Counts::ZERO }
    }

    /// What came so far.
    pub const fn counts(&self) -> Counts {
        self.counts
    }

    /// Forgets a packet that is cut off. What came so far stays counted.
    pub fn cut(&mut self) {
        (self.length, self.cobs, self.skipping) = (0, DecoderState::Idle, false);
    }

    /// Reads `input` up to the end of the next packet and leaves the rest in it. `None`: the input ended first.
    pub fn next<'a>(&'a mut self, input: &mut &[u8]) -> Option<Result<Packet<'a>, PacketError>> {
        let ended = self.read(input)?;
        let length = core::mem::take(&mut self.length);
        let packet = ended.and_then(|()| open(self.buffer.get(..length).unwrap_or_default()));
        let count = match packet {
            Ok(_) => &mut self.counts.packets,
            Err(PacketError::Check { .. }) => &mut self.counts.check,
            Err(PacketError::TooShort { .. }) => &mut self.counts.too_short,
            Err(PacketError::TooLong { .. }) => &mut self.counts.too_long,
            Err(_) => &mut self.counts.framing,
        };
        *count = count.saturating_add(1);
        Some(packet)
    }

    fn read(&mut self, input: &mut &[u8]) -> Option<Result<(), PacketError>> {
        while let [byte, rest @ ..] = *input {
            *input = rest;
            match self.cobs.feed(*byte) {
                Ok(DecodeResult::DataContinue(byte)) => match self.buffer.get_mut(self.length) {
                    Some(place) => {
                        *place = byte;
                        self.length += 1;
                    }
                    None => self.skipping = true,
                },
                Ok(DecodeResult::DataStart | DecodeResult::NoData) => {}
                Ok(DecodeResult::DataComplete) | Err(_) if core::mem::take(&mut self.skipping) => {
                    return Some(Err(PacketError::TooLong { bytes_max: N }));
                }
                Ok(DecodeResult::DataComplete) => return Some(Ok(())),
                Err(_) => return Some(Err(PacketError::Framing)),
            }
        }
        None
    }
}

impl Counts {
    const ZERO: Self = Self { packets: 0, framing: 0, too_long: 0, too_short: 0, check: 0 };
}

fn open(bytes: &[u8]) -> Result<Packet<'_>, PacketError> {
    let too_short = PacketError::TooShort { bytes: bytes.len() };
    let (body, check) = bytes.split_last_chunk::<CHECK_BYTES>().ok_or(too_short)?;
    let (sequence, message) = body.split_first_chunk::<4>().ok_or(too_short)?;
    let (id, payload) = message.split_first().ok_or(too_short)?;
    let (expected, found) = (u32::from_le_bytes(*check), CRC_32.checksum(body));
    if expected != found {
        return Err(PacketError::Check { expected, found });
    }
    Ok(Packet { sequence: u32::from_le_bytes(*sequence), id: *id, payload })
}

#[cfg(test)]
mod tests;
