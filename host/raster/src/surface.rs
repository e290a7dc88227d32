//! What is drawn on: the nearest of what lies on each pixel.

use super::block::{Block, COLUMNS, PIXELS, ROWS};
use super::tile::Tile;

/// A cell on which nothing lies: farther than everything, and dark.
const EMPTY: i16 = i16::MAX;

/// Cells of an image, row by row, with room at the right and at the bottom for blocks that reach over its edges.
pub struct Cells {
    cells: Vec<i16>,
    stride: u32,
}

impl Cells {
    /// For images of `size` pixels.
    fn new([width, height]: [i32; 2], value: i16) -> Self {
        // Whole blocks laid end to end, too.
        let stride = (width as usize + COLUMNS).next_multiple_of(PIXELS);
        Self { cells: vec![value; stride * (height as usize + ROWS)], stride: stride as u32 }
    }

    #[inline(always)]
    fn at(&self, [x, y]: [i32; 2]) -> usize {
        y as usize * self.stride as usize + x as usize
    }

    #[inline(always)]
    fn load<B: Block>(&self, place: [i32; 2]) -> B {
        B::load(&self.cells, self.at(place), self.stride)
    }

    #[inline(always)]
    fn store<B: Block>(&mut self, place: [i32; 2], block: B) {
        let at = self.at(place);
        block.store(&mut self.cells, at, self.stride);
    }
}

/// Takes what triangles leave on pixels.
pub trait Surface {
    /// Lays `luminance` at `depth` on the pixels of the block at `place`, but for those that are `outside` or nearer already.
    fn put<B: Block>(&mut self, place: [i32; 2], outside: B, depth: B, luminance: B);

    /// Which pixels [`Surface::put`] might change; more of them, in doubt.
    fn open<B: Block>(&self, place: [i32; 2], outside: B, depth: B) -> u32;
}

/// Depth and bit in one number, so that the nearer wins with its bit: the lowest one, set for dark.
pub struct Bits {
    cells: Cells,
    /// What decides about bits.
    pub tile: Tile,
}

impl Bits {
    /// Dark.
    pub fn new(size: [i32; 2]) -> Self {
        Self { cells: Cells::new(size, EMPTY), tile: Tile::default() }
    }

    /// Writes the rows `top` to `bottom`, columns `left` to `right`, of an image `width` pixels wide to `plane`, and empties them.
    #[inline(always)]
    pub fn take<B: Block>(
        &mut self,
        [left, right]: [i32; 2],
        [top, bottom]: [i32; 2],
        [width, height]: [i32; 2],
        plane: &mut [u8],
    ) {
        let stride = (width as usize).div_ceil(8);
        if left >= right {
            return;
        }
        let left = left as usize / PIXELS;
        let blocks = (right as usize).div_ceil(PIXELS) - left;
        let spare = (stride * 8 - width as usize) as u32;
        for y in top..bottom {
            let at = self.cells.at([(left * PIXELS) as i32, y]);
            let cells = &mut self.cells.cells[at..][..blocks * PIXELS];
            let row = if y < height { &mut plane[y as usize * stride..][..stride] } else { &mut [] };
            let bytes = row.get_mut(left * (PIXELS / 8)..).unwrap_or(&mut []);
            let mut whole = bytes.chunks_mut(PIXELS / 8);
            for cells in cells.chunks_exact_mut(PIXELS) {
                let dark = B::load(cells, 0, COLUMNS as u32).mul(B::splat(i16::MIN)).negative();
                let lit = (!dark).to_le_bytes();
                match whole.next() {
                    // Most often, and then one store.
                    Some([a, b, c, d]) => [*a, *b, *c, *d] = lit,
                    Some(bytes) => bytes.copy_from_slice(&lit[..bytes.len()]),
                    None => {}
                }
                B::splat(EMPTY).store(cells, 0, COLUMNS as u32);
            }
            if let Some(last) = row.last_mut().filter(|_| spare > 0) {
                *last &= 0xFF >> spare;
            }
        }
    }
}

impl Surface for Bits {
    #[inline(always)]
    fn put<B: Block>(&mut self, place: [i32; 2], outside: B, depth: B, luminance: B) {
        let lit = luminance.above(self.tile.block(place));
        // Where it is outside, the sum wraps to the last of all numbers, elsewhere it is the first.
        let limit = outside.add(B::splat(i16::MIN));
        // Odd, and one less where it is lit.
        let key = depth.or(B::splat(1)).add(lit).max(limit);
        let cells: B = self.cells.load(place);
        self.cells.store(place, cells.min(key));
    }

    #[inline(always)]
    fn open<B: Block>(&self, place: [i32; 2], outside: B, depth: B) -> u32 {
        let lit = depth.and(B::splat(!1));
        let cells: B = self.cells.load(place);
        cells.above(lit).and_not(outside).negative()
    }
}

/// Depth and luminance.
pub struct Greys {
    depths: Cells,
    luminances: Cells,
}

impl Greys {
    /// Dark.
    pub fn new(size: [i32; 2]) -> Self {
        Self { depths: Cells::new(size, EMPTY), luminances: Cells::new(size, 0) }
    }

    /// Calls `pixels` with the row and the luminances of each row `top` to `bottom` of the image, and darkens them.
    pub fn take(&mut self, [top, bottom]: [i32; 2], [width, height]: [i32; 2], mut pixels: impl FnMut(usize, &[i16])) {
        for y in top..bottom {
            let at = self.depths.at([0, y]);
            let stride = self.depths.stride as usize;
            if y < height {
                pixels(y as usize, &self.luminances.cells[at..][..width as usize]);
            }
            self.depths.cells[at..][..stride].fill(EMPTY);
            self.luminances.cells[at..][..stride].fill(0);
        }
    }
}

impl Surface for Greys {
    #[inline(always)]
    fn put<B: Block>(&mut self, place: [i32; 2], outside: B, depth: B, luminance: B) {
        let depths: B = self.depths.load(place);
        let nearer = depths.above(depth).and_not(outside);
        self.depths.store(place, nearer.select(depth, depths));
        let luminances: B = self.luminances.load(place);
        self.luminances.store(place, nearer.select(luminance, luminances));
    }

    #[inline(always)]
    fn open<B: Block>(&self, place: [i32; 2], outside: B, depth: B) -> u32 {
        let depths: B = self.depths.load(place);
        depths.above(depth).and_not(outside).negative()
    }
}
