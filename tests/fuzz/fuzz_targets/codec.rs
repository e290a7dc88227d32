//! Any bytes as a compressed plane, in pieces: a refusal, or a plane that has the check that was sent with it.

#![no_main]

use protocol::codec::{ByteStatistics, Codebook, Expander, ImageSize, plane_check};
use std::sync::LazyLock;

/// A mask of 8 × 8, and codes of which some are short and some are long.
static BOOK: LazyLock<Codebook> = LazyLock::new(|| {
    let mut book = Codebook::EMPTY;
    book.mask.set((0..64u16).map(|cell| cell * 37 % 64)).expect("a mask");
    let mut statistics = ByteStatistics::default();
    let plane: Vec<u8> = (0..2_000u32).map(|at| (at * at / 7 >> (at % 8)) as u8).collect();
    statistics.add(&plane, 20);
    book.codes.set(&statistics.lengths()).expect("complete codes");
    book
});

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    let [width, height, piece, stream @ ..] = bytes else { return };
    let Ok(size) = ImageSize::new((*width).into(), (*height).into()) else { return };
    let mut plane = vec![0xa5; size.plane_bytes()];
    let mut expander = Expander::new(size);
    let pieces = stream.chunks(usize::from(*piece).max(1));
    if pieces.map(|piece| expander.push(piece, &BOOK, &mut plane)).any(|pushed| pushed.is_err()) {
        return;
    }
    // The right check for whatever this is, so that the end is reached.
    let check = {
        let (mut expander, mut plane) = (expander.clone(), plane.clone());
        let _ = expander.finish(&BOOK, &mut plane, 0);
        plane_check(&plane)
    };
    if expander.finish(&BOOK, &mut plane, check).is_ok() {
        assert_eq!(plane_check(&plane), check);
    }
});
