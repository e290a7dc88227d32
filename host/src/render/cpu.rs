//! The clear renderer: a task a slice, fixed-point rasterisation, depth by |V' − Q|, then halftone.

use super::halftone::{halftone_slices, slices_read};
use super::plan::{Halftone, Plan};
use super::tessellate::{Mesh, Triangle, tessellate};
use super::turn::{Depth, Turn};
use super::{RenderError, Renderer};
use crate::scene::{ShadedScene, Texture, luminance};
use glam::{DVec2, DVec3, Vec2, Vec3};
use protocol::rig::Rig;
use rayon::prelude::*;
use shaders::halftone::{Blur, Slot, halftone};
use shaders::project::methods::Method;
use shaders::project::{SliceOptics, Visibility};
use std::sync::Arc;

/// The reference on the CPU.
#[derive(Clone, Copy, Debug, Default)]
pub struct CpuRenderer;

impl Renderer for CpuRenderer {
    fn render_slices(
        &self,
        scene: &ShadedScene,
        rig: &Rig,
        plan: &Plan,
        slices: &[u32],
        done: &(dyn Fn() + Sync),
    ) -> Result<Turn, RenderError> {
        if plan.halftone == Halftone::SightLine {
            let grey = Plan { halftone: Halftone::Grey, ..*plan };
            let grey = self.render_slices(scene, rig, &grey, &slices_read(rig, slices), done)?;
            return Ok(halftone_slices(&grey, rig, plan.halftone, 0, slices, &|| ()));
        }
        let (width, height) = (rig.projector.width_px, rig.projector.height_px);
        let depth = if plan.halftone.binary().is_some() { Depth::Binary } else { Depth::Grey };
        let mut turn = Turn::dark(rig.rotation.slices, width, height, depth)?;
        let model = Method::from(plan.projection).model();
        let mesh = tessellate(scene, rig, model, plan.bow_px)?;
        let slice_bytes = turn.slice_bytes();
        let wanted = turn.bytes_mut().par_chunks_mut(slice_bytes).enumerate();
        wanted.filter(|(slice, _)| slices.contains(&(*slice as u32))).for_each_init(
            || Canvas::new(width, height),
            |canvas, (slice, bytes)| {
                canvas.clear();
                let theta = rig.slice_angle(slice as u32);
                let faces: Vec<_> =
                    (0..rig.mirror.face.len()).map(|face| SliceOptics::new(rig, face, theta, model)).collect();
                for face in 0..faces.len() {
                    canvas.draw(&mesh, &scene.textures, &faces, face);
                }
                match plan.halftone.binary() {
                    Some(method) => halftone(
                        method,
                        Slot { slice: slice as u32, turn: 0, blur: Blur::ROUND },
                        width,
                        &canvas.luminance,
                        bytes,
                    ),
                    None => to_bytes(&canvas.luminance, bytes),
                }
                done();
            },
        );
        Ok(turn)
    }
}

fn to_bytes(luminance: &[f32], bytes: &mut [u8]) {
    for (byte, value) in bytes.iter_mut().zip(luminance) {
        *byte = (value * 255.0 + 0.5) as u8;
    }
}

/// Sub-pixel steps a pixel.
const STEPS: f64 = 256.0;
/// Vertices farther outside the image than this many pixels are not drawn: their fixed-point products would overflow.
const FAR_PX: f64 = 1e6;

/// One slice in the making.
struct Canvas {
    width: i64,
    height: i64,
    luminance: Vec<f32>,
    depth: Vec<f32>,
    corners: Vec<Corner>,
}

/// A vertex in the slice.
#[derive(Clone, Copy)]
struct Corner {
    /// Pixels times [`STEPS`].
    x: i64,
    y: i64,
    depth: f32,
    place: Place,
    /// Where it is off the panel: see [`SliceOptics::sides`].
    sides: u8,
}

impl Corner {
    fn new(optics: &SliceOptics, position: DVec3) -> Self {
        let mut corner = Self { x: 0, y: 0, depth: 0.0, place: Place::Nowhere, sides: 0 };
        if !optics.is_near(position) {
            return corner;
        }
        let projected = optics.project(position);
        let pixel = projected.pixel.filter(|pixel| pixel.abs().max_element() < FAR_PX);
        let (Some(pixel), Some(depth), Some(mirror)) = (pixel, projected.depth_m, projected.mirror) else {
            return corner;
        };
        (corner.x, corner.y) = ((pixel.x * STEPS).round() as i64, (pixel.y * STEPS).round() as i64);
        corner.depth = depth as f32;
        corner.sides = optics.sides(mirror);
        corner.place = match projected.visibility {
            Visibility::Visible | Visibility::OutsideImage => Place::Inside,
            Visibility::OffPanel => Place::OffPanel,
            Visibility::Unlit => Place::Unlit,
            _ => Place::Nowhere,
        };
        corner
    }
}

#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Place {
    /// On the panel, with a lit viewer.
    Inside,
    /// Off the panel: pixels near it are tested one by one.
    OffPanel,
    /// The viewer is behind the mirror: pixels near it are tested one by one.
    Unlit,
    /// There is no pixel.
    Nowhere,
}

impl Canvas {
    fn new(width: u32, height: u32) -> Self {
        let pixels = width as usize * height as usize;
        Self {
            width: width.into(),
            height: height.into(),
            luminance: vec![0.0; pixels],
            depth: vec![f32::INFINITY; pixels],
            corners: Vec::new(),
        }
    }

    fn clear(&mut self) {
        self.luminance.fill(0.0);
        self.depth.fill(f32::INFINITY);
    }

    fn draw(&mut self, mesh: &Mesh, textures: &[Arc<Texture>], faces: &[SliceOptics], face: usize) {
        let optics = &faces[face];
        self.corners.clear();
        self.corners.extend(mesh.positions.iter().map(|position| Corner::new(optics, *position)));
        for triangle in &mesh.triangles {
            let corners = triangle.corners.map(|corner| self.corners[corner as usize]);
            let worst = corners.iter().map(|corner| corner.place).max().unwrap_or(Place::Nowhere);
            if worst == Place::Nowhere || corners.iter().fold(u8::MAX, |common, corner| common & corner.sides) != 0 {
                continue;
            }
            let shows = |x: i64, y: i64| {
                let pixel = DVec2::new(x as f64 + 0.5, y as f64 + 0.5);
                let on_face = || optics.mirror_of(pixel).filter(|mirror| optics.sides(*mirror) == 0);
                (faces.len() == 1 || owner(faces, pixel) == Some(face))
                    && match worst {
                        Place::Inside => true,
                        Place::OffPanel => on_face().is_some(),
                        _ => on_face().and_then(|mirror| optics.sight_of(mirror)).is_some(),
                    }
            };
            self.fill(corners, triangle, textures, shows);
        }
    }

    /// Draws the pixels whose centres lie in the triangle (on its border by the top-left rule) and that `shows` admits.
    fn fill(
        &mut self,
        mut corners: [Corner; 3],
        triangle: &Triangle,
        textures: &[Arc<Texture>],
        shows: impl Fn(i64, i64) -> bool,
    ) {
        let mut order = [0, 1, 2];
        let mut area = edge(corners[0], corners[1], corners[2].x, corners[2].y);
        if area == 0 {
            return;
        }
        if area < 0 {
            corners.swap(1, 2);
            order.swap(1, 2);
            area = -area;
        }
        let [columns, rows] = self.bounds(&corners);
        let step = STEPS as i64;
        let half = step / 2;
        let edges = [(1, 2), (2, 0), (0, 1)].map(|(a, b)| Edge::new(corners[a], corners[b]));
        let shading = Shader { triangle, textures, order };
        for y in rows {
            let mut values = edges.map(|edge| edge.at(columns.start * step + half, y * step + half));
            for x in columns.start..columns.end {
                if values.iter().all(|value| *value >= 0) {
                    let weights = [0, 1, 2].map(|index| (values[index] + edges[index].bias) as f32 / area as f32);
                    let depth = (0..3).map(|index| weights[index] * corners[index].depth).sum::<f32>();
                    let cell = (y * self.width + x) as usize;
                    if depth < self.depth[cell] && shows(x, y) {
                        self.depth[cell] = depth;
                        self.luminance[cell] = shading.luminance(weights).clamp(0.0, 1.0);
                    }
                }
                for (value, edge) in values.iter_mut().zip(&edges) {
                    *value += edge.dx * step;
                }
            }
        }
    }

    /// The columns and rows whose pixel centres may lie within the triangle.
    fn bounds(&self, corners: &[Corner; 3]) -> [core::ops::Range<i64>; 2] {
        let range = |values: [i64; 3], limit: i64| {
            let (low, high) = (values.iter().min().unwrap_or(&0), values.iter().max().unwrap_or(&0));
            let step = STEPS as i64;
            (low - step / 2).div_euclid(step).max(0)..((high + step / 2).div_euclid(step) + 1).min(limit)
        };
        [range(corners.map(|corner| corner.x), self.width), range(corners.map(|corner| corner.y), self.height)]
    }
}

/// The face that the projector's ray through `pixel` meets first; where it meets none, the one whose guard band it does.
pub(super) fn owner(faces: &[SliceOptics], pixel: DVec2) -> Option<usize> {
    let first = |meets: &dyn Fn(&SliceOptics, DVec3) -> bool| {
        let hits = faces.iter().enumerate().filter_map(|(face, optics)| {
            let mirror = optics.mirror_of(pixel).filter(|mirror| meets(optics, *mirror))?;
            Some((face, optics.throw_m(mirror)))
        });
        hits.min_by(|a, b| a.1.total_cmp(&b.1)).map(|(face, _)| face)
    };
    first(&SliceOptics::on_panel).or_else(|| first(&|optics, mirror| optics.sides(mirror) == 0))
}

/// Twice the signed area of the triangle a, b, (x, y).
fn edge(a: Corner, b: Corner, x: i64, y: i64) -> i64 {
    (b.x - a.x) * (y - a.y) - (b.y - a.y) * (x - a.x)
}

/// The edge function, not below 0 for what is inside; an exact integer, so that neighbours share no pixel and leave none out.
#[derive(Clone, Copy)]
struct Edge {
    from: Corner,
    to: Corner,
    dx: i64,
    /// 1 where the border belongs to the neighbour.
    bias: i64,
}

impl Edge {
    fn new(from: Corner, to: Corner) -> Self {
        let (across, down) = (to.x - from.x, to.y - from.y);
        // With y downward and a positive area, the inside is to the right of the way: up is a left edge, rightward a top one.
        let owns_border = down < 0 || (down == 0 && across > 0);
        Self { from, to, dx: -down, bias: i64::from(!owns_border) }
    }

    fn at(&self, x: i64, y: i64) -> i64 {
        edge(self.from, self.to, x, y) - self.bias
    }
}

/// What leaves a triangle at given weights of its corners.
struct Shader<'a> {
    triangle: &'a Triangle,
    textures: &'a [Arc<Texture>],
    order: [usize; 3],
}

impl Shader<'_> {
    fn luminance(&self, weights: [f32; 3]) -> f32 {
        let corners = self.order.into_iter().zip(weights);
        let radiance: Vec3 = corners.clone().map(|(corner, weight)| weight * self.triangle.radiance[corner]).sum();
        match self.triangle.texture {
            None => luminance(radiance),
            Some(texture) => {
                let uv: Vec2 = corners.map(|(corner, weight)| weight * self.triangle.uv[corner]).sum();
                luminance(radiance * self.textures[texture as usize].sample(uv))
            }
        }
    }
}
