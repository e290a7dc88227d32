//! Halftone by local search: bits that leave the least error once an eye has blurred it.
//!
//! The energy of bits b for luminance l is |G ∗ (b − l)|², G a Gaussian as wide as the eye's blur: a quadratic form with the kernel
//! K = G ⋆ G. Flipping a pixel p changes it by ±2 c(p) + K(0), where c = K ∗ (b − l) is kept up to date flip by flip. Pixels at
//! the same place of 10 × 10 tiles are a phase. K ends within 7 pixels, so that a phase's pixels and their neighbours do not see
//! each other, and c is an integer, so that sums do not depend on their order: a phase may be decided in any order, or all at once.
//!
//! What other slices show to the same eyes enters as a field that is added to c: see [`Search::add_field`].

use super::{Blur, plane_stride};
use core::array::from_fn;

/// Sweeps of [`improve`]. A pixel in 40 flips in the first one, a pixel in 600 in the fourth.
const SWEEPS: u32 = 4;

/// Improves the bits of `plane` for an eye with `blur`; see [`super::halftone`] for the rest.
///
/// Half of the time are sums written for the caller's vector instructions.
#[inline(always)]
pub fn improve(blur: Blur, width: u32, luminance: &[f32], plane: &mut [u8]) {
    let kernel = Kernel::sampled(blur);
    let mut search = Search::new(&kernel, width, luminance, plane);
    for _ in 0..SWEEPS {
        search.sweep(&kernel, Moves::Flips);
    }
    search.write(width, plane);
}

/// Side of a tile: a sweep has [`TILE`]² phases.
const TILE: usize = 10;
/// K reaches this many pixels.
const REACH: usize = 7;
/// Columns of the kernel's table: 2 [`REACH`] + 1, and one to fill up.
const COLUMNS: usize = ROWS + 1;
const ROWS: usize = 2 * REACH + 1;
/// The sum of K's entries, from which its scale follows: however wrong the bits are, c fits.
const KERNEL_SUM: f64 = 27_000.0;
/// A field is held within this, so that it fits with c.
const FIELD_MAX: f32 = 5_000.0;

/// K in fixed point.
#[derive(Clone, Debug)]
pub struct Kernel {
    taps: [[i16; COLUMNS]; ROWS],
    /// K as a sum of products of a column's taps and a row's.
    factors: Vec<[[f32; ROWS]; 2]>,
}

impl Kernel {
    /// The kernel of an eye's blur.
    pub fn new(blur: Blur) -> Self {
        Self::of(blur, |_, _| 1.0)
    }

    /// The kernel of an eye, or a camera, that takes the slice by points and then blurs. Points [`SPACING`] σ apart meet some pixels
    /// once and others twice, and the beat between them and dots that alternate pixel by pixel is seen through any blur. Over all
    /// places of the points, two pixels weigh the mean product of their numbers of points.
    pub fn sampled(blur: Blur) -> Self {
        let [first, second] = axes(blur.0.map(f64::from)).map(|[u, v]| {
            let length = u.hypot(v).max(1e-9);
            // Points closer than a quarter of a pixel weigh all pixels alike.
            [u, v].map(|value| value / length * (SPACING * length).max(0.25))
        });
        let [across, along] = [first, second].map(|[u, v]| u.hypot(v));
        let overlap = |distance: f64| (1.0 - distance.abs()).max(0.0);
        Self::of(blur, |x, y| {
            let near = |[u, v]: [f64; 2], length: f64| {
                let middle = (x * u + y * v) / (length * length);
                let reach = core::f64::consts::SQRT_2 / length;
                (middle - reach).ceil() as i32..=(middle + reach).floor() as i32
            };
            let points =
                near(first, across).flat_map(|i| near(second, along).map(move |j| (f64::from(i), f64::from(j))));
            let offset = |(i, j): (f64, f64)| [0, 1].map(|axis| i * first[axis] + j * second[axis]);
            across * along * points.map(offset).map(|[u, v]| overlap(x - u) * overlap(y - v)).sum::<f64>()
        })
    }

    /// The kernel of an eye's blur times `weight` of the distance.
    fn of(blur: Blur, weight: impl Fn(f64, f64) -> f64) -> Self {
        let [uu, uv, vv] = within_reach(blur.0.map(f64::from)).map(|covariance| 2.0 * covariance);
        let determinant = uu * vv - uv * uv;
        // It fades to 0 at its end: cut off, it would be no one's energy.
        let fade = |distance: f64| 1.0 - (distance / (REACH + 1) as f64).powi(4);
        let value = |x: f64, y: f64| {
            weight(x, y)
                * fade(x)
                * fade(y)
                * (-(vv * x * x - 2.0 * uv * x * y + uu * y * y) / (2.0 * determinant)).exp()
        };
        let at = |cell: usize| cell as f64 - REACH as f64;
        let values: [[f64; ROWS]; ROWS] = from_fn(|row| from_fn(|column| value(at(column), at(row))));
        let scale = KERNEL_SUM / values.iter().flatten().sum::<f64>();
        let mut taps = [[0; COLUMNS]; ROWS];
        for (taps, values) in taps.iter_mut().zip(&values) {
            for (tap, value) in taps.iter_mut().zip(values) {
                *tap = (scale * value).round() as i16;
            }
        }
        let factors = factors(values.map(|row| row.map(|value| scale * value)));
        Self { taps, factors }
    }

    /// K(0).
    fn peak(&self) -> i16 {
        self.taps[REACH][REACH]
    }
}

/// How far apart the points of [`Kernel::sampled`] are, in σ of the blur: where σ is 1.4 arc minutes, 0.45, which is about the
/// distance of the fovea's cones, and that of the measure's rays.
const SPACING: f64 = 0.323;

/// The axes of a covariance: two vectors at right angles, as long as its σ along them.
fn axes([uu, uv, vv]: [f64; 3]) -> [[f64; 2]; 2] {
    let (middle, spread) = ((uu + vv) / 2.0, ((uu - vv) / 2.0).hypot(uv));
    let (sin, cos) = (uv.atan2((uu - vv) / 2.0) / 2.0).sin_cos();
    let [wide, thin] = [middle + spread, middle - spread].map(|variance| variance.max(0.0).sqrt());
    [[wide * cos, wide * sin], [-thin * sin, thin * cos]]
}

/// The σ of a blur in px that the tile has room for, and the least that is worth a search.
const SIGMA_PX: [f64; 2] = [0.8, 2.2];

/// The blur's covariance, shrunk as a whole and widened where it is thin so that its σ lie within [`SIGMA_PX`].
fn within_reach(covariance: [f64; 3]) -> [f64; 3] {
    let [least, most] = SIGMA_PX.map(|sigma| sigma * sigma);
    let widest = |[uu, uv, vv]: [f64; 3]| (uu + vv) / 2.0 + ((uu - vv) / 2.0).hypot(uv);
    let scale = (most / widest(covariance)).min(1.0);
    let [uu, uv, vv] = covariance.map(|value| scale * value);
    let thinnest = uu + vv - widest([uu, uv, vv]);
    let lack = (least - thinnest).max(0.0);
    [uu + lack, uv, vv + lack]
}

/// `matrix` as a sum of products of a column and a row, to half a unit: its singular vectors, by power iteration. Two or three are
/// enough for a Gaussian, and one where it stands upright.
fn factors(mut matrix: [[f64; ROWS]; ROWS]) -> Vec<[[f32; ROWS]; 2]> {
    let mut factors = Vec::new();
    while factors.len() < ROWS && matrix.iter().flatten().any(|value| value.abs() > 0.5) {
        let largest = |a: &&[f64; ROWS], b: &&[f64; ROWS]| dot(a, a).total_cmp(&dot(b, b));
        let mut row = *matrix.iter().max_by(largest).expect("rows");
        for _ in 0..20 {
            let column = matrix.map(|line| dot(&line, &row));
            row = from_fn(|index| matrix.iter().zip(&column).map(|(line, weight)| line[index] * weight).sum());
            let length = dot(&row, &row).sqrt();
            row = row.map(|value| value / length);
        }
        let column = matrix.map(|line| dot(&line, &row));
        for (line, weight) in matrix.iter_mut().zip(column) {
            for (value, row) in line.iter_mut().zip(row) {
                *value -= weight * row;
            }
        }
        factors.push([column, row].map(|vector| vector.map(|value| value as f32)));
    }
    factors
}

fn dot(a: &[f64; ROWS], b: &[f64; ROWS]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// What a sweep tries at each pixel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Moves {
    /// To flip it.
    Flips,
    /// To flip it, or to swap it with one of its eight neighbours, whichever lowers the energy more.
    Swaps,
}

/// A slice under search: its picture's bounding box with a margin of [`TILE`] pixels, in which nothing is.
#[derive(Clone, Debug)]
pub struct Search {
    /// The box's first column and row in the slice.
    left: usize,
    top: usize,
    /// Columns, rows.
    size: [usize; 2],
    luminance: Vec<f32>,
    /// +1 lit, −1 dark, 0 not to be searched.
    state: Vec<i8>,
    /// c = K ∗ (b − l), in units of [`KERNEL_SUM`] for an error of 1 everywhere.
    error: Vec<i16>,
}

impl Search {
    /// A slice of `width` columns whose bits are those of `plane`; see [`super::halftone`].
    #[inline(always)]
    pub fn new(kernel: &Kernel, width: u32, luminance: &[f32], plane: &[u8]) -> Self {
        let stride = plane_stride(width);
        let width = width as usize;
        let inner = |value: &f32| *value > 0.0 && *value < 1.0;
        let rows: Vec<&[f32]> = luminance.chunks_exact(width).collect();
        let top = rows.iter().position(|row| row.iter().any(inner)).unwrap_or(0);
        let bottom = rows.iter().rposition(|row| row.iter().any(inner)).map_or(0, |last| last + 1);
        let lefts = rows[top..bottom].iter().filter_map(|row| row.iter().position(inner));
        let rights = rows[top..bottom].iter().filter_map(|row| row.iter().rposition(inner));
        let (left, right) = (lefts.min().unwrap_or(0), rights.max().map_or(0, |last| last + 1));
        let size = [(right - left).next_multiple_of(BLOCK) + 2 * TILE, bottom - top + 2 * TILE];
        let cells = size[0] * size[1];
        let mut search =
            Self { left, top, size, luminance: vec![0.0; cells], state: vec![0; cells], error: vec![0; cells] };
        for (y, row) in rows[top..bottom].iter().enumerate() {
            for x in left..right {
                if inner(&row[x]) {
                    let cell = (y + TILE) * size[0] + x - left + TILE;
                    search.luminance[cell] = row[x];
                    search.state[cell] = if plane[(top + y) * stride + x / 8] >> (x % 8) & 1 == 1 { 1 } else { -1 };
                }
            }
        }
        search.convolve(kernel);
        search
    }

    /// c from the bits.
    #[inline(always)]
    fn convolve(&mut self, kernel: &Kernel) {
        let [width, height] = self.size;
        let inner = TILE..width - TILE;
        let pixel = |(state, luminance): (&i8, &f32)| if *state > 0 { 1.0 - luminance } else { -luminance };
        // A row of b − l, the last rows of it filtered across by each factor, and a row of c: as little as stays in the cache.
        let mut errors = vec![0.0; width];
        let mut across = vec![vec![vec![0.0; inner.len()]; ROWS]; kernel.factors.len()];
        let mut sums = vec![0.0; inner.len()];
        for below in TILE - REACH..height - TILE + REACH {
            let cells = below * width..(below + 1) * width;
            let pixels = self.state[cells.clone()].iter().zip(&self.luminance[cells]).map(pixel);
            errors.iter_mut().zip(pixels).for_each(|(error, value)| *error = value);
            for ([_, row], across) in kernel.factors.iter().zip(&mut across) {
                let into = &mut across[below % ROWS];
                into.fill(0.0);
                add_filtered(into, row, |tap| &errors[inner.start - REACH + tap..]);
            }
            let Some(y) = below.checked_sub(REACH).filter(|y| *y >= TILE) else { continue };
            sums.fill(0.0);
            for ([column, _], across) in kernel.factors.iter().zip(&across) {
                add_filtered(&mut sums, column, |tap| &across[(y - REACH + tap) % ROWS]);
            }
            for (error, sum) in self.error[y * width..][inner.clone()].iter_mut().zip(&sums) {
                *error = ((sum + 32_768.5) as i32 - 32_768) as i16;
            }
        }
    }

    /// Adds `field` at each searched (column, row) of the slice to c: K ∗ (b − l) of what eyes see together with this pixel.
    pub fn add_field(&mut self, field: impl Fn(usize, usize) -> f32) {
        let width = self.size[0];
        for (cell, error) in self.error.iter_mut().enumerate().filter(|(cell, _)| self.state[*cell] != 0) {
            let value = field(self.left + cell % width - TILE, self.top + cell / width - TILE);
            *error += value.clamp(-FIELD_MAX, FIELD_MAX) as i16;
        }
    }

    /// Decides every pixel once, phase after phase. Returns how many moved.
    ///
    /// Rows [`TILE`] apart do not see each other: each goes through its phases while it is in the cache.
    pub fn sweep(&mut self, kernel: &Kernel, moves: Moves) -> u32 {
        let [width, height] = self.size;
        let rows = (0..TILE).flat_map(|first| (TILE + first..height - TILE).step_by(TILE));
        let row = |y: usize| {
            (0..TILE).flat_map(move |first| (y * width + TILE + first..(y + 1) * width - TILE).step_by(TILE))
        };
        let decide = |cell| match moves {
            Moves::Flips => self.flip(kernel, cell),
            Moves::Swaps => self.swap(kernel, cell),
        };
        rows.flat_map(row).map(decide).map(u32::from).sum()
    }

    /// Flips `cell` where that lowers the energy.
    fn flip(&mut self, kernel: &Kernel, cell: usize) -> bool {
        let state = self.state[cell];
        let flips = i16::from(state) * self.error[cell] > kernel.peak() / 2;
        if flips {
            self.set(kernel, cell, -state);
        }
        flips
    }

    /// Flips `cell`, alone or with the neighbour with which that lowers the energy most, where anything does.
    fn swap(&mut self, kernel: &Kernel, cell: usize) -> bool {
        let (state, width) = (self.state[cell], self.size[0]);
        if state == 0 {
            return false;
        }
        let pull = |cell: usize| i32::from(state) * i32::from(self.error[cell]);
        // Half the change of energy.
        let mut best = (i32::from(kernel.peak()) / 2 - pull(cell), None);
        for row in 0..3 {
            for column in 0..3 {
                let other = cell + row * width + column - width - 1;
                if self.state[other] == -state {
                    let barrier = kernel.peak() - kernel.taps[REACH + row - 1][REACH + column - 1];
                    let change = i32::from(barrier) - pull(cell) + pull(other);
                    if change < best.0 {
                        best = (change, Some(other));
                    }
                }
            }
        }
        let (change, other) = best;
        if change < 0 {
            self.set(kernel, cell, -state);
            if let Some(other) = other {
                self.set(kernel, other, state);
            }
        }
        change < 0
    }

    /// Flips `cell` to `state` and keeps c up to date.
    fn set(&mut self, kernel: &Kernel, cell: usize, state: i8) {
        self.state[cell] = state;
        let first = cell - REACH * self.size[0] - REACH;
        for (taps, line) in kernel.taps.iter().zip(self.error[first..].chunks_mut(self.size[0])) {
            for (error, tap) in line[..COLUMNS].iter_mut().zip(taps) {
                *error = if state > 0 { *error + tap } else { *error - tap };
            }
        }
    }

    /// c + `sharp` K(0) (b − l): this slice's error as another slice feels it, see [`Search::add_field`].
    pub fn field(&self, kernel: &Kernel, sharp: f32) -> Field {
        let unblurred = sharp * f32::from(kernel.peak());
        let cells = self.error.iter().zip(&self.state).zip(&self.luminance);
        let value = |((error, state), luminance): ((&i16, &i8), &f32)| {
            f32::from(*error) + unblurred * (f32::from(u8::from(*state > 0)) - luminance)
        };
        Field {
            first: [self.left as f32 - TILE as f32, self.top as f32 - TILE as f32],
            width: self.size[0],
            values: cells.map(value).collect(),
        }
    }

    /// Sets the searched bits in `plane`.
    pub fn write(&self, width: u32, plane: &mut [u8]) {
        let stride = plane_stride(width);
        for (y, row) in self.state.chunks_exact(self.size[0]).enumerate().skip(TILE) {
            for (x, state) in row.iter().enumerate().filter(|(_, state)| **state != 0) {
                let (x, y) = (self.left + x - TILE, self.top + y - TILE);
                let byte = &mut plane[y * stride + x / 8];
                *byte = *byte & !(1 << (x % 8)) | u8::from(*state > 0) << (x % 8);
            }
        }
    }
}

/// A slice's error with the kernel: see [`Search::field`].
#[derive(Clone, Debug)]
pub struct Field {
    /// The column and row of the first value.
    first: [f32; 2],
    width: usize,
    values: Vec<f32>,
}

impl Field {
    /// At (u, v) in pixels, linear between their centres; 0 outside.
    pub fn at(&self, u: f32, v: f32) -> f32 {
        let [x, y] = [u - 0.5 - self.first[0], v - 0.5 - self.first[1]];
        let cell = y as usize * self.width + x as usize;
        if x < 0.0 || y < 0.0 || x as usize + 1 >= self.width || cell + self.width + 1 >= self.values.len() {
            return 0.0;
        }
        let [right, down] = [x.fract(), y.fract()];
        let between = |cell: usize| self.values[cell] + right * (self.values[cell + 1] - self.values[cell]);
        let (above, below) = (between(cell), between(cell + self.width));
        above + down * (below - above)
    }
}

/// Pixels that a box is a multiple of.
const BLOCK: usize = 8;

/// Adds to each pixel of `into`, a multiple of [`BLOCK`], the pixels of `line(tap)` weighted with `taps`.
#[inline(always)]
fn add_filtered<'a>(into: &mut [f32], taps: &[f32; ROWS], line: impl Fn(usize) -> &'a [f32]) {
    let lines: [&[f32]; ROWS] = from_fn(|tap| &line(tap)[..into.len()]);
    // Four blocks are as many sums as stay in registers, and enough for none to wait for itself.
    let (wide, narrow) = into.as_chunks_mut::<{ 4 * BLOCK }>();
    add_blocks(wide, taps, lines);
    add_blocks(narrow.as_chunks_mut::<BLOCK>().0, taps, lines.map(|line| &line[4 * BLOCK * wide.len()..]));
}

#[inline(always)]
fn add_blocks<const WIDTH: usize>(into: &mut [[f32; WIDTH]], taps: &[f32; ROWS], lines: [&[f32]; ROWS]) {
    let lines = lines.map(|line| line.as_chunks::<WIDTH>().0);
    for (block, into) in into.iter_mut().enumerate() {
        let mut sums = *into;
        for (line, weight) in lines.iter().zip(taps) {
            for (sum, pixel) in sums.iter_mut().zip(&line[block]) {
                *sum += weight * pixel;
            }
        }
        *into = sums;
    }
}

#[cfg(test)]
mod tests;
