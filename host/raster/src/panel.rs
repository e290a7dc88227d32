//! Which pixels show what one face reflects, found where somebody asks.

use super::block::{COLUMNS, ROWS};

/// Columns and rows of a small tile, and of a large one.
const SMALL: i32 = 8;
const LARGE: i32 = 32;

/// A face's pixels in one slice.
///
/// They make up a convex region, or nearly so, so that a tile on whose border all places agree is taken to be all alike. Where they do
/// not, small tiles are tried, and rows of those by bisection.
#[derive(Default)]
pub struct Panel {
    /// When a tile was found out: it holds where this is `now`.
    small: Vec<u32>,
    large: Vec<Large>,
    now: u32,
    /// Large tiles in a row.
    columns: i32,
    /// A bit for each pixel, eight columns a byte.
    pixels: Vec<u8>,
}

#[derive(Clone, Copy, Default)]
struct Large {
    found: u32,
    /// Whether all of it is alike, which its pixels say then.
    alike: bool,
}

impl Panel {
    /// Forgets all: another face or slice, of `size` pixels, is next.
    pub fn forget(&mut self, size: [i32; 2]) {
        // With room for blocks that reach over the edges.
        let [columns, rows] = size.map(|side| (side + COLUMNS as i32) / LARGE + 1);
        let tiles = (columns * rows) as usize;
        let smalls = tiles * ((LARGE / SMALL) * (LARGE / SMALL)) as usize;
        self.columns = columns;
        self.large.resize(tiles, Large::default());
        self.small.resize(smalls, 0);
        self.pixels.resize(smalls * SMALL as usize, 0);
        self.now += 1;
    }

    /// Bit by bit, which pixels of the block at `place` show what the face reflects: those for which `shows` says so.
    pub fn block(&mut self, [x, y]: [i32; 2], shows: &dyn Fn([i32; 2]) -> bool) -> u32 {
        for row in [y, y + ROWS as i32 - 1] {
            for column in [x, x + COLUMNS as i32 - 1] {
                self.find([column / SMALL * SMALL, row / SMALL * SMALL], shows);
            }
        }
        let bytes = |row: i32| {
            let at = self.byte([x, y + row]);
            let pair = u16::from_le_bytes([self.pixels[at], self.pixels.get(at + 1).copied().unwrap_or(0)]);
            u32::from((pair >> (x % 8)) as u8) << (row * COLUMNS as i32)
        };
        (0..ROWS as i32).map(bytes).sum()
    }

    fn byte(&self, [x, y]: [i32; 2]) -> usize {
        (y * self.columns * (LARGE / 8) + x / 8) as usize
    }

    /// Finds the small tile at `place` out, and the large one around it.
    fn find(&mut self, [x, y]: [i32; 2], shows: &dyn Fn([i32; 2]) -> bool) {
        let small = (y / SMALL * self.columns * (LARGE / SMALL) + x / SMALL) as usize;
        if self.small[small] == self.now {
            return;
        }
        let corner = [x / LARGE * LARGE, y / LARGE * LARGE];
        let large = (y / LARGE * self.columns + x / LARGE) as usize;
        if self.large[large].found != self.now {
            let alike = alike(corner, LARGE, shows);
            self.large[large] = Large { found: self.now, alike: alike.is_some() };
            if let Some(value) = alike {
                for row in 0..LARGE {
                    let at = self.byte([corner[0], corner[1] + row]);
                    self.pixels[at..][..(LARGE / 8) as usize].fill(if value { 0xFF } else { 0 });
                }
            }
        }
        if !self.large[large].alike {
            let value = alike([x, y], SMALL, shows);
            for row in y..y + SMALL {
                let at = self.byte([x, row]);
                self.pixels[at] = match value {
                    Some(value) => {
                        if value {
                            0xFF
                        } else {
                            0
                        }
                    }
                    None => row_of_tile([x, row], shows),
                };
            }
        }
        self.small[small] = self.now;
    }
}

/// What places around the border of the tile at `corner` have in common.
fn alike([x, y]: [i32; 2], side: i32, shows: &dyn Fn([i32; 2]) -> bool) -> Option<bool> {
    let last = side - 1;
    let value = shows([x, y]);
    let mut steps = (0..=4).map(|step| step * last / 4);
    let same = |[across, down]: [i32; 2]| shows([x + across, y + down]) == value;
    steps.all(|step| [[step, 0], [step, last], [0, step], [last, step]].into_iter().all(same)).then_some(value)
}

/// Eight pixels, of which those that show are together, at one end or in the middle.
fn row_of_tile([x, y]: [i32; 2], shows: &dyn Fn([i32; 2]) -> bool) -> u8 {
    let at = |column: i32| shows([x + column, y]);
    let (first, last) = (at(0), at(SMALL - 1));
    if first == last {
        return (0..SMALL).map(|column| u8::from(at(column)) << column).sum();
    }
    // The first column that is like the last.
    let (mut low, mut high) = (0, SMALL - 1);
    while high - low > 1 {
        let middle = (low + high) / 2;
        if at(middle) == last { high = middle } else { low = middle }
    }
    if last { 0xFF << high } else { !(0xFF << high) }
}
