use super::super::clear::ClearRenderer;
use super::super::mesh::Mesh;
use super::super::turn::Turn;
use super::super::{Renderer, Wanted, dark_turn};
use super::solids::solids;
use super::*;
use crate::render::plan::{Edges, Projection};
use crate::render::tessellate::tessellate;
use crate::rigs;
use crate::scene::{Scene, ShadedScene, ShadedTriangle, Shading, Texture, Wrap, shade};
use glam::{DVec2, Vec2, Vec3, Vec3Swizzles};
use proptest::prelude::*;
use shaders::halftone::plane_stride;
use shaders::project::methods::FaceOptics;
use std::path::Path;
use std::sync::Arc;

const ANY: [u32; 3] = [5, 100, 201];

/// Built-in rig `name` with another image, which shows the same: `side` columns and four rows less.
fn small(name: &str, side: u32) -> Rig {
    let mut rig = rigs::find(name).unwrap();
    let scale = f64::from(side) / f64::from(rig.projector.width_px);
    [rig.projector.width_px, rig.projector.height_px] = [side, side - 4];
    rig.projector.focal_px = rig.projector.focal_px.map(|focal| focal * scale);
    rig.projector.principal_px = rig.projector.principal_px.map(|place| place.map(|axis| axis * scale));
    rig
}

fn plan(halftone: Halftone) -> Plan {
    Plan { projection: Projection::Planar, halftone, ..Plan::default() }
}

fn load(name: &str, fit_m: Option<f32>) -> ShadedScene {
    let mut scene = Scene::load(name).unwrap();
    if let Some(extent_m) = fit_m {
        scene.fit(extent_m);
    }
    shade(&scene, Shading::Lambert, false)
}

fn turn(renderer: &dyn Renderer, scene: &ShadedScene, rig: &Rig, plan: &Plan, number: u32) -> Turn {
    let mut turn = dark_turn(rig, plan).unwrap();
    let wanted = Wanted { slices: &ANY, number, done: &|| () };
    renderer.prepare(scene, rig, plan).unwrap().render(wanted, &mut turn).unwrap();
    turn
}

fn levels() -> impl Iterator<Item = FastRenderer> {
    Level::ALL.into_iter().filter_map(FastRenderer::with)
}

/// Of the bits that `clear` lights, how many `other` differs by.
fn share_of_differing(clear: &Turn, other: &Turn) -> f64 {
    let count = |bytes: &mut dyn Iterator<Item = u8>| bytes.map(|byte| f64::from(byte.count_ones())).sum::<f64>();
    let pairs = clear.bytes().iter().zip(other.bytes());
    count(&mut pairs.map(|(clear, other)| clear ^ other)) / count(&mut clear.bytes().iter().copied())
}

/// Asserts that the fast renderer draws what the clear one does, and that all levels draw the same.
fn assert_alike(what: &str, scene: &ShadedScene, rig: &Rig, plan: &Plan, allowed: f64) {
    let clear = turn(&ClearRenderer, scene, rig, plan, 1);
    let fast: Vec<_> = levels().map(|renderer| turn(&renderer, scene, rig, plan, 1)).collect();
    assert!(fast.iter().all(|other| *other == fast[0]), "{what}: levels differ");
    let share = share_of_differing(&clear, &fast[0]);
    println!("{what}: {:.3} %", 100.0 * share);
    assert!(share < allowed, "{what}: {share}");
}

#[test]
fn masks_are_the_clear_renderers() {
    let scene = load("builtin", None);
    for halftone in Halftone::ALL.into_iter().filter(|halftone| halftone.is_mask()) {
        assert_alike(&halftone.to_string(), &scene, &small("reference", 203), &plan(halftone), 0.003);
    }
}

#[test]
fn rigs_and_scenes_are_the_clear_renderers() {
    let blue = plan(Halftone::BlueNoise);
    let cone = Plan { projection: Projection::ConeNewton, ..blue };
    let mut lens = small("reference", 256);
    lens.projector.radial = [-0.3, 0.2];
    let large = |name: &str| {
        let mut scene = load(name, None);
        for triangle in &mut scene.triangles {
            triangle.positions = triangle.positions.map(|position| 2.5 * position);
        }
        scene
    };
    let [builtin, boxes, knot] = ["builtin", "boxes", "knot-5k"].map(|name| load(name, None));
    let cases = [
        ("cone", &builtin, small("reference", 256), cone),
        ("high", &builtin, small("high-viewer", 256), cone),
        ("tent", &builtin, small("tent", 256), blue),
        ("lens", &builtin, lens, blue),
        ("boxes", &boxes, small("reference", 256), blue),
        ("straight", &boxes, small("reference", 768), Plan { edges: Edges::Straight, ..blue }),
        ("knot", &knot, small("reference", 256), blue),
        ("beyond the panel", &large("builtin"), small("reference", 256), blue),
        ("beyond the tent", &large("boxes"), small("tent", 256), blue),
    ];
    for (what, scene, rig, plan) in cases {
        assert_alike(what, scene, &rig, &plan, 0.003);
    }
}

#[test]
fn textures_are_the_clear_renderers() {
    let path = "../../shared/data/gltf/FlightHelmet/FlightHelmet.gltf";
    if !Path::new(path).exists() {
        return println!("skipped: no {path}");
    }
    let scene = load(path, Some(0.11));
    assert_alike("helmet", &scene, &small("reference", 512), &plan(Halftone::BlueNoise), 0.002);
}

#[test]
fn greys_are_the_clear_renderers() {
    // Luminances that change over triangles, too.
    let mut scene = load("builtin", None);
    for triangle in &mut scene.triangles {
        triangle.radiance =
            triangle.positions.map(|position| (Vec3::splat(0.5) + 8.0 * position).clamp(Vec3::ZERO, Vec3::ONE));
    }
    let (rig, grey) = (small("reference", 256), plan(Halftone::Grey));
    let clear = turn(&ClearRenderer, &scene, &rig, &grey, 0);
    for renderer in levels() {
        let fast = turn(&renderer, &scene, &rig, &grey, 0);
        let differences = || clear.bytes().iter().zip(fast.bytes()).map(|(clear, fast)| clear.abs_diff(*fast));
        let lit = clear.bytes().iter().filter(|byte| **byte > 0).count();
        let off = differences().filter(|difference| *difference > 1).count();
        assert!(off * 200 < lit, "{}: {off} of {lit}", renderer.name());
    }
}

#[test]
fn diffusion_is_a_second_pass() {
    let (scene, rig) = (load("builtin", None), small("reference", 128));
    for halftone in [Halftone::FloydSteinberg, Halftone::Search, Halftone::AlternatingDiffusion, Halftone::SightLine] {
        let [clear, fast] = [&ClearRenderer as &dyn Renderer, &FastRenderer::new()]
            .map(|renderer| turn(renderer, &scene, &rig, &plan(halftone), 1));
        for slice in ANY {
            let [clear, fast] = [clear.mean(slice), fast.mean(slice)];
            assert!(clear > 0.0 && (fast / clear - 1.0).abs() < 0.02, "{halftone} {slice}: {clear} {fast}");
        }
    }
}

#[test]
fn slices_that_are_not_wanted_stay() {
    let (scene, rig) = (load("knot-5k", None), small("reference", 100));
    let plan = plan(Halftone::AlternatingBlueNoise);
    let renderer = FastRenderer::new();
    let mut job = renderer.prepare(&scene, &rig, &plan).unwrap();
    let mut turn = dark_turn(&rig, &plan).unwrap();
    turn.bytes_mut().fill(0xA5);
    let mut render = |slices: &[u32], number| {
        job.render(Wanted { slices, number, done: &|| () }, &mut turn).unwrap();
        turn.clone()
    };
    let first = render(&[3, 30, 287], 0);
    for slice in 0..288 {
        assert_eq!(first.slice(slice).iter().all(|byte| *byte == 0xA5), ![3, 30, 287].contains(&slice), "{slice}");
    }
    // Whatever was drawn before, the same again.
    let other = render(&[30, 3], 1);
    assert!(other.slice(3) != first.slice(3) && other.slice(287) == first.slice(287));
    assert_eq!(render(&[287, 3, 30], 0), first);
}

#[test]
fn nothing_and_next_to_nothing() {
    let (rig, plan) = (small("reference", 64), plan(Halftone::BlueNoise));
    let none = ShadedScene::default();
    assert!(turn(&FastRenderer::new(), &none, &rig, &plan, 0).bytes().iter().all(|byte| *byte == 0));
    let one = white([Vec3::ZERO, Vec3::new(0.0, 0.02, 0.0), Vec3::new(0.02, 0.0, 0.0)]);
    assert_alike("one", &one, &rig, &plan, 0.02);
}

fn white(positions: [Vec3; 3]) -> ShadedScene {
    let triangle = ShadedTriangle { positions, radiance: [Vec3::ONE; 3], uv: [Vec2::ZERO; 3], texture: None };
    ShadedScene { triangles: vec![triangle], textures: vec![] }
}

fn point(radius: f32) -> impl Strategy<Value = Vec3> {
    [-radius..radius, -radius..radius, -radius..radius].prop_map(Vec3::from_array)
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, ..ProptestConfig::default() })]

    /// Small ones, slivers, some that reach beyond panel and image: there are no holes, and pixels differ only where corners that are
    /// rounded to 32nds of a pixel in one renderer and to 256ths in the other move an edge over their centre, or at the panel's rim.
    #[test]
    fn one_triangle(a in point(0.08), arms in [point(1.0), point(1.0)], scale in -3.0f32..0.0, thin in 0.001f32..1.0) {
        let size = 0.3 * 10f32.powf(scale);
        let scene = white([a, a + size * arms[0], a + size * arms[0].lerp(arms[1], thin)]);
        let rig = small("reference", 301);
        for edges in [Edges::Adaptive, Edges::Straight] {
            let plan = Plan { edges, ..plan(Halftone::Bayer) };
            let clear = turn(&ClearRenderer, &scene, &rig, &plan, 0);
            let fast: Vec<_> = levels().map(|renderer| turn(&renderer, &scene, &rig, &plan, 0)).collect();
            prop_assert!(fast.iter().all(|other| *other == fast[0]));
            let mesh = tessellate(&scene, &rig, &plan).unwrap();
            let optics = FaceOptics::<f64>::new(&rig, 0, plan.projection.into());
            for slice in ANY {
                let projector = optics.slice(rig.slice_angle(slice));
                let corners: Vec<_> = mesh.positions.iter().map(|position| projector.vertex(position.to_array())).collect();
                let pixel = |corner: &u32| corners[*corner as usize].map_or(DVec2::MAX, |vertex| vertex.pixel.into());
                let pieces = mesh.triangles.iter().map(|triangle| triangle.corners.each_ref().map(pixel));
                let sides: Vec<_> = pieces.flat_map(|[a, b, c]| [[a, b], [b, c], [c, a]]).collect();
                let shows = |x: i32, y: i32| projector.sight([f64::from(x) + 0.5, f64::from(y) + 0.5]).is_some();
                let lit = |turn: &Turn, x: i32, y: i32| {
                    (0..301).contains(&x) && (0..297).contains(&y)
                        && turn.slice(slice)[y as usize * plane_stride(301) + x as usize / 8] >> (x % 8) & 1 != 0
                };
                for (x, y) in (0..301 * 297).map(|cell| (cell % 301, cell / 301)) {
                    if lit(&clear, x, y) == lit(&fast[0], x, y) {
                        continue;
                    }
                    let around = || (-1..=1).flat_map(|down| (-1..=1).map(move |across| (x + across, y + down)));
                    prop_assert!(!around().all(|(x, y)| lit(&clear, x, y)), "a hole at {x} {y} in slice {slice}");
                    let centre = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
                    let nearest = sides.iter().map(|side| distance(*side, centre)).fold(f64::INFINITY, f64::min);
                    let is_rim = around().any(|(x, y)| !shows(x, y));
                    prop_assert!(nearest < 0.03 || is_rim, "{nearest} px from an edge at {x} {y} in slice {slice}");
                }
            }
        }
    }
}

/// From `point` to the nearest place on a straight line between two others.
fn distance([from, to]: [DVec2; 2], point: DVec2) -> f64 {
    let way = to - from;
    let along = ((point - from).dot(way) / way.length_squared()).clamp(0.0, 1.0);
    (from + if along.is_nan() { 0.0 } else { along } * way).distance(point)
}

#[test]
fn solids_are_closed_and_the_right_way_round() {
    let whole = Mesh::new(&load("boxes", None));
    assert!(solids(&whole).iter().all(|solid| *solid));
    let mut open = whole.clone();
    open.triangles.pop();
    // The last of eight boxes.
    assert_eq!(solids(&open).iter().filter(|solid| !**solid).count(), 11);
    let mut turned = whole.clone();
    turned.triangles.iter_mut().for_each(|triangle| triangle.corners.reverse());
    assert!(solids(&turned).iter().all(|solid| !solid));
}

#[test]
fn all_time_goes_into_parts() {
    let (scene, rig, plan) = (load("knot-5k", None), small("reference", 100), plan(Halftone::Bayer));
    let renderer = FastRenderer::new();
    let mut job = renderer.prepare(&scene, &rig, &plan).unwrap();
    let mut turn = dark_turn(&rig, &plan).unwrap();
    job.render(Wanted { slices: &ANY, number: 0, done: &|| () }, &mut turn).unwrap();
    let stages = job.stages().expect("they are taken");
    assert!(stages.len() == 3 && stages.iter().all(|(_, time)| !time.is_zero()), "{stages:?}");
}

#[test]
fn deep_scenes_are_the_clear_renderers() {
    let plan = Plan { edges: Edges::Straight, ..plan(Halftone::Bayer) };
    // Who renders, by a rig of so many pixels, a knot and another triangle as far up: only the fast renderer tells its stages.
    let is_fast = |side: u32, far_m: f32| {
        let mut scene = load("knot-5k", None);
        let far = [Vec3::ZERO, 0.01 * Vec3::X, 0.01 * Vec3::Z].map(|corner| corner + far_m * Vec3::Y);
        scene.triangles.extend(white(far).triangles);
        let rig = small("reference", side);
        let renderer = FastRenderer::new();
        let mut job = renderer.prepare(&scene, &rig, &plan).unwrap();
        let mut drawn = dark_turn(&rig, &plan).unwrap();
        job.render(Wanted { slices: &ANY, number: 0, done: &|| () }, &mut drawn).unwrap();
        let is_fast = job.stages().is_some();
        assert!(is_fast || drawn == turn(&ClearRenderer, &scene, &rig, &plan, 0));
        is_fast
    };
    assert!(!is_fast(1536, 0.95), "steps of depth of half a pixel");
    assert!(is_fast(768, 0.2));
    assert!(is_fast(1536, 50.0), "out of everybody's sight");
}

/// Textures with more detail than pixels, on small triangles: what half a step of a corner moves is seen.
#[test]
fn fine_textures_are_the_clear_renderers() {
    let mut state = 1u32;
    let mut random = || {
        state = state.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
        (state >> 24) as u8
    };
    let texels = (0..256 * 256).map(|_| [random(); 4]).collect();
    let mut scene = load("knot-20k", None);
    scene.textures = vec![Arc::new(Texture::new(256, 256, texels, [Wrap::Repeat; 2]))];
    for triangle in &mut scene.triangles {
        triangle.texture = Some(0);
        triangle.uv = triangle.positions.map(|position| 25.0 * position.xy());
    }
    assert_alike("fine textures", &scene, &small("reference", 512), &plan(Halftone::BlueNoise), 0.003);
}
