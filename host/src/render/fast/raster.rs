//! Triangles to pixels, block by block.

use super::block::{Block, CENTRE, COLUMNS, ROWS};
use super::figure::{Figure, Ink, LANES, level};
use super::grid::Grid;
use super::panel::Panel;
use super::setup::{Setup, wrapped};
use super::surface::Surface;
use super::vertices::Vertices;
use crate::render::canvas::shade;
use crate::scene::Texture;
use std::sync::Arc;

/// What pixels of a slice are filled with, and by which rules.
pub struct Scene<'a> {
    pub figure: &'a Figure,
    pub textures: &'a [Arc<Texture>],
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
    /// x and y in steps and depth of vertex `index`.
    pub corner: &'a dyn Fn(u32) -> [i64; 3],
}

/// The pixels that have been filled, or lie between such, from first to last: half open.
#[derive(Clone, Copy, Debug)]
pub struct Touched {
    pub first: [i32; 2],
    pub end: [i32; 2],
}

impl Touched {
    /// Nothing.
    pub const NONE: Self = Self { first: [i32::MAX; 2], end: [0; 2] };

    #[inline(always)]
    fn add(&mut self, first: [i32; 2], end: [i32; 2]) {
        for axis in 0..2 {
            self.first[axis] = self.first[axis].min(first[axis]);
            self.end[axis] = self.end[axis].max(end[axis]);
        }
    }
}

/// Draws one face of a slice.
#[inline(always)]
pub fn draw<B: Block, S: Surface>(
    scene: &Scene<'_>,
    view: &View<'_>,
    vertices: &Vertices,
    panel: &mut Panel,
    surface: &mut S,
    touched: &mut Touched,
) {
    let mut setup = Setup::new();
    for group in 0..scene.figure.groups() {
        setup.prepare::<B>(scene.figure, vertices, &scene.grid, view.front, group);
        let mut drawn = setup.drawn;
        while drawn != 0 {
            let lane = drawn.trailing_zeros() as usize;
            drawn &= drawn - 1;
            let is_cut = view.is_shared || setup.rim >> lane & 1 != 0;
            let mut painter = Painter { scene, view, panel, surface, touched, is_cut };
            painter.triangle::<B>(&setup, lane, group * LANES + lane);
        }
        let mut wide = setup.wide;
        while wide != 0 {
            let lane = wide.trailing_zeros() as usize;
            wide &= wide - 1;
            let is_cut = view.is_shared || setup.rim >> lane & 1 != 0;
            let mut painter = Painter { scene, view, panel, surface, touched, is_cut };
            painter.wide::<B>(group * LANES + lane);
        }
    }
}

/// A number that grows evenly over the image.
#[derive(Clone, Copy)]
struct Slope {
    /// At the centre of the first block.
    value: f32,
    across: f32,
    down: f32,
}

impl Slope {
    /// By its values at the corners of a triangle.
    fn new(triangle: &Corners, values: [f32; 3], at: [i32; 2], grid: &Grid) -> Self {
        let steps = f64::from(grid.steps());
        let arm = |corner: usize| {
            let [x, y] = [0, 1].map(|axis| (triangle.0[corner][axis] - triangle.0[0][axis]) as f64 / steps);
            [x, y, f64::from(values[corner] - values[0])]
        };
        let ([bx, by, bz], [cx, cy, cz]) = (arm(1), arm(2));
        let area = bx * cy - by * cx;
        let (across, down) = ((bz * cy - cz * by) / area, (cz * bx - bz * cx) / area);
        let [x, y] = [0, 1].map(|axis| {
            let centre = f64::from(at[axis] + CENTRE[axis] - grid.origin[axis]) + 0.5;
            centre - triangle.0[0][axis] as f64 / steps
        });
        Self { value: (f64::from(values[0]) + across * x + down * y) as f32, across: across as f32, down: down as f32 }
    }

    /// Over the block that lies `columns` and `rows` from the first.
    #[inline(always)]
    fn block<B: Block>(&self, [columns, rows]: [i32; 2]) -> B {
        let value = self.value + self.across * columns as f32 + self.down * rows as f32;
        let across = B::splat(wrapped(self.across)).mul(B::columns());
        let down = B::splat(wrapped(self.down)).mul(B::rows());
        B::splat(wrapped(value)).add(across).add(down)
    }
}

/// A triangle's corners: x and y in steps.
struct Corners([[i64; 2]; 3]);

impl Corners {
    /// Twice the area on the right of the way between two corners, seen from `pixel`'s centre.
    fn edge(&self, from: usize, to: usize, [x, y]: [i64; 2]) -> i64 {
        let ([from_x, from_y], [to_x, to_y]) = (self.0[from], self.0[to]);
        (to_x - from_x) * (y - from_y) - (to_y - from_y) * (x - from_x)
    }

    /// The weights of the corners at the centre of `pixel`.
    fn weights(&self, pixel: [i32; 2], grid: &Grid) -> [f32; 3] {
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

/// How the pixels of one triangle get their luminance.
enum Paint<'a> {
    Flat(i16),
    Smooth(Slope),
    Shaded(&'a Corners, usize),
}

struct Painter<'a, 'b, S> {
    scene: &'a Scene<'b>,
    view: &'a View<'b>,
    panel: &'a mut Panel,
    surface: &'a mut S,
    touched: &'a mut Touched,
    is_cut: bool,
}

impl<S: Surface> Painter<'_, '_, S> {
    #[inline(always)]
    fn triangle<B: Block>(&mut self, setup: &Setup, lane: usize, index: usize) {
        let first = [setup.first[0][lane], setup.first[1][lane]];
        let last = [setup.last[0][lane], setup.last[1][lane]];
        let depth = Slope { value: setup.depth[lane], across: setup.depth_across[lane], down: setup.depth_down[lane] };
        let ink = self.scene.figure.inks[index];
        let blocks = Blocks::new(first, last);
        self.touched.add(first, blocks.end());
        if let Ink::Flat(luminance) = ink {
            return self.blocks::<B>(setup, lane, &blocks, &depth, &Paint::Flat(luminance));
        }
        let turned = setup.turned[lane] != 0;
        let order = if turned { [0, 2, 1] } else { [0, 1, 2] };
        let corners = Corners(order.map(|corner| [setup.x[corner][lane].into(), setup.y[corner][lane].into()]));
        let paint = self.paint(&corners, ink, first, index);
        self.blocks::<B>(setup, lane, &blocks, &depth, &paint);
    }

    fn paint<'c>(&self, corners: &'c Corners, ink: Ink, first: [i32; 2], index: usize) -> Paint<'c> {
        match ink {
            Ink::Flat(luminance) => Paint::Flat(luminance),
            Ink::Smooth(luminances) => Paint::Smooth(Slope::new(corners, luminances, first, &self.scene.grid)),
            Ink::Shaded => Paint::Shaded(corners, index),
        }
    }

    #[inline(always)]
    fn blocks<B: Block>(&mut self, setup: &Setup, lane: usize, blocks: &Blocks, depth: &Slope, paint: &Paint<'_>) {
        let edge = |edge: usize| Edge {
            value: setup.edges[edge][lane],
            across: setup.across[edge][lane],
            down: setup.down[edge][lane],
        };
        let edges = [edge(0), edge(1), edge(2)];
        for row in 0..blocks.rows {
            for column in 0..blocks.columns {
                let offset = [column * COLUMNS as i32, row * ROWS as i32];
                let values = [edges[0].at(offset), edges[1].at(offset), edges[2].at(offset)];
                let reaches = |edge: usize| edges[edge].reaches(values[edge]);
                if blocks.is_one() || (reaches(0) && reaches(1) && reaches(2)) {
                    let edge = |edge: usize| edges[edge].block::<B>(values[edge]);
                    // Below 0 where one of them is.
                    let outside = B::splat(0).above(edge(0).or(edge(1)).or(edge(2)));
                    self.lay(blocks.at(offset), offset, outside, depth, paint);
                }
            }
        }
    }

    #[inline(always)]
    fn lay<B: Block>(&mut self, place: [i32; 2], offset: [i32; 2], mut outside: B, depth: &Slope, paint: &Paint<'_>) {
        if self.is_cut {
            let shown = self.panel.block(place, self.view.shows);
            outside = outside.or(B::from_bits(!shown));
        }
        let depth: B = depth.block(offset);
        let luminance = match paint {
            Paint::Flat(luminance) => B::splat(*luminance),
            Paint::Smooth(slope) => slope.block(offset),
            Paint::Shaded(corners, index) => {
                let open = self.surface.open(place, outside, depth);
                B::from_array(&self.shade(place, open, corners, *index))
            }
        };
        self.surface.put(place, outside, depth, luminance);
    }

    /// The luminance of the pixels of a block whose bits are set in `open`.
    fn shade(&self, [x, y]: [i32; 2], mut open: u32, corners: &Corners, index: usize) -> [i16; ROWS * COLUMNS] {
        let mut luminances = [0; ROWS * COLUMNS];
        while open != 0 {
            let pixel = open.trailing_zeros() as usize;
            open &= open - 1;
            let place = [x + (pixel % COLUMNS) as i32, y + (pixel / COLUMNS) as i32];
            let weights = corners.weights(place, &self.scene.grid);
            luminances[pixel] = level(shade(&self.scene.figure.mesh.triangles[index], self.scene.textures, weights));
        }
        luminances
    }

    /// A triangle that the arithmetic of [`Setup`] is too narrow for.
    fn wide<B: Block>(&mut self, index: usize) {
        let Scene { figure, grid, .. } = self.scene;
        let mut vertices = figure.mesh.triangles[index].corners.map(|corner| (self.view.corner)(corner));
        let unturned = Corners(vertices.map(|[x, y, _]| [x, y]));
        let area = unturned.edge(0, 1, unturned.0[2]);
        let is_back =
            figure.solid[index / LANES] >> (index % LANES) & 1 != 0 && area.signum() * i64::from(self.view.front) < 0;
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
        let depth = Slope::new(&unturned, vertices.map(|[.., depth]| depth as f32), blocks.first, grid);
        let paint = self.paint(&unturned, figure.inks[index], blocks.first, index);
        if area < 0 {
            vertices.swap(1, 2);
        }
        let corners = Corners(vertices.map(|[x, y, _]| [x, y]));
        for row in 0..blocks.rows {
            for column in 0..blocks.columns {
                let offset = [column * COLUMNS as i32, row * ROWS as i32];
                let covered = corners.covered(blocks.at(offset), grid);
                if covered != 0 {
                    self.lay(blocks.at(offset), offset, B::from_bits(!covered), &depth, &paint);
                }
            }
        }
    }
}

impl Corners {
    /// Bit by bit, which pixels of the block at `place` a triangle of positive area covers.
    fn covered(&self, place: [i32; 2], grid: &Grid) -> u32 {
        let start = centre(place, grid);
        let steps = i64::from(grid.steps());
        let mut covered = u32::MAX;
        for (from, to) in [(1, 2), (2, 0), (0, 1)] {
            let [across, down] = [0, 1].map(|axis| self.0[to][axis] - self.0[from][axis]);
            let owns_border = down < 0 || (down == 0 && across > 0);
            let value = self.edge(from, to, start) - i64::from(!owns_border);
            let mut inside = 0;
            for pixel in 0..ROWS * COLUMNS {
                let [x, y] = [pixel % COLUMNS, pixel / COLUMNS].map(|offset| offset as i64 * steps);
                inside |= u32::from(value - down * x + across * y >= 0) << pixel;
            }
            covered &= inside;
        }
        covered
    }
}

/// The blocks that a triangle lies in.
struct Blocks {
    first: [i32; 2],
    columns: i32,
    rows: i32,
}

impl Blocks {
    #[inline(always)]
    fn new(first: [i32; 2], last: [i32; 2]) -> Self {
        Self { first, columns: (last[0] - first[0]) / COLUMNS as i32 + 1, rows: (last[1] - first[1]) / ROWS as i32 + 1 }
    }

    #[inline(always)]
    fn is_one(&self) -> bool {
        self.columns == 1 && self.rows == 1
    }

    #[inline(always)]
    fn at(&self, offset: [i32; 2]) -> [i32; 2] {
        [self.first[0] + offset[0], self.first[1] + offset[1]]
    }

    #[inline(always)]
    fn end(&self) -> [i32; 2] {
        self.at([self.columns * COLUMNS as i32, self.rows * ROWS as i32])
    }
}

/// An edge function in whole numbers.
#[derive(Clone, Copy)]
struct Edge {
    /// At the centre of the first block.
    value: i32,
    across: i32,
    down: i32,
}

impl Edge {
    #[inline(always)]
    fn at(&self, [columns, rows]: [i32; 2]) -> i32 {
        self.value + self.across * columns + self.down * rows
    }

    /// Whether some pixel of the block at whose centre it is `value` is inside.
    #[inline(always)]
    fn reaches(&self, value: i32) -> bool {
        let across = (self.across * -CENTRE[0]).max(self.across * (CENTRE[0] - 1));
        let down = (self.down * -CENTRE[1]).max(self.down * (CENTRE[1] - 1));
        value + across + down >= 0
    }

    /// Over the block at whose centre it is `value`.
    #[inline(always)]
    fn block<B: Block>(&self, value: i32) -> B {
        let value = value.clamp(i16::MIN.into(), i16::MAX.into()) as i16;
        let across = B::splat(self.across as i16).mul(B::columns());
        let down = B::splat(self.down as i16).mul(B::rows());
        B::splat(value).add_saturating(across).add_saturating(down)
    }
}
