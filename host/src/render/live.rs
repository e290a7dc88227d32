//! A turn that follows its scene: slices that show nothing of a change stay as they are.

use super::mesh::Mesh;
use super::plan::{Edges, Halftone, Plan, Precision};
use super::tessellate::tessellate;
use super::turn::Turn;
use super::visible::may_slice_show;
use super::{RenderError, Renderer, Wanted, dark_turn};
use crate::scene::{ShadedScene, ShadedTriangle};
use core::f64::consts::TAU;
use glam::{Vec2, Vec3};
use protocol::rig::{Rig, RigError, TrackedViewer};
use rayon::prelude::*;
use shaders::project::SliceOptics;
use shaders::project::curve::shows_alike;
use shaders::project::methods::{FaceOptics, Method, Real};
use std::collections::HashMap;
use std::sync::Arc;

/// From the middle between somebody's eyes to where one of them may be: half of what lies between them, and as much again.
const ASIDE_M: f64 = 0.065;

/// A turn of the scene that was last shown.
pub struct Live {
    rig: Rig,
    /// The rig that the turn is for, where viewers have moved since.
    before: Option<Rig>,
    plan: Plan,
    scene: ShadedScene,
    turn: Turn,
}

impl Live {
    /// A dark turn, of an empty scene.
    pub fn new(rig: &Rig, plan: &Plan) -> Result<Self, RenderError> {
        Ok(Self {
            rig: rig.clone(),
            before: None,
            plan: *plan,
            scene: ShadedScene::default(),
            turn: dark_turn(rig, plan)?,
        })
    }

    /// The turn.
    pub fn turn(&self) -> &Turn {
        &self.turn
    }

    /// Who is tracked from the next turn on.
    ///
    /// # Errors
    /// The viewers are impossible; then those before stay.
    pub fn follow(&mut self, viewers: Vec<TrackedViewer>) -> Result<(), RigError> {
        let mut rig = self.rig.clone();
        rig.viewing.tracked = viewers;
        let before = std::mem::replace(&mut self.rig, rig.checked()?);
        self.before.get_or_insert(before);
        Ok(())
    }

    /// Makes the turn, whose number is `number`, one of `scene`. The slices that were rendered for it: all others, and so their
    /// frames on a device, are as they were. After an error the turn still is of the scene before.
    pub fn show(
        &mut self,
        renderer: &dyn Renderer,
        scene: ShadedScene,
        number: u32,
        done: &(dyn Fn() + Sync),
    ) -> Result<Vec<u32>, RenderError> {
        let slices = match self.plan.halftone.turns() {
            1 => self.changed_slices(&scene)?,
            _ => (0..self.rig.rotation.slices).collect(),
        };
        if !slices.is_empty() {
            let mut turn = self.turn.clone();
            let mut prepared = renderer.prepare(&scene, &self.rig, &self.plan)?;
            prepared.render(Wanted { slices: &slices, number, done }, &mut turn)?;
            self.turn = turn;
        }
        (self.scene, self.before) = (scene, None);
        Ok(slices)
    }

    /// The slices in which scene or viewers have changed.
    fn changed_slices(&self, scene: &ShadedScene) -> Result<Vec<u32>, RenderError> {
        let mut slices = changed_slices(&self.scene, scene, &self.rig, &self.plan)?;
        if let Some(before) = &self.before {
            slices.extend(slices_of_moved_viewers(before, &self.rig, &self.plan));
            slices.sort_unstable();
            slices.dedup();
        }
        Ok(slices)
    }
}

/// The slices by whose fans viewers are elsewhere on `after` than on `before`, rigs that differ in their tracked viewers alone, in order.
/// The others show the same by both, but for where `plan` cuts edges, which it does for all slices together, within its bow.
pub fn slices_of_moved_viewers(before: &Rig, after: &Rig, plan: &Plan) -> Vec<u32> {
    if before.viewing == after.viewing {
        return Vec::new();
    }
    let model = Method::from(plan.projection).model();
    let is_alike = |slice: u32| {
        (0..after.mirror.face.len()).all(|face| shows_alike(before, after, face, after.slice_angle(slice), model))
    };
    let is_joint = matches!(plan.halftone, Halftone::SightLine | Halftone::Joint);
    (0..after.rotation.slices).into_par_iter().filter(|slice| is_joint || !is_alike(*slice)).collect()
}

/// The slices that viewers see, with either eye, while they move their heads a little, in order. Tracked ones: where the curve bends for them
/// they are as far away and as high as they say.
pub fn slices_seen_by(viewers: &[TrackedViewer], rig: &Rig, plan: &Plan) -> Vec<u32> {
    let model = Method::from(plan.projection).model();
    let circles = viewers.iter().map(|viewer| {
        let mut circle = rig.clone();
        circle.viewing.tracked.clear();
        (circle.viewing.distance_m, circle.viewing.height_m) = (Some(viewer.distance_m), Some(viewer.height_m));
        (viewer.azimuth_deg.to_radians(), ASIDE_M / viewer.distance_m, circle)
    });
    let circles: Vec<_> = circles.collect();
    let is_seen = |slice: u32| {
        let angle = rig.slice_angle(slice);
        circles.iter().any(|(azimuth, aside, circle)| {
            (0..rig.mirror.face.len()).any(|face| {
                // Where a fan is not known it may be any.
                SliceOptics::new(circle, face, angle, model).fan().is_none_or(|[from, to]| {
                    let from_first = (azimuth - (from - aside)).rem_euclid(TAU);
                    from_first <= to - from + 2.0 * aside
                })
            })
        })
    };
    (0..rig.rotation.slices).filter(|slice| is_seen(*slice)).collect()
}

/// The slices that may show something of what is in one of the scenes and not in the other, in order.
pub fn changed_slices(
    before: &ShadedScene,
    after: &ShadedScene,
    rig: &Rig,
    plan: &Plan,
) -> Result<Vec<u32>, RenderError> {
    let all = || (0..rig.rotation.slices).collect();
    let changed = difference(before, after);
    if changed.triangles.is_empty() {
        return Ok(Vec::new());
    }
    // Those halftones know other slices; those edges have no straight pieces.
    let is_joint = matches!(plan.halftone, Halftone::SightLine | Halftone::Joint);
    if is_joint || matches!(plan.edges, Edges::Discard | Edges::Rays) {
        return Ok(all());
    }
    let mesh = tessellate(&changed, rig, plan)?;
    Ok(match plan.precision {
        Precision::Single => showing::<f32>(&mesh, rig, plan),
        Precision::Double => showing::<f64>(&mesh, rig, plan),
    })
}

fn showing<F: Real>(mesh: &Mesh, rig: &Rig, plan: &Plan) -> Vec<u32> {
    let faces: Vec<_> =
        (0..rig.mirror.face.len()).map(|face| FaceOptics::<F>::new(rig, face, plan.projection.into())).collect();
    let shows =
        |slice: &u32| faces.iter().any(|optics| may_slice_show(mesh, rig, &optics.slice(rig.slice_angle(*slice))));
    (0..rig.rotation.slices).into_par_iter().filter(shows).collect()
}

/// The triangles that are in one of two scenes and not in the other, as bits tell. The textures are those of the second: pieces are
/// only asked for their place.
fn difference(before: &ShadedScene, after: &ShadedScene) -> ShadedScene {
    let mut count: HashMap<Key, (i64, ShadedTriangle)> = HashMap::new();
    for (scene, sign) in [(before, -1), (after, 1)] {
        for triangle in &scene.triangles {
            count.entry(key(scene, triangle)).or_insert((0, *triangle)).0 += sign;
        }
    }
    let changed = count.into_values().filter(|(count, _)| *count != 0);
    ShadedScene { triangles: changed.map(|(_, triangle)| triangle).collect(), textures: after.textures.clone() }
}

/// All bits of a triangle, and its texture's address: textures are shared, not copied.
type Key = ([u32; 24], usize);

fn key(scene: &ShadedScene, triangle: &ShadedTriangle) -> Key {
    let ShadedTriangle { positions, radiance, uv, texture } = triangle;
    let vectors = positions.iter().chain(radiance).flat_map(Vec3::to_array);
    let mut bits = vectors.chain(uv.iter().flat_map(Vec2::to_array)).map(f32::to_bits);
    let address = texture.map_or(0, |texture| Arc::as_ptr(&scene.textures[texture as usize]) as usize);
    (core::array::from_fn(|_| bits.next().unwrap_or_default()), address)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::clear::ClearRenderer;
    use crate::rigs;
    use crate::scene::{Scene, Shading, shade};
    use glam::Affine3A;

    fn rig() -> Rig {
        let mut rig = rigs::find("reference").unwrap();
        let projector = &mut rig.projector;
        (projector.width_px, projector.height_px) = (96, 96);
        (projector.focal_px, projector.principal_px) = (Some(384.0), Some([48.0; 2]));
        rig
    }

    /// A knot in the middle, and a small one far out that some slices do not show.
    fn scene(place: Vec3) -> ShadedScene {
        let mut scene = shade(&Scene::load("knot-5k").unwrap(), Shading::Lambert, false);
        let small = Affine3A::from_translation(place) * Affine3A::from_scale(Vec3::splat(0.05));
        let copies: Vec<_> = scene
            .triangles
            .iter()
            .map(|triangle| ShadedTriangle {
                positions: triangle.positions.map(|position| small.transform_point3(position)),
                ..*triangle
            })
            .collect();
        scene.triangles.extend(copies);
        scene
    }

    #[test]
    fn what_was_not_rendered_anew_is_as_if_it_had_been() {
        let (rig, plan) = (rig(), Plan { halftone: Halftone::BlueNoise, ..Plan::default() });
        let mut live = Live::new(&rig, &plan).unwrap();
        let places = [Vec3::new(0.1, 0.06, 0.0), Vec3::new(0.1, 0.065, 0.0)];
        let rendered = places.map(|place| live.show(&ClearRenderer, scene(place), 0, &|| ()).unwrap().len() as u32);
        assert!(rendered[0] > 200 && (1..250).contains(&rendered[1]), "{rendered:?}");
        let anew = ClearRenderer.render_turn(&scene(places[1]), &rig, &plan, &|| ()).unwrap();
        assert!(live.turn() == &anew);
        assert_eq!(live.show(&ClearRenderer, scene(places[1]), 1, &|| ()), Ok(vec![]));
    }

    fn viewer(azimuth_deg: f64, height_m: f64) -> TrackedViewer {
        TrackedViewer { azimuth_deg, distance_m: 0.9, height_m }
    }

    #[test]
    fn only_slices_of_viewers_who_move_are_rendered_anew() {
        let plan = Plan { halftone: Halftone::BlueNoise, edges: Edges::Straight, ..Plan::default() };
        let scene = scene(Vec3::ZERO);
        let mut live = Live::new(&rig(), &plan).unwrap();
        live.show(&ClearRenderer, scene.clone(), 0, &|| ()).unwrap();
        let moves = [
            (vec![viewer(90.0, 0.5)], 1),
            (vec![viewer(90.0, 0.5), viewer(200.0, 0.2)], 1),
            (vec![viewer(200.0, 0.25)], 2),
        ];
        for (viewers, sectors) in moves {
            live.follow(viewers.clone()).unwrap();
            let slices = live.show(&ClearRenderer, scene.clone(), 0, &|| ()).unwrap();
            // 30° of the curve, and a fan of 24° and 2° beside it.
            assert!((40 * sectors..60 * sectors).contains(&slices.len()), "{} for {viewers:?}", slices.len());
            let mut rig = rig();
            rig.viewing.tracked = viewers;
            let anew = ClearRenderer.render_turn(&scene, &rig, &plan, &|| ()).unwrap();
            let differing: Vec<_> = (0..288).filter(|slice| live.turn().slice(*slice) != anew.slice(*slice)).collect();
            assert!(differing.is_empty(), "{differing:?} are not as if they had been rendered anew");
            assert_eq!(live.show(&ClearRenderer, scene.clone(), 0, &|| ()), Ok(vec![]));
        }
        assert!(live.follow(vec![viewer(0.0, f64::NAN)]).is_err());
        assert_eq!(live.rig.viewing.tracked, [viewer(200.0, 0.25)]);
    }

    #[test]
    fn a_change_of_light_counts_and_an_order_does_not() {
        let (rig, plan) = (rig(), Plan::default());
        let before = scene(Vec3::ZERO);
        let mut after = before.clone();
        after.triangles.reverse();
        assert_eq!(changed_slices(&before, &after, &rig, &plan), Ok(vec![]));
        after.triangles[0].radiance[1].x += 0.01;
        assert!(!changed_slices(&before, &after, &rig, &plan).unwrap().is_empty());
        let joint = Plan { halftone: Halftone::SightLine, ..plan };
        assert_eq!(changed_slices(&before, &after, &rig, &joint).unwrap().len(), 288);
    }
}
