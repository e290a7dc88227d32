//! One slice in the making: fixed-point rasterisation, depth by |V' − Q|.

use super::bow::{edge_limit_m, panel_m};
use super::mesh::{Mesh, Triangle};
use super::plan::{DepthTest, Edges, Plan};
use super::sight::{Line, Sights};
use crate::scene::{Texture, luminance};
use core::f64::consts::TAU;
use core::ops::Range;
use glam::{DVec3, Vec2, Vec3};
use protocol::rig::{Rig, Viewers};
use shaders::project::methods::{Method, Real, SliceProjector};
use std::sync::Arc;

/// Sub-pixel steps a pixel.
const STEPS: f64 = 256.0;
/// Vertices farther outside the image than this many pixels are not drawn: their fixed-point products would overflow.
const FAR_PX: f64 = 1e6;
/// What rounding of vertices, to steps and in single precision, may move a triangle's outline by.
const ROUNDING_PX: f64 = 0.02;
/// No triangle.
const NONE: u32 = u32::MAX;

/// How the pixels of a triangle are found and which of several wins.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Coverage {
    /// Those within the straight triangle, by depth interpolated between its corners.
    Linear,
    /// As [`Coverage::Linear`], but by depth on the pixel's own sight line where two triangles are closer than interpolated depth tells.
    Exact {
        /// By how many metres true depth may differ from interpolated depth, for each square metre of the longest edge.
        bulge_per_m: f64,
    },
    /// Those near the straight triangle whose sight lines meet the triangle itself.
    Discard {
        /// How far from the straight triangle they may lie, in pixels, for each square metre of the longest edge.
        bow_px_per_m2: f64,
        /// And at most, in pixels.
        bow_px: f64,
    },
}

impl Coverage {
    /// What `plan` asks for in drawing `mesh`.
    pub fn new(mesh: &Mesh, rig: &Rig, plan: &Plan) -> Self {
        match (plan.edges, plan.depth) {
            (Edges::Discard, _) => {
                // Up to this length every edge keeps within the bow; what is longer was cut where it does not.
                let length_m = edge_limit_m(rig, Method::from(plan.projection).model(), mesh.radius_m(), plan.bow_px);
                Self::Discard { bow_px_per_m2: plan.bow_px / (length_m * length_m), bow_px: plan.bow_px }
            }
            (_, DepthTest::Linear) => Self::Linear,
            (_, DepthTest::Exact) => Self::Exact { bulge_per_m: depth_bulge_per_m(rig) },
        }
    }

    /// What holds for a triangle: its bulge in metres, or how far from it pixels are tested, in pixels.
    pub fn margin(self, corners: [DVec3; 3]) -> f64 {
        match self {
            Self::Linear => 0.0,
            Self::Exact { bulge_per_m } => bulge_per_m * longest_squared(corners),
            Self::Discard { bow_px_per_m2, bow_px } => {
                (bow_px_per_m2 * longest_squared(corners)).min(bow_px) + ROUNDING_PX
            }
        }
    }
}

/// How far depth may lie from what is interpolated between a triangle's corners, in metres, for each square metre of its longest edge:
/// a sixth of its curvature, since no point is farther from a corner than the edge by √3, and a fifth more. Its curvature is that of a
/// sphere about the viewer and of the turning of V' with the point about P'. Where viewers are on a curve, V' also turns faster, and
/// not evenly.
fn depth_bulge_per_m(rig: &Rig) -> f64 {
    let throw = 1.0 / rig.camera().position.length();
    let viewers = rig.viewers();
    let viewer = match &viewers {
        Viewers::Circle { distance_m, .. } => 1.0 / distance_m,
        Viewers::Curve(curve) => {
            let turn = throw + 1.0 / curve.distances()[0];
            let [first, second] = turning(&viewers);
            return (turn * first + panel_m(rig) * turn * turn * second) / 5.0;
        }
        Viewers::Infinity { .. } => 0.0,
    };
    (throw + viewer) / 5.0
}

/// The largest first and second derivative by azimuth of the direction of viewers from the origin; at least 1, as on a circle.
fn turning(viewers: &Viewers) -> [f64; 2] {
    const PLACES: u32 = 1440;
    let step = TAU / f64::from(PLACES);
    let toward = |place: u32| viewers.place(f64::from(place) * step, 1.0).normalize();
    (0..PLACES).fold([1.0, 1.0], |[first, second]: [f64; 2], place| {
        let [before, here, after] = [place, place + 1, place + 2].map(toward);
        [first.max((here - before).length() / step), second.max((before - 2.0 * here + after).length() / (step * step))]
    })
}

/// The square of a triangle's longest edge.
fn longest_squared([a, b, c]: [DVec3; 3]) -> f64 {
    a.distance_squared(b).max(b.distance_squared(c)).max(c.distance_squared(a))
}

/// What is drawn: triangles, how, and for each of them what [`Coverage::margin`] says.
pub struct Drawing {
    /// The triangles.
    pub mesh: Mesh,
    coverage: Coverage,
    margins: Vec<f32>,
}

impl Drawing {
    /// `mesh`, drawn by `coverage`.
    pub fn new(mesh: Mesh, coverage: Coverage) -> Self {
        let margins = mesh.triangles.iter().map(|triangle| coverage.margin(mesh.corners(triangle)) as f32).collect();
        Self { margins, mesh, coverage }
    }
}

/// One slice in the making.
pub struct Canvas {
    width: i64,
    height: i64,
    /// Row by row from the top, linear.
    pub luminance: Vec<f32>,
    depth: Vec<f32>,
    /// The triangle that each pixel shows.
    shown: Vec<u32>,
    corners: Vec<Corner>,
    sights: Sights,
}

/// A vertex in the slice.
#[derive(Clone, Copy)]
struct Corner {
    /// Pixels times [`STEPS`].
    x: i64,
    y: i64,
    depth: f32,
    place: Place,
    /// Where it is off the panel: see [`shaders::project::SliceOptics::sides`].
    sides: u8,
}

impl Corner {
    fn new<F: Real>(projector: &SliceProjector<F>, position: DVec3) -> Self {
        let vertex = projector.vertex(position.to_array().map(F::of));
        let Some(vertex) = vertex.filter(|vertex| vertex.pixel.iter().all(|value| value.wide().abs() < FAR_PX)) else {
            return Self { x: 0, y: 0, depth: 0.0, place: Place::Nowhere, sides: 0 };
        };
        let [x, y] = vertex.pixel.map(|value| (value.wide() * STEPS).round() as i64);
        let place = if vertex.sides == 0 && vertex.lit { Place::Inside } else { Place::Outside };
        Self { x, y, depth: vertex.depth_m.wide() as f32, place, sides: vertex.sides }
    }
}

#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Place {
    /// On the panel, with a lit viewer.
    Inside,
    /// Off the panel, or the viewer is behind the mirror: pixels near it are tested one by one.
    Outside,
    /// There is no pixel.
    Nowhere,
}

impl Canvas {
    /// Dark.
    pub fn new(width: u32, height: u32) -> Self {
        let pixels = width as usize * height as usize;
        Self {
            width: width.into(),
            height: height.into(),
            luminance: vec![0.0; pixels],
            depth: vec![f32::INFINITY; pixels],
            shown: vec![NONE; pixels],
            corners: Vec::new(),
            sights: Sights::new(pixels),
        }
    }

    /// Dark again.
    pub fn clear(&mut self) {
        self.luminance.fill(0.0);
        self.depth.fill(f32::INFINITY);
        self.shown.fill(NONE);
    }

    /// Draws one face's picture of `mesh` on the pixels that `owns` admits.
    pub fn draw<F: Real>(
        &mut self,
        drawing: &Drawing,
        textures: &[Arc<Texture>],
        projector: &SliceProjector<F>,
        owns: impl Fn([i64; 2]) -> bool,
    ) {
        let Drawing { mesh, coverage, .. } = drawing;
        self.sights.forget();
        self.corners.clear();
        self.corners.extend(mesh.positions.iter().map(|position| Corner::new(projector, *position)));
        for index in 0..mesh.triangles.len() {
            let corners = self.corners_of(mesh, index);
            let outside = corners.iter().fold(u8::MAX, |common, corner| common & corner.sides) != 0;
            // A piece that bows may reach the panel though none of its corners does.
            let curved = matches!(coverage, Coverage::Discard { .. });
            if corners.iter().any(|corner| corner.place == Place::Nowhere) || (outside && !curved) {
                continue;
            }
            match curved {
                true => self.draw_curved(drawing, textures, index, projector, &owns),
                false => self.draw_straight(drawing, textures, index, projector, &owns),
            }
        }
    }

    /// Fills every pixel that `owns` admits with what `luminance` finds on its sight line.
    pub fn cast<F: Real>(
        &mut self,
        projector: &SliceProjector<F>,
        owns: impl Fn([i64; 2]) -> bool,
        luminance: impl Fn(&Line) -> f32,
    ) {
        self.sights.forget();
        for cell in 0..self.luminance.len() {
            let pixel = [cell as i64 % self.width, cell as i64 / self.width];
            if let Some(line) = self.sights.line(projector, pixel, cell).filter(|_| owns(pixel)) {
                self.luminance[cell] = luminance(&line).clamp(0.0, 1.0);
            }
        }
    }

    fn corners_of(&self, mesh: &Mesh, triangle: usize) -> [Corner; 3] {
        mesh.triangles[triangle].corners.map(|corner| self.corners[corner as usize])
    }

    fn draw_straight<F: Real>(
        &mut self,
        drawing: &Drawing,
        textures: &[Arc<Texture>],
        index: usize,
        projector: &SliceProjector<F>,
        owns: &impl Fn([i64; 2]) -> bool,
    ) {
        let Drawing { mesh, margins: bulges, .. } = drawing;
        let corners = self.corners_of(mesh, index);
        let safe = corners.iter().all(|corner| corner.place == Place::Inside);
        fill([self.width, self.height], corners, 0.0, |pixel, cell, weights| {
            let depth = (0..3).map(|corner| weights[corner] * corners[corner].depth).sum::<f32>();
            let rival = self.shown[cell];
            let bulge = |triangle: u32| bulges.get(triangle as usize).copied().unwrap_or(0.0);
            let nearer = match (depth - self.depth[cell]).abs() < bulge(index as u32) + bulge(rival) {
                true => self.sights.line(projector, pixel, cell).is_some_and(|line| {
                    let [own, rival] = [index, rival as usize].map(|index| self.true_depth(drawing, index, &line));
                    own < rival
                }),
                false => depth < self.depth[cell],
            };
            if nearer && (safe || self.sights.line(projector, pixel, cell).is_some()) && owns(pixel) {
                self.depth[cell] = depth;
                self.shown[cell] = index as u32;
                self.luminance[cell] = shade(&mesh.triangles[index], textures, weights).clamp(0.0, 1.0);
            }
        });
    }

    /// Depth on a sight line that meets a triangle or, since straight pieces bow, nearly does: not beyond the triangle's own depths.
    fn true_depth(&self, drawing: &Drawing, index: usize, line: &Line) -> f64 {
        let depths = self.corners_of(&drawing.mesh, index).map(|corner| corner.depth);
        let bulge = drawing.margins[index];
        let low = depths.into_iter().fold(f32::INFINITY, f32::min) - bulge;
        let high = depths.into_iter().fold(f32::NEG_INFINITY, f32::max) + bulge;
        let depth = line.plane_depth_m(drawing.mesh.corners(&drawing.mesh.triangles[index]));
        if depth.is_finite() { depth.clamp(low.into(), high.into()) } else { high.into() }
    }

    /// The patent's alternative: "a fragment shader could discard incorrect pixels that lie outside the triangle".
    fn draw_curved<F: Real>(
        &mut self,
        drawing: &Drawing,
        textures: &[Arc<Texture>],
        index: usize,
        projector: &SliceProjector<F>,
        owns: &impl Fn([i64; 2]) -> bool,
    ) {
        let triangle = &drawing.mesh.triangles[index];
        let positions = drawing.mesh.corners(triangle);
        let corners = self.corners_of(&drawing.mesh, index);
        let margin = (f64::from(drawing.margins[index]) * STEPS).ceil();
        fill([self.width, self.height], corners, margin, |pixel, cell, _| {
            let Some(line) = self.sights.line(projector, pixel, cell) else { return };
            let Some(weights) = line.weights(positions) else { return };
            let depth = line.plane_depth_m(positions) as f32;
            if depth < self.depth[cell] && owns(pixel) {
                self.depth[cell] = depth;
                self.luminance[cell] = shade(triangle, textures, weights).clamp(0.0, 1.0);
            }
        });
    }
}

/// Calls `fragment` for the pixels whose centres lie in the triangle (on its border by the top-left rule), with the cell and the
/// weights of the corners; with `margin` steps above 0, for those within that distance of it too, and more at its corners.
fn fill(size: [i64; 2], mut corners: [Corner; 3], margin: f64, mut fragment: impl FnMut([i64; 2], usize, [f32; 3])) {
    let mut order = [0, 1, 2];
    let mut area = twice_area(corners[0], corners[1], corners[2].x, corners[2].y);
    if area == 0 && margin == 0.0 {
        return;
    }
    if area < 0 {
        corners.swap(1, 2);
        order.swap(1, 2);
        area = -area;
    }
    let [columns, rows] = bounds(size, &corners, margin as i64);
    let step = STEPS as i64;
    let half = step / 2;
    let edges = [(1, 2), (2, 0), (0, 1)].map(|(a, b)| Edge::new(corners[a], corners[b], margin));
    for y in rows {
        let mut values = edges.map(|edge| edge.at(columns.start * step + half, y * step + half));
        for x in columns.clone() {
            if values.iter().all(|value| *value >= 0) {
                let mut weights = [0.0; 3];
                for index in 0..3 {
                    weights[order[index]] = (values[index] + edges[index].bias) as f32 / area as f32;
                }
                fragment([x, y], (y * size[0] + x) as usize, weights);
            }
            for (value, edge) in values.iter_mut().zip(&edges) {
                *value += edge.dx * step;
            }
        }
    }
}

/// The columns and rows whose pixel centres may lie within `margin` steps of the triangle.
fn bounds(size: [i64; 2], corners: &[Corner; 3], margin: i64) -> [Range<i64>; 2] {
    let range = |values: [i64; 3], limit: i64| {
        let (low, high) = (values.iter().min().unwrap_or(&0) - margin, values.iter().max().unwrap_or(&0) + margin);
        let step = STEPS as i64;
        (low - step / 2).div_euclid(step).max(0)..((high + step / 2).div_euclid(step) + 1).min(limit)
    };
    [range(corners.map(|corner| corner.x), size[0]), range(corners.map(|corner| corner.y), size[1])]
}

/// Twice the signed area of the triangle a, b, (x, y).
fn twice_area(a: Corner, b: Corner, x: i64, y: i64) -> i64 {
    (b.x - a.x) * (y - a.y) - (b.y - a.y) * (x - a.x)
}

/// The edge function, not below 0 for what is inside; an exact integer, so that neighbours share no pixel and leave none out.
#[derive(Clone, Copy)]
struct Edge {
    from: Corner,
    to: Corner,
    dx: i64,
    /// 1 where the border belongs to the neighbour; below 0 where a margin is inside too.
    bias: i64,
}

impl Edge {
    fn new(from: Corner, to: Corner, margin: f64) -> Self {
        let (across, down) = (to.x - from.x, to.y - from.y);
        // With y downward and a positive area, the inside is to the right of the way: up is a left edge, rightward a top one.
        let owns_border = down < 0 || (down == 0 && across > 0);
        let margin = (margin * (across as f64).hypot(down as f64)).ceil() as i64;
        Self { from, to, dx: -down, bias: if margin > 0 { -margin } else { i64::from(!owns_border) } }
    }

    fn at(&self, x: i64, y: i64) -> i64 {
        twice_area(self.from, self.to, x, y) - self.bias
    }
}

/// What leaves a triangle at given weights of its corners.
pub(super) fn shade(triangle: &Triangle, textures: &[Arc<Texture>], weights: [f32; 3]) -> f32 {
    let radiance: Vec3 = (0..3).map(|corner| weights[corner] * triangle.radiance[corner]).sum();
    match triangle.texture {
        None => luminance(radiance),
        Some(texture) => {
            let uv: Vec2 = (0..3).map(|corner| weights[corner] * triangle.uv[corner]).sum();
            luminance(radiance * textures[texture as usize].sample(uv))
        }
    }
}
