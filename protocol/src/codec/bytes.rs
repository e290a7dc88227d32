//! Planes of any halftone: each byte by a prefix code, for the neighbourhood that it has.
//!
//! Error diffusion lights so many pixels in so much room, and never two together: how many the bytes around have, and on which colour of
//! a checkerboard the byte above has them, foretells a byte. The codes were learnt from a turn and sent before; see
//! [`ByteCodes`](super::byte_codes::ByteCodes).
//!
//! A run's bytes come row of pixels by row of pixels, from left to right, 8 rows; those below the plane are 0 and come as well.

use super::ExpandError;
use super::bits::BitReader;
use super::codebook::Codebook;
use super::mask::BLOCK;
use super::walk::{Coding, Run};

#[cfg(feature = "std")]
pub(super) mod compress;

/// Expands bytes. All that it knows lies in the plane.
#[derive(Clone, Debug)]
pub(super) struct Bytes;

impl Coding for Bytes {
    const NEW: Self = Self;
    const STEPS: usize = BLOCK;

    fn head(&mut self, _: &Codebook, _: &mut BitReader<'_>) {}

    fn begin_run(&mut self, _: usize, _: usize) {}

    fn end_row(&mut self, _: usize, _: usize) {}

    #[inline(always)]
    fn steps(
        &mut self,
        book: &Codebook,
        run: Run,
        mut step: usize,
        bits: &mut BitReader<'_>,
        plane: &mut [u8],
    ) -> Result<usize, ExpandError> {
        let columns = (run.end - run.start).max(1);
        let (mut y, mut column) = (run.row * BLOCK + step / columns, run.start + step % columns);
        while step < BLOCK * columns && bits.has_code() {
            let (byte, length) = book.codes.read(context(plane, run.stride, y, column), bits.peek());
            bits.skip(length);
            if let Some(place) = plane.get_mut(y * run.stride + column) {
                *place = byte;
            }
            step += 1;
            column += 1;
            if column == run.end {
                (y, column) = (y + 1, run.start);
            }
        }
        Ok(step)
    }
}

/// The neighbourhood of the byte in row `y` of pixels: what is to the left, above, two above, and above to the right. All of it has been
/// expanded before, or is dark.
#[inline(always)]
fn context(plane: &[u8], stride: usize, y: usize, column: usize) -> usize {
    let at = y * stride + column;
    let byte = |back: usize, is_there: bool| {
        let place = at.checked_sub(back).filter(|_| is_there);
        place.and_then(|place| plane.get(place)).copied().unwrap_or(0)
    };
    let above = byte(stride, true);
    let around = [byte(1, column > 0), above, byte(2 * stride, true), byte(stride - 1, column + 1 < stride)];
    let density = u32::from_le_bytes(around).count_ones() / 2;
    3 * density as usize + usize::from(PHASES[usize::from(above)])
}

/// Whether more odd pixels of a byte are lit, as many, or more even ones.
const PHASES: [u8; 256] = {
    let mut phases = [1; 256];
    let mut byte = 0usize;
    while byte < 256 {
        let (even, odd) = ((byte & 0x55).count_ones(), (byte & 0xaa).count_ones());
        if even != odd {
            phases[byte] = if even > odd { 2 } else { 0 };
        }
        byte += 1;
    }
    phases
};
