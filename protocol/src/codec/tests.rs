use super::*;
use proptest::prelude::*;

/// Ranks of a mask `side` pixels wide, in an order that a seed gives.
fn ranks(side: u16, seed: u64) -> Vec<u16> {
    let (mut ranks, mut state): (Vec<u16>, _) = ((0..side * side).collect(), seed);
    for place in (1..ranks.len()).rev() {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ranks.swap(place, (state >> 33) as usize % (place + 1));
    }
    ranks
}

/// Ranks of a mask 64 pixels wide of which each block has one rank in every 64.
fn even_ranks() -> Vec<u16> {
    let pixels = ranks(8, 5);
    let rank = |x: usize, y: usize| pixels[y % 8 * 8 + x % 8] * 64 + (y / 8 * 8 + x / 8) as u16;
    (0..64 * 64).map(|cell| rank(cell % 64, cell / 64)).collect()
}

/// Lengths of codes that were learnt from a few pictures, so that some are long.
fn lengths() -> Vec<u8> {
    let size = ImageSize::new(200, 100).unwrap();
    let mut statistics = ByteStatistics::default();
    statistics.add(&disc(size, |x, y| (x ^ y) & 1 == 0), size.row_bytes());
    statistics.add(&disc(size, |x, y| (x * 5 + y * 3) % 11 < 4), size.row_bytes());
    statistics.lengths()
}

fn book() -> &'static Codebook {
    static BOOK: std::sync::OnceLock<Codebook> = std::sync::OnceLock::new();
    BOOK.get_or_init(|| {
        let mut book = Codebook::EMPTY;
        book.mask.set(even_ranks().into_iter()).unwrap();
        book.codes.set(&lengths()).unwrap();
        book
    })
}

fn compressed_by(plane: &[u8], size: ImageSize, hint: Hint) -> Vec<u8> {
    let mut out = Vec::new();
    let mut compressor = Compressor::new(size);
    compressor.set_mask(book().mask.clone());
    compressor.set_codes(&lengths()).unwrap();
    compressor.compress(plane, hint, &mut out);
    out
}

fn compressed(plane: &[u8], size: ImageSize) -> Vec<u8> {
    compressed_by(plane, size, Hint::None)
}

fn expand<'a>(pieces: impl IntoIterator<Item = &'a [u8]>, size: ImageSize, check: u64) -> Result<Vec<u8>, ExpandError> {
    // What lay there before must not matter.
    let mut plane = vec![0xa5; size.plane_bytes()];
    let mut expander = Expander::new(size);
    pieces.into_iter().try_for_each(|piece| expander.push(piece, book(), &mut plane))?;
    expander.finish(book(), &mut plane, check)?;
    Ok(plane)
}

fn picture(size: ImageSize, is_lit: impl Fn(u32, u32) -> bool) -> Vec<u8> {
    let mut plane = vec![0; size.plane_bytes()];
    for (x, y) in (0..size.height()).flat_map(|y| (0..size.width()).map(move |x| (x, y))) {
        plane[y as usize * size.row_bytes() + x as usize / 8] |= u8::from(is_lit(x, y)) << (x % 8);
    }
    plane
}

fn disc(size: ImageSize, keep: impl Fn(u32, u32) -> bool) -> Vec<u8> {
    picture(size, |x, y| {
        let (dx, dy) = (2 * x as i32 - size.width() as i32, 2 * y as i32 - size.height() as i32);
        dx * dx + dy * dy < (size.width() * size.height()) as i32 / 2 && keep(x, y)
    })
}

/// A plane halftoned by the mask of [`book`] with its ranks moved by `shift`; `luminance` is of 4096.
fn halftoned(size: ImageSize, shift: u16, luminance: impl Fn(u32, u32) -> u16) -> Vec<u8> {
    let ranks = even_ranks();
    picture(size, |x, y| (ranks[(y % 64 * 64 + x % 64) as usize] + shift) % 4096 < luminance(x, y))
}

/// Small planes that use every coding and every kind of run and block, with how they were halftoned.
fn corpus() -> Vec<(ImageSize, Vec<u8>, Hint)> {
    let size = |width, height| ImageSize::new(width, height).unwrap();
    let runs = run_corpus().into_iter().map(|(size, plane)| (size, plane, Hint::None));
    let blocks = [
        (size(8, 8), 0, halftoned(size(8, 8), 0, |_, _| 2000)),
        (size(100, 61), 1234, halftoned(size(100, 61), 1234, |x, y| (x * 30 + y * 11).saturating_sub(300) as u16)),
        (size(72, 64), 4095, halftoned(size(72, 64), 4095, |x, y| if (x / 9 + y / 7) % 2 == 0 { 300 } else { 3_700 })),
        // Halftoned by something else, and not at all.
        (size(40, 24), 77, disc(size(40, 24), |x, y| (x ^ y) & 1 == 0)),
        (size(24, 24), 9, vec![0; 72]),
    ];
    let diffused = [
        (size(8, 8), picture(size(8, 8), |x, y| (x ^ y) & 1 == 0)),
        (size(100, 45), disc(size(100, 45), |x, y| (x * 5 + y * 3) % 11 < 4)),
        (size(24, 24), vec![0x93; 72]),
        (size(24, 24), vec![0; 72]),
    ];
    let masked = blocks.map(|(size, shift, plane)| (size, plane, Hint::Mask { shift }));
    runs.chain(masked).chain(diffused.map(|(size, plane)| (size, plane, Hint::Diffusion))).collect()
}

fn run_corpus() -> Vec<(ImageSize, Vec<u8>)> {
    let size = |width, height| ImageSize::new(width, height).unwrap();
    let noise = |x: u32, y: u32| x.wrapping_mul(2_654_435_761).wrapping_add(y * 40_503 + x * y * 97) >> 5 & 3 == 0;
    vec![
        (size(1, 1), vec![1]),
        (size(13, 5), disc(size(13, 5), |_, _| true)),
        (size(64, 40), vec![0; 320]),
        (size(64, 40), vec![0x5a; 320]),
        (size(96, 48), disc(size(96, 48), |_, _| true)),
        (size(96, 48), disc(size(96, 48), noise)),
        (size(64, 24), (0..192).map(|byte: u32| (byte * 151 % 251) as u8).collect()),
    ]
}

#[test]
fn the_bytes_of_the_runs() {
    let size = ImageSize::new(8 * 100, 3).unwrap();
    let mut plane = vec![0; 300];
    plane[2..5].copy_from_slice(&[7, 8, 9]);
    plane[10..16].fill(0xaa);
    let above = plane[..100].to_vec();
    plane[100..200].copy_from_slice(&above);
    // 0 0 7 8 9 | 5 zeros | 6 x aa | 86 zeros = 62 + 24 | 100 above = 62 + 38 | 98 zeros = 62 + 36
    let expected = [0x00, 0x04, 0, 0, 7, 8, 9, 0x44, 0x85, 0xaa, 0x7d, 24, 0xfd, 38, 0x7d, 36];
    assert_eq!(compressed(&plane, size), expected);
    assert_eq!(expand([&expected[..]], size, plane_check(&plane)), Ok(plane));
    assert_eq!(plane_check(b"123456789"), 0x995d_c9bb_df19_39fa, "CRC-64/XZ as everybody knows it");
}

#[test]
fn the_check_of_a_host_is_that_of_a_controller() {
    let bytes: Vec<u8> = (0..5000u32).map(|byte| (byte * byte / 7) as u8).collect();
    for length in (0..300).chain([4999, 5000]) {
        assert_eq!(plane_check(&bytes[..length]), CRC_64.checksum(&bytes[..length]));
    }
}

#[test]
fn a_run_that_does_not_belong_is_refused() {
    let size = ImageSize::new(16, 4).unwrap();
    let refused = |stream: &[u8]| expand([stream], size, 0).unwrap_err();
    assert_eq!(refused(&[0, 0x48]), ExpandError::TooLong { at: 0, length: 9 });
    assert_eq!(refused(&[0, 0x47, 0x40]), ExpandError::TooLong { at: 8, length: 1 });
    assert_eq!(refused(&[0, 0x7f, 255, 255, 255]), ExpandError::TooLong { at: 0, length: 62 + 0xff_ffff });
    assert_eq!(refused(&[0, 0x40, 0xc0]), ExpandError::NothingAbove { at: 1 });
    assert_eq!(refused(&[0, 0x46]), ExpandError::Truncated { at: 7, needed: 8 });
    assert_eq!(refused(&[0, 0x07, 1, 2]), ExpandError::Truncated { at: 2, needed: 8 });
    assert_eq!(refused(&[0, 0x47, 0x7d]), ExpandError::Truncated { at: 8, needed: 8 });
    assert!(matches!(refused(&[0, 0x47]), ExpandError::Check { expected: 0, .. }));
    let memory = Expander::new(size).push(&[0, 0x47], &Codebook::EMPTY, &mut [0; 9]);
    assert_eq!(memory, Err(ExpandError::Memory { given: 9, needed: 8 }));
}

#[test]
fn no_truncation_and_no_bit_flip_gives_a_wrong_plane() {
    for (size, plane, hint) in corpus() {
        let (stream, check) = (compressed_by(&plane, size, hint), plane_check(&plane));
        assert_eq!(expand([&stream[..]], size, check).as_ref(), Ok(&plane));
        for length in 0..stream.len() {
            expand([&stream[..length]], size, check).expect_err("truncated");
        }
        for bit in 0..stream.len() * 8 {
            let mut flipped = stream.clone();
            flipped[bit / 8] ^= 1 << (bit % 8);
            // Another run may mean the same picture: zeros for a copy of a dark row.
            let found = expand([&flipped[..]], size, check);
            assert!(found.is_err() || found.as_ref() == Ok(&plane), "bit {bit}");
        }
        for bit in 0..64 {
            let wrong = check ^ 1 << bit;
            assert_eq!(expand([&stream[..]], size, wrong), Err(ExpandError::Check { expected: wrong, found: check }));
        }
        let long = [&stream[..], &[0x40]].concat();
        assert!(matches!(
            expand([&long[..]], size, check),
            Err(ExpandError::TooLong { .. } | ExpandError::Trailing { .. })
        ));
    }
}

#[test]
fn what_was_not_sent_before_is_refused() {
    let size = ImageSize::new(16, 8).unwrap();
    let push = |bytes: &[u8], book: &Codebook| Expander::new(size).push(bytes, book, &mut [0; 16]);
    assert_eq!(push(&[3, 0], book()), Err(ExpandError::Coding { coding: 3 }));
    for coding in [1, 2] {
        assert_eq!(push(&[coding, 0], &Codebook::EMPTY), Err(ExpandError::NotKnown));
    }
    assert_eq!(expand([], size, 0), Err(ExpandError::Truncated { at: 0, needed: 16 }));
}

#[test]
fn a_mask_holds_each_rank_once() {
    let set = |ranks: Vec<u16>| Mask::NONE.clone().set(ranks.into_iter());
    for side in [8, 16, 32, 64] {
        assert_eq!(set(ranks(side, 3)), Ok(()));
    }
    assert_eq!(set(vec![]), Err(MaskError::Size { ranks: 0 }));
    assert_eq!(set((0..24 * 24).collect()), Err(MaskError::Size { ranks: 576 }));
    let mut twice = ranks(8, 3);
    twice[9] = twice[30];
    assert_eq!(set(twice.clone()), Err(MaskError::Ranks { rank: twice[9], largest: 63 }));
    twice[9] = 64;
    assert_eq!(set(twice), Err(MaskError::Ranks { rank: 64, largest: 63 }));
}

#[test]
fn knowledge_comes_in_parts_that_may_repeat() {
    use crate::message::Knowledge::{Codes, Mask};
    let (mut book, lengths) = (Codebook::EMPTY, lengths());
    let mut learn = |kind, offset: usize, total, bytes: &[u8]| {
        let learnt = book.learn(kind, [offset, total], bytes);
        (learnt, book.codes.is_set(), book.mask.is_set())
    };
    let (half, total) = (LENGTHS_BYTES / 2, LENGTHS_BYTES);
    let wrong = |offset, end, expected| Err(LearnError::Part { offset, end, total, expected });
    assert_eq!(learn(Codes, half, total, &lengths[half..]), (wrong(half, total, 0), false, false));
    for _ in 0..2 {
        assert_eq!(learn(Codes, 0, total, &lengths[..half]), (Ok(()), false, false));
        assert_eq!(learn(Mask, half, total, &lengths[half..]), (wrong(half, total, 0), false, false));
        assert_eq!(
            learn(Codes, half, total, &[lengths.clone(), vec![0]].concat()[half..]),
            (wrong(half, total + 1, half), false, false)
        );
        for _ in 0..2 {
            assert_eq!(learn(Codes, half, total, &lengths[half..]), (Ok(()), true, false));
        }
    }
    let ranks: Vec<u8> = ranks(8, 3).iter().flat_map(|rank| rank.to_le_bytes()).collect();
    assert_eq!(learn(Mask, 0, 128, &ranks), (Ok(()), true, true));
    let too_long = LearnError::Part { offset: 0, end: 512, total: 9_000, expected: 0 };
    assert_eq!(learn(Mask, 0, 9_000, &[0; 512]), (Err(too_long), true, false));
    book.forget();
    assert!(!book.codes.is_set());
}

#[test]
fn codes_are_complete_or_refused() {
    let set = |lengths: &[u8]| ByteCodes::NONE.clone().set(lengths);
    let good = lengths();
    assert_eq!(set(&good), Ok(()));
    assert_eq!(set(&good[1..]), Err(ByteCodesError::Size { given: LENGTHS_BYTES - 1 }));
    // Eight bits for every byte is a complete code; one byte in nine is not, nor one in none.
    let mut eight = vec![0x88; LENGTHS_BYTES];
    assert_eq!(set(&eight), Ok(()));
    for wrong in [0x89, 0x80, 0x87, 0xf8] {
        eight[3 * 128 + 70] = wrong;
        assert_eq!(set(&eight), Err(ByteCodesError::Lengths { context: 3 }), "{wrong:#x}");
    }
}

#[test]
fn codes_are_as_short_as_the_bytes_allow() {
    // Bytes that halve in frequency from one to the next: their codes grow by a bit each, up to the longest.
    let size = ImageSize::new(8, 4080).unwrap();
    let bytes = (0..11u8).flat_map(|rank| std::iter::repeat_n(0xff ^ rank, 1 << (10 - rank)));
    let plane: Vec<u8> = bytes.flat_map(|byte| [byte, 0]).take(4080).collect();
    let mut statistics = ByteStatistics::default();
    statistics.add(&plane, size.row_bytes());
    let lengths = statistics.lengths();
    assert_eq!(ByteCodes::NONE.clone().set(&lengths), Ok(()));
    let mut compressor = Compressor::new(size);
    compressor.set_codes(&lengths).unwrap();
    let mut out = Vec::new();
    compressor.compress(&plane, Hint::Diffusion, &mut out);
    // Two bits for a byte that is half of all, a bit for what follows it, and a bit for each row of blocks.
    assert!(out.len() < 4080 * 2 / 8, "{}", out.len());
}

#[test]
fn even_luminance_costs_two_bits_a_block_and_a_slope_little_more() {
    let size = ImageSize::new(512, 512).unwrap();
    let bits = |shift, luminance: &dyn Fn(u32, u32) -> u16| {
        let bytes = compressed_by(&halftoned(size, shift, luminance), size, Hint::Mask { shift }).len();
        8.0 * bytes as f64 / (64.0 * 64.0)
    };
    for shift in [0, 64, 704, 4032] {
        assert!(bits(shift, &|_, _| 2048) < 2.05, "{shift}");
        let slope = bits(shift, &|x, y| (x * 4 + y * 2) as u16);
        assert!(slope < 2.5, "{shift}: {slope}");
    }
}

#[test]
fn a_plane_without_runs_hardly_grows() {
    let size = ImageSize::new(768, 768).unwrap();
    let mut state = 1u64;
    let noise: Vec<u8> = (0..size.plane_bytes())
        .map(|_| {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            (state >> 56) as u8
        })
        .collect();
    assert!(compressed(&noise, size).len() <= size.plane_bytes() + 65);
    let sparse: Vec<u8> = noise.iter().enumerate().map(|(at, byte)| if at % 70 < 66 { *byte } else { 0 }).collect();
    assert!(compressed(&sparse, size).len() <= size.plane_bytes() + size.plane_bytes() / 64 + 5);
    assert_eq!(compressed(&vec![0; size.plane_bytes()], size).len(), 5);
}

#[test]
fn the_check_of_a_turn_reads_number_order_and_count() {
    let check = turn_check(1, [3, 4, 5]);
    for other in [turn_check(2, [3, 4, 5]), turn_check(1, [4, 3, 5]), turn_check(1, [3, 4])] {
        assert_ne!(check, other);
    }
    assert_eq!(check, turn_check(1, vec![3, 4, 5]));
}

proptest! {
    #[test]
    fn any_plane_comes_back_from_any_pieces(
        width in 1u32..200, height in 1u32..30, kinds in prop::collection::vec((0usize..4, 1usize..300, any::<u8>()), 1..30),
        pieces in prop::collection::vec(1usize..50, 1..10),
        hint in prop_oneof![Just(Hint::None), Just(Hint::Diffusion), (0u16..4096).prop_map(|shift| Hint::Mask { shift })],
    ) {
        let size = ImageSize::new(width, height).unwrap();
        let row = size.row_bytes();
        let mut plane = vec![0u8; size.plane_bytes()];
        let mut at = 0;
        for (kind, length, seed) in kinds.into_iter().cycle().take(4000) {
            for index in at..(at + length).min(plane.len()) {
                plane[index] = match kind {
                    0 => seed,
                    1 => 0,
                    2 if index >= row => plane[index - row],
                    _ => (index * index * 31 + usize::from(seed)) as u8,
                };
            }
            at += length;
        }
        let stream = compressed_by(&plane, size, hint);
        prop_assert!(hint != Hint::None || stream.len() <= plane.len() + plane.len() / 64 + 5);
        let (mut rest, mut pieces, mut cut) = (&stream[..], pieces.into_iter().cycle(), Vec::new());
        while !rest.is_empty() {
            let (piece, after) = rest.split_at(pieces.next().unwrap().min(rest.len()));
            cut.push(piece);
            rest = after;
        }
        prop_assert_eq!(expand(cut, size, plane_check(&plane)).unwrap(), plane);
    }

    #[test]
    fn any_bytes_are_expanded_or_refused(
        coding in 0u8..4, mut stream in prop::collection::vec(any::<u8>(), 0..200), check: u64,
    ) {
        let size = ImageSize::new(100, 20).unwrap();
        stream.insert(0, coding);
        if let Ok(plane) = expand([&stream[..]], size, check) {
            prop_assert_eq!(plane_check(&plane), check);
        }
    }
}
