//! Many vertices at once, for processors that do the same to many numbers.

use super::kernel::{Course, Trial, UNSURE};
use super::{Method, SliceProjector};
use crate::wgsl::BENDS;

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

/// [`Course`] `N` times.
struct Courses<const N: usize> {
    numbers: [[f32; N]; 5],
    marks: [i32; N],
}

impl<const N: usize> Courses<N> {
    #[inline(always)]
    fn get(&self, lane: usize) -> Course<f32> {
        let [a, b, c, d, e] = &self.numbers;
        Course { numbers: [a[lane], b[lane], c[lane], d[lane], e[lane]], marks: self.marks[lane] }
    }

    #[inline(always)]
    fn set(&mut self, lane: usize, course: Course<f32>) {
        for (numbers, number) in self.numbers.iter_mut().zip(course.numbers) {
            numbers[lane] = number;
        }
        self.marks[lane] = course.marks;
    }
}

impl<const N: usize> Lanes<N> {
    #[inline(always)]
    fn set(&mut self, lane: usize, trial: Trial<f32>) {
        [self.pixel[0][lane], self.pixel[1][lane]] = trial.pixel;
        self.depth_m[lane] = trial.depth_m;
        self.state[lane] = trial.state;
    }
}

impl SliceProjector<f32> {
    /// [`SliceProjector::vertex`] of `N` points, given as their x, y and z. The answers are the same bits; only [`Method::ConeTable`]
    /// finds them by Newton's steps, which are nearer to the root and need no gathers.
    ///
    /// Written for the caller's vector instructions: without a branch, but for the few points that need another way. 32 lanes are
    /// fastest: 1.7 ns a vertex planar and 4.1 by Newton with AVX-512, 3.7 and 7.1 with AVX2, 7.0 and 15 with SSE2 alone; one by one
    /// it is 25 and 63. On a bent piece of a curve they take a quarter of one by one (`cargo bench -p shaders vertices`).
    #[inline(always)]
    pub fn vertices<const N: usize>(&self, points: [&[f32; N]; 3]) -> Lanes<N> {
        let mut lanes = match self.bends() {
            0 => self.by_method::<0, N>(points),
            1 => self.by_method::<1, N>(points),
            2 => self.by_method::<2, N>(points),
            _ => self.by_method::<BENDS, N>(points),
        };
        if lanes.state.iter().fold(0, |all, state| all | state) & UNSURE != 0 {
            self.ask_again(points, &mut lanes);
        }
        lanes
    }

    /// So many steps settle every point on the panels of the built-in rigs, and of all tested ones but those with two roots.
    #[inline(always)]
    fn by_method<const PIECES: usize, const N: usize>(&self, points: [&[f32; N]; 3]) -> Lanes<N> {
        match self.method {
            Method::Planar => self.trials::<PIECES, 0, N>(points, self.settled),
            Method::ConeNewton | Method::ConeTable => self.trials::<PIECES, 2, N>(points, self.settled),
            Method::ConeRoot => self.trials::<PIECES, 3, N>(points, self.root_settled()),
        }
    }

    /// Part by part for all lanes, so that a processor finds other lanes' work while some wait for a root or a quotient: the cone
    /// takes 4.1 ns a vertex with AVX-512 where it took 5.7 when lanes went their whole way at once. The steps to the planar line of a bent
    /// piece, as one part, were not vectorised at all.
    #[inline(always)]
    fn trials<const PIECES: usize, const STEPS: usize, const N: usize>(
        &self,
        points: [&[f32; N]; 3],
        settled: f32,
    ) -> Lanes<N> {
        let mut lanes = Lanes { pixel: [[0.0; N]; 2], depth_m: [0.0; N], state: [0; N] };
        let mut courses = Courses { numbers: [[0.0; N]; 5], marks: [0; N] };
        let point = |lane| points.map(|axis| axis[lane]);
        if STEPS == 0 && PIECES == 0 {
            for lane in 0..N {
                let course = self.first_part::<PIECES>(point(lane), 0, courses.get(lane));
                lanes.set(lane, self.last_part::<PIECES, false>(point(lane), course, settled));
            }
            return lanes;
        }
        for part in 0..Self::first_parts::<PIECES>() {
            for lane in 0..N {
                courses.set(lane, self.first_part::<PIECES>(point(lane), part, courses.get(lane)));
            }
        }
        for _ in 0..STEPS {
            for lane in 0..N {
                courses.set(lane, self.next_part::<PIECES>(point(lane), courses.get(lane), settled));
            }
        }
        for lane in 0..N {
            let trial = match STEPS {
                0 => self.last_part::<PIECES, false>(point(lane), courses.get(lane), settled),
                _ => self.last_part::<PIECES, true>(point(lane), courses.get(lane), settled),
            };
            lanes.set(lane, trial);
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
