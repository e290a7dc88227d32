//! How far a plan draws the scene from where the diffuser's cone puts it.

use super::{Edges, Plan, Precision};
use crate::render::canvas::Coverage;
use crate::render::mesh::Mesh;
use glam::{DVec2, DVec3};
use protocol::rig::Rig;
use rayon::prelude::*;
use serde::Serialize;
use shaders::project::methods::{FaceOptics, Method, Real, SliceProjector};
use shaders::project::{Model, Projected, SliceOptics, Viewer, Visibility};

/// The distance between drawn and exact, over points of the surface in slices that show them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct GeometricError {
    /// The largest, in projector pixels.
    pub worst_px: f64,
    /// The root of the mean square, in projector pixels.
    pub rms_px: f64,
    /// The largest as an eye at V' sees it, in minutes of arc; for viewers at infinity, as from the rig's default distance of 1 m.
    pub worst_arcmin: f64,
    /// By how much an interpolated depth errs at most, in metres.
    pub worst_depth_m: f64,
    /// How many points were compared. 0: nothing of the scene was seen.
    pub points: usize,
    /// How many points are visible but are not drawn, because a corner of their piece has no pixel, or because they lie too far from
    /// it for the test by pixel.
    pub lost: usize,
}

/// From how far viewers at infinity are taken to look, where an angle is asked for.
const FAR_VIEWER_M: f64 = 1.0;

/// Compares `plan`, drawing `mesh`, with the cone's root in double precision, at `pairs` pairs of a piece and a slice: seven points
/// of each. Half the pairs take the pieces with the longest edges, where the bow is; half take them as they come.
pub fn geometric_error(mesh: &Mesh, rig: &Rig, plan: &Plan, pairs: usize) -> GeometricError {
    match plan.precision {
        Precision::Single => compare::<f32>(mesh, rig, plan, pairs),
        Precision::Double => compare::<f64>(mesh, rig, plan, pairs),
    }
}

fn compare<F: Real>(mesh: &Mesh, rig: &Rig, plan: &Plan, pairs: usize) -> GeometricError {
    let faces: Vec<FaceOptics<F>> =
        (0..rig.mirror.face.len()).map(|face| FaceOptics::new(rig, face, Method::from(plan.projection))).collect();
    let longest = longest_first(mesh, pairs);
    let coverage = Coverage::new(mesh, rig, plan);
    let slices = rig.rotation.slices as usize;
    // Pairs of one slice are together, so that its optics are made once.
    let sums = (0..slices).into_par_iter().map(|slice| {
        let mut sum = Sum::default();
        let of_slice: Vec<usize> = (slice..pairs).step_by(slices).collect();
        if of_slice.is_empty() || mesh.triangles.is_empty() {
            return sum;
        }
        // Neighbouring slices must not take neighbouring pieces only: the golden ratio spreads both.
        let slice = spread(slice, slices);
        let theta = rig.slice_angle(slice as u32);
        for (face, optics) in faces.iter().enumerate() {
            let exact = SliceOptics::new(rig, face, theta, Model::Cone);
            let drawn = optics.slice(theta);
            for pair in &of_slice {
                let piece = match pair % 2 {
                    0 => longest[pair / 2 % longest.len()],
                    _ => spread(*pair, mesh.triangles.len()),
                };
                let corners = mesh.corners(&mesh.triangles[piece]);
                sum.add(corners, &exact, &drawn, plan.edges, coverage.margin(corners));
            }
        }
        sum
    });
    sums.reduce(Sum::default, Sum::and).error()
}

/// Point `index` of a sequence that spreads evenly over 0 … `count` − 1 from its start on.
fn spread(index: usize, count: usize) -> usize {
    ((index as f64 * 0.618_033_988_749_894_9).fract() * count as f64) as usize
}

/// The pieces with the longest edges: as many as a quarter of `pairs`, the longest first.
fn longest_first(mesh: &Mesh, pairs: usize) -> Vec<usize> {
    let length = |piece: &usize| {
        let [a, b, c] = mesh.triangles[*piece].corners.map(|corner| mesh.positions[corner as usize]);
        a.distance_squared(b).max(b.distance_squared(c)).max(c.distance_squared(a))
    };
    let mut pieces: Vec<(f64, usize)> = (0..mesh.triangles.len()).map(|piece| (length(&piece), piece)).collect();
    let wanted = (pairs / 4).clamp(1, pieces.len().max(1));
    if pieces.len() > wanted {
        pieces.select_nth_unstable_by(wanted - 1, |a, b| b.0.total_cmp(&a.0));
        pieces.truncate(wanted);
    }
    pieces.into_iter().map(|(_, piece)| piece).collect()
}

#[derive(Clone, Copy, Default)]
struct Sum {
    worst_px: f64,
    squares: f64,
    worst_radians: f64,
    worst_depth_m: f64,
    points: usize,
    lost: usize,
}

impl Sum {
    fn and(self, other: Self) -> Self {
        Self {
            worst_px: self.worst_px.max(other.worst_px),
            squares: self.squares + other.squares,
            worst_radians: self.worst_radians.max(other.worst_radians),
            worst_depth_m: self.worst_depth_m.max(other.worst_depth_m),
            points: self.points + other.points,
            lost: self.lost + other.lost,
        }
    }

    fn error(self) -> GeometricError {
        GeometricError {
            worst_px: self.worst_px,
            rms_px: (self.squares / self.points.max(1) as f64).sqrt(),
            worst_arcmin: self.worst_radians.to_degrees() * 60.0,
            worst_depth_m: self.worst_depth_m,
            points: self.points,
            lost: self.lost,
        }
    }

    fn add<F: Real>(
        &mut self,
        corners: [DVec3; 3],
        exact: &SliceOptics,
        drawn: &SliceProjector<F>,
        edges: Edges,
        margin_px: f64,
    ) {
        const WEIGHTS: [[f64; 3]; 7] = [
            [1.0, 0.0, 0.0],
            [0.0, 1.0, 0.0],
            [0.0, 0.0, 1.0],
            [0.5, 0.5, 0.0],
            [0.0, 0.5, 0.5],
            [0.5, 0.0, 0.5],
            [1.0 / 3.0, 1.0 / 3.0, 1.0 / 3.0],
        ];
        let vertex_of = |point: DVec3| {
            let vertex = drawn.vertex(point.to_array().map(F::of))?;
            Some((DVec2::from_array(vertex.pixel.map(F::wide)), vertex.depth_m.wide()))
        };
        let vertices = corners.map(vertex_of);
        for weights in WEIGHTS {
            let point: DVec3 = (0..3).map(|corner| weights[corner] * corners[corner]).sum();
            let truly = exact.project(point);
            let (Some(pixel), Visibility::Visible) = (truly.pixel, truly.visibility) else { continue };
            let itself = vertex_of(point);
            let drawn_at = match (edges, vertices) {
                // The test by pixel and the ray bend what they draw as the method itself does.
                (Edges::Rays, _) => itself,
                (Edges::Discard, [Some(a), Some(b), Some(c)]) => {
                    itself.filter(|itself| distance([a, b, c].map(|corner| corner.0), itself.0) <= margin_px)
                }
                (Edges::Discard, _) => None,
                (_, [Some(a), Some(b), Some(c)]) => Some((
                    weights[0] * a.0 + weights[1] * b.0 + weights[2] * c.0,
                    weights[0] * a.1 + weights[1] * b.1 + weights[2] * c.1,
                )),
                _ => None,
            };
            let (Some((drawn_at, depth)), Some((_, own_depth))) = (drawn_at, itself) else {
                self.lost += 1;
                continue;
            };
            let off = drawn_at.distance(pixel);
            self.worst_px = self.worst_px.max(off);
            self.squares += off * off;
            self.worst_radians = self.worst_radians.max(seen_angle(exact, &truly, drawn_at).unwrap_or(0.0));
            self.worst_depth_m = self.worst_depth_m.max((depth - own_depth).abs());
            self.points += 1;
        }
    }
}

/// How far `point` lies from a triangle; 0 within it.
fn distance(corners: [DVec2; 3], point: DVec2) -> f64 {
    let edges = [(0, 1), (1, 2), (2, 0)].map(|(from, to)| (corners[from], corners[to] - corners[from]));
    let turns = edges.map(|(from, edge)| edge.perp_dot(point - from));
    if turns.iter().all(|turn| *turn > 0.0) || turns.iter().all(|turn| *turn < 0.0) {
        return 0.0;
    }
    let to_edge = |(from, edge): (DVec2, DVec2)| {
        let along = (edge.dot(point - from) / edge.length_squared().max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
        point.distance(from + along * edge)
    };
    edges.map(to_edge).into_iter().fold(f64::INFINITY, f64::min)
}

/// The angle at V' between where a point is drawn on the mirror and where it belongs.
fn seen_angle(exact: &SliceOptics, truly: &Projected, drawn_at: DVec2) -> Option<f64> {
    let (belongs, lies) = (truly.mirror?, exact.mirror_of(drawn_at)?);
    Some(match truly.viewer? {
        Viewer::At(viewer) => (belongs - viewer).angle_between(lies - viewer),
        Viewer::Toward(direction) => {
            let off = lies - belongs;
            (off - off.dot(direction) * direction).length() / FAR_VIEWER_M
        }
    })
}
