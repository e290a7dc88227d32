//! The clear renderer: a task a slice, then halftone.

use super::blur::eye_blur;
use super::canvas::{Canvas, Coverage, Drawing};
use super::plan::{Edges, Halftone, Plan, Precision};
use super::second_pass::SecondPass;
use super::tessellate::tessellate;
use super::truth::Caster;
use super::turn::Turn;
use super::{Prepared, RenderError, Renderer, Wanted};
use crate::scene::ShadedScene;
use glam::{DVec2, DVec3};
use protocol::rig::Rig;
use rayon::prelude::*;
use shaders::halftone::{Slot, halftone};
use shaders::project::SliceOptics;
use shaders::project::methods::{FaceOptics, Real};

/// The reference on the CPU: every plan, every halftone, and nothing done to be quick.
#[derive(Clone, Copy, Debug, Default)]
pub struct ClearRenderer;

impl Renderer for ClearRenderer {
    fn name(&self) -> String {
        "clear".into()
    }

    fn prepare<'a>(
        &'a self,
        scene: &'a ShadedScene,
        rig: &Rig,
        plan: &Plan,
    ) -> Result<Box<dyn Prepared + 'a>, RenderError> {
        if matches!(plan.halftone, Halftone::SightLine | Halftone::Joint) {
            return SecondPass::prepare(self, scene, rig, plan);
        }
        Ok(match plan.precision {
            Precision::Single => Box::new(Job::<f32>::new(scene, rig, plan)?),
            Precision::Double => Box::new(Job::<f64>::new(scene, rig, plan)?),
        })
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

/// A scene on a rig.
struct Job<'a, F> {
    scene: &'a ShadedScene,
    rig: Rig,
    halftone: Halftone,
    subject: Subject<'a>,
    faces: Vec<FaceOptics<F>>,
}

impl<'a, F: Real> Job<'a, F> {
    fn new(scene: &'a ShadedScene, rig: &Rig, plan: &Plan) -> Result<Self, RenderError> {
        let optics = |face| FaceOptics::new(rig, face, plan.projection.into());
        Ok(Self {
            scene,
            rig: rig.clone(),
            halftone: plan.halftone,
            subject: Subject::new(scene, rig, plan)?,
            faces: (0..rig.mirror.face.len()).map(optics).collect(),
        })
    }
}

impl<F: Real> Prepared for Job<'_, F> {
    fn render(&mut self, wanted: Wanted<'_>, turn: &mut Turn) -> Result<(), RenderError> {
        let (width, height) = (turn.width(), turn.height());
        let slice_bytes = turn.slice_bytes();
        let chunks = turn.bytes_mut().chunks_mut(slice_bytes).enumerate();
        let wanted_bytes: Vec<_> = chunks.filter(|(slice, _)| wanted.slices.contains(&(*slice as u32))).collect();
        let job: &Self = self;
        wanted_bytes.into_par_iter().for_each_init(
            || Canvas::new(width, height),
            |canvas, (slice, bytes)| {
                let slice = slice as u32;
                canvas.clear();
                draw(canvas, job.scene, &job.rig, &job.subject, &job.faces, job.rig.slice_angle(slice));
                match job.halftone.binary() {
                    Some(method) => {
                        let slot = Slot { slice, turn: wanted.number, blur: eye_blur(&job.rig, slice) };
                        halftone(method, slot, width, &canvas.luminance, bytes);
                    }
                    None => to_bytes(&canvas.luminance, bytes),
                }
                (wanted.done)();
            },
        );
        Ok(())
    }
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
                caster.cast_along(line.mirror, line.toward_viewer, line.viewer_distance_m())
            }),
        }
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
