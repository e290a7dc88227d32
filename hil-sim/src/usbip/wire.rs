//! The messages of USB/IP, version 1.1.1 (Documentation/usb/usbip_protocol.rst of Linux): numbers are big-endian.

use crate::usb::descriptors::{Descriptors, FROM_DEVICE};
use crate::usb::{Completion, Outcome, Pipe, Setup, Transfer};
use std::io::{self, BufRead, Read};
use thiserror::Error;

/// Bytes of a transfer. What Linux lets all of a program's transfers have together is the same.
pub const TRANSFER_BYTES_MAX: u32 = 16 << 20;
/// The name under which the one device is offered.
pub const BUS_ID: &str = "1-1";

const VERSION: u16 = 0x0111;
const LIST: u16 = 0x8005;
const LIST_REPLY: u16 = 0x0005;
const IMPORT: u16 = 0x8003;
const IMPORT_REPLY: u16 = 0x0003;
const BUS_ID_BYTES: usize = 32;
const PATH_BYTES: usize = 256;
/// Where on the server the device is: bus 1, device 2.
const PLACE: [u32; 2] = [1, 2];
/// Speed: high.
pub const HIGH_SPEED: u32 = 3;

const SUBMIT: u32 = 1;
const UNLINK: u32 = 2;
const SUBMITTED: u32 = 3;
const UNLINKED: u32 = 4;
/// Of every message after the import.
const HEADER_BYTES: usize = 48;
/// Packets of a transfer that is not isochronous: one or the other, by the client's version.
const NOT_ISOCHRONOUS: [u32; 2] = [0, u32::MAX];

// Errors as Linux numbers them.
const EPIPE: i32 = 32;
const EOVERFLOW: i32 = 75;
const ECONNRESET: i32 = 104;

/// Why a client is sent away.
#[derive(Debug, Error)]
pub enum UsbIpError {
    /// See the message.
    #[error("the client went away in the middle of a message")]
    Gone,
    /// See the message.
    #[error("the connection: {0}")]
    Io(io::Error),
    /// See the message.
    #[error("the client speaks version {0:#06x} of USB/IP: only {VERSION:#06x} is known")]
    Version(u16),
    /// See the message.
    #[error("an unknown message, {0:#x}")]
    Message(u32),
    /// See the message.
    #[error("a transfer of {0} bytes: allowed are {TRANSFER_BYTES_MAX}")]
    Length(u32),
    /// See the message.
    #[error("an isochronous transfer of {0} packets: the device has none")]
    Isochronous(u32),
    /// See the message.
    #[error("{count} transfers of {bytes} bytes at once: the client does not wait")]
    Flood {
        /// How many.
        count: usize,
        /// Of all of them.
        bytes: usize,
    },
}

impl From<io::Error> for UsbIpError {
    fn from(error: io::Error) -> Self {
        use io::ErrorKind::{BrokenPipe, ConnectionAborted, ConnectionReset, UnexpectedEof};
        match error.kind() {
            UnexpectedEof | BrokenPipe | ConnectionAborted | ConnectionReset => Self::Gone,
            _ => Self::Io(error),
        }
    }
}

/// What a client wants before it has the device.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Request {
    /// To know what there is.
    List,
    /// To have the device of this name.
    Import(String),
}

/// What a client wants that has the device.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Command {
    /// A transfer.
    Submit(Transfer),
    /// The transfer `victim` back.
    Unlink {
        /// The message's number.
        id: u32,
        /// The transfer's.
        victim: u32,
    },
}

/// Reads a client's first message.
pub fn read_request(from: &mut impl Read) -> Result<Request, UsbIpError> {
    let [version, code] = [read_u16(from)?, read_u16(from)?];
    let _status = read::<4>(from)?;
    match (version, code) {
        (VERSION, LIST) => Ok(Request::List),
        (VERSION, IMPORT) => {
            let name = read::<BUS_ID_BYTES>(from)?;
            let name = name.split(|byte| *byte == 0).next().unwrap_or_default();
            Ok(Request::Import(String::from_utf8_lossy(name).into_owned()))
        }
        (VERSION, other) => Err(UsbIpError::Message(other.into())),
        (version, _) => Err(UsbIpError::Version(version)),
    }
}

/// What there is.
pub fn list(descriptors: &Descriptors) -> Vec<u8> {
    let mut bytes = reply(LIST_REPLY, 0);
    bytes.extend(1u32.to_be_bytes());
    bytes.extend(record(descriptors));
    for interface in descriptors.interfaces.iter().filter(|interface| interface.setting == 0) {
        bytes.extend(interface.class);
        bytes.push(0);
    }
    bytes
}

/// The device, given to a client.
pub fn imported(descriptors: &Descriptors) -> Vec<u8> {
    let mut bytes = reply(IMPORT_REPLY, 0);
    bytes.extend(record(descriptors));
    bytes
}

/// Why it is not given.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Denial {
    /// Somebody has it.
    Busy = 2,
    /// There is none of that name.
    Absent = 4,
}

/// No device for a client.
pub fn denied(why: Denial) -> Vec<u8> {
    reply(IMPORT_REPLY, why as u32)
}

fn reply(code: u16, status: u32) -> Vec<u8> {
    [&VERSION.to_be_bytes()[..], &code.to_be_bytes(), &status.to_be_bytes()].concat()
}

fn record(descriptors: &Descriptors) -> Vec<u8> {
    let padded = |text: &str, length: usize| {
        let mut bytes = text.as_bytes().to_vec();
        bytes.resize(length, 0);
        bytes
    };
    let mut bytes = padded(&format!("/sys/devices/simulated/{BUS_ID}"), PATH_BYTES);
    bytes.extend(padded(BUS_ID, BUS_ID_BYTES));
    PLACE.iter().chain([&HIGH_SPEED]).for_each(|number| bytes.extend(number.to_be_bytes()));
    let Descriptors { vendor, product, release, .. } = descriptors;
    [vendor, product, release].iter().for_each(|number| bytes.extend(number.to_be_bytes()));
    // Class, subclass and protocol are the interfaces' matter. Configured, as the one configuration that there is.
    bytes.extend([0, 0, 0, 1, 1, descriptors.interface_count()]);
    bytes
}

/// Reads the next message; nothing where the client has left. It takes at most [`TRANSFER_BYTES_MAX`] of memory.
pub fn read_command(from: &mut impl BufRead) -> Result<Option<Command>, UsbIpError> {
    // The client may leave between messages.
    if from.fill_buf()?.is_empty() {
        return Ok(None);
    }
    let header = read::<HEADER_BYTES>(from)?;
    let word = |at: usize| u32::from_be_bytes([header[at], header[at + 1], header[at + 2], header[at + 3]]);
    let id = word(4);
    match word(0) {
        SUBMIT => {
            let (length, packets) = (word(24), word(32));
            if length > TRANSFER_BYTES_MAX {
                return Err(UsbIpError::Length(length));
            }
            if !NOT_ISOCHRONOUS.contains(&packets) {
                return Err(UsbIpError::Isochronous(packets));
            }
            let is_in = word(12) != 0;
            let endpoint = word(16) as u8 & 0x0F | if is_in { FROM_DEVICE } else { 0 };
            let mut setup = [0; 8];
            setup.copy_from_slice(&header[40..]);
            let pipe =
                if endpoint & 0x0F == 0 { Pipe::Control(Setup::from_bytes(setup)) } else { Pipe::Bulk(endpoint) };
            let (sent, room) = if is_in { (0, length as usize) } else { (length as usize, 0) };
            let mut transfer = Transfer { id, pipe, bytes: vec![0; sent], room };
            from.read_exact(&mut transfer.bytes)?;
            Ok(Some(Command::Submit(transfer)))
        }
        UNLINK => Ok(Some(Command::Unlink { id, victim: word(20) })),
        other => Err(UsbIpError::Message(other)),
    }
}

/// That a transfer has ended.
pub fn submitted(completion: &Completion) -> Vec<u8> {
    let status = match completion.outcome {
        Outcome::Done => 0,
        Outcome::Stalled => -EPIPE,
        Outcome::Overflow => -EOVERFLOW,
    };
    let mut bytes = answer(SUBMITTED, completion.id, status);
    bytes[24..28].copy_from_slice(&(completion.count as u32).to_be_bytes());
    bytes.extend(&completion.bytes);
    bytes
}

/// That a transfer was taken back, or had ended before.
pub fn unlinked(id: u32, was_pending: bool) -> Vec<u8> {
    answer(UNLINKED, id, if was_pending { -ECONNRESET } else { 0 })
}

fn answer(code: u32, id: u32, status: i32) -> Vec<u8> {
    let mut bytes = vec![0; HEADER_BYTES];
    bytes[..4].copy_from_slice(&code.to_be_bytes());
    bytes[4..8].copy_from_slice(&id.to_be_bytes());
    bytes[20..24].copy_from_slice(&status.to_be_bytes());
    bytes
}

fn read<const N: usize>(from: &mut impl Read) -> io::Result<[u8; N]> {
    let mut bytes = [0; N];
    from.read_exact(&mut bytes)?;
    Ok(bytes)
}

fn read_u16(from: &mut impl Read) -> io::Result<u16> {
    read(from).map(u16::from_be_bytes)
}
