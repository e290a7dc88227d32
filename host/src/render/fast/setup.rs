//! Triangles of a slice: which of them may show, and what is to be known to fill them.

use super::block::{Block, CENTRE, COLUMNS};
use super::figure::{Figure, LANES};
use super::grid::{Grid, rounded};
use super::vertices::{LOST, OFF, SIDES, Vertices, WIDE};

/// Triangles larger than this many steps, 170 pixels at 32 steps, are wide: their edge functions would leave 16 bits within a block,
/// whose farthest pixel is six from its centre, and their areas 32.
const LARGE: i32 = i16::MAX as i32 / (CENTRE[0] + CENTRE[1]);

/// A number for every triangle of a group.
pub type Lane<T = i32> = [T; LANES];

/// A group of triangles in a slice. Only what is said of those in `drawn` means anything.
pub struct Setup {
    /// Bit by bit, the triangles that are to be filled.
    pub drawn: u32,
    /// Those that may show but do not fit this arithmetic.
    pub wide: u32,
    /// Those of `drawn` that may reach beyond the panel.
    pub rim: u32,
    /// x and y of the corners in steps, and their depths.
    pub x: [Lane; 3],
    pub y: [Lane; 3],
    pub z: [Lane; 3],
    /// -1 where corners go round the other way than those of a triangle with positive area.
    pub turned: Lane,
    /// The first and last columns and rows with pixels that may be covered, in the image.
    pub first: [Lane; 2],
    pub last: [Lane; 2],
    /// Edge functions at the centre of the first block: not below 0 inside. In steps, rounded down: they grow by whole numbers.
    pub edges: [Lane; 3],
    /// By what edge functions grow from column to column, and from row to row.
    pub across: [Lane; 3],
    pub down: [Lane; 3],
    /// Depth at the centre of the first block, and by what it grows.
    pub depth: Lane<f32>,
    pub depth_across: Lane<f32>,
    pub depth_down: Lane<f32>,
}

impl Setup {
    /// Empty.
    pub fn new() -> Self {
        Self {
            drawn: 0,
            wide: 0,
            rim: 0,
            x: [[0; LANES]; 3],
            y: [[0; LANES]; 3],
            z: [[0; LANES]; 3],
            turned: [0; LANES],
            first: [[0; LANES]; 2],
            last: [[0; LANES]; 2],
            edges: [[0; LANES]; 3],
            across: [[0; LANES]; 3],
            down: [[0; LANES]; 3],
            depth: [0.0; LANES],
            depth_across: [0.0; LANES],
            depth_down: [0.0; LANES],
        }
    }

    /// Sets group `group` up. `front` is the sign that the area of a triangle has whose front is seen, 0 if that is not known.
    #[inline(always)]
    pub fn prepare<B: Block>(&mut self, figure: &Figure, vertices: &Vertices, grid: &Grid, front: i32, group: usize) {
        let [common, any] = self.gather::<B>(figure, vertices, group);
        self.choose::<B>(&common, &any, grid, front, figure.solid[group]);
        if self.drawn != 0 {
            self.find_edges(grid);
            self.find_depth(grid);
        }
    }

    /// Collects the corners; the states that all of them have, and those that any has.
    #[inline(always)]
    #[allow(unsafe_code)]
    fn gather<B: Block>(&mut self, figure: &Figure, vertices: &Vertices, group: usize) -> [Lane; 2] {
        assert!(vertices.packed().len() >= figure.vertices());
        let mut common = [-1; LANES];
        let mut any = [0; LANES];
        for corner in 0..3 {
            // SAFETY: a figure's corners are below the number of its vertices.
            let packed = unsafe { B::gather(vertices.packed(), &figure.corners(corner)[group]) };
            let (place, depth) = (each(|lane| packed[lane] as i32), each(|lane| (packed[lane] >> 32) as i32));
            self.x[corner] = each(|lane| place[lane] << 16 >> 16);
            self.y[corner] = each(|lane| place[lane] >> 16);
            self.z[corner] = each(|lane| depth[lane] << 16 >> 16);
            common = each(|lane| common[lane] & depth[lane]);
            any = each(|lane| any[lane] | depth[lane]);
        }
        [common, any]
    }

    /// Finds out which triangles are to be filled, turns the corners of those whose area is negative, and finds the pixels in reach.
    ///
    /// What holds is said by signs: of comparisons the compiler makes branches.
    #[inline(always)]
    fn choose<B: Block>(&mut self, common: &Lane, any: &Lane, grid: &Grid, front: i32, solid: u32) {
        let [ax, bx, cx] = self.x;
        let [ay, by, cy] = self.y;
        let area = each(|lane| {
            let one = (bx[lane] - ax[lane]).wrapping_mul(cy[lane] - ay[lane]);
            one.wrapping_sub((by[lane] - ay[lane]).wrapping_mul(cx[lane] - ax[lane]))
        });
        let turned = each(|lane| area[lane] >> 31);
        let (left, right) = (smallest(&self.x), largest(&self.x));
        let (top, bottom) = (smallest(&self.y), largest(&self.y));
        let half = grid.steps() / 2;
        let first = |low: &Lane, axis: usize| {
            let origin = grid.origin[axis];
            each(|lane| (((low[lane] + half - 1) >> grid.shift) + origin).max(0))
        };
        let last = |high: &Lane, axis: usize| {
            let (origin, end) = (grid.origin[axis], grid.size[axis] - 1);
            each(|lane| (((high[lane] - half) >> grid.shift) + origin).min(end))
        };
        let (first_x, first_y) = (first(&left, 0), first(&top, 1));
        let (last_x, last_y) = (last(&right, 0), last(&bottom, 1));
        let shut = each(|lane| -(common[lane] & SIDES | any[lane] & LOST));
        let large =
            each(|lane| (LARGE - right[lane] + left[lane]) | (LARGE - bottom[lane] + top[lane]) | -(any[lane] & WIDE));
        let has_area = each(|lane| area[lane] | area[lane].wrapping_neg());
        let misses = each(|lane| (last_x[lane] - first_x[lane]) | (last_y[lane] - first_y[lane]) | !has_area[lane]);
        let faces = each(|lane| area[lane] ^ front);
        let rim = each(|lane| -(any[lane] & OFF));
        // Where the sign of fronts is not known, all are drawn.
        let backs = if front == 0 { 0 } else { B::negative_lanes(&faces) & solid };
        let open = !B::negative_lanes(&shut);
        let large = B::negative_lanes(&large);
        self.drawn = open & !large & !B::negative_lanes(&misses) & !backs & ((1 << LANES) - 1);
        self.wide = open & large;
        self.rim = B::negative_lanes(&rim);
        turn(&mut self.x, &turned);
        turn(&mut self.y, &turned);
        turn(&mut self.z, &turned);
        self.turned = turned;
        self.first = [first_x, first_y];
        self.last = [last_x, last_y];
    }

    #[inline(always)]
    fn find_edges(&mut self, grid: &Grid) {
        let [x, y] = [self.centres(grid, 0), self.centres(grid, 1)];
        for (edge, [from, to]) in [[1, 2], [2, 0], [0, 1]].into_iter().enumerate() {
            let (from_x, from_y) = (&self.x[from], &self.y[from]);
            let (to_x, to_y) = (&self.x[to], &self.y[to]);
            let across = each(|lane| to_x[lane] - from_x[lane]);
            let up = each(|lane| from_y[lane] - to_y[lane]);
            // The top-left rule: with y downward and a positive area, up is a left edge, rightward a top one.
            let bias = each(|lane| {
                let rightward = !(up[lane] | -up[lane]) & -across[lane];
                !(-up[lane] | rightward) >> 31
            });
            self.edges[edge] = each(|lane| {
                let one = across[lane].wrapping_mul(y[lane] - from_y[lane]);
                one.wrapping_add(up[lane].wrapping_mul(x[lane] - from_x[lane])).wrapping_add(bias[lane]) >> grid.shift
            });
            self.across[edge] = up;
            self.down[edge] = across;
        }
    }

    #[inline(always)]
    fn find_depth(&mut self, grid: &Grid) {
        let steps = grid.steps() as f32;
        let arm = |values: &[Lane; 3], corner: usize| each(|lane| (values[corner][lane] - values[0][lane]) as f32);
        let [bx, by, bz] = [arm(&self.x, 1), arm(&self.y, 1), arm(&self.z, 1)];
        let [cx, cy, cz] = [arm(&self.x, 2), arm(&self.y, 2), arm(&self.z, 2)];
        let per_area = each(|lane| 1.0 / (bx[lane] * cy[lane] - by[lane] * cx[lane]));
        let across = each(|lane| (bz[lane] * cy[lane] - cz[lane] * by[lane]) * per_area[lane]);
        let down = each(|lane| (cz[lane] * bx[lane] - bz[lane] * cx[lane]) * per_area[lane]);
        let [x, y] = [self.centres(grid, 0), self.centres(grid, 1)];
        self.depth = each(|lane| {
            let [x, y] = [x[lane] - self.x[0][lane], y[lane] - self.y[0][lane]];
            self.z[0][lane] as f32 + across[lane] * x as f32 + down[lane] * y as f32
        });
        self.depth_across = each(|lane| across[lane] * steps);
        self.depth_down = each(|lane| down[lane] * steps);
    }

    /// The centres of the first blocks, in steps.
    #[inline(always)]
    fn centres(&self, grid: &Grid, axis: usize) -> Lane {
        let half = grid.steps() / 2;
        let offset = CENTRE[axis] - grid.origin[axis];
        each(|lane| ((self.first[axis][lane] + offset) << grid.shift) + half)
    }
}

/// `value` for every lane.
#[inline(always)]
fn each<T: Copy + Default>(value: impl Fn(usize) -> T) -> Lane<T> {
    let mut lanes = [T::default(); LANES];
    for (lane, result) in lanes.iter_mut().enumerate() {
        *result = value(lane);
    }
    lanes
}

#[inline(always)]
fn smallest(values: &[Lane; 3]) -> Lane {
    each(|lane| values[0][lane].min(values[1][lane]).min(values[2][lane]))
}

#[inline(always)]
fn largest(values: &[Lane; 3]) -> Lane {
    each(|lane| values[0][lane].max(values[1][lane]).max(values[2][lane]))
}

/// Swaps the second and third where `turned` is -1.
#[inline(always)]
fn turn(values: &mut [Lane; 3], turned: &Lane) {
    let [_, b, c] = *values;
    values[1] = each(|lane| b[lane] ^ turned[lane] & (b[lane] ^ c[lane]));
    values[2] = each(|lane| c[lane] ^ turned[lane] & (b[lane] ^ c[lane]));
}

/// A gradient, or a number that wraps, in the 16 bits of a block.
#[inline(always)]
pub fn wrapped(value: f32) -> i16 {
    rounded(value) as i16
}

const _: () = assert!(COLUMNS as i32 == 2 * CENTRE[0]);
