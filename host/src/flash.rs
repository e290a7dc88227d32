//! Firmware images: keys, signatures, and the way into a device over USB DFU.

use crate::input;
use crate::link::LinkError;
use dfu_core::functional_descriptor::FunctionalDescriptor;
use dfu_core::synchronous::DfuSync;
use dfu_core::{DfuIo, DfuProtocol, Status};
use ed25519_dalek::{Digest, Sha512, Signature, Signer, SigningKey, VerifyingKey};
use protocol::image::{BLOCK, Board, Header, Identity, ImageError, Version, split};
use protocol::message::SCHEMA;
use std::cell::Cell;
use std::path::{Path, PathBuf};
use std::rc::Rc;
use thiserror::Error;

pub mod usb;

/// More than any slot holds.
pub const IMAGE_BYTES_MAX: u64 = 64 << 20;
/// A transfer that is disturbed begins anew so many times in all.
const ATTEMPTS: usize = 3;

/// Why an image is not made, or does not run on the device in the end.
#[derive(Debug, Error)]
pub enum FlashError {
    /// A file that cannot be read.
    #[error("{0}: {1}")]
    File(PathBuf, std::io::Error),
    /// A file that is no key.
    #[error("{0} is no key: allowed are 64 hexadecimal digits, as praxi image key writes them")]
    Key(PathBuf),
    /// A file that is no image.
    #[error("{0}: {1}")]
    Image(PathBuf, ImageError),
    /// Signed by somebody else, or changed since.
    #[error("the signature is not that key's, or the image has changed since it was signed")]
    Signature,
    /// For another board.
    #[error("the image is for the board {image}, the device is {device}")]
    Board {
        /// The image's.
        image: Board,
        /// The device's.
        device: Board,
    },
    /// Not newer.
    #[error(
        "version {image} is not newer than {device}, which the device runs: allowed are newer ones, or any with --force"
    )]
    Version {
        /// The image's.
        image: Version,
        /// The device's.
        device: Version,
    },
    /// The device said why.
    #[error("the device refuses the image: {}", reason(.0))]
    Refused(Status),
    /// Neither.
    #[error("the transfer failed {ATTEMPTS} times, the last time with: {0}")]
    Transfer(String),
    /// The device cannot be talked to.
    #[error("the device: {0}")]
    Device(String),
    /// Not there, or not to be had.
    #[error(transparent)]
    Link(#[from] LinkError),
    /// It stays in its application.
    #[error(
        "the device does not go into its loader, which it does only in the states Idle and Fault: stop the mirror, then try again"
    )]
    StaysInApplication,
    /// The new image failed its test, or was never started.
    #[error("the device runs {0} again: the new image did not confirm itself")]
    CameBack(Identity),
    /// Not even the old one.
    #[error("the device runs nothing: its boot loader waits for an image")]
    RunsNothing,
}

/// What our loaders mean by their word for a refusal.
fn reason(status: &Status) -> String {
    match status {
        Status::ErrTarget => "it is for another board, or not newer than what runs".into(),
        Status::ErrFile => "it is damaged, or larger than a slot of the device".into(),
        Status::ErrVendor => "its loader was built without its owner's public key, and takes none".into(),
        Status::ErrFirmware => {
            "what runs there is on trial, or about to be swapped: try again when it has confirmed itself".into()
        }
        other => other.to_string(),
    }
}

/// Thirty-two bytes in hexadecimal from the file at `path`: a secret key's seed, or a public key.
pub fn read_key(path: &Path) -> Result<[u8; 32], FlashError> {
    let text = input::read_text(path).map_err(|error| FlashError::File(path.into(), error))?;
    from_hex(text.trim()).ok_or_else(|| FlashError::Key(path.into()))
}

/// As [`read_key`] reads it.
pub fn to_hex(key: &[u8; 32]) -> String {
    key.iter().map(|byte| format!("{byte:02x}")).collect()
}

fn from_hex(text: &str) -> Option<[u8; 32]> {
    let digits: Vec<u8> =
        text.chars().map(|digit| digit.to_digit(16).map(|digit| digit as u8)).collect::<Option<_>>()?;
    let bytes: Vec<u8> = digits.chunks_exact(2).map(|pair| pair[0] << 4 | pair[1]).collect();
    bytes.try_into().ok().filter(|_| digits.len() == 64)
}

/// The public half of a secret key.
pub fn public(secret: &[u8; 32]) -> [u8; 32] {
    SigningKey::from_bytes(secret).verifying_key().to_bytes()
}

/// An image of `code`, filled up to whole blocks, signed.
pub fn sign(secret: &[u8; 32], board: Board, version: Version, mut code: Vec<u8>) -> Result<Vec<u8>, ImageError> {
    code.resize(code.len().next_multiple_of(BLOCK), 0xFF);
    let code_bytes = u32::try_from(code.len()).map_err(|_| ImageError::Length)?;
    let [a, b, c, d, ..]: [u8; 64] = Sha512::digest(&code).into();
    let build = u32::from_le_bytes([a, b, c, d]);
    let header = Header { board, version, code_bytes, schema: SCHEMA, build };
    let mut image = header.to_bytes().to_vec();
    Header::parse(&image)?;
    image.append(&mut code);
    let signature = SigningKey::from_bytes(secret).sign(&Sha512::digest(&image));
    image.extend(signature.to_bytes());
    Ok(image)
}

/// Whether the owner of the public key has signed `image`.
pub fn verify(key: &[u8; 32], image: &[u8]) -> Result<(), FlashError> {
    let (_, signed, signature) = split(image).map_err(|_| FlashError::Signature)?;
    let key = VerifyingKey::from_bytes(key).map_err(|_| FlashError::Signature)?;
    key.verify_strict(&Sha512::digest(signed), &Signature::from_bytes(signature)).map_err(|_| FlashError::Signature)
}

/// A device that can be opened again after it has started anew.
pub trait Device {
    /// What can go wrong once it is open.
    type Error: std::error::Error + From<std::io::Error> + From<dfu_core::Error>;
    /// Its loader, opened.
    type Io: DfuIo<Read = usize, Write = usize, Reset = (), Error = Self::Error>;

    /// What runs on it, as far as it tells.
    fn running(&mut self) -> Result<Option<Identity>, FlashError>;

    /// Opens its loader, to take newer versions only or any.
    fn open(&mut self, takes_any: bool) -> Result<Self::Io, FlashError>;

    /// What runs on it when it has come to rest after an image was sent; `None`: its loader waits for another.
    fn settled(&mut self) -> Result<Option<Identity>, FlashError> {
        self.running()
    }
}

/// Sends `image` and sees it run. `progress` is told how many bytes have been sent in this attempt.
pub fn flash<D: Device>(
    device: &mut D,
    image: &[u8],
    force: bool,
    progress: impl Fn(u64) + Clone + 'static,
) -> Result<Header, FlashError> {
    let (header, ..) = split(image).map_err(|error| FlashError::Image(PathBuf::from("image"), error))?;
    if let Some(running) = device.running()? {
        if running.board != header.board {
            return Err(FlashError::Board { image: header.board, device: running.board });
        }
        if !force && header.version <= running.version {
            return Err(FlashError::Version { image: header.version, device: running.version });
        }
    }
    let mut outcome = Ok(());
    for _ in 0..ATTEMPTS {
        outcome = send(device, image, force, progress.clone());
        if !matches!(outcome, Err(FlashError::Transfer(_))) {
            break;
        }
    }
    outcome?;
    match device.settled()? {
        Some(running) if running == header.identity() => Ok(header),
        Some(running) => Err(FlashError::CameBack(running)),
        None => Err(FlashError::RunsNothing),
    }
}

// DFU 1.1, table 3.2: a request to the interface, of its class.
const REQUEST_TYPE: u8 = 0b0010_0001;
const DETACH: u8 = 0;
const GETSTATUS: u8 = 3;
const ABORT: u8 = 6;

fn send<D: Device>(
    device: &mut D,
    image: &[u8],
    force: bool,
    progress: impl Fn(u64) + 'static,
) -> Result<(), FlashError> {
    let io = device.open(force)?;
    // What another host left half sent would be in the way. Where a failure was left, this is refused, and `dfu-core` clears it.
    let _ = io.write_control(REQUEST_TYPE, ABORT, 0, &[]);
    let status = Rc::new(Cell::new(Status::Ok));
    let mut dfu = DfuSync::new(Watched { io, status: Rc::clone(&status) });
    let mut sent = 0;
    dfu.with_progress(move |bytes| {
        sent += bytes as u64;
        progress(sent);
    });
    dfu.download_from_slice(image).map(drop).map_err(|error| match status.get() {
        // The image itself is wrong there; anything else may have happened on the way.
        status @ (Status::ErrTarget | Status::ErrFile | Status::ErrFirmware | Status::ErrVendor) => {
            FlashError::Refused(status)
        }
        Status::Ok => FlashError::Transfer(error.to_string()),
        status => FlashError::Transfer(status.to_string()),
    })
}

/// Remembers what the device last said of itself, which `dfu-core` does not tell.
struct Watched<I> {
    io: I,
    status: Rc<Cell<Status>>,
}

impl<I: DfuIo<Read = usize>> DfuIo for Watched<I> {
    type Read = usize;
    type Write = I::Write;
    type Reset = I::Reset;
    type Error = I::Error;
    type MemoryLayout = I::MemoryLayout;

    fn read_control(&self, kind: u8, request: u8, value: u16, buffer: &mut [u8]) -> Result<usize, I::Error> {
        let count = self.io.read_control(kind, request, value, buffer)?;
        if let (GETSTATUS, Some(&status)) = (request, buffer[..count.min(buffer.len())].first()) {
            self.status.set(status.into());
        }
        Ok(count)
    }

    fn write_control(&self, kind: u8, request: u8, value: u16, buffer: &[u8]) -> Result<I::Write, I::Error> {
        let written = self.io.write_control(kind, request, value, buffer);
        if written.is_err() {
            // A stall has its reason too. A device that does not tell it keeps what it told before.
            let _ = self.read_control(kind, GETSTATUS, 0, &mut [0; 6]);
        }
        written
    }

    fn usb_reset(self) -> Result<I::Reset, I::Error> {
        self.io.usb_reset()
    }

    fn protocol(&self) -> &DfuProtocol<I::MemoryLayout> {
        self.io.protocol()
    }

    fn functional_descriptor(&self) -> &FunctionalDescriptor {
        self.io.functional_descriptor()
    }
}

#[cfg(test)]
mod tests;
