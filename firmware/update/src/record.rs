//! The boot loader's notes in flash, each of which is written whole or not at all.
//!
//! `embassy-boot` keeps a magic word and its progress in a partition of words that it writes one by one and erases together. A cut
//! within that erase can leave the word "swap" and lose the progress, and the next swap then begins in the middle and mixes two
//! images. [`Record`] is a flash to `embassy-boot`, of bytes; below, every write and every erase appends a copy of them all.
//!
//! Copies are appended in threes with one number. Those count of which the first two are readable, the highest number first. A write
//! that power was cut off in may read as new, as old, as nothing, and differently each time. So [`open`](Record::open) writes three
//! new copies unless the highest number it sees has all three: what it has once told stays so. The third says that the second was
//! written to its end; the second says so of the first.

use crc::{CRC_32_ISCSI, Crc};
use embedded_storage::nor_flash::{
    ErrorType, NorFlash, NorFlashError, NorFlashErrorKind, ReadNorFlash, check_erase, check_read, check_write,
};
use thiserror::Error;

/// Bytes of notes: room for the swap of twelve pages and the loader's trials.
pub const NOTES: usize = 55;
/// Bytes of a copy in flash: notes, number, place among three, checksum.
const COPY: usize = 64;
const COPIES: u8 = 3;
/// Turns every value of a note into one that is not `0xFF`: a word of a copy that looked blank would be written twice when power fails
/// behind it.
const VEIL: u8 = 0xA5;
const CHECKSUM: Crc<u32> = Crc::<u32>::new(&CRC_32_ISCSI);

/// Why notes are not kept.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum RecordError {
    /// The flash below, or a place out of bounds.
    #[error("flash: {0:?}")]
    Flash(NorFlashErrorKind),
    /// What was written reads as something else, at every place.
    #[error("the flash does not keep what is written")]
    Worn,
}

impl NorFlashError for RecordError {
    fn kind(&self) -> NorFlashErrorKind {
        match self {
            Self::Flash(kind) => *kind,
            Self::Worn => NorFlashErrorKind::Other,
        }
    }
}

impl From<NorFlashErrorKind> for RecordError {
    fn from(kind: NorFlashErrorKind) -> Self {
        Self::Flash(kind)
    }
}

fn below(error: impl NorFlashError) -> RecordError {
    RecordError::Flash(error.kind())
}

/// [`NOTES`] bytes over a partition of two halves, each of one or more sectors.
#[derive(Debug)]
pub struct Record<F> {
    flash: F,
    notes: [u8; NOTES],
    number: u32,
    half: u32,
    /// Where in the half the next copy goes.
    next: u32,
}

/// One readable copy.
#[derive(Clone, Copy, PartialEq, Eq)]
struct Copy {
    notes: [u8; NOTES],
    number: u32,
    place: u8,
}

impl Copy {
    fn to_bytes(self) -> [u8; COPY] {
        let mut bytes = [0; COPY];
        bytes[..NOTES].copy_from_slice(&self.notes.map(|note| note ^ VEIL));
        bytes[NOTES..NOTES + 4].copy_from_slice(&self.number.to_le_bytes());
        bytes[NOTES + 4] = self.place;
        let checksum = CHECKSUM.checksum(&bytes[..COPY - 4]);
        bytes[COPY - 4..].copy_from_slice(&checksum.to_le_bytes());
        bytes
    }

    fn parse(bytes: &[u8; COPY]) -> Option<Self> {
        let number = core::array::from_fn(|index| bytes[NOTES + index]);
        let notes = core::array::from_fn(|index| bytes[index] ^ VEIL);
        let copy = Self { notes, number: u32::from_le_bytes(number), place: bytes[NOTES + 4] };
        (copy.to_bytes() == *bytes && copy.place < COPIES).then_some(copy)
    }
}

/// What a half holds.
#[derive(Default)]
struct Half {
    /// The notes of the highest number whose first two copies agree, and whether the third does as well.
    best: Option<(Copy, bool)>,
    /// The highest number of any copy.
    highest: u32,
    /// Behind the last place that is not blank.
    next: u32,
}

impl<F: NorFlash> Record<F> {
    /// The notes in `flash`; all `0xFF` where there are none. Settles what a power cut left open.
    pub fn open(flash: F) -> Result<Self, RecordError> {
        const {
            assert!(COPY.is_multiple_of(F::WRITE_SIZE) && COPY.is_multiple_of(F::READ_SIZE));
        }
        let mut record = Self { flash, notes: [0xFF; NOTES], number: 0, half: 0, next: 0 };
        let size = record.half_bytes();
        if !(size as usize).is_multiple_of(F::ERASE_SIZE) || size < 2 * COPY as u32 * u32::from(COPIES) {
            return Err(NorFlashErrorKind::OutOfBounds.into());
        }
        let halves = [record.survey(0), record.survey(1)];
        record.number = halves[0].highest.max(halves[1].highest);
        let number = |half: &Half| half.best.map(|(copy, _)| copy.number);
        record.half = u32::from(number(&halves[1]) > number(&halves[0]));
        let Half { best, next, .. } = halves[record.half as usize];
        record.next = next;
        if let Some((copy, is_settled)) = best {
            record.notes = copy.notes;
            if is_settled && copy.number == record.number {
                return Ok(record);
            }
        } else {
            // Whatever lies there is no note; what was half erased is erased anew.
            record.half = 1;
            record.next = size;
        }
        record.store()?;
        Ok(record)
    }

    fn half_bytes(&self) -> u32 {
        self.flash.capacity() as u32 / 2
    }

    fn survey(&mut self, half: u32) -> Half {
        let mut found = Half::default();
        let mut run: Option<Copy> = None;
        for at in (0..self.half_bytes() / COPY as u32).map(|index| index * COPY as u32) {
            let mut bytes = [0; COPY];
            // What cannot be read is torn: a word whose error correction fails.
            let is_read = self.flash.read(half * self.half_bytes() + at, &mut bytes).is_ok();
            if is_read && bytes == [0xFF; COPY] {
                continue;
            }
            found.next = at + COPY as u32;
            let Some(copy) = Copy::parse(&bytes).filter(|_| is_read) else { continue };
            found.highest = found.highest.max(copy.number);
            let follows = run.is_some_and(|run| Copy { place: run.place + 1, ..run } == copy);
            if follows && found.best.is_none_or(|(best, _)| best.number <= copy.number) {
                found.best = Some((copy, copy.place + 1 == COPIES));
            }
            run = (follows || copy.place == 0).then_some(copy);
        }
        found
    }

    /// Appends the notes as they are now.
    fn store(&mut self) -> Result<(), RecordError> {
        self.number = self.number.wrapping_add(1);
        if self.append()? {
            return Ok(());
        }
        // Once only: the half that is left holds the notes that count until then.
        self.half = 1 - self.half;
        self.next = 0;
        let start = self.half * self.half_bytes();
        self.flash.erase(start, start + self.half_bytes()).map_err(below)?;
        if self.append()? { Ok(()) } else { Err(RecordError::Worn) }
    }

    /// Whether all copies found room in this half. A place that does not read as it was written is passed over.
    fn append(&mut self) -> Result<bool, RecordError> {
        let mut place = 0;
        while place < COPIES {
            let left = self.half_bytes().saturating_sub(self.next);
            if left < COPY as u32 * u32::from(COPIES - place) {
                return Ok(false);
            }
            let at = self.half * self.half_bytes() + self.next;
            let bytes = Copy { notes: self.notes, number: self.number, place }.to_bytes();
            self.next += COPY as u32;
            self.flash.write(at, &bytes).map_err(below)?;
            let mut back = [0; COPY];
            place += u8::from(self.flash.read(at, &mut back).is_ok() && back == bytes);
        }
        Ok(true)
    }
}

impl<F: NorFlash> ErrorType for Record<F> {
    type Error = RecordError;
}

impl<F: NorFlash> ReadNorFlash for Record<F> {
    const READ_SIZE: usize = 1;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), RecordError> {
        check_read(self, offset, bytes.len())?;
        bytes.copy_from_slice(&self.notes[offset as usize..offset as usize + bytes.len()]);
        Ok(())
    }

    fn capacity(&self) -> usize {
        NOTES
    }
}

impl<F: NorFlash> NorFlash for Record<F> {
    const WRITE_SIZE: usize = 1;
    const ERASE_SIZE: usize = 1;

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), RecordError> {
        check_write(self, offset, bytes.len())?;
        self.notes[offset as usize..offset as usize + bytes.len()].copy_from_slice(bytes);
        self.store()
    }

    fn erase(&mut self, from: u32, to: u32) -> Result<(), RecordError> {
        check_erase(self, from, to)?;
        self.notes[from as usize..to as usize].fill(0xFF);
        self.store()
    }
}
