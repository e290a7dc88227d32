//! Vertices of a slice.

use super::figure::{Figure, VERTEX_LANES};
use super::grid::{FAR_PX, FINE, Grid, nearest_step};
use shaders::project::methods::SliceProjector;
use shaders::project::methods::lanes::NOWHERE;

/// In the upper half of a vertex's depth, besides [`shaders::project::methods::lanes::Lanes::state`]: the place does not fit 16 bits.
pub const WIDE: i32 = 0x80 << 16;
/// There is no pixel.
pub const LOST: i32 = NOWHERE << 16;
/// Sides of the panel.
pub const SIDES: i32 = 0xF << 16;
/// All that keeps a vertex from being on the panel and lit.
pub const OFF: i32 = 0x3F << 16;

/// Where in a vertex the finer steps are by which it lies beyond x and y.
const FINE_AT: [u32; 2] = [56, 60];

/// The vertices of one face in one slice: x, y and depth in 16 bits each, and what else is known.
#[derive(Default)]
pub struct Vertices(pub(crate) Vec<[u64; VERTEX_LANES]>);

impl Vertices {
    /// Projects them.
    #[inline(always)]
    pub fn project(&mut self, figure: &Figure, projector: &SliceProjector<f32>, grid: &Grid) {
        let [xs, ys, zs] = &figure.positions;
        self.0.resize(xs.len(), [0; VERTEX_LANES]);
        let (grid, finer) = (*grid, grid.finer());
        for (((x, y), z), packed) in xs.iter().zip(ys).zip(zs).zip(&mut self.0) {
            let vertices = projector.vertices([x, y, z]);
            for (lane, packed) in packed.iter_mut().enumerate() {
                let [u, v] = [vertices.pixel[0][lane], vertices.pixel[1][lane]];
                let [[x, more_x], [y, more_y]] = [nearest_step(finer.place(0, u)), nearest_step(finer.place(1, v))];
                let is_far = !((u.abs() < FAR_PX) & (v.abs() < FAR_PX));
                let is_wide = (x != i32::from(x as i16)) | (y != i32::from(y as i16));
                let place = x & 0xFFFF | y << 16;
                let depth = grid.depth(vertices.depth_m[lane]) & 0xFFFF;
                let state = vertices.state[lane] << 16 | if is_far { LOST } else { 0 } | if is_wide { WIDE } else { 0 };
                let fine = (more_x & 0xF) << (FINE_AT[0] - 32) | more_y << (FINE_AT[1] - 32);
                *packed = u64::from(place as u32) | u64::from((depth | state | fine) as u32) << 32;
            }
        }
    }

    /// x and y of vertex `index`, of those that fit 16 bits, in the steps of [`Grid::finer`].
    #[inline(always)]
    pub fn fine(&self, index: u32) -> [i64; 2] {
        let packed = self.packed()[index as usize];
        // Four bits each, the first of which is the sign.
        let [more_x, more_y] = [(packed << (60 - FINE_AT[0])) as i64 >> 60, (packed << (60 - FINE_AT[1])) as i64 >> 60];
        [(i64::from(packed as i16) << FINE) + more_x, (i64::from((packed >> 16) as i16) << FINE) + more_y]
    }

    /// All of them, in the order of the figure's.
    #[inline(always)]
    pub fn packed(&self) -> &[u64] {
        self.0.as_flattened()
    }
}
