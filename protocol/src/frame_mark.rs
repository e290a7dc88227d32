//! Which frame of the turn a picture is, told by the picture itself: where frames come as video, nothing else says so.
//!
//! The mark is the block of 8 × 8 pixels at the upper left, which a video link carries first, so that a controller knows a frame before it
//! is lit. Pixels are 24-bit words, R | G << 8 | B << 16. Those of one colour of a chessboard are the frame's number and its inverse, those
//! of the other colour the inverse of that: half of the block is lit in each plane, whatever the number.
//! Every bit must be as it is written. So a link that scales, dithers, mixes neighbours (YCbCr 4:2:0) or bends levels has no marks, and
//! the display stays dark, in place of showing planes that nearly are what they should be.

/// Pixels on a side.
pub const SIDE: u32 = 8;
/// Pixels of a mark.
pub const PIXELS: usize = (SIDE * SIDE) as usize;
/// Bits of a number; a turn has 170 frames at most ([`Rotation::SLICES_MAX`](crate::timing::Rotation::SLICES_MAX)).
const BITS: u32 = 12;
const LOW: u32 = (1 << BITS) - 1;
const WORD: u32 = (1 << (2 * BITS)) - 1;

/// The pixel at `column`, `row` of the mark of frame `frame`, modulo 4096.
pub const fn pixel(frame: u32, column: u32, row: u32) -> u32 {
    let number = frame & LOW;
    let word = number | (!number & LOW) << BITS;
    if (column + row).is_multiple_of(2) { word } else { !word & WORD }
}

/// The frame whose mark `pixels` are, row by row from the top, if they are one. The upper byte of a pixel is not looked at.
pub fn read(pixels: &[u32; PIXELS]) -> Option<u32> {
    let frame = pixels[0] & LOW;
    let is_as_written = |(place, found): (u32, &u32)| found & WORD == pixel(frame, place % SIDE, place / SIDE);
    (0..).zip(pixels).all(is_as_written).then_some(frame)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn mark(frame: u32) -> [u32; PIXELS] {
        core::array::from_fn(|place| pixel(frame, place as u32 % SIDE, place as u32 / SIDE))
    }

    #[test]
    fn every_plane_is_lit_in_half_of_the_block() {
        for frame in 0..=LOW {
            let mark = mark(frame);
            assert_eq!(read(&mark), Some(frame));
            (0..24)
                .for_each(|plane| assert_eq!(mark.iter().filter(|word| *word >> plane & 1 == 1).count(), PIXELS / 2));
        }
    }

    #[test]
    fn a_desktop_is_no_mark() {
        for word in [0, 0xFF_FFFF, 0x80_8080, 0xFF] {
            assert_eq!(read(&[word; PIXELS]), None);
        }
    }

    proptest! {
        #[test]
        fn one_flipped_bit_is_noticed(frame in 0..=LOW, place in 0..PIXELS, bit in 0u32..24) {
            let mut mark = mark(frame);
            mark[place] ^= 1u32 << bit;
            prop_assert_eq!(read(&mark), None);
        }

        #[test]
        fn levels_that_are_bent_are_noticed(frame in 0..=LOW, gamma in prop_oneof![0.3f64..0.97, 1.03f64..3.0]) {
            let bend = |level: u32| ((f64::from(level) / 255.0).powf(gamma) * 255.0).round() as u32;
            let bent = mark(frame).map(|word| bend(word & 255) | bend(word >> 8 & 255) << 8 | bend(word >> 16) << 16);
            prop_assert_eq!(read(&bent), None);
        }

        #[test]
        fn neighbours_that_are_mixed_are_noticed(frame in 0..=LOW) {
            let sharp = mark(frame);
            let mixed = core::array::from_fn(|place| {
                let beside = sharp[place ^ 1];
                (0..3).fold(0, |word, channel| {
                    let [one, other] = [sharp[place], beside].map(|word| word >> (8 * channel) & 255);
                    word | one.midpoint(other) << (8 * channel)
                })
            });
            prop_assert_eq!(read(&mixed), None);
        }

        #[test]
        fn noise_is_no_mark(pixels in prop::array::uniform8(prop::array::uniform8(0..1u32 << 24))) {
            prop_assert_eq!(read(pixels.as_flattened().try_into().unwrap()), None);
        }
    }
}
