//! Every renderer shows what the clear one shows: slice by slice, bit by bit, but for what rounding may do at borders.

use host::render::clear::ClearRenderer;
use host::render::plan::{Edges, Halftone, Plan, Projection};
use host::render::turn::Turn;
use host::render::{Prepared, RenderError, Renderer, Wanted};
use host::scene::{Scene, ShadedScene, Shading, shade};
use protocol::rig::{Rig, TrackedViewer};
use tests::agree::{Exact, MODELS, renderers};
use tests::{bunny, rig, scene, shared};

/// Two frames' worth of sides, with slices at both ends of a frame and of the turn.
const SLICES: [u32; 10] = [0, 23, 24, 61, 100, 143, 170, 215, 250, 287];

fn plan(projection: Projection, halftone: Halftone) -> Plan {
    Plan { projection, halftone, edges: Edges::Adaptive, bow_px: 0.4, ..Plan::default() }
}

fn compare(name: &str, scene: &ShadedScene) {
    let renderers = renderers();
    for rig_name in ["reference", "high-viewer", "tent"] {
        let rig = rig(rig_name);
        for (model, projection) in MODELS {
            let exact = Exact::new(scene, &rig, plan(projection, Halftone::BlueNoise), &SLICES);
            for (who, renderer) in &renderers {
                exact.assert_same(&format!("{name}, {rig_name}, {model}, {who}"), renderer.as_ref());
            }
        }
    }
}

#[test]
fn the_built_in_scene_is_the_same() {
    compare("builtin", &scene("builtin"));
}

#[test]
fn long_edges_are_the_same() {
    compare("boxes", &scene("boxes"));
}

#[test]
fn small_triangles_are_the_same() {
    compare("knot-5k", &scene("knot-5k"));
}

#[test]
fn the_bunny_is_the_same() {
    if let Some(bunny) = bunny() {
        compare("bunny", &bunny);
    }
}

#[test]
fn textures_are_the_same() {
    let Some(path) = shared("data/gltf/FlightHelmet/FlightHelmet.gltf") else { return };
    let mut scene = Scene::load(path).expect("the helmet");
    scene.fit(0.1);
    compare("helmet", &shade(&scene, Shading::Lambert, true));
}

/// Slices 61, 100 and 143 are on bends, 170 on neither bend nor circle, the others on the circle.
#[test]
fn curves_through_viewers_are_the_same() {
    let mut rig = rig("reference");
    rig.viewing.tracked = [(70.0, 1.2, 0.6), (115.0, 0.8, 0.15), (135.0, 0.9, 0.75), (180.0, 1.3, 0.5)]
        .map(|(azimuth_deg, distance_m, height_m)| TrackedViewer { azimuth_deg, distance_m, height_m })
        .to_vec();
    let rig = rig.checked().expect("a possible rig");
    let renderers = renderers();
    for name in ["builtin", "boxes", "knot-5k"] {
        let scene = scene(name);
        for (model, projection) in MODELS {
            let exact = Exact::new(&scene, &rig, plan(projection, Halftone::BlueNoise), &SLICES);
            for (who, renderer) in &renderers {
                exact.assert_same(&format!("{name}, a curve, {model}, {who}"), renderer.as_ref());
            }
        }
    }
}

#[test]
fn every_mask_is_the_same() {
    let (scene, rig) = (scene("builtin"), rig("reference"));
    let renderers = renderers();
    for halftone in Halftone::ALL.into_iter().filter(|halftone| halftone.is_mask()) {
        let exact = Exact::new(&scene, &rig, plan(Projection::ConeNewton, halftone), &SLICES[3..6]);
        for (who, renderer) in &renderers {
            exact.assert_same(&format!("{halftone}, {who}"), renderer.as_ref());
        }
    }
}

/// What goes wrong in a slice's plane, with so many bytes in a row.
type Fault = fn(&mut [u8], usize);

/// The clear renderer with a fault in one slice.
struct Broken {
    slice: u32,
    fault: Fault,
}

struct BrokenJob<'a> {
    whole: Box<dyn Prepared + 'a>,
    broken: &'a Broken,
}

impl Renderer for Broken {
    fn name(&self) -> String {
        "broken".into()
    }

    fn prepare<'a>(
        &'a self,
        scene: &'a ShadedScene,
        rig: &Rig,
        plan: &Plan,
    ) -> Result<Box<dyn Prepared + 'a>, RenderError> {
        Ok(Box::new(BrokenJob { whole: ClearRenderer.prepare(scene, rig, plan)?, broken: self }))
    }
}

impl Prepared for BrokenJob<'_> {
    fn render(&mut self, wanted: Wanted<'_>, turn: &mut Turn) -> Result<(), RenderError> {
        self.whole.render(wanted, turn)?;
        let stride = (turn.width() as usize).div_ceil(8);
        (self.broken.fault)(turn.slice_mut(self.broken.slice), stride);
        Ok(())
    }
}

/// A picture one pixel lower.
fn lower(plane: &mut [u8], stride: usize) {
    plane.copy_within(..plane.len() - stride, stride);
}

/// A picture one pixel to the right.
fn right(plane: &mut [u8], stride: usize) {
    for row in plane.chunks_mut(stride) {
        let mut carry = 0;
        for byte in row {
            (*byte, carry) = (*byte << 1 | carry, *byte >> 7);
        }
    }
}

/// A few bits in the middle of a triangle.
fn speckled(plane: &mut [u8], stride: usize) {
    for row in [300, 350, 400] {
        plane[row * stride + stride / 2] ^= 1;
    }
}

/// The test of the test: what is one pixel off in one slice, or wrong in a handful of bits, is not the same.
#[test]
fn a_broken_renderer_is_found() {
    let rig = rig("reference");
    for name in ["builtin", "boxes", "knot-5k"] {
        let scene = scene(name);
        let exact = Exact::new(&scene, &rig, plan(Projection::ConeNewton, Halftone::BlueNoise), &SLICES[3..6]);
        assert!(exact.against(&ClearRenderer).unwrap().iter().all(|one| one.differing == 0));
        let faults: [(&str, Fault); 2] = [("lower", lower), ("right", right)];
        for (fault_name, fault) in faults {
            let found = exact.against(&Broken { slice: SLICES[4], fault }).unwrap();
            let holds: Vec<bool> = found.iter().map(|one| one.holds()).collect();
            assert_eq!(holds, [true, false, true], "{name}, {fault_name}: {found:?}");
        }
    }
    // Large triangles have a middle; three bits are within the share that may differ, but not there.
    let scene = wall();
    let exact = Exact::new(&scene, &rig, plan(Projection::ConeNewton, Halftone::BlueNoise), &SLICES[..1]);
    let found = exact.against(&Broken { slice: SLICES[0], fault: speckled }).unwrap();
    assert!(found[0].stray > 0 && found[0].differing <= 3 && !found[0].holds(), "{found:?}");
}

/// Two large triangles that face the front.
fn wall() -> ShadedScene {
    let [a, b, c, d] = [[-0.05, -0.04, 0.0], [0.05, -0.04, 0.0], [0.05, 0.04, 0.0], [-0.05, 0.04, 0.0]];
    tests::scene_of(vec![tests::triangle([a, b, c], 0.6), tests::triangle([a, c, d], 0.6)])
}
