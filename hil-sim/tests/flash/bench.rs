//! A device with an image in it, newer ones for it, and what it does when it is switched on.

use ed25519_dalek::{Digest, Sha512, Signer, SigningKey};
use embedded_storage::nor_flash::{NorFlash, ReadNorFlash};
use hil_sim::flash::{Chip, Region};
use protocol::image::{BLOCK, Board, HEADER_BYTES, Header, SIGNATURE_BYTES, Version};
use std::cell::RefCell;
use std::rc::Rc;
use update::image::Owner;
use update::loader::{Decision, Slots, Stage};
use update::updater::{Accept, Transfer};

/// Words and sectors of the chip, pages of the active slot, sectors of the notes.
pub struct Device<const WORD: usize, const SECTOR: usize> {
    pub chip: Rc<RefCell<Chip<WORD, SECTOR>>>,
    pages: usize,
    pub owner: Owner,
    /// How many times it was switched on.
    pub starts: u32,
}

pub fn key() -> SigningKey {
    SigningKey::from_bytes(&[7; 32])
}

pub fn owner() -> Owner {
    Owner { board: Board::new("bench").unwrap(), key: key().verifying_key().to_bytes() }
}

/// Signed code of `code_bytes` bytes that no other version's is like.
pub fn image(version: u16, code_bytes: usize) -> Vec<u8> {
    let version_number = Version { major: 1, minor: version, patch: 0 };
    let header =
        Header { board: owner().board, version: version_number, code_bytes: code_bytes as u32, schema: 0, build: 0 };
    let code = (0..code_bytes).map(|at| (at as u8).wrapping_mul(31) ^ (version as u8));
    signed(&key(), header.to_bytes().into_iter().chain(code).collect())
}

pub fn signed(key: &SigningKey, mut image: Vec<u8>) -> Vec<u8> {
    image.extend(key.sign(&Sha512::digest(&image)).to_bytes());
    image
}

pub type BenchSlots<const W: usize, const S: usize> = Slots<Region<W, S>, Region<W, S>, Region<W, S>>;

impl<const W: usize, const S: usize> Device<W, S> {
    /// With `image` in its active slot of `pages` sectors.
    pub fn with(image: &[u8], pages: usize, seed: u64) -> Self {
        let notes = 2 * 512usize.div_ceil(S).max(1);
        let chip = Rc::new(RefCell::new(Chip::blank(2 * pages + 1 + notes, seed)));
        let device = Self { chip, pages, owner: owner(), starts: 0 };
        let [mut active, ..] = device.regions();
        active.write(0, image).unwrap();
        device
    }

    pub fn regions(&self) -> [Region<W, S>; 3] {
        let sectors = self.chip.borrow().bytes() / S;
        Region::split(&self.chip, [self.pages, self.pages + 1, sectors - 2 * self.pages - 1])
    }

    /// The longest code that fits.
    pub fn code_bytes(pages: usize) -> usize {
        (pages * S - HEADER_BYTES - SIGNATURE_BYTES) / BLOCK * BLOCK
    }

    /// Switches it on; nothing where power fails again before it has decided.
    pub fn start(&mut self) -> Option<(Decision, BenchSlots<W, S>)> {
        self.chip.borrow_mut().power_on();
        self.starts += 1;
        let [active, spare, notes] = self.regions();
        let outcome = Slots::open(active, spare, notes).and_then(|mut slots| {
            let decision = slots.boot(&self.owner)?;
            Ok((decision, slots))
        });
        self.unless_off(outcome)
    }

    /// What came of it; nothing where power failed. No other error is expected.
    pub fn unless_off<T, E: std::fmt::Debug>(&self, outcome: Result<T, E>) -> Option<T> {
        match outcome {
            Ok(value) => Some(value),
            Err(_) if self.chip.borrow().is_off() => None,
            Err(error) => panic!("an error without a power cut: {error:?}"),
        }
    }

    /// Sends a whole image in blocks of a kibibyte; nothing where power fails.
    pub fn send(&self, slots: &mut BenchSlots<W, S>, image: &[u8]) -> Option<()> {
        let mut transfer = Transfer::new(self.owner, Accept::Newer);
        for block in image.chunks(1024) {
            self.unless_off(transfer.take(slots, block))?;
        }
        self.unless_off(transfer.finish(slots)).map(|_| ())
    }

    /// An update to `image` that runs into a power cut or not. The new image confirms itself, or finds that it is bad.
    pub fn update(&mut self, image: &[u8], is_good: bool) -> Option<()> {
        let (_, mut slots) = self.start()?;
        self.send(&mut slots, image)?;
        self.rest(is_good)
    }

    /// Switches it on until nothing is left to do.
    pub fn rest(&mut self, is_good: bool) -> Option<()> {
        loop {
            let (decision, mut slots) = self.start()?;
            match decision {
                Decision::Try(..) => {
                    let outcome = if is_good { slots.confirm() } else { slots.give_up() };
                    self.unless_off(outcome)?;
                }
                Decision::Run(_) => {
                    assert_eq!(slots.stage().unwrap(), Stage::Settled);
                    return Some(());
                }
                Decision::Wait(refusal) => panic!("nothing boots: {refusal}"),
            }
        }
    }

    /// The same, through every cut; at most `most` starts.
    pub fn settle(&mut self, is_good: bool, most: u32) {
        let before = self.starts;
        while self.rest(is_good).is_none() {}
        let starts = self.starts - before;
        assert!(starts <= most, "{starts} starts");
    }

    /// Which of `images` the active slot holds, to the last byte.
    pub fn runs<'a>(&self, images: &'a [Vec<u8>]) -> &'a Vec<u8> {
        let [mut active, ..] = self.regions();
        let mut bytes = vec![0; active.capacity()];
        active.read(0, &mut bytes).unwrap();
        images.iter().find(|image| bytes.starts_with(image)).expect("the active slot holds neither image")
    }
}
