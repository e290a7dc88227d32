//! A scene whose edges are cut once, for as long as it stands still or turns about the axis, whoever looks at it.
//!
//! Cutting is done by one thread for all slices together: for somebody who is followed it took longer than drawing the slices that they
//! see. Where a scene turns about the axis the same cuts serve in each of its turns, and a viewer who moves changes them only where the
//! display was never seen from so far or so high before.

use super::RenderError;
use super::mesh::{Mesh, Triangle};
use super::plan::{Edges, Plan};
use super::tessellate::cut;
use crate::scene::{ShadedScene, ShadedTriangle};
use core::f64::consts::TAU;
use glam::{DQuat, Mat3, Vec2, Vec3};
use protocol::rig::{Rig, Viewing};

/// A projector beside the axis draws a scene that has turned otherwise: edges are cut for as many of its turns. Bows are measured every 15°
/// by themselves.
const ORIENTATIONS: u32 = 4;

/// The pieces of a scene's triangles.
pub struct Precut {
    plan: Plan,
    /// The pieces: instead of radiances their corners' weights of the corners of the scene's triangle, instead of a texture its index.
    mesh: Mesh,
    /// For whom edges are cut.
    viewing: Vec<Viewing>,
    reach_m: f64,
}

impl Precut {
    /// `scene`, not cut yet; of what lies farther than `reach_m` metres from the axis, whole pieces may be left out.
    /// `None` where `plan` does not cut edges by their bow.
    pub fn new(scene: &ShadedScene, plan: &Plan, reach_m: f64) -> Option<Self> {
        if !matches!(plan.edges, Edges::Adaptive | Edges::Uniform) {
            return None;
        }
        let by_weight = |(index, triangle): (usize, &ShadedTriangle)| ShadedTriangle {
            radiance: Vec3::AXES,
            uv: [Vec2::ZERO; 3],
            texture: Some(index as u32),
            ..*triangle
        };
        let triangles = scene.triangles.iter().enumerate().map(by_weight).collect();
        let mesh = Mesh::new(&ShadedScene { triangles, textures: Vec::new() });
        Some(Self { plan: *plan, mesh, viewing: Vec::new(), reach_m })
    }

    /// Cuts edges so that pieces bow no more than the plan allows on `rig`, too, however the scene has turned. Does nothing the second time.
    pub fn refine(&mut self, rig: &Rig) -> Result<(), RenderError> {
        if self.viewing.contains(&rig.viewing) {
            return Ok(());
        }
        for orientation in 0..ORIENTATIONS {
            let turn = DQuat::from_rotation_y(TAU * f64::from(orientation) / f64::from(ORIENTATIONS));
            let turned = |mesh: Mesh, turn: DQuat| Mesh {
                positions: mesh.positions.into_iter().map(|position| turn * position).collect(),
                ..mesh
            };
            let mesh = turned(core::mem::take(&mut self.mesh), turn);
            self.mesh = turned(cut(mesh, rig, &self.plan, self.reach_m)?, turn.inverse());
        }
        self.viewing.push(rig.viewing.clone());
        Ok(())
    }

    /// For how many ways of viewing edges are cut.
    pub fn refinements(&self) -> usize {
        self.viewing.len()
    }

    /// How far from the axis nothing is left out, metres.
    pub fn reach_m(&self) -> f64 {
        self.reach_m
    }

    /// The pieces of `scene`, which is that of [`Precut::new`] turned about the axis by `radians`, with whatever radiance it has now.
    pub fn of(&self, scene: &ShadedScene, radians: f64) -> ShadedScene {
        let turn = DQuat::from_rotation_y(radians);
        let positions: Vec<Vec3> = self.mesh.positions.iter().map(|position| (turn * *position).as_vec3()).collect();
        let piece = |Triangle { corners, radiance: weights, texture, .. }: &Triangle| {
            let whole = &scene.triangles[texture.unwrap_or_default() as usize];
            let radiances = Mat3::from_cols_array_2d(&whole.radiance.map(Vec3::into));
            ShadedTriangle {
                positions: corners.map(|corner| positions[corner as usize]),
                radiance: weights.map(|weights| radiances * weights),
                uv: weights.map(|weights| (0..3).map(|corner| whole.uv[corner] * weights[corner]).sum()),
                texture: whole.texture,
            }
        };
        ShadedScene { triangles: self.mesh.triangles.iter().map(piece).collect(), textures: scene.textures.clone() }
    }

    /// By what [`Precut::of`] is drawn.
    pub fn plan(&self) -> Plan {
        Plan { edges: Edges::Straight, ..self.plan }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::bow::{Samples, reach_m};
    use crate::render::tessellate::tessellate;
    use crate::rigs;
    use crate::scene::{Scene, Shading, shade};
    use glam::DVec3;
    use shaders::project::Model;

    const RADIANS: f64 = 0.7;

    fn plan() -> Plan {
        Plan { bow_px: 0.4, ..Plan::default() }
    }

    fn scene(degrees: f32) -> ShadedScene {
        shade(&Scene::load("builtin").unwrap().turned(degrees), Shading::Lambert, false)
    }

    fn seen_from(distance_m: f64, height_m: f64) -> Rig {
        let mut rig = rigs::find("reference").unwrap();
        (rig.viewing.distance_m, rig.viewing.height_m) = (Some(distance_m), Some(height_m));
        rig
    }

    /// The farthest that the middle of an edge lies from straight, pixels.
    fn bow_px(scene: &ShadedScene, rig: &Rig) -> f64 {
        let samples = Samples::new(rig, Model::Cone);
        let bow = |[from, to]: [DVec3; 2]| {
            let ends = [from, to].map(|end| samples.track(end));
            samples.bow_px(&samples.track((from + to) / 2.0), [&ends[0], &ends[1]], [0.5; 2])
        };
        let edges = scene.triangles.iter().flat_map(|triangle| {
            let corners = triangle.positions.map(Vec3::as_dvec3);
            [0, 1, 2].map(|edge| [corners[edge], corners[(edge + 1) % 3]])
        });
        edges.map(bow).filter(|bow| bow.is_finite()).fold(0.0, f64::max)
    }

    #[test]
    fn pieces_bow_no_more_than_allowed_however_the_scene_has_turned_and_whoever_sees_it() {
        let rigs = [seen_from(0.9, 0.35), seen_from(0.6, 0.5)];
        let mut cut = Precut::new(&scene(0.0), &plan(), reach_m(&rigs[0])).unwrap();
        let whole = cut.of(&scene(0.0), 0.0);
        assert!(bow_px(&whole, &rigs[0]) > 2.0 * plan().bow_px);
        for rig in &rigs {
            cut.refine(rig).unwrap();
        }
        let turned = scene(RADIANS.to_degrees() as f32);
        let pieces = cut.of(&turned, RADIANS);
        let middle = |scene: &ShadedScene| {
            let area = |[a, b, c]: [Vec3; 3]| (b - a).cross(c - a).length() * (a + b + c);
            scene.triangles.iter().map(|triangle| area(triangle.positions)).sum::<Vec3>()
        };
        assert!(middle(&pieces).distance(middle(&turned)) < 1e-3 * middle(&turned).length());
        for rig in &rigs {
            let bow = bow_px(&pieces, rig);
            assert!(bow <= plan().bow_px, "{bow} px from {:?}", rig.viewing);
        }
        // Half a step of the grid on which viewers are.
        for off in [-0.05, 0.05] {
            let bow = bow_px(&pieces, &seen_from(0.6 + off, 0.5 + off));
            assert!(bow <= plan().bow_px, "{bow} px {off} m off");
        }
        let triangles = pieces.triangles.len();
        cut.refine(&rigs[0]).unwrap();
        assert_eq!((cut.refinements(), cut.of(&scene(0.0), 0.0).triangles.len()), (2, triangles));
    }

    #[test]
    fn pieces_are_those_that_cutting_each_time_gives() {
        let (rig, scene) = (seen_from(0.9, 0.35), scene(0.0));
        let mut cut = Precut::new(&scene, &plan(), reach_m(&rig)).unwrap();
        cut.refine(&rig).unwrap();
        let (pieces, anew) = (cut.of(&scene, 0.0), tessellate(&scene, &rig, &plan()).unwrap());
        let ratio = pieces.triangles.len() as f64 / anew.triangles.len() as f64;
        assert!((0.99..1.1).contains(&ratio), "{ratio}");
        let area = |scene: &ShadedScene| -> f32 {
            let area = |[a, b, c]: [Vec3; 3]| (b - a).cross(c - a).length() / 2.0;
            scene.triangles.iter().map(|triangle| area(triangle.positions) * triangle.radiance[0].x).sum()
        };
        assert!((area(&pieces) / area(&scene) - 1.0).abs() < 0.1);
        let straight = Plan { edges: Edges::Straight, ..plan() };
        assert!(Precut::new(&scene, &straight, 1.0).is_none());
    }
}
