//! Whether what lies in flash is an image for this board, whole and signed.

use embedded_storage::nor_flash::{NorFlashError, NorFlashErrorKind, ReadNorFlash};
use protocol::image::{BLOCK, Board, HEADER_BYTES, Header, ImageError, SIGNATURE_BYTES, Version};
use thiserror::Error;

/// An ed25519 public key: whoever has its secret half decides what runs.
pub type PublicKey = [u8; 32];

/// Whose images run here.
#[derive(Clone, Copy, Debug)]
pub struct Owner {
    /// This board.
    pub board: Board,
    /// Compiled into the boot loader.
    pub key: PublicKey,
}

/// Why an image is not taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum Refusal {
    /// It is none.
    #[error(transparent)]
    Image(#[from] ImageError),
    /// The flash cannot be read or written there: a word that a power cut tore, or broken.
    #[error("flash: {0:?}")]
    Flash(NorFlashErrorKind),
    /// It runs elsewhere.
    #[error("the image is for the board {image}, this is {here}")]
    Board {
        /// What the image is for.
        image: Board,
        /// What this is.
        here: Board,
    },
    /// It does not fit.
    #[error("an image of {bytes} bytes, allowed are {most}")]
    Size {
        /// Of the image.
        bytes: u32,
        /// Of the slot.
        most: u32,
    },
    /// Signed by somebody else, or changed.
    #[error("the signature is not the owner's")]
    Signature,
    /// It is as old as what runs, or older.
    #[error("version {image} is not newer than {here}, which runs")]
    Version {
        /// Of the image.
        image: Version,
        /// What runs.
        here: Version,
    },
    /// The new image has not confirmed itself yet, or a swap is under way.
    #[error("an image that runs on trial takes no other: let it confirm itself first")]
    OnTrial,
    /// The image's parts come in another order, or not all of them.
    #[error("a block of {bytes} bytes at {at}: allowed are whole blocks of 64 bytes in order, none missing")]
    Order {
        /// Where the block would begin.
        at: u32,
        /// Its length.
        bytes: u32,
    },
}

/// The error as one of a flash.
pub(crate) fn flash(error: impl NorFlashError) -> Refusal {
    Refusal::Flash(error.kind())
}

impl Owner {
    /// Whether an image with this header may run here, from a slot of `slot_bytes`; its signature apart.
    pub fn accepts(&self, header: &Header, slot_bytes: u32) -> Result<(), Refusal> {
        if header.board != self.board {
            return Err(Refusal::Board { image: header.board, here: self.board });
        }
        let bytes = header.image_bytes();
        if bytes > slot_bytes { Err(Refusal::Size { bytes, most: slot_bytes }) } else { Ok(()) }
    }

    /// The header of the image `at` bytes into `slot`, of which `slot_bytes` are its; the board fits, the signature is the owner's.
    ///
    /// Reads in blocks of [`BLOCK`] bytes at multiples of it.
    pub fn verify<F: ReadNorFlash>(&self, slot: &mut F, at: u32, slot_bytes: u32) -> Result<Header, Refusal> {
        let header = read_header(slot, at)?;
        self.accepts(&header, slot_bytes)?;
        let mut digest = salty::Sha512::new();
        let mut block = [0; BLOCK];
        for offset in (0..header.signed_bytes()).step_by(BLOCK) {
            slot.read(at + offset, &mut block).map_err(flash)?;
            digest.update(&block);
        }
        let signature = read_signature(slot, at, &header)?;
        let key = salty::PublicKey::try_from(&self.key).map_err(|_| Refusal::Signature)?;
        let verdict = key.verify(&digest.finalize(), &salty::Signature::from(&signature));
        verdict.map(|()| header).map_err(|_| Refusal::Signature)
    }
}

/// What the image `at` bytes into `slot` says of itself, unverified.
pub fn read_header<F: ReadNorFlash>(slot: &mut F, at: u32) -> Result<Header, Refusal> {
    let mut bytes = [0; HEADER_BYTES];
    slot.read(at, &mut bytes).map_err(flash)?;
    Ok(Header::parse(&bytes)?)
}

/// The last bytes of the image of `header`, which lies `at` bytes into `slot`.
pub(crate) fn read_signature<F: ReadNorFlash>(
    slot: &mut F,
    at: u32,
    header: &Header,
) -> Result<[u8; SIGNATURE_BYTES], Refusal> {
    let mut signature = [0; SIGNATURE_BYTES];
    slot.read(at + header.signed_bytes(), &mut signature).map_err(flash)?;
    Ok(signature)
}
