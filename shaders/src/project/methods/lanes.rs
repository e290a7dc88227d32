//! Many vertices at once, for processors that do the same to many numbers.

use super::kernel::UNSURE;
use super::{Method, SliceProjector};

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
    /// [`SliceProjector::vertex`] of `N` points, given as their x, y and z. The answers are the same bits; only [`Method::ConeTable`]
    /// finds them by Newton's steps, which are nearer to the root and in lanes faster than gathers from the table.
    ///
    /// Written for the caller's vector instructions: without a branch, but for the few points that need another way.
    #[inline(always)]
    pub fn vertices<const N: usize>(&self, points: [&[f32; N]; 3]) -> Lanes<N> {
        // So many steps settle all that is on the panel of a physical rig.
        let mut lanes = match self.method {
            Method::Planar => self.trials::<0, N>(points, self.settled),
            Method::ConeNewton | Method::ConeTable => self.trials::<2, N>(points, self.settled),
            Method::ConeRoot => self.trials::<3, N>(points, self.root_settled()),
        };
        if lanes.state.iter().fold(0, |all, state| all | state) & UNSURE != 0 {
            self.ask_again(points, &mut lanes);
        }
        lanes
    }

    #[inline(always)]
    fn trials<const STEPS: usize, const N: usize>(&self, points: [&[f32; N]; 3], settled: f32) -> Lanes<N> {
        let mut lanes = Lanes { pixel: [[0.0; N]; 2], depth_m: [0.0; N], state: [0; N] };
        for lane in 0..N {
            let trial = self.trial::<STEPS>(points.map(|axis| axis[lane]), settled);
            [lanes.pixel[0][lane], lanes.pixel[1][lane]] = trial.pixel;
            lanes.depth_m[lane] = trial.depth_m;
            lanes.state[lane] = trial.state;
        }
        lanes
    }

    #[cold]
    #[inline(never)]
    fn ask_again<const N: usize>(&self, points: [&[f32; N]; 3], lanes: &mut Lanes<N>) {
        for lane in 0..N {
            if lanes.state[lane] != UNSURE {
                continue;
            }
            lanes.state[lane] = NOWHERE;
            if let Some(vertex) = self.vertex(points.map(|axis| axis[lane])) {
                [lanes.pixel[0][lane], lanes.pixel[1][lane]] = vertex.pixel;
                lanes.depth_m[lane] = vertex.depth_m;
                lanes.state[lane] = i32::from(vertex.sides) | if vertex.lit { 0 } else { UNLIT };
            }
        }
    }
}

#[cfg(test)]
mod tests;
