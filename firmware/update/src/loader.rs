//! What the boot loader does before it jumps: finishes what was cut off, verifies, tries, takes back.
//!
//! | notes say | then |
//! |---|---|
//! | nothing, or that all is well | what is in the active slot runs, if it is signed |
//! | that an update is wanted | it is verified again; a signed one is swapped in, anything else is forgotten |
//! | that a swap or its way back was cut off | it is carried on |
//! | that a new image runs on trial | it runs again, [`TRIALS`] times in all; then the old one comes back, if it is still signed |
//!
//! Without a signed image in the active slot a signed one in the other slot takes its place: one that was downloaded, else the old one that the
//! last swap left there. Without any, nothing runs and the loader waits for one over USB.

use crate::image::{Owner, Refusal};
use crate::record::{NOTES, Record, RecordError};
use embassy_boot::{BlockingFirmwareState, BootError, BootLoader, BootLoaderConfig, FirmwareUpdaterError, State};
use embedded_storage::nor_flash::{NorFlash, NorFlashError, NorFlashErrorKind, ReadNorFlash};
use protocol::image::{BLOCK, Header};
use thiserror::Error;

/// Starts that a new image has to confirm itself. One could fail by a power cut that is not its fault.
pub const TRIALS: usize = 3;
/// Where the notes of the starts on trial stand, a byte each, behind those of `embassy-boot`.
const TRIALS_AT: usize = NOTES - TRIALS;
/// Two bytes, four a page, and one that is never written, where `embassy-boot` stops counting.
const PAGES_MAX: usize = (TRIALS_AT - 3) / 4;
/// What `embassy-boot` writes for [`State::Swap`].
const SWAP: u8 = 0xF0;
/// Forget, swap, take back: no path through the table above is longer.
const ROUNDS: usize = 6;

/// Why the loader cannot decide. The watchdog starts it again.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum LoaderError {
    /// A flash fails.
    #[error("flash: {0:?}")]
    Flash(NorFlashErrorKind),
    /// The notes are not kept.
    #[error(transparent)]
    Record(#[from] RecordError),
    /// `embassy-boot` asserts these; here they are an error.
    #[error("slots that do not fit each other: allowed are up to 12 pages, and one more in the second")]
    Layout,
    /// A flash that changes under the loader's hands.
    #[error("the slots do not come to rest")]
    Restless,
}

impl From<BootError> for LoaderError {
    fn from(error: BootError) -> Self {
        match error {
            BootError::Flash(kind) => Self::Flash(kind),
            BootError::BadMagic => Self::Restless,
        }
    }
}

impl From<FirmwareUpdaterError> for LoaderError {
    fn from(error: FirmwareUpdaterError) -> Self {
        match error {
            FirmwareUpdaterError::Flash(kind) => Self::Flash(kind),
            _ => Self::Restless,
        }
    }
}

/// What runs now.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Decision {
    /// The image in the active slot.
    Run(Header),
    /// The same, which must test and [confirm](Slots::confirm) itself: this is its how-manieth start, from 1.
    Try(Header, usize),
    /// Nothing: why the active slot does not. The loader waits for an image over USB.
    Wait(Refusal),
}

/// Where an update stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage {
    /// All is well.
    Settled,
    /// A mark was cut off when the active slot was whole.
    Marking,
    /// Wanted, nothing swapped.
    Wanted,
    /// Begun, either way.
    Swapping,
    /// Swapped in, and so many times started.
    Trial(usize),
}

/// The two slots and the notes.
#[derive(Debug)]
pub struct Slots<A, D, S> {
    /// What runs.
    pub active: A,
    /// What will run: larger than `active` by a page or more.
    pub spare: D,
    /// How far the swap is.
    pub record: Record<S>,
}

impl<A: NorFlash, D: NorFlash, S: NorFlash> Slots<A, D, S> {
    /// What is swapped at once, in bytes: the larger sector of the two slots.
    pub const PAGE: u32 = if A::ERASE_SIZE > D::ERASE_SIZE { A::ERASE_SIZE as u32 } else { D::ERASE_SIZE as u32 };

    /// The slots `active` and `spare`, with the notes in `notes`.
    pub fn open(active: A, spare: D, notes: S) -> Result<Self, LoaderError> {
        let (runs, spares, page) = (active.capacity(), spare.capacity(), Self::PAGE as usize);
        let is_whole = runs.is_multiple_of(page) && spares.is_multiple_of(page) && page.is_multiple_of(BLOCK);
        let is_aligned = [A::WRITE_SIZE, D::WRITE_SIZE].iter().all(|&size| BLOCK.is_multiple_of(size));
        if !is_whole || !is_aligned || runs == 0 || runs / page > PAGES_MAX || spares < runs + page {
            return Err(LoaderError::Layout);
        }
        Ok(Self { active, spare, record: Record::open(notes)? })
    }

    /// Where an update stands.
    pub fn stage(&mut self) -> Result<Stage, LoaderError> {
        let mut notes = [0; NOTES];
        self.record.read(0, &mut notes)?;
        let page_copies = 2 * self.active.capacity() / Self::PAGE as usize;
        let progress = notes[2..TRIALS_AT].iter().take_while(|&&byte| byte != 0xFF).count();
        Ok(if State::from(&notes[..1]) != State::Swap {
            Stage::Settled
        } else if notes[1] != 0xFF {
            Stage::Marking
        } else if progress == 0 {
            Stage::Wanted
        } else if progress == page_copies {
            Stage::Trial(notes[TRIALS_AT..].iter().filter(|&&byte| byte != 0xFF).count())
        } else {
            Stage::Swapping
        })
    }

    /// What runs now. Every signature is verified anew; the slots are at rest when it returns.
    pub fn boot(&mut self, owner: &Owner) -> Result<Decision, LoaderError> {
        let most = self.active.capacity() as u32;
        for _ in 0..ROUNDS {
            match self.stage()? {
                Stage::Settled => match owner.verify(&mut self.active, 0, most) {
                    Ok(header) => return Ok(Decision::Run(header)),
                    Err(_) if owner.verify(&mut self.spare, 0, most).is_ok() => self.mark(Mark::Swap)?,
                    // After a swap the old image stands a page further on.
                    Err(_) if owner.verify(&mut self.spare, Self::PAGE, most).is_ok() => self.mark(Mark::TakeBack)?,
                    Err(refusal) => return Ok(Decision::Wait(refusal)),
                },
                Stage::Wanted if owner.verify(&mut self.spare, 0, most).is_err() => self.mark(Mark::Booted)?,
                Stage::Marking => self.mark(Mark::Booted)?,
                Stage::Wanted => {
                    self.make_way(owner)?;
                    self.move_pages()?;
                }
                Stage::Swapping => self.move_pages()?,
                Stage::Trial(starts) => {
                    let tried = owner.verify(&mut self.active, 0, most);
                    match tried {
                        Ok(header) if starts < TRIALS => {
                            self.record.write((TRIALS_AT + starts) as u32, &[0])?;
                            return Ok(Decision::Try(header, starts + 1));
                        }
                        _ if owner.verify(&mut self.spare, Self::PAGE, most).is_ok() => {
                            self.make_way(owner)?;
                            self.move_pages()?;
                        }
                        // There is no way back: what is signed stays.
                        _ => self.mark(Mark::Booted)?,
                    }
                }
            }
        }
        Err(LoaderError::Restless)
    }

    /// Swaps, or takes back, or carries on with either: `embassy-boot` knows which.
    fn move_pages(&mut self) -> Result<(), LoaderError> {
        let Self { active, spare, record } = self;
        let mut loader = BootLoader::new(BootLoaderConfig { active, dfu: spare, state: record });
        let mut buffer = embassy_boot::AlignedBuffer([0; BLOCK]);
        loader.prepare_boot(buffer.as_mut())?;
        Ok(())
    }

    /// Pages are swapped, and a word of the active slot that does not read would stop that for ever: a slot with one, or with nothing that may run,
    /// is blank before. Only where what takes its place has been verified and nothing is swapped yet; power that fails finds all as it was.
    fn make_way(&mut self, owner: &Owner) -> Result<(), LoaderError> {
        let end = self.active.capacity() as u32;
        let mut block = [0; BLOCK];
        let is_whole = owner.verify(&mut self.active, 0, end).is_ok()
            && (0..end).step_by(BLOCK).all(|at| self.active.read(at, &mut block).is_ok());
        if is_whole { Ok(()) } else { self.active.erase(0, end).map_err(|error| LoaderError::Flash(error.kind())) }
    }

    fn mark(&mut self, mark: Mark) -> Result<(), LoaderError> {
        if mark == Mark::TakeBack {
            // As behind a swap whose trials are used up. All at once: half of it would be half a swap.
            let page_copies = 2 * self.active.capacity() / Self::PAGE as usize;
            let mut notes = [0xFF; NOTES];
            notes[0] = SWAP;
            notes[2..].iter_mut().take(page_copies).for_each(|note| *note = 0);
            notes[TRIALS_AT..].fill(0);
            return Ok(self.record.write(0, &notes)?);
        }
        let mut word = [0];
        let mut state = BlockingFirmwareState::new(&mut self.record, &mut word);
        match mark {
            Mark::Booted => state.mark_booted()?,
            Mark::Swap | Mark::TakeBack => state.mark_updated()?,
        }
        Ok(())
    }
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Mark {
    Booted,
    Swap,
    TakeBack,
}

/// What a running image does about its trial.
impl<A: NorFlash, D: NorFlash, S: NorFlash> Slots<A, D, S> {
    /// The image has tested itself and stays.
    pub fn confirm(&mut self) -> Result<(), LoaderError> {
        if matches!(self.stage()?, Stage::Trial(_)) { self.mark(Mark::Booted) } else { Ok(()) }
    }

    /// The image has failed its test: the next start takes the old one back.
    pub fn give_up(&mut self) -> Result<(), LoaderError> {
        if matches!(self.stage()?, Stage::Trial(_)) {
            self.record.write(TRIALS_AT as u32, &[0; TRIALS])?;
        }
        Ok(())
    }
}
