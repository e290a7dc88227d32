//! Triangles of a slice: which of them may show, and what is to be known to fill them.

use super::block::{Block, CENTRE, COLUMNS, ROWS};
use super::cover::Slope;
use super::figure::Figure;
use super::grid::{Grid, rounded};
use super::vertices::{LOST, OFF, SIDES, Vertices, WIDE};

/// Triangles larger than this many steps, 170 pixels at 32 steps, are wide: their edge functions would leave 16 bits within a block,
/// whose farthest pixel is six from its centre, and their areas 32.
const LARGE: i32 = i16::MAX as i32 / (CENTRE[0] + CENTRE[1]);

/// A number for every triangle of a group.
pub type Lane<const N: usize, T = i32> = [T; N];

/// A group of triangles in a slice. Only what is said of those in `drawn` means anything.
pub struct Setup<const N: usize> {
    /// Bit by bit, the triangles that are to be filled.
    pub drawn: u32,
    /// Those that may show but do not fit this arithmetic.
    pub wide: u32,
    /// Those of `drawn` that may reach beyond the panel.
    pub rim: u32,
    /// Those of `drawn` that lie in one block.
    pub small: u32,
    /// x and y of the corners in steps, and their depths.
    pub x: [Lane<N>; 3],
    pub y: [Lane<N>; 3],
    pub z: [Lane<N>; 3],
    /// -1 where corners go round the other way than those of a triangle with positive area.
    pub turned: Lane<N>,
    /// The first and last columns and rows with pixels that may be covered, in the image.
    pub first: [Lane<N>; 2],
    pub last: [Lane<N>; 2],
    /// Edge functions at the centre of the first block: not below 0 inside. In steps, rounded down: they grow by whole numbers.
    pub edges: [Lane<N>; 3],
    /// By what edge functions grow from column to column, and from row to row.
    pub across: [Lane<N>; 3],
    pub down: [Lane<N>; 3],
    /// Depth at the centre of the first block, and by what it grows from column to column and from row to row.
    pub depth: [Lane<N, f32>; 3],
    /// The same in whole numbers.
    pub rounded_depth: [Lane<N>; 3],
    /// The first and last columns and rows of all that was in `drawn`, lane by lane.
    touched: [[Lane<N>; 2]; 2],
}

impl<const N: usize> Setup<N> {
    /// Empty.
    pub fn new() -> Self {
        Self {
            drawn: 0,
            wide: 0,
            rim: 0,
            small: 0,
            x: [[0; N]; 3],
            y: [[0; N]; 3],
            z: [[0; N]; 3],
            turned: [0; N],
            first: [[0; N]; 2],
            last: [[0; N]; 2],
            edges: [[0; N]; 3],
            across: [[0; N]; 3],
            down: [[0; N]; 3],
            depth: [[0.0; N]; 3],
            rounded_depth: [[0; N]; 3],
            touched: [[[i32::MAX; N]; 2], [[0; N]; 2]],
        }
    }

    /// Sets group `group` up. `front` is the sign that the area of a triangle has whose front is seen, 0 if that is not known.
    #[inline(always)]
    pub fn prepare<B: Block>(&mut self, figure: &Figure, vertices: &Vertices, grid: &Grid, front: i32, group: usize) {
        let [common, any] = self.gather::<B>(figure, vertices, group);
        self.choose::<B>(&common, &any, grid, front, figure.solids::<N>(group));
        if self.drawn != 0 {
            self.find_edges(grid);
            self.find_depth(grid);
        }
    }

    /// The first and last columns and rows of all that was drawn; the first beyond the last where nothing was.
    pub fn touched(&self) -> [[i32; 2]; 2] {
        let [first, last] = &self.touched;
        let lowest = |lanes: &Lane<N>| lanes.iter().copied().fold(i32::MAX, i32::min);
        let highest = |lanes: &Lane<N>| lanes.iter().copied().fold(-1, i32::max);
        [[lowest(&first[0]), lowest(&first[1])], [highest(&last[0]), highest(&last[1])]]
    }

    /// Depth over a triangle that is drawn.
    #[inline(always)]
    pub fn depth_of(&self, lane: usize) -> Slope {
        Slope { value: self.depth[0][lane], across: self.depth[1][lane], down: self.depth[2][lane] }
    }

    /// Collects the corners; the states that all of them have, and those that any has.
    #[inline(always)]
    #[allow(unsafe_code)]
    fn gather<B: Block>(&mut self, figure: &Figure, vertices: &Vertices, group: usize) -> [Lane<N>; 2] {
        assert!(vertices.packed().len() >= figure.vertices());
        let mut common = [-1; N];
        let mut any = [0; N];
        for corner in 0..3 {
            // SAFETY: a figure's corners are below the number of its vertices.
            let packed = unsafe { B::gather(vertices.packed(), figure.corners::<N>(corner, group)) };
            let (place, depth) =
                (each::<N, _>(|lane| packed[lane] as i32), each::<N, _>(|lane| (packed[lane] >> 32) as i32));
            self.x[corner] = each::<N, _>(|lane| place[lane] << 16 >> 16);
            self.y[corner] = each::<N, _>(|lane| place[lane] >> 16);
            self.z[corner] = each::<N, _>(|lane| depth[lane] << 16 >> 16);
            common = each::<N, _>(|lane| common[lane] & depth[lane]);
            any = each::<N, _>(|lane| any[lane] | depth[lane]);
        }
        [common, any]
    }

    /// Finds out which triangles are to be filled, turns the corners of those whose area is negative, and finds the pixels in reach.
    ///
    /// What holds is said by signs: of comparisons the compiler makes branches.
    #[inline(always)]
    fn choose<B: Block>(&mut self, common: &Lane<N>, any: &Lane<N>, grid: &Grid, front: i32, solid: u32) {
        let [ax, bx, cx] = self.x;
        let [ay, by, cy] = self.y;
        let area = each::<N, _>(|lane| {
            let one = (bx[lane] - ax[lane]).wrapping_mul(cy[lane] - ay[lane]);
            one.wrapping_sub((by[lane] - ay[lane]).wrapping_mul(cx[lane] - ax[lane]))
        });
        let turned = each::<N, _>(|lane| area[lane] >> 31);
        let (left, right) = (smallest(&self.x), largest(&self.x));
        let (top, bottom) = (smallest(&self.y), largest(&self.y));
        let half = grid.steps() / 2;
        let first = |low: &Lane<N>, axis: usize| {
            let origin = grid.origin[axis];
            each::<N, _>(|lane| (((low[lane] + half - 1) >> grid.shift) + origin).max(0))
        };
        let last = |high: &Lane<N>, axis: usize| {
            let (origin, end) = (grid.origin[axis], grid.size[axis] - 1);
            each::<N, _>(|lane| (((high[lane] - half) >> grid.shift) + origin).min(end))
        };
        let (first_x, first_y) = (first(&left, 0), first(&top, 1));
        let (last_x, last_y) = (last(&right, 0), last(&bottom, 1));
        let shut = each::<N, _>(|lane| -(common[lane] & SIDES | any[lane] & LOST));
        let large = each::<N, _>(|lane| {
            (LARGE - right[lane] + left[lane]) | (LARGE - bottom[lane] + top[lane]) | -(any[lane] & WIDE)
        });
        let has_area = each::<N, _>(|lane| area[lane] | area[lane].wrapping_neg());
        let misses =
            each::<N, _>(|lane| (last_x[lane] - first_x[lane]) | (last_y[lane] - first_y[lane]) | !has_area[lane]);
        let faces = each::<N, _>(|lane| area[lane] ^ front);
        let rim = each::<N, _>(|lane| -(any[lane] & OFF));
        let small = each::<N, _>(|lane| {
            (last_x[lane] - first_x[lane] - COLUMNS as i32) & (last_y[lane] - first_y[lane] - ROWS as i32)
        });
        // Where the sign of fronts is not known, all are drawn.
        let backs = if front == 0 { 0 } else { B::negative_lanes(&faces) & solid };
        let open = !B::negative_lanes(&shut);
        let large = B::negative_lanes(&large);
        self.drawn = open & !large & !B::negative_lanes(&misses) & !backs & ((1 << N) - 1);
        self.wide = open & large;
        self.rim = B::negative_lanes(&rim);
        self.small = B::negative_lanes(&small);
        let missed = each::<N, _>(|lane| misses[lane] >> 31);
        for (axis, (first, last)) in [(&first_x, &last_x), (&first_y, &last_y)].into_iter().enumerate() {
            let [touched_first, touched_last] = [self.touched[0][axis], self.touched[1][axis]];
            self.touched[0][axis] = each::<N, _>(|lane| touched_first[lane].min(first[lane] | missed[lane] & i32::MAX));
            self.touched[1][axis] = each::<N, _>(|lane| touched_last[lane].max(last[lane] & !missed[lane]));
        }
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
            let across = each::<N, _>(|lane| to_x[lane] - from_x[lane]);
            let up = each::<N, _>(|lane| from_y[lane] - to_y[lane]);
            // The top-left rule: with y downward and a positive area, up is a left edge, rightward a top one.
            let bias = each::<N, _>(|lane| {
                let rightward = !(up[lane] | -up[lane]) & -across[lane];
                !(-up[lane] | rightward) >> 31
            });
            self.edges[edge] = each::<N, _>(|lane| {
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
        let arm =
            |values: &[Lane<N>; 3], corner: usize| each::<N, _>(|lane| (values[corner][lane] - values[0][lane]) as f32);
        let [bx, by, bz] = [arm(&self.x, 1), arm(&self.y, 1), arm(&self.z, 1)];
        let [cx, cy, cz] = [arm(&self.x, 2), arm(&self.y, 2), arm(&self.z, 2)];
        let per_area = each::<N, _>(|lane| 1.0 / (bx[lane] * cy[lane] - by[lane] * cx[lane]));
        let across = each::<N, _>(|lane| (bz[lane] * cy[lane] - cz[lane] * by[lane]) * per_area[lane]);
        let down = each::<N, _>(|lane| (cz[lane] * bx[lane] - bz[lane] * cx[lane]) * per_area[lane]);
        let [x, y] = [self.centres(grid, 0), self.centres(grid, 1)];
        let depth = each::<N, _>(|lane| {
            let [x, y] = [x[lane] - self.x[0][lane], y[lane] - self.y[0][lane]];
            self.z[0][lane] as f32 + across[lane] * x as f32 + down[lane] * y as f32
        });
        let (across, down) = (each::<N, _>(|lane| across[lane] * steps), each::<N, _>(|lane| down[lane] * steps));
        // One by one: of a loop over the three the compiler makes gathers.
        self.rounded_depth = [
            each::<N, _>(|lane| rounded(depth[lane])),
            each::<N, _>(|lane| rounded(across[lane])),
            each::<N, _>(|lane| rounded(down[lane])),
        ];
        self.depth = [depth, across, down];
    }

    /// The centres of the first blocks, in steps.
    #[inline(always)]
    fn centres(&self, grid: &Grid, axis: usize) -> Lane<N> {
        let half = grid.steps() / 2;
        let offset = CENTRE[axis] - grid.origin[axis];
        each::<N, _>(|lane| ((self.first[axis][lane] + offset) << grid.shift) + half)
    }
}

/// `value` for every lane.
#[inline(always)]
fn each<const N: usize, T: Copy + Default>(value: impl Fn(usize) -> T) -> Lane<N, T> {
    let mut lanes = [T::default(); N];
    for (lane, result) in lanes.iter_mut().enumerate() {
        *result = value(lane);
    }
    lanes
}

#[inline(always)]
fn smallest<const N: usize>(values: &[Lane<N>; 3]) -> Lane<N> {
    each::<N, _>(|lane| values[0][lane].min(values[1][lane]).min(values[2][lane]))
}

#[inline(always)]
fn largest<const N: usize>(values: &[Lane<N>; 3]) -> Lane<N> {
    each::<N, _>(|lane| values[0][lane].max(values[1][lane]).max(values[2][lane]))
}

/// Swaps the second and third where `turned` is -1.
#[inline(always)]
fn turn<const N: usize>(values: &mut [Lane<N>; 3], turned: &Lane<N>) {
    let [_, b, c] = *values;
    values[1] = each::<N, _>(|lane| b[lane] ^ turned[lane] & (b[lane] ^ c[lane]));
    values[2] = each::<N, _>(|lane| c[lane] ^ turned[lane] & (b[lane] ^ c[lane]));
}

/// A gradient, or a number that wraps, in the 16 bits of a block.
#[inline(always)]
pub fn wrapped(value: f32) -> i16 {
    rounded(value) as i16
}

const _: () = assert!(COLUMNS as i32 == 2 * CENTRE[0]);
