//! `embassy-boot` on a bare state partition: why the notes have a record of their own.

use embassy_boot::{AlignedBuffer, BlockingFirmwareState, BootLoader, BootLoaderConfig, State};
use embedded_storage::nor_flash::{NorFlash, ReadNorFlash};
use hil_sim::flash::{Chip, Region, Tear};
use std::cell::RefCell;
use std::rc::Rc;

const WORD: usize = 32;
const PAGE: usize = 1024;
const PAGES: usize = 3;
type Part = Region<WORD, PAGE>;

fn filled(seed: u8) -> Vec<u8> {
    (0..PAGES * PAGE).map(|at| (at / 64) as u8 ^ seed).collect()
}

/// A start, by `embassy-boot`'s own example: swap or take back, then the image confirms itself. Nothing where it fails.
fn start(parts: &[Part; 3]) -> Option<()> {
    let [active, dfu, state] = parts.clone();
    let mut loader = BootLoader::new(BootLoaderConfig { active, dfu, state });
    let decided = loader.prepare_boot(&mut AlignedBuffer([0; 64]).0).ok()?;
    if decided == State::Swap {
        BlockingFirmwareState::new(parts[2].clone(), &mut [0; WORD]).mark_booted().ok()?;
    }
    Some(())
}

/// Whether one of the two images is whole after a cut in an update; nothing where there is no such operation.
fn survives(at: u64, tear: Tear) -> Option<bool> {
    let chip = Rc::new(RefCell::new(Chip::<WORD, PAGE>::blank(2 * PAGES + 2, at)));
    let parts = Region::split(&chip, [PAGES, PAGES + 1, 1]);
    let [mut active, mut dfu, _] = parts.clone();
    active.write(0, &filled(1)).unwrap();
    dfu.write(0, &filled(2)).unwrap();
    chip.borrow_mut().cut_after(at, tear);
    let marked = BlockingFirmwareState::new(parts[2].clone(), &mut [0; WORD]).mark_updated();
    let _ = marked.ok().and_then(|()| start(&parts));
    if !chip.borrow().is_off() {
        return None;
    }
    let mut settled = None;
    for _ in 0..6 {
        chip.borrow_mut().power_on();
        settled = start(&parts);
    }
    let mut bytes = vec![0; PAGES * PAGE];
    let is_read = active.read(0, &mut bytes).is_ok();
    Some(settled.is_some() && is_read && (bytes == filled(1) || bytes == filled(2)))
}

#[test]
fn embassy_boot_alone_is_broken_by_cuts_within_its_state() {
    let mut broken = Vec::new();
    for tear in Tear::ALL {
        let all: Vec<bool> = (0..).map_while(|at| survives(at, tear)).collect();
        let count = all.iter().filter(|survived| !**survived).count();
        println!("{tear:?}: {count} of {} cuts leave a mixture, or nothing that starts", all.len());
        broken.push((tear, count));
    }
    let of = |tear| broken.iter().find(|(other, _)| *other == tear).unwrap().1;
    assert!(of(Tear::Unreadable) + of(Tear::Unstable) + of(Tear::SecondHalf) > 0, "no record is needed any more");
}
