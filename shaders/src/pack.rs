//! 24 slices to one RGB8 frame, and back.

use crate::halftone::plane_stride;
use crate::shuffle::shuffle;
use protocol::rig::PlaneOrder;

/// Packs 24 planes, one after the other as [`plane_stride`] lays them out, into an RGB8 frame, row major.
///
/// Plane p is bit p mod 8 of the channel that `order` names as number p div 8. `planes`: 24 × height × stride bytes;
/// `frame`: height × width × 3 bytes.
///
/// Written for the caller's vector instructions.
#[inline(always)]
pub fn pack(width: u32, height: u32, order: PlaneOrder, planes: &[u8], frame: &mut [u8]) {
    let stride = plane_stride(width);
    let plane_bytes = stride * height as usize;
    for (row, line) in frame.chunks_exact_mut(width as usize * 3).enumerate() {
        for (block, pixels) in line.chunks_mut(BLOCK * 8 * 3).enumerate() {
            let first = row * stride + block * BLOCK;
            let columns = pixels.len().div_ceil(8 * 3);
            let mut channels = [[0; BLOCK * 8]; 3];
            for (place, channel) in order.channels().into_iter().enumerate() {
                let plane = |plane: usize| &planes[(place * 8 + plane) * plane_bytes + first..][..columns];
                channels[channel] = merge(plane);
            }
            let [red, green, blue] = &channels;
            for (pixel, ((red, green), blue)) in pixels.chunks_exact_mut(3).zip(red.iter().zip(green).zip(blue)) {
                (pixel[0], pixel[1], pixel[2]) = (*red, *green, *blue);
            }
        }
    }
}

/// Bytes of a row that are packed at once.
const BLOCK: usize = 32;

/// Pixel by pixel a byte of the bits of 8 planes, from at most [`BLOCK`] bytes of each.
#[inline(always)]
fn merge<'a>(plane: impl Fn(usize) -> &'a [u8]) -> [u8; BLOCK * 8] {
    let mut rows = [[0; BLOCK]; 8];
    for (index, row) in rows.iter_mut().enumerate() {
        let plane = plane(index);
        // A copy of known length is a few instructions.
        match plane.try_into() {
            Ok(whole) => *row = whole,
            Err(_) => row[..plane.len()].copy_from_slice(plane),
        }
    }
    let mut columns = [0; BLOCK * 8];
    shuffle(rows.as_flattened(), &mut columns);
    shuffle(&columns, rows.as_flattened_mut());
    shuffle(rows.as_flattened(), &mut columns);
    for bytes in columns.as_chunks_mut().0 {
        *bytes = transpose(*bytes);
    }
    columns
}

/// The inverse of [`pack`].
pub fn unpack(width: u32, height: u32, order: PlaneOrder, frame: &[u8], planes: &mut [u8]) {
    let stride = plane_stride(width);
    let plane_bytes = stride * height as usize;
    for (row, line) in frame.chunks_exact(width as usize * 3).enumerate() {
        for (place, channel) in order.channels().into_iter().enumerate() {
            for (column, pixels) in line.chunks(24).enumerate() {
                let mut bytes = [0; 8];
                for (byte, pixel) in bytes.iter_mut().zip(pixels.chunks_exact(3)) {
                    *byte = pixel[channel];
                }
                for (bit, byte) in transpose(bytes).into_iter().enumerate() {
                    planes[(place * 8 + bit) * plane_bytes + row * stride + column] = byte;
                }
            }
        }
    }
}

/// Transposes an 8 × 8 matrix of bits: bit j of byte i becomes bit i of byte j (Warren, Hacker's Delight, 7-3).
#[inline(always)]
fn transpose(rows: [u8; 8]) -> [u8; 8] {
    let mut bits = u64::from_le_bytes(rows);
    for (shift, mask) in [(7, 0x00AA_00AA_00AA_00AA), (14, 0x0000_CCCC_0000_CCCC), (28, 0x0000_0000_F0F0_F0F0)] {
        let swap = (bits ^ bits >> shift) & mask;
        bits ^= swap ^ swap << shift;
    }
    bits.to_le_bytes()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn plane_k_is_bit_k_of_the_word() {
        for plane in 0..24 {
            let (width, height) = (10, 3);
            let mut planes = vec![0; 24 * 2 * 3];
            planes[plane * 6 + 2 + 1] = 0b10; // pixel (9, 1)
            let mut frame = vec![0xFF; 90];
            pack(width, height, PlaneOrder::Rgb, &planes, &mut frame);
            let words: Vec<_> = frame
                .chunks_exact(3)
                .map(|pixel| u32::from(pixel[0]) | u32::from(pixel[1]) << 8 | u32::from(pixel[2]) << 16)
                .collect();
            let expected: Vec<_> = (0..30).map(|pixel| if pixel == 19 { 1 << plane } else { 0 }).collect();
            assert_eq!(words, expected);
        }
    }

    #[test]
    fn dlpc350_shows_green_first() {
        let mut planes = vec![0; 24];
        planes[0] = 1;
        let mut frame = [0; 3];
        pack(1, 1, PlaneOrder::Grb, &planes, &mut frame);
        assert_eq!(frame, [0, 1, 0]);
    }

    proptest! {
        #[test]
        fn packing_is_a_bijection(
            width in prop_oneof![1u32..40, 250u32..300], height in 1u32..5, seed: u64,
            order in prop::sample::select(vec![PlaneOrder::Rgb, PlaneOrder::Grb, PlaneOrder::Bgr, PlaneOrder::Gbr]),
        ) {
            let mut state = seed;
            let mut frame: Vec<u8> = (0..width * height * 3).map(|_| {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
                (state >> 56) as u8
            }).collect();
            let expected = frame.clone();
            let mut planes = vec![0xFF; 24 * plane_stride(width) * height as usize];
            unpack(width, height, order, &frame, &mut planes);
            frame.fill(0);
            pack(width, height, order, &planes, &mut frame);
            prop_assert_eq!(frame, expected);
        }
    }
}
