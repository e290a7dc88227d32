//! What lies in a slot and is no image of this owner for this board never runs, wherever it lies and whatever the notes say; and an image that
//! is one runs wherever the loader finds it.

use crate::bench::{Device, image, key, owner, signed};
use ed25519_dalek::SigningKey;
use embassy_boot::BlockingFirmwareState;
use embedded_storage::nor_flash::NorFlash;
use hil_sim::flash::Tear;
use protocol::image::{Board, HEADER_BYTES, Header};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use update::loader::Decision;

const WORD: usize = 32;
const SECTOR: usize = 1024;
const PAGES: usize = 3;
type Bench = Device<WORD, SECTOR>;

/// Each kind of garbage, in words.
const KINDS: [&str; 7] =
    ["random bytes", "another key", "another board", "cut short", "a changed bit", "too long a code", "nothing"];

fn garbage(kind: &str, random: &mut ChaCha8Rng) -> Vec<u8> {
    let mut good = image(1, Bench::code_bytes(PAGES));
    let unsigned = good.len() - 64;
    let mut with_header = |change: &dyn Fn(&mut Header)| {
        let mut header = Header::parse(&good).unwrap();
        change(&mut header);
        good[..HEADER_BYTES].copy_from_slice(&header.to_bytes());
        signed(&key(), good[..unsigned].to_vec())
    };
    match kind {
        "random bytes" => (0..WORD * random.random_range(1..90)).map(|_| random.random()).collect(),
        "another key" => signed(&SigningKey::from_bytes(&[8; 32]), good[..unsigned].to_vec()),
        "another board" => with_header(&|header| header.board = Board::new("other").unwrap()),
        "cut short" => good[..WORD * random.random_range(0..good.len() / WORD)].to_vec(),
        "a changed bit" => {
            let at = random.random_range(0..good.len());
            good[at] ^= 1 << random.random_range(0..8);
            good
        }
        "too long a code" => with_header(&|header| header.code_bytes += 64),
        _ => Vec::new(),
    }
}

/// A device whose slots hold garbage, but for the place where `good` is put: the active slot, the spare one, or a page into it.
fn filled(seed: u64, good: Option<usize>) -> (Bench, String) {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let device = Bench::with(&[], PAGES, seed);
    let [mut active, mut spare, mut notes] = device.regions();
    let kinds = [KINDS[random.random_range(0..KINDS.len())], KINDS[random.random_range(0..KINDS.len())]];
    let whole = image(1, Bench::code_bytes(PAGES));
    let mut fill = |place: usize, kind: &str| {
        if good == Some(place) { whole.clone() } else { garbage(kind, &mut random) }
    };
    active.write(0, &fill(0, kinds[0])).unwrap();
    // Only one of them has room.
    let at = if good == Some(2) || good != Some(1) && seed.is_multiple_of(2) { 2 } else { 1 };
    spare.write(if at == 2 { SECTOR as u32 } else { 0 }, &fill(at, kinds[1])).unwrap();
    let note = ["no notes", "random notes", "an update is wanted"][random.random_range(0..3)];
    match note {
        "random notes" => notes.write(0, &(0..SECTOR).map(|_| random.random()).collect::<Vec<u8>>()).unwrap(),
        "an update is wanted" if good != Some(2) => {
            let mut record = update::record::Record::open(notes).unwrap();
            BlockingFirmwareState::new(&mut record, &mut [0]).mark_updated().unwrap();
        }
        _ => {}
    }
    // A sector that does not read.
    if good != Some(0) && random.random() {
        device.chip.borrow_mut().cut_after(0, Tear::Unreadable);
        let _ = active.erase(0, SECTOR as u32);
    }
    (device, format!("seed {seed}, {good:?} is good: {kinds:?}, {note}"))
}

#[test]
fn garbage_never_runs() {
    (0..150u64).into_par_iter().for_each(|seed| {
        let (mut device, what) = filled(seed, None);
        for _ in 0..4 {
            let (decision, mut slots) = device.start().unwrap();
            assert!(matches!(decision, Decision::Wait(_)), "{what}: {decision:?}");
            assert!(slots.boot(&owner()).is_ok_and(|again| again == decision), "{what}");
        }
        let images = [image(2, Bench::code_bytes(PAGES))];
        let (_, mut slots) = device.start().unwrap();
        device.send(&mut slots, &images[0]).unwrap();
        device.rest(true).unwrap();
        device.runs(&images);
    });
}

#[test]
fn what_is_signed_runs_from_wherever_it_lies() {
    let images = [image(1, Bench::code_bytes(PAGES))];
    (0..150u64).into_par_iter().for_each(|seed| {
        let (mut device, what) = filled(seed, Some((seed % 3) as usize));
        assert!(std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| device.rest(true))).is_ok(), "{what}");
        device.runs(&images);
    });
}

/// A version that has been confirmed and then damaged, with power that is cut in each way within each operation of its way back.
#[test]
fn the_old_image_comes_back_for_one_that_is_damaged_later() {
    let images = [1, 2].map(|version: u16| image(version, Bench::code_bytes(PAGES) - 64 * usize::from(version)));
    let damaged = |tear: Tear| {
        let mut device = Bench::with(&images[0], PAGES, 5);
        device.update(&images[1], true).unwrap();
        device.runs(&images[1..]);
        let [mut active, ..] = device.regions();
        device.chip.borrow_mut().cut_after(1, tear);
        let _ = active.erase(0, 2 * SECTOR as u32);
        assert!(device.chip.borrow().is_off());
        device
    };
    let operations = {
        let mut device = damaged(Tear::Unreadable);
        let before = device.chip.borrow().operations();
        device.rest(true).unwrap();
        device.runs(&images[..1]);
        device.chip.borrow().operations() - before
    };
    println!("{operations} operations, each torn in {} ways", Tear::ALL.len());
    (0..operations).into_par_iter().for_each(|at| {
        for tear in Tear::ALL {
            let mut device = damaged(tear);
            device.chip.borrow_mut().cut_after(at, tear);
            let outcome = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| device.settle(true, 4)));
            assert!(outcome.is_ok(), "power cut at operation {at}, which leaves {tear:?}");
            device.runs(&images[..1]);
        }
    });
}
