//! NOR flash in memory that loses power where it is told to: between two operations, or within one.
//!
//! An erase sets a sector's bits; a write fills blank words, once each, because words carry error correction (STM32H743: words of
//! 32 bytes, sectors of 128 KiB). What a word holds whose write or erase was cut off, the chip's manual leaves open, but for that
//! reading it may fail. [`Tear`] lists what it can come to; whether a cell that was left between two levels reads the same twice
//! nobody promises either.

use embedded_storage::nor_flash::{
    ErrorType, NorFlash, NorFlashError, NorFlashErrorKind, ReadNorFlash, check_erase, check_read, check_write,
};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::cell::RefCell;
use std::rc::Rc;
use thiserror::Error;

/// What is left of the operation that power was cut off in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Tear {
    /// Nothing has happened yet.
    Nothing,
    /// The first half of the word or sector is done.
    FirstHalf,
    /// The second half is done.
    SecondHalf,
    /// Random bits, the same at every reading.
    Garbage,
    /// Reading fails: error correction cannot mend it.
    Unreadable,
    /// Each reading gives the old, the new, blank, random bits, or fails.
    Unstable,
    /// All is done; only nobody has been told.
    Everything,
}

impl Tear {
    /// Each of them.
    pub const ALL: [Self; 7] = [
        Self::Nothing,
        Self::FirstHalf,
        Self::SecondHalf,
        Self::Garbage,
        Self::Unreadable,
        Self::Unstable,
        Self::Everything,
    ];
}

/// Why an operation fails.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum FlashError {
    /// There is no power.
    #[error("no power")]
    Off,
    /// Error correction cannot mend the word.
    #[error("an unreadable word")]
    Unreadable,
    /// Out of bounds, not aligned, or a word that has been written since it was erased: its user's mistake.
    #[error("misused: {0:?}")]
    Misused(NorFlashErrorKind),
}

impl NorFlashError for FlashError {
    fn kind(&self) -> NorFlashErrorKind {
        match self {
            Self::Off | Self::Unreadable => NorFlashErrorKind::Other,
            Self::Misused(kind) => *kind,
        }
    }
}

impl From<NorFlashErrorKind> for FlashError {
    fn from(kind: NorFlashErrorKind) -> Self {
        Self::Misused(kind)
    }
}

#[derive(Clone, Debug, PartialEq, Eq)]
enum Word {
    Blank,
    Written,
    /// Cut off, but readable as it stands.
    Torn,
    Unreadable,
    /// With the old bytes; the new ones stand in their place.
    Unstable(Box<[u8]>),
}

/// A chip of words of `WORD` bytes, written whole, and sectors of `SECTOR` bytes, erased whole.
#[derive(Clone, Debug)]
pub struct Chip<const WORD: usize, const SECTOR: usize> {
    bytes: Vec<u8>,
    words: Vec<Word>,
    /// Words written and sectors erased so far.
    operations: u64,
    cut: Option<(u64, Tear)>,
    is_off: bool,
    misuse: Option<FlashError>,
    noise: ChaCha8Rng,
}

impl<const WORD: usize, const SECTOR: usize> Chip<WORD, SECTOR> {
    /// A blank chip of so many sectors. `seed` decides random bits.
    pub fn blank(sectors: usize, seed: u64) -> Self {
        let size = sectors * SECTOR;
        Self {
            bytes: vec![0xFF; size],
            words: vec![Word::Blank; size / WORD],
            operations: 0,
            cut: None,
            is_off: false,
            misuse: None,
            noise: ChaCha8Rng::seed_from_u64(seed),
        }
    }

    /// Its size.
    pub fn bytes(&self) -> usize {
        self.bytes.len()
    }

    /// Words written and sectors erased so far.
    pub fn operations(&self) -> u64 {
        self.operations
    }

    /// Cuts power within the operation after `operations` more, and leaves `tear`.
    pub fn cut_after(&mut self, operations: u64, tear: Tear) {
        self.cut = Some((self.operations + operations, tear));
    }

    /// Forgets a cut that has not come.
    pub fn cut_no_more(&mut self) {
        self.cut = None;
    }

    /// Whether power has been cut.
    pub fn is_off(&self) -> bool {
        self.is_off
    }

    /// Power comes back.
    pub fn power_on(&mut self) {
        self.is_off = false;
    }

    /// The first mistake of its user.
    pub fn misuse(&self) -> Option<FlashError> {
        self.misuse
    }

    /// The tear, where power is cut off in this operation; an error where there is none.
    fn begin(&mut self) -> Result<Option<Tear>, FlashError> {
        if self.is_off {
            return Err(FlashError::Off);
        }
        let tear = self.cut.take_if(|(at, _)| *at == self.operations).map(|(_, tear)| tear);
        self.operations += 1;
        self.is_off = tear.is_some();
        Ok(tear)
    }

    /// Does one operation on the words of `range` bytes: `new` takes the place of what stands there.
    fn replace(&mut self, start: usize, new: &[u8], done: &Word) -> Result<(), FlashError> {
        let tear = self.begin()?;
        let half = start + new.len() / 2;
        for (at, new) in (start..).step_by(WORD).zip(new.chunks(WORD)) {
            let is_first = at < half;
            let word = match tear {
                None | Some(Tear::Everything) => self.put(at, new, done.clone()),
                Some(Tear::Nothing) => continue,
                Some(Tear::FirstHalf | Tear::SecondHalf) if start + WORD < half => {
                    if is_first == (tear == Some(Tear::FirstHalf)) { self.put(at, new, done.clone()) } else { continue }
                }
                Some(Tear::FirstHalf) => self.put(at, &new[..WORD / 2], Word::Torn),
                Some(Tear::SecondHalf) => self.put(at + WORD / 2, &new[WORD / 2..], Word::Torn),
                Some(Tear::Garbage) => {
                    let random: Vec<u8> = (0..WORD).map(|_| self.noise.random()).collect();
                    self.put(at, &random, Word::Torn)
                }
                Some(Tear::Unreadable) => Word::Unreadable,
                Some(Tear::Unstable) => {
                    let old = self.bytes[at..at + WORD].into();
                    self.put(at, new, Word::Unstable(old))
                }
            };
            self.words[at / WORD] = word;
        }
        if tear.is_some() { Err(FlashError::Off) } else { Ok(()) }
    }

    fn put(&mut self, at: usize, bytes: &[u8], word: Word) -> Word {
        self.bytes[at..at + bytes.len()].copy_from_slice(bytes);
        word
    }

    fn write_word(&mut self, at: usize, new: &[u8]) -> Result<(), FlashError> {
        match self.words[at / WORD] {
            Word::Blank => self.replace(at, new, &Word::Written),
            Word::Written => self.misused(NorFlashErrorKind::Other.into()),
            // What is written over a torn word mixes with what it holds; its error correction never fits.
            _ => {
                self.begin()?;
                self.words[at / WORD] = Word::Unreadable;
                if self.is_off { Err(FlashError::Off) } else { Ok(()) }
            }
        }
    }

    fn read_word(&mut self, at: usize) -> Result<Vec<u8>, FlashError> {
        let new = &self.bytes[at..at + WORD];
        match &self.words[at / WORD] {
            Word::Unreadable => Err(FlashError::Unreadable),
            Word::Unstable(old) => match self.noise.random_range(0..5) {
                0 => Ok(old.to_vec()),
                1 => Ok(new.to_vec()),
                2 => Ok(vec![0xFF; WORD]),
                3 => Ok((0..WORD).map(|_| self.noise.random()).collect()),
                _ => Err(FlashError::Unreadable),
            },
            _ => Ok(new.to_vec()),
        }
    }

    fn misused<T>(&mut self, error: FlashError) -> Result<T, FlashError> {
        self.misuse.get_or_insert(error);
        Err(error)
    }
}

/// A part of a chip that other parts share.
#[derive(Clone, Debug)]
pub struct Region<const WORD: usize, const SECTOR: usize> {
    chip: Rc<RefCell<Chip<WORD, SECTOR>>>,
    start: usize,
    size: usize,
}

impl<const WORD: usize, const SECTOR: usize> Region<WORD, SECTOR> {
    /// Splits a chip into regions of so many sectors each, from its start on.
    pub fn split<const N: usize>(chip: &Rc<RefCell<Chip<WORD, SECTOR>>>, sectors: [usize; N]) -> [Self; N] {
        let mut start = 0;
        sectors.map(|sectors| {
            let region = Self { chip: Rc::clone(chip), start, size: sectors * SECTOR };
            start += region.size;
            region
        })
    }

    fn checked<T>(&mut self, check: Result<T, NorFlashErrorKind>) -> Result<T, FlashError> {
        check.or_else(|kind| self.chip.borrow_mut().misused(kind.into()))
    }
}

impl<const WORD: usize, const SECTOR: usize> ErrorType for Region<WORD, SECTOR> {
    type Error = FlashError;
}

impl<const WORD: usize, const SECTOR: usize> ReadNorFlash for Region<WORD, SECTOR> {
    const READ_SIZE: usize = 1;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), FlashError> {
        let check = check_read(self, offset, bytes.len());
        self.checked(check)?;
        let mut chip = self.chip.borrow_mut();
        if chip.is_off {
            return Err(FlashError::Off);
        }
        let start = self.start + offset as usize;
        let mut filled = 0;
        while filled < bytes.len() {
            let at = start + filled;
            let word = chip.read_word(at - at % WORD)?;
            let part = &word[at % WORD..];
            let count = part.len().min(bytes.len() - filled);
            bytes[filled..filled + count].copy_from_slice(&part[..count]);
            filled += count;
        }
        Ok(())
    }

    fn capacity(&self) -> usize {
        self.size
    }
}

impl<const WORD: usize, const SECTOR: usize> NorFlash for Region<WORD, SECTOR> {
    const WRITE_SIZE: usize = WORD;
    const ERASE_SIZE: usize = SECTOR;

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), FlashError> {
        let check = check_write(self, offset, bytes.len());
        self.checked(check)?;
        let mut chip = self.chip.borrow_mut();
        let start = self.start + offset as usize;
        (start..).step_by(WORD).zip(bytes.chunks(WORD)).try_for_each(|(at, word)| chip.write_word(at, word))
    }

    fn erase(&mut self, from: u32, to: u32) -> Result<(), FlashError> {
        let check = check_erase(self, from, to);
        self.checked(check)?;
        let mut chip = self.chip.borrow_mut();
        let [from, to] = [from, to].map(|offset| self.start + offset as usize);
        (from..to).step_by(SECTOR).try_for_each(|at| chip.replace(at, &[0xFF; SECTOR], &Word::Blank))
    }
}
