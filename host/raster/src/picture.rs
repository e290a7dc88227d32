//! Textures as luminances, for triangles that show them in one tint.

use super::grid::rounded;

/// The luminance of a white texel.
pub const FULL: f32 = 65_535.0;

/// What a texture shows outside of its unit square.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Wrap {
    /// The same again.
    #[default]
    Repeat,
    /// The same again, every other time mirrored.
    Mirror,
    /// Its border.
    Clamp,
}

/// The luminances of a texture's texels in one tint: linear, in 16 bits, with a border of one texel as the texture wraps.
pub struct Picture {
    sides: [f32; 2],
    /// One over the length after which it repeats, along both axes: twice its side where it is mirrored.
    per_period: [f32; 2],
    wrap: [Wrap; 2],
    stride: usize,
    cells: Vec<u16>,
}

/// How a triangle shows a picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Skin {
    /// An index of the figure's pictures.
    pub picture: u32,
    /// Places in the picture at the corners, in texels, not below 0 where it is repeated.
    pub places: [[f32; 3]; 2],
    /// What luminances at the corners are multiplied by, to be in parts of [`crate::WHITE`].
    pub gains: [f32; 3],
}

impl Picture {
    /// Of `texels` in parts of [`FULL`], row by row, each row `width` long.
    ///
    /// # Panics
    /// Where there are no texels, or no whole rows of them.
    pub fn new(width: u32, wrap: [Wrap; 2], texels: &[u16]) -> Self {
        let rows: Vec<_> = texels.chunks_exact(width as usize).collect();
        assert!(!rows.is_empty() && rows.len() * width as usize == texels.len(), "a picture is a rectangle");
        let sides = [width, rows.len() as u32];
        let [columns, lines] = [0, 1].map(|axis| bordered(sides[axis], wrap[axis]));
        let cells = lines.flat_map(|y| columns.clone().map(move |x| (x, y))).map(|(x, y)| rows[y as usize][x as usize]);
        let cells = cells.collect();
        let sides = sides.map(|side| side as f32);
        let period = |axis: usize| if wrap[axis] == Wrap::Mirror { 2.0 * sides[axis] } else { sides[axis] };
        Self { sides, per_period: [1.0 / period(0), 1.0 / period(1)], wrap, stride: width as usize + 2, cells }
    }

    /// Between texels at each of those `places` that `wanted` names, in parts of [`FULL`]; at others, some luminance.
    ///
    /// One step for all of them after the other, so that only the texels are fetched one by one.
    #[inline(always)]
    pub fn samples<const N: usize>(&self, places: [&[f32; N]; 2], wanted: impl Iterator<Item = usize>) -> [f32; N] {
        let [(columns, fx), (rows, fy)] = [self.cells(0, places[0]), self.cells(1, places[1])];
        let (mut upper, mut lower) = ([[0; 2]; N], [[0; 2]; N]);
        for place in wanted {
            let rows = &self.cells[rows[place] as usize * self.stride + columns[place] as usize..][..self.stride + 2];
            (upper[place], lower[place]) = ([rows[0], rows[1]], [rows[self.stride], rows[self.stride + 1]]);
        }
        let mut samples = [0.0; N];
        for place in 0..N {
            let [a, b] = upper[place].map(f32::from);
            let [c, d] = lower[place].map(f32::from);
            let (upper, lower) = (a + (b - a) * fx[place], c + (d - c) * fx[place]);
            samples[place] = upper + (lower - upper) * fy[place];
        }
        samples
    }

    /// The first of the two cells that each place lies between along an axis, and how far it lies toward the second.
    #[inline(always)]
    fn cells<const N: usize>(&self, axis: usize, places: &[f32; N]) -> ([u32; N], [f32; N]) {
        let side = self.sides[axis];
        // Whole periods before a place; on a border one more or less, which shows the same.
        let periods = |place: f32| rounded(place * self.per_period[axis] - 0.5) as f32;
        match self.wrap[axis] {
            Wrap::Clamp => cells(side, places, |place| place),
            Wrap::Repeat => cells(side, places, |place| place - side * periods(place)),
            Wrap::Mirror => cells(side, places, |place| {
                let place = place - 2.0 * side * periods(place);
                place.min(2.0 * side - place)
            }),
        }
    }
}

/// The same for places that `wrapped` takes into a picture with `side` texels along the axis.
#[inline(always)]
fn cells<const N: usize>(side: f32, places: &[f32; N], wrapped: impl Fn(f32) -> f32) -> ([u32; N], [f32; N]) {
    let (mut first, mut beyond) = ([0; N], [0.0; N]);
    for lane in 0..N {
        // Far away digits are lost, but no more; and of no number at all this makes 0.
        let place = wrapped(places[lane]).max(0.0).min(side);
        // Half a texel from its border to its centre, and one of the border.
        let nearest = rounded(place);
        (first[lane], beyond[lane]) = (nearest as u32, place + 0.5 - nearest as f32);
    }
    (first, beyond)
}

/// The texels of a row or column with its border.
fn bordered(side: u32, wrap: Wrap) -> impl Iterator<Item = u32> + Clone {
    // The mirror image begins with the border itself.
    let [before, after] = if wrap == Wrap::Repeat { [side - 1, 0] } else { [0, side - 1] };
    [before].into_iter().chain(0..side).chain([after])
}
