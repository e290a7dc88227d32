//! A firmware image as it is signed, sent and stored: a header, the code, a signature.
//!
//! | bytes | what |
//! |---|---|
//! | 0..8 | [`MAGIC`] |
//! | 8..10 | [`FORMAT`] |
//! | 10..12 | [`HEADER_BYTES`] |
//! | 12..16 | length of the code in bytes, a multiple of [`BLOCK`] |
//! | 16..22 | version: major, minor, patch, two bytes each |
//! | 24..40 | the board's name in ASCII, filled up with zeros |
//! | 40..48 | the wire's [`SCHEMA`](crate::message::SCHEMA) that the code speaks |
//! | 48..52 | build: tells images of one version apart; the first bytes of the code's SHA-512 digest |
//! | ..1024 | zeros |
//! | 1024.. | the code, whose vector table so stands at a multiple of 1024 |
//! | last 64 | ed25519 over the SHA-512 digest of everything before, which is what embassy-boot verifies |
//!
//! Numbers are little-endian.

use core::fmt::{Display, Formatter};
use thiserror::Error;

/// What every image begins with.
pub const MAGIC: [u8; 8] = *b"PRAXIIMG";
/// This layout.
pub const FORMAT: u16 = 1;
/// Bytes before the code: a Cortex-M7's vector table of up to 240 entries wants a multiple of 1024.
pub const HEADER_BYTES: usize = 1024;
/// Code fills blocks of so many bytes, so that every flash's words of up to 64 bytes are filled whole.
pub const BLOCK: usize = 64;
/// Bytes of an ed25519 signature.
pub const SIGNATURE_BYTES: usize = 64;
/// The longest name of a board, in bytes.
pub const BOARD_BYTES: usize = 16;

/// Of a firmware; the larger is the newer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Version {
    /// Changes that break.
    pub major: u16,
    /// Changes that add.
    pub minor: u16,
    /// Changes that mend.
    pub patch: u16,
}

impl Display for Version {
    fn fmt(&self, to: &mut Formatter<'_>) -> core::fmt::Result {
        write!(to, "{}.{}.{}", self.major, self.minor, self.patch)
    }
}

impl core::str::FromStr for Version {
    type Err = ImageError;

    fn from_str(text: &str) -> Result<Self, ImageError> {
        let mut parts = text.split('.').map(|part| part.parse().map_err(|_| ImageError::Version));
        let mut next = || parts.next().unwrap_or(Err(ImageError::Version));
        let version = Self { major: next()?, minor: next()?, patch: next()? };
        if parts.next().is_some() { Err(ImageError::Version) } else { Ok(version) }
    }
}

/// The name of a board: 1 to [`BOARD_BYTES`] lower-case letters, digits and hyphens.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Board([u8; BOARD_BYTES]);

impl Board {
    /// Named so.
    pub fn new(name: &str) -> Result<Self, ImageError> {
        let mut bytes = [0; BOARD_BYTES];
        bytes.get_mut(..name.len()).ok_or(ImageError::Board)?.copy_from_slice(name.as_bytes());
        Self::from_bytes(bytes)
    }

    fn from_bytes(bytes: [u8; BOARD_BYTES]) -> Result<Self, ImageError> {
        let length = bytes.iter().position(|&byte| byte == 0).unwrap_or(BOARD_BYTES);
        let (name, rest) = bytes.split_at(length);
        let is_name = name.iter().all(|byte| byte.is_ascii_lowercase() || byte.is_ascii_digit() || *byte == b'-');
        if is_name && length > 0 && rest.iter().all(|&byte| byte == 0) {
            Ok(Self(bytes))
        } else {
            Err(ImageError::Board)
        }
    }

    /// Its name.
    pub fn name(&self) -> &str {
        core::str::from_utf8(&self.0).unwrap_or_default().trim_end_matches('\0')
    }
}

impl Display for Board {
    fn fmt(&self, to: &mut Formatter<'_>) -> core::fmt::Result {
        to.write_str(self.name())
    }
}

/// Which image it is: what a device says of the one that it runs, at the end of its USB product string.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Identity {
    /// The board that it runs on.
    pub board: Board,
    /// Of the code.
    pub version: Version,
    /// See [`Header::build`].
    pub build: u32,
}

impl Display for Identity {
    fn fmt(&self, to: &mut Formatter<'_>) -> core::fmt::Result {
        write!(to, "{} {}+{:08x}", self.board, self.version, self.build)
    }
}

impl Identity {
    /// At the end of `text`, as it is displayed; `None` where no such thing stands there.
    pub fn at_end_of(text: &str) -> Option<Self> {
        let (rest, release) = text.rsplit_once(' ')?;
        let board = rest.rsplit(' ').next()?;
        let (version, build) = release.split_once('+')?;
        let build = u32::from_str_radix(build, 16).ok()?;
        Some(Self { board: Board::new(board).ok()?, version: version.parse().ok()?, build })
    }
}

/// What an image says of itself. Only its signature makes it true.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Header {
    /// The board that it runs on.
    pub board: Board,
    /// Of the code.
    pub version: Version,
    /// The code's length in bytes, a multiple of [`BLOCK`], not 0.
    pub code_bytes: u32,
    /// The wire that the code speaks.
    pub schema: u64,
    /// Tells images of one version apart.
    pub build: u32,
}

/// Why bytes are no image.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum ImageError {
    /// Fewer bytes than a header has, or than the header says.
    #[error("cut short")]
    Short,
    /// More bytes than the header says.
    #[error("longer than its header says")]
    Long,
    /// See [`MAGIC`].
    #[error("no firmware image: it does not begin with PRAXIIMG")]
    Magic,
    /// See [`FORMAT`].
    #[error("an image of another format: known is 1")]
    Format,
    /// The length is 0, no multiple of [`BLOCK`], or beyond 32 bits.
    #[error("a bad length of the code: allowed are multiples of 64 bytes")]
    Length,
    /// See [`Board`].
    #[error("a bad name of a board: allowed are 1 to 16 lower-case letters, digits and hyphens")]
    Board,
    /// See [`Version`].
    #[error("a bad version: allowed are three numbers up to 65535, as in 1.2.3")]
    Version,
    /// Something stands where zeros belong.
    #[error("a header with bytes that mean nothing")]
    Reserved,
}

impl Header {
    /// Read from an image's first bytes, of which [`HEADER_BYTES`] or more are given.
    pub fn parse(bytes: &[u8]) -> Result<Self, ImageError> {
        let bytes: &[u8; HEADER_BYTES] = bytes.first_chunk().ok_or(ImageError::Short)?;
        if field(bytes, 0) != MAGIC {
            return Err(ImageError::Magic);
        }
        let half = |at| u16::from_le_bytes(field(bytes, at));
        if half(8) != FORMAT || usize::from(half(10)) != HEADER_BYTES {
            return Err(ImageError::Format);
        }
        let code_bytes = u32::from_le_bytes(field(bytes, 12));
        let most = u32::MAX - (HEADER_BYTES + SIGNATURE_BYTES) as u32;
        if code_bytes == 0 || code_bytes > most || !code_bytes.is_multiple_of(BLOCK as u32) {
            return Err(ImageError::Length);
        }
        if bytes[22..24].iter().chain(&bytes[52..]).any(|&byte| byte != 0) {
            return Err(ImageError::Reserved);
        }
        Ok(Self {
            board: Board::from_bytes(field(bytes, 24))?,
            version: Version { major: half(16), minor: half(18), patch: half(20) },
            code_bytes,
            schema: u64::from_le_bytes(field(bytes, 40)),
            build: u32::from_le_bytes(field(bytes, 48)),
        })
    }

    /// As it stands in front of the code.
    pub fn to_bytes(&self) -> [u8; HEADER_BYTES] {
        let mut bytes = [0; HEADER_BYTES];
        let Version { major, minor, patch } = self.version;
        bytes[..8].copy_from_slice(&MAGIC);
        bytes[12..16].copy_from_slice(&self.code_bytes.to_le_bytes());
        for (at, half) in [(8, FORMAT), (10, HEADER_BYTES as u16), (16, major), (18, minor), (20, patch)] {
            bytes[at..at + 2].copy_from_slice(&half.to_le_bytes());
        }
        bytes[24..40].copy_from_slice(&self.board.0);
        bytes[40..48].copy_from_slice(&self.schema.to_le_bytes());
        bytes[48..52].copy_from_slice(&self.build.to_le_bytes());
        bytes
    }

    /// Which image it is.
    pub fn identity(&self) -> Identity {
        Identity { board: self.board, version: self.version, build: self.build }
    }

    /// Bytes that are signed: header and code.
    pub fn signed_bytes(&self) -> u32 {
        HEADER_BYTES as u32 + self.code_bytes
    }

    /// Bytes of the whole image, with its signature.
    pub fn image_bytes(&self) -> u32 {
        self.signed_bytes() + SIGNATURE_BYTES as u32
    }
}

fn field<const N: usize>(bytes: &[u8; HEADER_BYTES], at: usize) -> [u8; N] {
    core::array::from_fn(|index| bytes[at + index])
}

/// Splits a whole image into its header, what is signed, and the signature, which is not verified here.
pub fn split(image: &[u8]) -> Result<(Header, &[u8], &[u8; SIGNATURE_BYTES]), ImageError> {
    let header = Header::parse(image)?;
    let (signed, signature) = image.split_at_checked(header.signed_bytes() as usize).ok_or(ImageError::Short)?;
    let fitting = signature.first_chunk().ok_or(ImageError::Short)?;
    if signature.len() > SIGNATURE_BYTES { Err(ImageError::Long) } else { Ok((header, signed, fitting)) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::vec::Vec;

    fn image(code_bytes: u32) -> Vec<u8> {
        let header = Header {
            board: Board::new("h743-rev-2").unwrap(),
            version: "1.2.3".parse().unwrap(),
            code_bytes,
            schema: 0x0123_4567_89ab_cdef,
            build: 0xfedc_ba98,
        };
        let mut bytes = header.to_bytes().to_vec();
        bytes.resize(header.image_bytes() as usize, 0xA5);
        bytes
    }

    #[test]
    fn the_layout_is_the_written_one() {
        let bytes = image(64);
        assert_eq!(bytes[..16], *b"PRAXIIMG\x01\x00\x00\x04\x40\x00\x00\x00");
        assert_eq!(bytes[16..40], *b"\x01\x00\x02\x00\x03\x00\x00\x00h743-rev-2\0\0\0\0\0\0");
        assert_eq!(bytes[40..48], [0xef, 0xcd, 0xab, 0x89, 0x67, 0x45, 0x23, 0x01]);
        assert_eq!(bytes[48..52], [0x98, 0xba, 0xdc, 0xfe]);
        let (header, signed, signature) = split(&bytes).unwrap();
        assert_eq!((header.version.to_string(), header.board.name()), ("1.2.3".into(), "h743-rev-2"));
        assert_eq!((signed.len(), signature), (1088, &[0xA5; 64]));
    }

    #[test]
    fn a_product_string_tells_which_image_runs() {
        let identity = Header::parse(&image(64)).unwrap().identity();
        let text = std::format!("Praxinoscope controller {identity}");
        assert_eq!(text, "Praxinoscope controller h743-rev-2 1.2.3+fedcba98");
        assert_eq!(Identity::at_end_of(&text), Some(identity));
        for text in ["", " ", "Praxinoscope loader", "h743 1.2.3", "h743 1.2.3+", "h743 1.2+0", "H7 1.2.3+0", "1.2.3+0"]
        {
            assert_eq!(Identity::at_end_of(text), None, "{text}");
        }
    }

    #[test]
    fn what_is_wrong_is_named() {
        let whole = image(64);
        let with = |at: usize, byte: u8| {
            let mut bytes = whole.clone();
            bytes[at] = byte;
            split(&bytes).unwrap_err()
        };
        let errors =
            [with(0, 0), with(8, 2), with(12, 0x41), with(12, 0x80), with(22, 1), with(1023, 1), with(24, b'H')];
        use ImageError::{Format, Length, Magic, Reserved, Short};
        assert_eq!(errors, [Magic, Format, Length, Short, Reserved, Reserved, ImageError::Board]);
        assert_eq!(split(&whole[..whole.len() - 1]).unwrap_err(), Short);
        assert_eq!(split(&[&whole[..], &[0]].concat()).unwrap_err(), ImageError::Long);
        for text in ["1.2", "1.2.3.4", "1.2.x", "1.2.65536", ""] {
            assert_eq!(text.parse::<Version>(), Err(ImageError::Version), "{text}");
        }
        for name in ["", "H7", "a name", "seventeen-letters"] {
            assert_eq!(super::Board::new(name), Err(ImageError::Board), "{name}");
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

        #[test]
        fn what_is_changed_is_read_without_panic_and_written_back(
            changes in prop::collection::vec((0usize..1200, any::<u8>()), 0..6), length in 0usize..1200,
        ) {
            let mut bytes = image(64);
            for (at, byte) in changes {
                if let Some(place) = bytes.get_mut(at) { *place = byte; }
            }
            bytes.truncate(length);
            if let Ok(header) = Header::parse(&bytes) {
                prop_assert_eq!(&header.to_bytes()[..], &bytes[..HEADER_BYTES]);
            }
            let _ = split(&bytes);
        }

        #[test]
        fn versions_are_ordered_as_numbers(a in any::<[u16; 3]>(), b in any::<[u16; 3]>()) {
            let version = |[major, minor, patch]: [u16; 3]| Version { major, minor, patch };
            prop_assert_eq!(version(a).cmp(&version(b)), a.cmp(&b));
            prop_assert_eq!(version(a).to_string().parse(), Ok(version(a)));
        }
    }
}
