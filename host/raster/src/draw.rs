//! Triangles to pixels, block by block.

use super::block::{Block, CENTRE, COLUMNS, PIXELS, ROWS};
use super::cover::{Blocks, Corners, Covered, Slope, Weights, outside_of_first};
use super::figure::{Figure, Ink, WHITE, level};
use super::grid::{Grid, nearest_step, rounded};
use super::panel::Panel;
use super::picture::Picture;
use super::setup::Setup;
use super::surface::Surface;
use super::vertices::Vertices;
use core::ops::Range;

/// What pixels of a slice are filled with, and by which rules.
pub struct Scene<'a> {
    /// The triangles.
    pub figure: &'a Figure,
    /// The luminance of a triangle whose ink is [`Ink::Shaded`], at given weights of its corners.
    pub shade: &'a dyn Fn(usize, [f32; 3]) -> f32,
    /// How pixels and depths are numbers.
    pub grid: Grid,
}

/// One face of a slice: which pixels it may fill, and how wide triangles find their corners.
pub struct View<'a> {
    /// Whether a pixel shows what the face reflects.
    pub shows: &'a dyn Fn([i32; 2]) -> bool,
    /// Whether that is to be asked for every triangle: another face may be in front.
    pub is_shared: bool,
    /// The sign of the area of fronts; 0 if not known.
    pub front: i32,
    /// x and y in the steps of [`Grid::finer`] and depth of vertex `index`.
    pub corner: &'a dyn Fn(u32) -> [i32; 3],
}

/// The pixels that have been filled, or lie between such, from first to last: half open.
#[derive(Clone, Copy, Debug)]
pub struct Touched {
    /// Column and row.
    pub first: [i32; 2],
    /// Column and row beyond the last.
    pub end: [i32; 2],
}

impl Touched {
    /// Nothing.
    pub const NONE: Self = Self { first: [i32::MAX; 2], end: [0; 2] };

    /// Takes in more pixels.
    #[inline(always)]
    pub fn add(&mut self, first: [i32; 2], end: [i32; 2]) {
        for axis in 0..2 {
            self.first[axis] = self.first[axis].min(first[axis]);
            self.end[axis] = self.end[axis].max(end[axis]);
        }
    }

    /// Its columns and rows within an image of `size` pixels.
    pub fn within(&self, size: [i32; 2]) -> [Range<usize>; 2] {
        [0, 1].map(|axis| {
            let [first, end] = [self.first, self.end].map(|place| place[axis].clamp(0, size[axis]) as usize);
            first.min(end)..end
        })
    }
}

/// Draws one face of a slice.
#[inline(always)]
pub fn draw<B: Block, const N: usize, S: Surface>(
    scene: &Scene<'_>,
    view: &View<'_>,
    vertices: &Vertices,
    panel: &mut Panel,
    surface: &mut S,
    touched: &mut Touched,
) {
    let mut setup = Setup::<N>::new();
    for group in 0..scene.figure.groups::<N>() {
        setup.prepare::<B>(scene.figure, vertices, &scene.grid, view.front, group);
        let cut = if view.is_shared { u32::MAX } else { setup.rim };
        let plain = setup.drawn & scene.figure.flats::<N>(group) & !cut;
        for lane in lanes(plain & setup.small) {
            small_triangle::<B, N, S>(&setup, lane, scene.figure.luminances[group * N + lane], surface);
        }
        for lane in lanes(plain & !setup.small) {
            plain_triangle::<B, N, S>(&setup, lane, scene.figure.luminances[group * N + lane], surface);
        }
        let others = setup.drawn & !plain;
        if others | setup.wide == 0 {
            continue;
        }
        let mut painter = Painter { scene, view, vertices, panel, surface, touched, is_cut: false };
        for lane in lanes(others) {
            painter.is_cut = cut >> lane & 1 != 0;
            painter.triangle::<B, N>(&setup, lane, group * N + lane);
        }
        for lane in lanes(setup.wide) {
            painter.is_cut = cut >> lane & 1 != 0;
            painter.wide::<B>(group * N + lane);
        }
    }
    let [first, last] = setup.touched();
    touched.add(first, [last[0] + COLUMNS as i32, last[1] + ROWS as i32]);
}

/// The places of the bits that are set.
#[inline(always)]
fn lanes(mut bits: u32) -> impl Iterator<Item = usize> {
    core::iter::from_fn(move || {
        let lane = bits.trailing_zeros() as usize;
        let is_one = bits != 0;
        bits &= bits.wrapping_sub(1);
        is_one.then_some(lane)
    })
}

/// Lays one luminance on a triangle that one block holds.
#[inline(always)]
fn small_triangle<B: Block, const N: usize, S: Surface>(
    setup: &Setup<N>,
    lane: usize,
    luminance: i16,
    surface: &mut S,
) {
    let outside = outside_of_first::<B, N>(setup, lane);
    let value = B::splat(setup.rounded_depth[0][lane] as i16);
    let across = B::splat(setup.rounded_depth[1][lane] as i16).mul(B::columns());
    let down = B::splat(setup.rounded_depth[2][lane] as i16).mul(B::rows());
    surface.put(
        [setup.first[0][lane], setup.first[1][lane]],
        outside,
        value.add(across).add(down),
        B::splat(luminance),
    );
}

/// Lays one luminance on a triangle.
#[inline(always)]
fn plain_triangle<B: Block, const N: usize, S: Surface>(
    setup: &Setup<N>,
    lane: usize,
    luminance: i16,
    surface: &mut S,
) {
    let blocks = Blocks::of(setup, lane);
    let depth = setup.depth_of(lane);
    let offsets: B = depth.offsets();
    let mut covered = Covered::<B>::new(setup, lane, &blocks);
    while let Some((offset, outside)) = covered.next() {
        surface.put(blocks.at(offset), outside, depth.block(offset, offsets), B::splat(luminance));
    }
}

/// How the pixels of one triangle get their luminance.
enum Paint<'a> {
    Flat(i16),
    Smooth(Slope),
    /// Places in the picture, and what its luminances are multiplied by.
    Textured(&'a Picture, [Slope; 2], Slope),
    Shaded(&'a Corners, usize),
}

/// The paint of triangle `index` by its ink, on blocks from the one at `first` on; `corners` in the steps of [`Grid::finer`].
#[inline(always)]
fn paint<'a>(scene: &'a Scene<'_>, corners: &'a Corners, ink: Ink, first: [i32; 2], index: usize) -> Paint<'a> {
    let weights = || Weights::new(corners, first, &scene.grid.finer());
    match ink {
        Ink::Flat(luminance) => Paint::Flat(luminance),
        Ink::Smooth(luminances) => Paint::Smooth(weights().slope(luminances)),
        Ink::Textured(skin) => {
            let (weights, skin) = (weights(), &scene.figure.skins[skin as usize]);
            let places = [weights.slope(skin.places[0]), weights.slope(skin.places[1])];
            Paint::Textured(&scene.figure.pictures[skin.picture as usize], places, weights.slope(skin.gains))
        }
        Ink::Shaded => Paint::Shaded(corners, index),
    }
}

struct Painter<'a, 'b, S> {
    scene: &'a Scene<'b>,
    view: &'a View<'b>,
    vertices: &'a Vertices,
    panel: &'a mut Panel,
    surface: &'a mut S,
    touched: &'a mut Touched,
    is_cut: bool,
}

impl<S: Surface> Painter<'_, '_, S> {
    #[inline(always)]
    fn triangle<B: Block, const N: usize>(&mut self, setup: &Setup<N>, lane: usize, index: usize) {
        let ink = self.scene.figure.inks[index];
        let blocks = Blocks::of(setup, lane);
        let group = index / N;
        let figure = self.scene.figure;
        // One by one: a closure is not inlined here, and what it hands over through memory took a quarter of the triangle's time.
        let corners = Corners([
            self.vertices.fine(figure.corners::<N>(0, group)[lane]),
            self.vertices.fine(figure.corners::<N>(1, group)[lane]),
            self.vertices.fine(figure.corners::<N>(2, group)[lane]),
        ]);
        let paint = paint(self.scene, &corners, ink, blocks.first, index);
        let depth = setup.depth_of(lane);
        let mut covered = Covered::<B>::new(setup, lane, &blocks);
        while let Some((offset, outside)) = covered.next() {
            self.lay(blocks.at(offset), offset, outside, &depth, &paint);
        }
    }

    #[inline(always)]
    fn lay<B: Block>(&mut self, place: [i32; 2], offset: [i32; 2], mut outside: B, depth: &Slope, paint: &Paint<'_>) {
        if self.is_cut {
            let shown = self.panel.block(place, self.view.shows);
            outside = outside.or(B::from_bits(!shown));
        }
        let depth = depth.block(offset, depth.offsets::<B>());
        let luminance = match paint {
            Paint::Flat(luminance) => B::splat(*luminance),
            Paint::Smooth(slope) => slope.block(offset, slope.offsets::<B>()),
            Paint::Textured(picture, places, gain) => {
                let open = self.surface.open(place, outside, depth);
                B::from_array(&sampled(picture, places, gain, offset, open))
            }
            Paint::Shaded(corners, index) => {
                let open = self.surface.open(place, outside, depth);
                B::from_array(&self.shade(place, open, corners, *index))
            }
        };
        self.surface.put(place, outside, depth, luminance);
    }

    /// The luminance of the pixels of a block whose bits are set in `open`.
    fn shade(&self, [x, y]: [i32; 2], open: u32, corners: &Corners, index: usize) -> [i16; PIXELS] {
        let grid = self.scene.grid.finer();
        let mut luminances = [0; PIXELS];
        for pixel in lanes(open) {
            let place = [x + (pixel % COLUMNS) as i32, y + (pixel / COLUMNS) as i32];
            let weights = corners.weights(place, &grid);
            luminances[pixel] = level((self.scene.shade)(index, weights));
        }
        luminances
    }

    /// A triangle that the arithmetic of [`Setup`] is too narrow for.
    #[inline(always)]
    fn wide<B: Block>(&mut self, index: usize) {
        let Scene { figure, grid, .. } = self.scene;
        let fine = figure.triangle(index).map(|corner| (self.view.corner)(corner));
        let mut vertices = fine.map(|[x, y, depth]| [nearest_step(x)[0], nearest_step(y)[0], depth].map(i64::from));
        let unturned = Corners(vertices.map(|[x, y, _]| [x, y]));
        let area = unturned.edge(0, 1, unturned.0[2]);
        let is_back = figure.solids::<1>(index) & 1 != 0 && area.signum() * i64::from(self.view.front) < 0;
        let reach = |axis: usize| {
            let [low, high] = [i64::min, i64::max]
                .map(|pick| vertices.map(|vertex| vertex[axis]).into_iter().reduce(pick).unwrap_or(0));
            let half = i64::from(grid.steps() / 2);
            let origin = i64::from(grid.origin[axis]);
            let first = (((low + half - 1) >> grid.shift) + origin).max(0);
            let last = (((high - half) >> grid.shift) + origin).min(i64::from(grid.size[axis]) - 1);
            (first <= last).then_some([first as i32, last as i32])
        };
        let (Some(columns), Some(rows)) = (reach(0), reach(1)) else { return };
        if area == 0 || is_back {
            return;
        }
        let blocks = Blocks::new([columns[0], rows[0]], [columns[1], rows[1]]);
        self.touched.add(blocks.first, blocks.end());
        let depth = Weights::new(&unturned, blocks.first, grid).slope(vertices.map(|[.., depth]| depth as f32));
        let fine = Corners(fine.map(|[x, y, _]| [x.into(), y.into()]));
        let paint = paint(self.scene, &fine, figure.inks[index], blocks.first, index);
        if area < 0 {
            vertices.swap(1, 2);
        }
        let corners = Corners(vertices.map(|[x, y, _]| [x, y]));
        for row in 0..blocks.rows {
            let [first, last] = corners.span(blocks.at([0, row * ROWS as i32]), blocks.columns, grid);
            for column in first..=last {
                let offset = [column * COLUMNS as i32, row * ROWS as i32];
                let covered = corners.covered(blocks.at(offset), grid);
                if covered != 0 {
                    self.lay(blocks.at(offset), offset, B::from_bits(!covered), &depth, &paint);
                }
            }
        }
    }
}

/// What makes rounding one up, but for whole numbers: see [`level`].
const UP: f32 = 0.499;

/// The luminance of the pixels whose bits are set in `open`, of the block that lies `offset` from the first; of others, some luminance.
#[inline(always)]
fn sampled(picture: &Picture, places: &[Slope; 2], gain: &Slope, offset: [i32; 2], open: u32) -> [i16; PIXELS] {
    let at = |pixel: usize| {
        [offset[0] + (pixel % COLUMNS) as i32 - CENTRE[0], offset[1] + (pixel / COLUMNS) as i32 - CENTRE[1]]
    };
    let mut across = [0.0; PIXELS];
    let mut down = [0.0; PIXELS];
    for pixel in 0..PIXELS {
        (across[pixel], down[pixel]) = (places[0].at(at(pixel)), places[1].at(at(pixel)));
    }
    let samples = picture.samples([&across, &down], lanes(open));
    let mut luminances = [0; PIXELS];
    for pixel in 0..PIXELS {
        let luminance = samples[pixel] * gain.at(at(pixel));
        luminances[pixel] = rounded(luminance.clamp(0.0, WHITE - 1.0) + UP) as i16;
    }
    luminances
}
