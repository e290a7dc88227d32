//! Many vertices at once, for processors that do the same to many numbers.

use super::SliceProjector;

/// [`Lanes::state`]: there is no pixel; nothing else of the lane means anything.
pub const NOWHERE: i32 = 0x20;
/// [`Lanes::state`]: viewer or projector are behind the mirror.
pub const UNLIT: i32 = 0x10;

/// [`super::Vertex`] `N` times.
#[derive(Clone, Copy, Debug)]
pub struct Lanes<const N: usize> {
    /// u and v in pixels.
    pub pixel: [[f32; N]; 2],
    /// As [`super::Vertex::depth_m`].
    pub depth_m: [f32; N],
    /// The bits of [`super::Vertex::sides`], [`UNLIT`] and [`NOWHERE`]: 0 for what is on the panel and lit.
    pub state: [i32; N],
}

impl SliceProjector<f32> {
    /// [`SliceProjector::vertex`] of `N` points, given as their x, y and z.
    #[inline(always)]
    pub fn vertices<const N: usize>(&self, points: [&[f32; N]; 3]) -> Lanes<N> {
        let mut lanes = Lanes { pixel: [[0.0; N]; 2], depth_m: [0.0; N], state: [NOWHERE; N] };
        for lane in 0..N {
            if let Some(vertex) = self.vertex(points.map(|axis| axis[lane])) {
                lanes.pixel[0][lane] = vertex.pixel[0];
                lanes.pixel[1][lane] = vertex.pixel[1];
                lanes.depth_m[lane] = vertex.depth_m;
                lanes.state[lane] = i32::from(vertex.sides) | if vertex.lit { 0 } else { UNLIT };
            }
        }
        lanes
    }
}
