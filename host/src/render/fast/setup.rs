//! Triangles of a slice: which of them may show, and what is to be known to fill them.

use super::block::{CENTRE, COLUMNS};
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
    pub fn prepare(&mut self, figure: &Figure, vertices: &Vertices, grid: &Grid, front: i32, group: usize) {
        let [common, any] = self.gather(figure, vertices, group);
        self.choose(&common, &any, grid, front, figure.solid[group]);
        if self.drawn != 0 {
            self.find_edges(grid);
            self.find_depth(grid);
        }
    }

    /// Collects the corners; the states that all of them have, and those that any has.
    #[inline(always)]
    fn gather(&mut self, figure: &Figure, vertices: &Vertices, group: usize) -> [Lane<u32>; 2] {
        let (mut common, mut any) = ([u32::MAX; LANES], [0; LANES]);
        let [places, depths] = [vertices.places.as_flattened(), vertices.depths.as_flattened()];
        for corner in 0..3 {
            let indices = &figure.corners[corner][group];
            let mut place = [0; LANES];
            let mut depth = [0; LANES];
            for lane in 0..LANES {
                place[lane] = places[indices[lane] as usize];
                depth[lane] = depths[indices[lane] as usize];
            }
            for lane in 0..LANES {
                self.x[corner][lane] = i32::from(place[lane] as i16);
                self.y[corner][lane] = place[lane] as i32 >> 16;
                self.z[corner][lane] = i32::from(depth[lane] as i16);
                common[lane] &= depth[lane];
                any[lane] |= depth[lane];
            }
        }
        [common, any]
    }

    /// Finds out which triangles are to be filled, turns the corners of those whose area is negative, and finds the pixels in reach.
    #[inline(always)]
    fn choose(&mut self, common: &Lane<u32>, any: &Lane<u32>, grid: &Grid, front: i32, solid: u32) {
        let half = grid.steps() / 2;
        let (mut drawn, mut wide, mut rim) = ([0; LANES], [0; LANES], [0; LANES]);
        for lane in 0..LANES {
            let [[ax, bx, cx], [ay, by, cy], [_, bz, cz]] =
                [&self.x, &self.y, &self.z].map(|axis| axis.map(|c| c[lane]));
            let (left, right) = (ax.min(bx).min(cx), ax.max(bx).max(cx));
            let (top, bottom) = (ay.min(by).min(cy), ay.max(by).max(cy));
            let is_large = right - left > LARGE || bottom - top > LARGE || any[lane] & WIDE != 0;
            let area = (bx - ax).wrapping_mul(cy - ay).wrapping_sub((by - ay).wrapping_mul(cx - ax));
            let may_show = common[lane] & SIDES == 0 && any[lane] & LOST == 0;
            // The product of two signs.
            let is_back = solid >> lane & 1 != 0 && area.signum() * front < 0;
            let turned = area >> 31;
            self.turned[lane] = turned;
            self.x[1][lane] = bx ^ turned & (bx ^ cx);
            self.x[2][lane] = cx ^ turned & (bx ^ cx);
            self.y[1][lane] = by ^ turned & (by ^ cy);
            self.y[2][lane] = cy ^ turned & (by ^ cy);
            self.z[1][lane] = bz ^ turned & (bz ^ cz);
            self.z[2][lane] = cz ^ turned & (bz ^ cz);
            let first_x = (((left + half - 1) >> grid.shift) + grid.origin[0]).max(0);
            let first_y = (((top + half - 1) >> grid.shift) + grid.origin[1]).max(0);
            let last_x = (((right - half) >> grid.shift) + grid.origin[0]).min(grid.size[0] - 1);
            let last_y = (((bottom - half) >> grid.shift) + grid.origin[1]).min(grid.size[1] - 1);
            self.first[0][lane] = first_x;
            self.first[1][lane] = first_y;
            self.last[0][lane] = last_x;
            self.last[1][lane] = last_y;
            let reaches = first_x <= last_x && first_y <= last_y;
            drawn[lane] = u32::from(may_show & !is_large & reaches & (area != 0) & !is_back) << lane;
            wide[lane] = u32::from(may_show & is_large) << lane;
            rim[lane] = u32::from(any[lane] & OFF != 0) << lane;
        }
        [self.drawn, self.wide, self.rim] =
            [drawn, wide, rim].map(|lanes| lanes.iter().fold(0, |bits, bit| bits | bit));
    }

    #[inline(always)]
    fn find_edges(&mut self, grid: &Grid) {
        let half = grid.steps() / 2;
        for (edge, (from, to)) in [(1, 2), (2, 0), (0, 1)].into_iter().enumerate() {
            for lane in 0..LANES {
                let [x, y] = [0, 1].map(|axis| self.centre(grid, axis, lane) * grid.steps() + half);
                let across = self.x[to][lane] - self.x[from][lane];
                let down = self.y[to][lane] - self.y[from][lane];
                // The top-left rule: with y downward and a positive area, up is a left edge, rightward a top one.
                let owns_border = (down < 0) | ((down == 0) & (across > 0));
                let value =
                    across.wrapping_mul(y - self.y[from][lane]).wrapping_sub(down.wrapping_mul(x - self.x[from][lane]));
                self.edges[edge][lane] = (value - i32::from(!owns_border)) >> grid.shift;
                self.across[edge][lane] = -down;
                self.down[edge][lane] = across;
            }
        }
    }

    #[inline(always)]
    fn find_depth(&mut self, grid: &Grid) {
        let steps = grid.steps() as f32;
        for lane in 0..LANES {
            let [[ax, bx, cx], [ay, by, cy], [az, bz, cz]] =
                [&self.x, &self.y, &self.z].map(|axis| axis.map(|corner| corner[lane]));
            let [bx, by, bz] = [(bx - ax) as f32, (by - ay) as f32, (bz - az) as f32];
            let [cx, cy, cz] = [(cx - ax) as f32, (cy - ay) as f32, (cz - az) as f32];
            let per_area = steps / (bx * cy - by * cx);
            let across = (bz * cy - cz * by) * per_area;
            let down = (cz * bx - bz * cx) * per_area;
            let [x, y] = [0, 1].map(|axis| self.centre(grid, axis, lane) as f32 + 0.5);
            self.depth[lane] = az as f32 + across * (x - ax as f32 / steps) + down * (y - ay as f32 / steps);
            self.depth_across[lane] = across;
            self.depth_down[lane] = down;
        }
    }

    /// The pixel at the centre of the first block, from the grid's origin.
    #[inline(always)]
    fn centre(&self, grid: &Grid, axis: usize, lane: usize) -> i32 {
        self.first[axis][lane] + CENTRE[axis] - grid.origin[axis]
    }
}

/// A gradient, or a number that wraps, in the 16 bits of a block.
#[inline(always)]
pub fn wrapped(value: f32) -> i16 {
    rounded(value) as i16
}

const _: () = assert!(COLUMNS as i32 == 2 * CENTRE[0]);
