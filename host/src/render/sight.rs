//! Sight lines of a slice's pixels, and where they meet triangles.

use glam::DVec3;
use shaders::project::methods::{Real, SightLine, SliceProjector};

/// What a pixel shows: everything on the line through `mirror` along `toward_viewer`.
#[derive(Clone, Copy, Debug)]
pub struct Line {
    /// M, world metres.
    pub mirror: DVec3,
    /// The unit direction from M to V'.
    pub toward_viewer: DVec3,
    /// Depth of M, as [`SightLine::depth_m`].
    pub depth_m: f64,
    /// As [`SightLine::from_origin_m`].
    pub from_origin_m: f64,
}

impl<F: Real> From<SightLine<F>> for Line {
    fn from(sight: SightLine<F>) -> Self {
        Self {
            mirror: DVec3::from_array(sight.mirror.map(F::wide)),
            toward_viewer: DVec3::from_array(sight.toward_viewer.map(F::wide)),
            depth_m: sight.depth_m.wide(),
            from_origin_m: sight.from_origin_m,
        }
    }
}

impl Line {
    /// |V' − M| in metres.
    pub fn viewer_distance_m(&self) -> f64 {
        self.from_origin_m + self.depth_m
    }

    /// Depth of the point at which the line meets the plane of a triangle; not finite where it does not.
    pub fn plane_depth_m(&self, [a, b, c]: [DVec3; 3]) -> f64 {
        let normal = (b - a).cross(c - a);
        self.depth_m + normal.dot(self.mirror - a) / normal.dot(self.toward_viewer)
    }

    /// The weights of the corners where the line meets the triangle; `None` where it passes by.
    ///
    /// The sign for an edge is the exact opposite for its neighbour, who runs through it the other way: no line passes between two
    /// triangles, and none meets both, but at a silhouette.
    pub fn weights(&self, corners: [DVec3; 3]) -> Option<[f32; 3]> {
        let arms = corners.map(|corner| corner - self.mirror);
        let volumes = [(1, 2), (2, 0), (0, 1)].map(|(from, to)| {
            let volume = self.toward_viewer.dot(arms[from].cross(arms[to]));
            let owned = corners[from].to_array() < corners[to].to_array();
            (volume, volume > 0.0 || (volume == 0.0 && owned))
        });
        let side = volumes[0].1;
        let total: f64 = volumes.iter().map(|(volume, _)| volume).sum();
        (volumes.iter().all(|(_, positive)| *positive == side) && total != 0.0)
            .then(|| volumes.map(|(volume, _)| (volume / total) as f32))
    }
}

/// Pixels whose lines get room together, when the first of them is asked for: most pixels are never. Room for all of 4096 × 4096
/// is 1.2 GB for every thread.
const TOGETHER: usize = 256;

/// The sight lines of the pixels of one face in one slice, each found when it is first asked for.
pub struct Sights {
    current: u32,
    /// When each pixel's line was found, and the line: it holds where that is `current`.
    lines: Vec<Vec<(u32, Option<Line>)>>,
}

impl Sights {
    /// For images of `pixels` pixels.
    pub fn new(pixels: usize) -> Self {
        Self { current: 0, lines: vec![Vec::new(); pixels.div_ceil(TOGETHER)] }
    }

    /// Forgets all lines: another face or slice is next.
    pub fn forget(&mut self) {
        self.current += 1;
    }

    /// What the pixel in column `x` and row `y`, which is cell `cell`, shows; `None` where its ray misses the panel with its guard
    /// band, or where no lit viewer sees it.
    pub fn line<F: Real>(&mut self, projector: &SliceProjector<F>, [x, y]: [i64; 2], cell: usize) -> Option<Line> {
        let lines = &mut self.lines[cell / TOGETHER];
        if lines.is_empty() {
            lines.resize(TOGETHER, (0, None));
        }
        let (found, line) = &mut lines[cell % TOGETHER];
        if *found != self.current {
            let centre = [x, y].map(|coordinate| F::of(coordinate as f64 + 0.5));
            (*found, *line) = (self.current, projector.sight(centre).map(Line::from));
        }
        *line
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rigs;
    use shaders::project::methods::{FaceOptics, Method};

    #[test]
    fn only_lines_that_are_asked_for_have_room() {
        let rig = rigs::find("reference").unwrap();
        let optics = FaceOptics::<f64>::new(&rig, 0, Method::Planar);
        let mut sights = Sights::new(768 * 768);
        let mut mirror = |slice, [x, y]: [i64; 2]| {
            sights.forget();
            let projector = optics.slice(rig.slice_angle(slice));
            sights.line(&projector, [x, y], (y * 768 + x) as usize).map(|line| line.mirror)
        };
        let first = mirror(0, [384, 384]).expect("the middle");
        assert!(mirror(30, [384, 384]).is_some_and(|other| other != first), "another slice has another line");
        assert_eq!(mirror(0, [384, 384]), Some(first));
        assert!(mirror(0, [400, 100]).is_some());
        assert_eq!(sights.lines.iter().filter(|lines| !lines.is_empty()).count(), 2);
    }
}
