//! Power is cut within each operation of an update, one after the other, in each way that leaves something else behind.

use crate::bench::{Device, image};
use hil_sim::flash::Tear;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

/// Starts after a cut until all is at rest: a trial, what follows from it, and one to spare.
const STARTS_MAX: u32 = 3;

/// The images of a bench: what runs, what comes, what comes after that.
struct Story<const W: usize, const S: usize> {
    pages: usize,
    images: [Vec<u8>; 3],
    is_good: bool,
}

impl<const W: usize, const S: usize> Story<W, S> {
    fn new(pages: usize, is_good: bool) -> Self {
        let most = Device::<W, S>::code_bytes(pages);
        // The new one is shorter than the old one: the slot's last words keep something else.
        Self { pages, images: [image(1, most), image(2, most - 192), image(3, most - 64)], is_good }
    }

    fn device(&self, seed: u64) -> Device<W, S> {
        Device::with(&self.images[0], self.pages, seed)
    }

    /// Operations of an update without a cut; the first ones install the old image.
    fn operations(&self) -> std::ops::Range<u64> {
        let mut device = self.device(0);
        let first = device.chip.borrow().operations();
        device.update(&self.images[1], self.is_good).unwrap();
        let expected = &self.images[usize::from(self.is_good)];
        assert_eq!(device.runs(&self.images[..2]), expected);
        assert_eq!(device.chip.borrow().misuse(), None);
        let last = device.chip.borrow().operations();
        0..last - first
    }

    /// Cuts power, lets it come back, and looks at what is left. `more` cuts follow, each so many operations after power is back.
    fn cut(&self, at: u64, tear: Tear, more: &[(u64, Tear)]) {
        let mut device = self.device(at);
        device.chip.borrow_mut().cut_after(at, tear);
        let is_cut = device.update(&self.images[1], self.is_good).is_none();
        assert!(is_cut || !more.is_empty(), "no operation {at}");
        for &(after, tear) in more {
            device.chip.borrow_mut().cut_after(after, tear);
            let _ = device.rest(self.is_good);
        }
        device.chip.borrow_mut().cut_no_more();
        device.settle(self.is_good, STARTS_MAX);
        let runs = device.runs(&self.images[..2]);
        assert!(self.is_good || *runs == self.images[0], "an image stays that failed its test");
        // Nothing is stuck: the next update works. Half the time goes into it, so it is seen after every cut in one way only.
        if more.is_empty() && tear != Tear::ALL[at as usize % Tear::ALL.len()] {
            return;
        }
        device.update(&self.images[2], true).expect("no more cuts");
        assert_eq!(device.runs(&self.images), &self.images[2]);
        assert_eq!(device.chip.borrow().misuse(), None);
    }

    fn every_cut(&self) {
        let operations = self.operations();
        println!("{operations:?} operations: {W}-byte words, {S}-byte sectors, each torn in {} ways", Tear::ALL.len());
        operations.clone().into_par_iter().for_each(|at| {
            for tear in Tear::ALL {
                let outcome = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| self.cut(at, tear, &[])));
                assert!(outcome.is_ok(), "power cut at operation {at} of {operations:?}, which leaves {tear:?}");
            }
        });
    }

    fn many_cuts(&self, seed: u64, runs: u64) {
        let operations = self.operations();
        (0..runs).into_par_iter().for_each(|run| {
            let mut random = ChaCha8Rng::seed_from_u64(seed ^ run << 32);
            let mut tear = || Tear::ALL[random.random_range(0..Tear::ALL.len())];
            let tears = [tear(), tear(), tear(), tear()];
            let first = random.random_range(operations.clone());
            // The ways back are shorter than the whole: half the cuts come soon.
            let mut soon = || {
                let most = if random.random() { 20 } else { operations.end / 2 };
                random.random_range(0..most)
            };
            let more = [(soon(), tears[1]), (soon(), tears[2]), (soon(), tears[3])];
            let outcome = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| self.cut(first, tears[0], &more)));
            assert!(outcome.is_ok(), "seed {seed}, run {run}: cuts {first} {:?}, then {more:?}", tears[0]);
        });
    }
}

/// Words and sectors of an STM32H743, its sectors scaled down from 128 KiB.
#[test]
fn an_update_survives_every_cut() {
    Story::<32, 1024>::new(3, true).every_cut();
}

#[test]
fn an_image_that_fails_its_test_goes_away_through_every_cut() {
    Story::<32, 1024>::new(3, false).every_cut();
}

/// Shorter words and sectors; the way back takes in all that the way there does.
#[test]
fn another_chip_survives_every_cut() {
    Story::<16, 512>::new(3, false).every_cut();
}

#[test]
fn cuts_upon_cuts_are_survived() {
    for is_good in [true, false] {
        Story::<32, 1024>::new(3, is_good).many_cuts(1, 300);
    }
}
