//! Which pixels a triangle covers, and numbers that grow evenly over them.
//!
//! No closures where blocks are put together: the compiler does not inline them everywhere, and calls by block are slow.

use super::block::{Block, CENTRE, COLUMNS, ROWS};
use super::grid::Grid;
use super::setup::{Setup, wrapped};

/// A number that grows evenly over the image.
#[derive(Clone, Copy)]
pub struct Slope {
    /// At the centre of the first block.
    pub value: f32,
    pub across: f32,
    pub down: f32,
}

impl Slope {
    /// `columns` and `rows` from the centre of the first block.
    #[inline(always)]
    pub fn at(&self, [columns, rows]: [i32; 2]) -> f32 {
        self.value + self.across * columns as f32 + self.down * rows as f32
    }

    /// By how much it differs from that at its centre in the pixels of any block.
    #[inline(always)]
    pub fn offsets<B: Block>(&self) -> B {
        B::splat(wrapped(self.across)).mul(B::columns()).add(B::splat(wrapped(self.down)).mul(B::rows()))
    }

    /// Over the block that lies `columns` and `rows` from the first.
    #[inline(always)]
    pub fn block<B: Block>(&self, offset: [i32; 2], offsets: B) -> B {
        B::splat(wrapped(self.at(offset))).add(offsets)
    }
}

/// How the weights of a triangle's second and third corners grow over the image.
pub struct Weights([[f64; 3]; 2]);

impl Weights {
    /// Of `triangle`, from the centre of the block at `at`.
    #[inline(always)]
    pub fn new(triangle: &Corners, at: [i32; 2], grid: &Grid) -> Self {
        let steps = f64::from(grid.steps());
        let [origin, b, c] = triangle.0;
        let [bx, by] = [(b[0] - origin[0]) as f64 / steps, (b[1] - origin[1]) as f64 / steps];
        let [cx, cy] = [(c[0] - origin[0]) as f64 / steps, (c[1] - origin[1]) as f64 / steps];
        let area = bx * cy - by * cx;
        // What covers pixels by its steps may be a line by finer ones.
        let per_area = if area == 0.0 { 0.0 } else { 1.0 / area };
        let x = f64::from(at[0] + CENTRE[0] - grid.origin[0]) + 0.5 - origin[0] as f64 / steps;
        let y = f64::from(at[1] + CENTRE[1] - grid.origin[1]) + 0.5 - origin[1] as f64 / steps;
        let [b_across, b_down, c_across, c_down] = [cy * per_area, -cx * per_area, -by * per_area, bx * per_area];
        Self([[b_across * x + b_down * y, b_across, b_down], [c_across * x + c_down * y, c_across, c_down]])
    }

    /// What has `values` at the corners.
    #[inline(always)]
    pub fn slope(&self, values: [f32; 3]) -> Slope {
        let [second, third] = &self.0;
        let (one, other) = (f64::from(values[1] - values[0]), f64::from(values[2] - values[0]));
        Slope {
            value: values[0] + (second[0] * one + third[0] * other) as f32,
            across: (second[1] * one + third[1] * other) as f32,
            down: (second[2] * one + third[2] * other) as f32,
        }
    }
}

/// A triangle's corners: x and y in steps.
pub struct Corners(pub [[i64; 2]; 3]);

impl Corners {
    /// Twice the area on the right of the way between two corners, seen from `pixel`'s centre.
    pub fn edge(&self, from: usize, to: usize, [x, y]: [i64; 2]) -> i64 {
        let ([from_x, from_y], [to_x, to_y]) = (self.0[from], self.0[to]);
        (to_x - from_x) * (y - from_y) - (to_y - from_y) * (x - from_x)
    }

    /// The weights of the corners at the centre of `pixel`.
    pub fn weights(&self, pixel: [i32; 2], grid: &Grid) -> [f32; 3] {
        let at = centre(pixel, grid);
        let area = self.edge(0, 1, self.0[2]);
        [(1, 2), (2, 0), (0, 1)].map(|(from, to)| self.edge(from, to, at) as f32 / area as f32)
    }
}

/// A pixel's centre in steps.
fn centre(pixel: [i32; 2], grid: &Grid) -> [i64; 2] {
    [0, 1]
        .map(|axis| i64::from(pixel[axis] - grid.origin[axis]) * i64::from(grid.steps()) + i64::from(grid.steps() / 2))
}

impl Corners {
    /// The edge function from one corner to another of a triangle of positive area, not below 0 inside.
    fn side(&self, from: usize, to: usize, grid: &Grid) -> Side {
        let [across, down] = [0, 1].map(|axis| self.0[to][axis] - self.0[from][axis]);
        let owns_border = down < 0 || (down == 0 && across > 0);
        let steps = i64::from(grid.steps());
        Side { less: i64::from(!owns_border), growth: [-down * steps, across * steps] }
    }

    /// Bit by bit, which pixels of the block at `place` a triangle of positive area covers.
    pub fn covered(&self, place: [i32; 2], grid: &Grid) -> u32 {
        let start = centre(place, grid);
        let mut covered = u32::MAX;
        for (from, to) in EDGES {
            let side = self.side(from, to, grid);
            let value = self.edge(from, to, start) - side.less;
            // Most blocks are wholly inside.
            if value + side.least() >= 0 {
                continue;
            }
            let mut inside = 0;
            for pixel in 0..ROWS * COLUMNS {
                let [x, y] = [pixel % COLUMNS, pixel / COLUMNS].map(|offset| offset as i64);
                inside |= u32::from(value + side.growth[0] * x + side.growth[1] * y >= 0) << pixel;
            }
            covered &= inside;
        }
        covered
    }

    /// The first and the last of `columns` blocks side by side, the first one at `place`, that a triangle of positive area may cover some of.
    pub fn span(&self, place: [i32; 2], columns: i32, grid: &Grid) -> [i32; 2] {
        let start = centre(place, grid);
        let [mut first, mut last] = [0, i64::from(columns) - 1];
        for (from, to) in EDGES {
            let side = self.side(from, to, grid);
            let most = self.edge(from, to, start) - side.less + side.most();
            let growth = side.growth[0] * COLUMNS as i64;
            match growth {
                0 if most < 0 => return [0, -1],
                0 => {}
                1.. => first = first.max(-most.div_euclid(growth)),
                _ => last = last.min(most.div_euclid(-growth)),
            }
        }
        [first.min(i64::from(columns)) as i32, last.max(-1) as i32]
    }
}

const EDGES: [(usize, usize); 3] = [(1, 2), (2, 0), (0, 1)];

/// An edge function.
struct Side {
    /// What is taken off where the border belongs to the neighbour.
    less: i64,
    /// From pixel to pixel, across and down.
    growth: [i64; 2],
}

impl Side {
    /// By how much it is larger in a block than at its first pixel, at most.
    fn most(&self) -> i64 {
        self.growth[0].max(0) * (COLUMNS as i64 - 1) + self.growth[1].max(0) * (ROWS as i64 - 1)
    }

    /// The same, at least.
    fn least(&self) -> i64 {
        self.growth[0].min(0) * (COLUMNS as i64 - 1) + self.growth[1].min(0) * (ROWS as i64 - 1)
    }
}

/// The blocks that a triangle lies in.
pub struct Blocks {
    pub first: [i32; 2],
    pub columns: i32,
    pub rows: i32,
}

impl Blocks {
    #[inline(always)]
    pub fn new(first: [i32; 2], last: [i32; 2]) -> Self {
        Self { first, columns: (last[0] - first[0]) / COLUMNS as i32 + 1, rows: (last[1] - first[1]) / ROWS as i32 + 1 }
    }

    /// Those of a triangle that is drawn.
    #[inline(always)]
    pub fn of<const N: usize>(setup: &Setup<N>, lane: usize) -> Self {
        let (first, last) = (&setup.first, &setup.last);
        Self::new([first[0][lane], first[1][lane]], [last[0][lane], last[1][lane]])
    }

    #[inline(always)]
    pub fn at(&self, offset: [i32; 2]) -> [i32; 2] {
        [self.first[0] + offset[0], self.first[1] + offset[1]]
    }

    #[inline(always)]
    pub fn end(&self) -> [i32; 2] {
        self.at([self.columns * COLUMNS as i32, self.rows * ROWS as i32])
    }
}

/// The blocks of a triangle that it may cover something of, row by row, each with -1 for the pixels that are outside.
pub struct Covered<B> {
    blocks: [i32; 2],
    /// Columns and rows of blocks before the next.
    next: [i32; 2],
    /// Edge functions at the centres of the next block, and of the first one in its row: not below 0 inside.
    values: [i32; 3],
    row: [i32; 3],
    /// By how much they grow from block to block.
    across: [i32; 3],
    down: [i32; 3],
    /// By how much, at most, they are larger in a block than at its centre.
    reach: [i32; 3],
    /// By how much in every pixel.
    offsets: [B; 3],
}

impl<B: Block> Covered<B> {
    /// Those of `blocks`, all that the triangle lies in.
    #[inline(always)]
    pub fn new<const N: usize>(setup: &Setup<N>, lane: usize, blocks: &Blocks) -> Self {
        let row = [setup.edges[0][lane], setup.edges[1][lane], setup.edges[2][lane]];
        let across = [setup.across[0][lane], setup.across[1][lane], setup.across[2][lane]];
        let down = [setup.down[0][lane], setup.down[1][lane], setup.down[2][lane]];
        Self {
            blocks: [blocks.columns, blocks.rows],
            next: [0; 2],
            values: row,
            row,
            across: [across[0] * COLUMNS as i32, across[1] * COLUMNS as i32, across[2] * COLUMNS as i32],
            down: [down[0] * ROWS as i32, down[1] * ROWS as i32, down[2] * ROWS as i32],
            reach: [reach(across[0], down[0]), reach(across[1], down[1]), reach(across[2], down[2])],
            offsets: [offsets(across[0], down[0]), offsets(across[1], down[1]), offsets(across[2], down[2])],
        }
    }

    /// The next one: how many columns and rows of pixels it lies from the first, and where it is outside.
    #[inline(always)]
    pub fn next(&mut self) -> Option<([i32; 2], B)> {
        while self.next[1] < self.blocks[1] {
            let ([column, row], values) = (self.next, self.values);
            if column + 1 < self.blocks[0] {
                self.next[0] += 1;
                for edge in 0..3 {
                    self.values[edge] += self.across[edge];
                }
            } else {
                self.next = [0, row + 1];
                for edge in 0..3 {
                    self.row[edge] += self.down[edge];
                    self.values[edge] = self.row[edge];
                }
            }
            let highest = [values[0] + self.reach[0], values[1] + self.reach[1], values[2] + self.reach[2]];
            if (highest[0] | highest[1] | highest[2]) >= 0 {
                return Some(([column * COLUMNS as i32, row * ROWS as i32], outside(values, &self.offsets)));
            }
        }
        None
    }
}

/// Where a triangle that the first block holds is outside.
#[inline(always)]
pub fn outside_of_first<B: Block, const N: usize>(setup: &Setup<N>, lane: usize) -> B {
    let values = [setup.edges[0][lane], setup.edges[1][lane], setup.edges[2][lane]];
    let (across, down) = (&setup.across, &setup.down);
    outside(
        values,
        &[
            offsets(across[0][lane], down[0][lane]),
            offsets(across[1][lane], down[1][lane]),
            offsets(across[2][lane], down[2][lane]),
        ],
    )
}

/// By how much an edge function is larger at most in a block than at its centre.
#[inline(always)]
fn reach(across: i32, down: i32) -> i32 {
    (across * -CENTRE[0]).max(across * (CENTRE[0] - 1)) + (down * -CENTRE[1]).max(down * (CENTRE[1] - 1))
}

/// By how much it is in every pixel: within 16 bits, as [`super::setup`] sees to.
#[inline(always)]
fn offsets<B: Block>(across: i32, down: i32) -> B {
    B::splat(across as i16).mul(B::columns()).add(B::splat(down as i16).mul(B::rows()))
}

/// -1 for the pixels of a block where an edge function is below 0. What does not fit 16 bits has the sign of its nearest number that does.
#[inline(always)]
fn outside<B: Block>(values: [i32; 3], offsets: &[B; 3]) -> B {
    let one = B::splat(saturated(values[0])).add_saturating(offsets[0]);
    let two = B::splat(saturated(values[1])).add_saturating(offsets[1]);
    let three = B::splat(saturated(values[2])).add_saturating(offsets[2]);
    B::splat(0).above(one.or(two).or(three))
}

#[inline(always)]
fn saturated(value: i32) -> i16 {
    value.clamp(i16::MIN.into(), i16::MAX.into()) as i16
}
