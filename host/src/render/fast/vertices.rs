//! Vertices of a slice.

use super::figure::{Figure, LANES};
use super::grid::{FAR_PX, Grid};
use shaders::project::methods::SliceProjector;
use shaders::project::methods::lanes::NOWHERE;

/// The bits of [`Vertices::depths`] above the depth, besides those of [`shaders::project::methods::lanes::Lanes::state`]: the place does not
/// fit 16 bits.
pub const WIDE: u32 = 0x80 << 16;
/// There is no pixel.
pub const LOST: u32 = (NOWHERE as u32) << 16;
/// Sides of the panel.
pub const SIDES: u32 = 0xF << 16;
/// All that keeps a vertex from being on the panel and lit.
pub const OFF: u32 = 0x3F << 16;

/// The vertices of one face in one slice.
#[derive(Default)]
pub struct Vertices {
    /// x and, in the upper half, y in steps.
    pub places: Vec<[u32; LANES]>,
    /// Depths, and in the upper half what else is known.
    pub depths: Vec<[u32; LANES]>,
}

impl Vertices {
    /// Projects them.
    #[inline(always)]
    pub fn project(&mut self, figure: &Figure, projector: &SliceProjector<f32>, grid: &Grid) {
        let [xs, ys, zs] = &figure.positions;
        self.places.resize(xs.len(), [0; LANES]);
        self.depths.resize(xs.len(), [0; LANES]);
        let grid = *grid;
        let outputs = self.places.iter_mut().zip(&mut self.depths);
        for (((x, y), z), (places, depths)) in xs.iter().zip(ys).zip(zs).zip(outputs) {
            let vertices = projector.vertices([x, y, z]);
            for lane in 0..LANES {
                let [u, v] = [vertices.pixel[0][lane], vertices.pixel[1][lane]];
                let [x, y] = [grid.place(0, u), grid.place(1, v)];
                let is_far = !(u.abs() < FAR_PX && v.abs() < FAR_PX);
                let is_wide = x != i32::from(x as i16) || y != i32::from(y as i16);
                let state = (vertices.state[lane] as u32) << 16;
                places[lane] = x as u32 & 0xFFFF | (y as u32) << 16;
                depths[lane] = grid.depth(vertices.depth_m[lane]) as u32 & 0xFFFF
                    | state
                    | if is_far { LOST } else { 0 }
                    | if is_wide { WIDE } else { 0 };
            }
        }
    }
}
