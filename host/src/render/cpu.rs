//! The clear renderer: a task a slice, then halftone.

use super::blur::eye_blur;
use super::canvas::{Canvas, Coverage, Drawing};
use super::halftone::{halftone_slices, slices_read};
use super::plan::{Edges, Halftone, Plan, Precision};
use super::sight::Line;
use super::tessellate::tessellate;
use super::truth::Caster;
use super::turn::{Depth, Turn};
use super::{RenderError, Renderer};
use crate::scene::ShadedScene;
use glam::{DVec2, DVec3};
use protocol::rig::{Rig, Viewers};
use rayon::prelude::*;
use shaders::halftone::{Slot, halftone};
use shaders::project::SliceOptics;
use shaders::project::methods::{FaceOptics, Real};

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
        let read = match plan.halftone {
            Halftone::SightLine => Some(slices_read(rig, slices)),
            Halftone::Joint => Some(slices.to_vec()),
            _ => None,
        };
        if let Some(read) = read {
            let grey = Plan { halftone: Halftone::Grey, ..*plan };
            let grey = self.render_slices(scene, rig, &grey, &read, done)?;
            return Ok(halftone_slices(&grey, rig, plan.halftone, 0, slices, &|| ()));
        }
        match plan.precision {
            Precision::Single => render::<f32>(scene, rig, plan, slices, done),
            Precision::Double => render::<f64>(scene, rig, plan, slices, done),
        }
    }
}

/// What is drawn, and how.
enum Subject<'a> {
    Drawing(Drawing),
    Rays(Caster<'a>),
}

impl<'a> Subject<'a> {
    fn new(scene: &'a ShadedScene, rig: &Rig, plan: &Plan) -> Result<Self, RenderError> {
        if plan.edges == Edges::Rays {
            return Ok(Self::Rays(Caster::new(scene)));
        }
        let mesh = tessellate(scene, rig, plan)?;
        let coverage = Coverage::new(&mesh, rig, plan);
        Ok(Self::Drawing(Drawing::new(mesh, coverage)))
    }
}

fn render<F: Real>(
    scene: &ShadedScene,
    rig: &Rig,
    plan: &Plan,
    slices: &[u32],
    done: &(dyn Fn() + Sync),
) -> Result<Turn, RenderError> {
    let (width, height) = (rig.projector.width_px, rig.projector.height_px);
    let depth = if plan.halftone.binary().is_some() { Depth::Binary } else { Depth::Grey };
    let mut turn = Turn::dark(rig.rotation.slices, width, height, depth)?;
    let subject = Subject::new(scene, rig, plan)?;
    let faces: Vec<_> =
        (0..rig.mirror.face.len()).map(|face| FaceOptics::<F>::new(rig, face, plan.projection.into())).collect();
    let slice_bytes = turn.slice_bytes();
    let chunks = turn.bytes_mut().chunks_mut(slice_bytes).enumerate();
    let wanted: Vec<_> = chunks.filter(|(slice, _)| slices.contains(&(*slice as u32))).collect();
    wanted.into_par_iter().for_each_init(
        || Canvas::new(width, height),
        |canvas, (slice, bytes)| {
            canvas.clear();
            draw(canvas, scene, rig, &subject, &faces, rig.slice_angle(slice as u32));
            match plan.halftone.binary() {
                Some(method) => halftone(
                    method,
                    Slot { slice: slice as u32, turn: 0, blur: eye_blur(rig, slice as u32) },
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

fn draw<F: Real>(
    canvas: &mut Canvas,
    scene: &ShadedScene,
    rig: &Rig,
    subject: &Subject<'_>,
    faces: &[FaceOptics<F>],
    theta: f64,
) {
    // Whose a pixel is does not depend on how V' is found.
    let model = shaders::project::Model::Planar;
    let panels: Vec<_> = (0..faces.len()).map(|face| SliceOptics::new(rig, face, theta, model)).collect();
    for (face, optics) in faces.iter().enumerate() {
        let owns = |[x, y]: [i64; 2]| {
            panels.len() == 1 || owner(&panels, DVec2::new(x as f64 + 0.5, y as f64 + 0.5)) == Some(face)
        };
        let projector = optics.slice(theta);
        match subject {
            Subject::Drawing(drawing) => canvas.draw(drawing, &scene.textures, &projector, owns),
            Subject::Rays(caster) => canvas.cast(&projector, owns, |line| {
                caster.cast_along(line.mirror, line.toward_viewer, viewer_distance_m(rig, line))
            }),
        }
    }
}

/// |V' − M| in metres.
fn viewer_distance_m(rig: &Rig, line: &Line) -> f64 {
    match rig.viewers() {
        Viewers::Circle { distance_m, height_m } => distance_m.hypot(height_m) + line.depth_m,
        Viewers::Infinity { .. } => f64::INFINITY,
    }
}

fn to_bytes(luminance: &[f32], bytes: &mut [u8]) {
    for (byte, value) in bytes.iter_mut().zip(luminance) {
        *byte = (value * 255.0 + 0.5) as u8;
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
