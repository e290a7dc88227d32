//! Textures as luminances, for triangles that show them in one tint.

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

    /// Between texels at `place`, in parts of [`FULL`].
    #[inline(always)]
    pub fn sample(&self, place: [f32; 2]) -> f32 {
        let (x, fx) = self.cell(0, place[0]);
        let (y, fy) = self.cell(1, place[1]);
        let upper = &self.cells[y * self.stride + x..][..self.stride + 2];
        let [a, b] = [upper[0], upper[1]].map(f32::from);
        let [c, d] = [upper[self.stride], upper[self.stride + 1]].map(f32::from);
        let (upper, lower) = (a + (b - a) * fx, c + (d - c) * fx);
        upper + (lower - upper) * fy
    }

    /// The first of the two cells that a place lies between along an axis, and how far it lies toward the second.
    #[inline(always)]
    fn cell(&self, axis: usize, place: f32) -> (usize, f32) {
        let side = self.sides[axis];
        // Places are positive where this counts, so that the cast rounds down, which without SSE4.1 is a call.
        let periods = (place * self.per_period[axis]) as u32 as f32;
        let place = match self.wrap[axis] {
            Wrap::Clamp => place,
            Wrap::Repeat => place - side * periods,
            Wrap::Mirror => {
                let place = place - 2.0 * side * periods;
                place.min(2.0 * side - place)
            }
        };
        // Half a texel from its border to its centre, and one of the border; far away digits are lost, but no more.
        let place = place.clamp(0.0, side) + 0.5;
        let first = place as u32;
        (first as usize, place - first as f32)
    }
}

/// The texels of a row or column with its border.
fn bordered(side: u32, wrap: Wrap) -> impl Iterator<Item = u32> + Clone {
    // The mirror image begins with the border itself.
    let [before, after] = if wrap == Wrap::Repeat { [side - 1, 0] } else { [0, side - 1] };
    [before].into_iter().chain(0..side).chain([after])
}
