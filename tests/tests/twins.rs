//! The WGSL and its twins: function by function on random inputs, and whole turns of every way of drawing against the clear renderer.

use glam::{Vec2, Vec3};
use host::render::clear::ClearRenderer;
use host::render::gpu::{GpuError, GpuRenderer, Way};
use host::render::pick::WithFallback;
use host::render::plan::{DepthTest, Edges, Halftone, Plan, Precision, Projection};
use host::render::turn::Turn;
use host::render::{RenderError, Renderer, Wanted, dark_turn};
use host::scene::{Scene, ShadedScene, ShadedTriangle, Shading, Texture, Wrap, shade};
use protocol::rig::Rig;
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use shaders::halftone::{Blur, Slot, halftone, plane_stride};
use shaders::project::methods::lanes::{NOWHERE, UNLIT};
use shaders::project::methods::{FaceOptics, Method, SliceProjector};
use shaders::wgsl::{self, HALFTONE, Mask, PROJECT, SHADE, UNSURE};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, LazyLock, Mutex, PoisonError};
use tests::{builtin, rig, scene, scene_of, shared, triangle};

/// One device for all tests: an instance of a software device costs 0.3 s and 340 MB.
static GPU: LazyLock<Option<Mutex<GpuRenderer>>> = LazyLock::new(|| GpuRenderer::open(None, None).ok().map(Mutex::new));

/// Calls `test` with the device, if there is one.
fn with_gpu(test: impl FnOnce(&mut GpuRenderer)) {
    match &*GPU {
        Some(gpu) => test(&mut gpu.lock().unwrap_or_else(PoisonError::into_inner)),
        None => println!("skipped: no GPU adapter"),
    }
}

/// A rig of 200 × 192 pixels, whose rows are no whole words, and 24 slices.
fn small(name: &str) -> Rig {
    let mut rig = rig(name);
    rig.rotation.slices = 24;
    rig.projector.focal_px = rig.projector.focal_px.map(|focal| focal / 4.0);
    rig.projector.principal_px = Some([100.0, 96.0]);
    (rig.projector.width_px, rig.projector.height_px) = (200, 192);
    rig.checked().expect("a possible rig")
}

fn lens() -> Rig {
    let mut rig = small("reference");
    rig.projector.radial = [-0.5, 0.3];
    rig.checked().expect("a possible lens")
}

fn plan(projection: Projection, halftone: Halftone) -> Plan {
    Plan { projection, halftone, ..Plan::default() }
}

/// A rig near the reference, or with a lens, or for viewers at infinity.
fn random_rig(rng: &mut impl Rng) -> Rig {
    let mut rig = rig(if rng.random_bool(0.3) { "tent" } else { "reference" });
    rig.projector.position_m =
        Some([rng.random_range(-0.05..0.05), rng.random_range(0.5..0.8), rng.random_range(-0.05..0.05)]);
    if rng.random_bool(0.5) {
        rig.projector.radial = [rng.random_range(-0.5..0.5), rng.random_range(-0.2..0.2)];
    }
    if rng.random_bool(0.2) {
        (rig.viewing.distance_m, rig.viewing.height_m) = (None, None);
        rig.viewing.elevation_deg = Some(rng.random_range(5.0..40.0));
    } else {
        rig.viewing.height_m = Some(rng.random_range(0.0..0.7));
    }
    rig.checked().expect("a possible rig")
}

fn random_projectors(rng: &mut impl Rng, method: Method) -> Vec<SliceProjector<f32>> {
    (0..32)
        .map(|_| {
            let rig = random_rig(rng);
            let face = rng.random_range(0..rig.mirror.face.len());
            let slice = rng.random_range(0..rig.rotation.slices);
            FaceOptics::<f32>::new(&rig, face, method).slice(rig.slice_angle(slice))
        })
        .collect()
}

const PER_SLICE: usize = 256;

/// `project.wgsl` for one model.
fn project(method: Method, text: &str) -> String {
    text.replace("override CONE = true;", &format!("const CONE = {};", method != Method::Planar))
}

const VERTEX_MAIN: &str = "
@group(0) @binding(1) var<storage, read> slices: array<Slice>;
@group(0) @binding(2) var<storage, read> points: array<vec4f>;
@group(0) @binding(100) var<storage, read_write> answers: array<Vertex>;
@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3u) {
    answers[id.x] = vertex_of(slices[id.x / 256u], points[id.x].xyz);
}";

/// The share of random points that `text` places elsewhere than its twin does, of those of which it is sure.
fn misplaced(gpu: &GpuRenderer, text: &str, method: Method) -> f64 {
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    let projectors = random_projectors(&mut rng, method);
    let slices: Vec<_> = projectors.iter().map(SliceProjector::shared).collect();
    let count = slices.len() * PER_SLICE;
    let points: Vec<[f32; 4]> =
        (0..count).map(|_| [0, 1, 2, 3].map(|axis| if axis < 3 { rng.random_range(-0.1..0.1) } else { 0.0 })).collect();
    let inputs: [(u32, &[u8]); 2] = [(1, bytemuck::cast_slice(&slices)), (2, bytemuck::cast_slice(&points))];
    let answers = gpu
        .evaluate(&[&project(method, text), VERTEX_MAIN], &inputs, 16 * count as u64, count as u32)
        .expect("valid WGSL");
    let answers: Vec<wgsl::Vertex> = bytemuck::pod_collect_to_vec(&answers);
    let (mut sure, mut wrong) = (0, 0);
    for (index, (answer, [x, y, z, _])) in answers.iter().zip(&points).enumerate() {
        if answer.state & UNSURE != 0 {
            continue;
        }
        sure += 1;
        let right = match projectors[index / PER_SLICE].vertex([*x, *y, *z]) {
            None => answer.state & NOWHERE as u32 != 0,
            Some(vertex) => {
                let state = u32::from(vertex.sides) | if vertex.lit { 0 } else { UNLIT as u32 };
                let apart = [0, 1].map(|axis| vertex.pixel[axis] - answer.pixel[axis]);
                answer.state == state && apart[0].hypot(apart[1]) < 0.02 && (vertex.depth_m - answer.depth).abs() < 1e-6
            }
        };
        wrong += usize::from(!right);
    }
    assert!(sure > count / 2, "sure of {sure} of {count}");
    wrong as f64 / sure as f64
}

#[test]
fn vertices_are_placed_alike() {
    with_gpu(|gpu| {
        for method in [Method::Planar, Method::ConeNewton, Method::ConeRoot] {
            let share = misplaced(gpu, PROJECT, method);
            println!("{method:?}: {share:.5} of the points placed otherwise");
            // On the border of the panel rounding decides.
            assert!(share < 1e-3, "{method:?}: {share}");
        }
        for (right, wrong) in [
            ("sin_cos.y * point.x - sin_cos.x * point.z", "sin_cos.y * point.x + sin_cos.x * point.z"),
            ("- along;\n    var line", "+ along;\n    var line"),
            ("squared - along - along", "squared - along"),
            ("1.0 + squared * (slice.radial.x", "1.0 - squared * (slice.radial.x"),
        ] {
            assert!(PROJECT.contains(right), "{right}");
            let share = misplaced(gpu, &PROJECT.replace(right, wrong), Method::Planar);
            assert!(share > 0.1, "{wrong}: {share}");
        }
        let short = PROJECT
            .replace("const STEPS = 6;", "const STEPS = 6;\n")
            .replace("line.viewer.x - move_x", "line.viewer.x + move_x");
        assert!(
            std::panic::catch_unwind(core::panic::AssertUnwindSafe(|| misplaced(gpu, &short, Method::ConeNewton)))
                .map_or(true, |share| share > 0.1)
        );
    });
}

const SIGHT_MAIN: &str = "
@group(0) @binding(1) var<storage, read> slices: array<Slice>;
@group(0) @binding(2) var<storage, read> pixels: array<vec2f>;
@group(0) @binding(100) var<storage, read_write> answers: array<u32>;
@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3u) {
    answers[id.x] = u32(sees(slices[id.x / 256u], pixels[id.x]));
}";

/// The share of random pixels of which `text` says otherwise than its twin whether something is seen there.
fn misseen(gpu: &GpuRenderer, text: &str, method: Method) -> f64 {
    let mut rng = ChaCha8Rng::seed_from_u64(6);
    let projectors = random_projectors(&mut rng, method);
    let slices: Vec<_> = projectors.iter().map(SliceProjector::shared).collect();
    let count = slices.len() * PER_SLICE;
    let pixels: Vec<[f32; 2]> = (0..count).map(|_| [0.0; 2].map(|_: f32| rng.random_range(0.0..768.0))).collect();
    let inputs: [(u32, &[u8]); 2] = [(1, bytemuck::cast_slice(&slices)), (2, bytemuck::cast_slice(&pixels))];
    let answers = gpu
        .evaluate(&[&project(method, text), SIGHT_MAIN], &inputs, 4 * count as u64, count as u32)
        .expect("valid WGSL");
    let answers: Vec<u32> = bytemuck::pod_collect_to_vec(&answers);
    let seen = |index: usize| projectors[index / PER_SLICE].sight(pixels[index]).is_some();
    let wrong = (0..count).filter(|index| seen(*index) != (answers[*index] == 1)).count();
    wrong as f64 / count as f64
}

#[test]
fn pixels_are_on_the_panel_alike() {
    with_gpu(|gpu| {
        for method in [Method::Planar, Method::ConeNewton] {
            let share = misseen(gpu, PROJECT, method);
            println!("{method:?}: {share:.5} of the pixels seen otherwise");
            assert!(share < 2e-3, "{method:?}: {share}");
        }
        let folded = PROJECT.replace("slice.focal * seen * (radius / goal)", "slice.focal * seen");
        let off = PROJECT.replace("dot(slice.mirror_slope, ideal) / w", "dot(slice.mirror_slope, ideal)");
        for wrong in [folded, off] {
            assert!(misseen(gpu, &wrong, Method::Planar) > 2e-3);
        }
    });
}

const MASK_MAIN: &str = "
@group(0) @binding(1) var<storage, read> masks: array<Mask>;
@group(0) @binding(2) var<storage, read> luminances: array<f32>;
@group(0) @binding(100) var<storage, read_write> answers: array<u32>;
@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3u) {
    answers[id.x] = halftoned(masks[0], vec2u(id.x % 96u, id.x / 96u), luminances[id.x]);
}";

/// Pixels of random luminances that `text` halftones otherwise than its twin.
fn mishalftoned(gpu: &GpuRenderer, text: &str, method: shaders::halftone::Halftone, slice: u32, turn: u32) -> usize {
    const SIZE: [usize; 2] = [96, 80];
    let mut rng = ChaCha8Rng::seed_from_u64(7);
    let luminances: Vec<f32> = (0..SIZE[0] * SIZE[1]).map(|_| rng.random_range(0.0..1.0)).collect();
    let mask = [Mask::new(method, slice, turn).expect("a mask")];
    // A buffer has something in it.
    let ranks: Vec<u32> = Mask::ranks(method).into_iter().chain([0]).collect();
    let mut inputs: Vec<(u32, &[u8])> = vec![(1, bytemuck::cast_slice(&mask)), (2, bytemuck::cast_slice(&luminances))];
    inputs.push((20, bytemuck::cast_slice(&ranks)));
    let count = luminances.len();
    let answers = gpu.evaluate(&[text, MASK_MAIN], &inputs, 4 * count as u64, count as u32).expect("valid WGSL");
    let answers: Vec<u32> = bytemuck::pod_collect_to_vec(&answers);
    let stride = plane_stride(SIZE[0] as u32);
    let mut plane = vec![0; stride * SIZE[1]];
    halftone(method, Slot { slice, turn, blur: Blur::ROUND }, SIZE[0] as u32, &luminances, &mut plane);
    let bit = |cell: usize| u32::from(plane[cell / SIZE[0] * stride + cell % SIZE[0] / 8] >> (cell % SIZE[0] % 8) & 1);
    (0..count).filter(|cell| answers[*cell] != bit(*cell)).count()
}

#[test]
fn masks_are_the_same_bit_for_bit() {
    with_gpu(|gpu| {
        for method in Halftone::ALL.into_iter().filter(|method| method.is_mask()).filter_map(Halftone::binary) {
            for (slice, turn) in [(0, 0), (7, 1), (211, 0)] {
                assert_eq!(mishalftoned(gpu, HALFTONE, method, slice, turn), 0, "{method:?} {slice} {turn}");
            }
        }
        let white = HALFTONE.replace("0x85EBCA6Bu", "0x85EBCA6Du");
        assert!(mishalftoned(gpu, &white, shaders::halftone::Halftone::WhiteNoise, 7, 0) > 1000);
        let moved = HALFTONE.replace("rank + mask.shift", "rank - mask.shift");
        assert!(mishalftoned(gpu, &moved, shaders::halftone::Halftone::BlueNoise, 7, 0) > 1000);
    });
}

const SAMPLE_MAIN: &str = "
@group(0) @binding(1) var<storage, read> places: array<vec2f>;
@group(0) @binding(100) var<storage, read_write> answers: array<vec4f>;
@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3u) {
    answers[id.x] = vec4f(sampled(pictures[0], places[id.x]), 0.0);
}";

fn random_texture(rng: &mut impl Rng, [width, height]: [u32; 2], wrap: [Wrap; 2]) -> Texture {
    Texture::new(width, height, (0..width * height).map(|_| [0; 4].map(|_: u8| rng.random())).collect(), wrap)
}

/// The largest difference between what `text` samples and what its twin does.
fn missampled(gpu: &GpuRenderer, text: &str, wrap: [Wrap; 2]) -> f32 {
    let mut rng = ChaCha8Rng::seed_from_u64(8);
    let texture = random_texture(&mut rng, [13, 6], wrap);
    let places: Vec<[f32; 2]> = (0..2048).map(|_| [0.0; 2].map(|_: f32| rng.random_range(-4.0..4.0))).collect();
    let code =
        wrap.map(|wrap| [Wrap::Repeat, Wrap::Mirror, Wrap::Clamp].iter().position(|one| *one == wrap).unwrap() as u32);
    let picture = [wgsl::Picture { offset: 0, width: 13, height: 6, wrap: code[0] | code[1] << 2 }];
    let tones: Vec<f32> = (0..256).map(|value| host::scene::linear_from_srgb(value as f32 / 255.0)).collect();
    let inputs: [(u32, &[u8]); 4] = [
        (1, bytemuck::cast_slice(&places)),
        (23, bytemuck::cast_slice(&picture)),
        (24, bytemuck::cast_slice(texture.texels_srgb8())),
        (25, bytemuck::cast_slice(&tones)),
    ];
    let answers = gpu.evaluate(&[text, SAMPLE_MAIN], &inputs, 16 * 2048, 2048).expect("valid WGSL");
    let answers: Vec<[f32; 4]> = bytemuck::pod_collect_to_vec(&answers);
    let difference = |(answer, place): (&[f32; 4], &[f32; 2])| {
        (Vec3::from_slice(answer) - texture.sample(Vec2::from_array(*place))).abs().max_element()
    };
    answers.iter().zip(&places).map(difference).fold(0.0, f32::max)
}

#[test]
fn textures_are_sampled_alike() {
    with_gpu(|gpu| {
        for wrap in [Wrap::Repeat, Wrap::Mirror, Wrap::Clamp] {
            for wrap in [[wrap, Wrap::Repeat], [Wrap::Mirror, wrap], [Wrap::Clamp, wrap]] {
                let worst = missampled(gpu, SHADE, wrap);
                assert!(worst < 1e-4, "{wrap:?}: {worst}");
            }
        }
        let wrong = SHADE.replace("* f32(count) - 0.5", "* f32(count) + 0.5");
        assert!(missampled(gpu, &wrong, [Wrap::Repeat; 2]) > 0.1);
    });
}

/// Lit pixels of `exact`; those in which `drawn` differs; and of these the ones that are near no border: everything within two pixels
/// is lit alike in grey. `exact` and `drawn` are grey.
fn differing(exact: &Turn, drawn: &Turn) -> (usize, usize) {
    let pairs = || exact.bytes().iter().zip(drawn.bytes());
    match exact.depth() {
        host::render::turn::Depth::Binary => (
            exact.bytes().iter().map(|byte| byte.count_ones() as usize).sum(),
            pairs().map(|(exact, drawn)| (exact ^ drawn).count_ones() as usize).sum(),
        ),
        host::render::turn::Depth::Grey => (
            exact.bytes().iter().filter(|value| **value > 0).count(),
            pairs().filter(|(exact, drawn)| exact.abs_diff(**drawn) > 2).count(),
        ),
    }
}

/// Pixels in which two grey turns differ though both are even around: not on an outline, nor where triangles meet.
fn astray(exact: &Turn, drawn: &Turn) -> usize {
    let (width, height) = (exact.width() as usize, exact.height() as usize);
    let even = |slice: &[u8], cell: usize| {
        let (x, y) = (cell % width, cell / width);
        let around = |turn: usize| [turn.saturating_sub(1), turn, turn + 1];
        let values =
            around(y).into_iter().flat_map(|y| around(x).map(|x| slice[y.min(height - 1) * width + x.min(width - 1)]));
        values.clone().max().unwrap_or(0).abs_diff(values.min().unwrap_or(0)) <= 4
    };
    let astray = |slice| {
        let (exact, drawn) = (exact.slice(slice), drawn.slice(slice));
        (0..width * height)
            .filter(|cell| exact[*cell].abs_diff(drawn[*cell]) > 4 && even(exact, *cell) && even(drawn, *cell))
            .count()
    };
    (0..exact.slices()).map(astray).sum()
}

/// Compares turns of every way with the clear renderer's.
fn compare(gpu: &mut GpuRenderer, name: &str, scene: &ShadedScene, rig: &Rig, plan: &Plan) {
    let exact = ClearRenderer.render_turn(scene, rig, plan, &|| ()).expect("a small scene");
    for way in Way::ALL {
        gpu.set_way(Some(way));
        let drawn = gpu.render_turn(scene, rig, plan, &|| ()).expect("a device that draws it");
        let (lit, wrong) = differing(&exact, &drawn);
        println!("{name}, {way:?}, {:?}: {wrong} of {lit} lit pixels differ", plan.projection);
        assert!(lit > 1000, "{name}: {lit} lit");
        assert!((wrong as f64) < 3e-3 * lit as f64, "{name}, {way:?}: {wrong} of {lit} differ");
        if plan.halftone == Halftone::Grey {
            assert_eq!(astray(&exact, &drawn), 0, "{name}, {way:?}");
        }
    }
}

#[test]
fn turns_agree_with_the_clear_renderer() {
    with_gpu(|gpu| {
        let reference = small("reference");
        for projection in [Projection::Planar, Projection::ConeNewton] {
            for halftone in [Halftone::BlueNoise, Halftone::Grey] {
                let plan = plan(projection, halftone);
                compare(gpu, "builtin", &builtin(), &reference, &plan);
                compare(gpu, "boxes", &scene("boxes"), &reference, &plan);
            }
        }
        compare(gpu, "knot", &scene("knot-5k"), &reference, &plan(Projection::ConeRoot, Halftone::WhiteNoise));
        compare(gpu, "tent", &builtin(), &small("tent"), &plan(Projection::Planar, Halftone::Bayer));
        compare(gpu, "lens", &builtin(), &lens(), &plan(Projection::ConeNewton, Halftone::BlueNoise3d));
        compare(gpu, "high viewer", &builtin(), &small("high-viewer"), &plan(Projection::ConeNewton, Halftone::Grey));
    });
}

#[test]
fn what_reaches_beyond_the_panel_ends_at_its_rim_alike() {
    with_gpu(|gpu| {
        let mut large = Scene::load("boxes").expect("a built-in scene");
        large.fit(0.3);
        let large = shade(&large, Shading::Lambert, false);
        for rig in [small("reference"), small("tent"), lens()] {
            let plan = Plan { edges: Edges::Adaptive, ..plan(Projection::Planar, Halftone::Grey) };
            compare(gpu, &format!("large boxes on {}", rig.name), &large, &rig, &plan);
        }
    });
}

/// A sheet that bends a little, with a texture that wraps.
fn textured(wrap: [Wrap; 2]) -> ShadedScene {
    let mut rng = ChaCha8Rng::seed_from_u64(9);
    let place = |x: u32, y: u32| {
        let (u, v) = (x as f32 / 8.0, y as f32 / 8.0);
        (Vec3::new(0.1 * u - 0.05, 0.06 * v - 0.03, 0.02 * (3.0 * u).sin()), Vec2::new(2.5 * u - 0.7, 1.7 * v - 0.3))
    };
    let cells = (0..64).map(|cell| (cell % 8, cell / 8));
    let triangles = cells.flat_map(|(x, y)| {
        let corners = [(x, y), (x + 1, y), (x + 1, y + 1), (x, y + 1)].map(|(x, y)| place(x, y));
        [[0, 1, 2], [0, 2, 3]].map(|order| ShadedTriangle {
            positions: order.map(|corner| corners[corner].0),
            radiance: [Vec3::new(0.9, 0.8, 0.7), Vec3::ONE, Vec3::splat(0.6)],
            uv: order.map(|corner| corners[corner].1),
            texture: Some(1),
        })
    });
    let texture = |rng: &mut ChaCha8Rng| Arc::new(random_texture(rng, [5, 3], wrap));
    let textures = vec![texture(&mut rng), texture(&mut rng)];
    let mut triangles: Vec<_> = triangles.collect();
    triangles.push(triangle([[-0.03, -0.04, 0.03], [0.03, -0.04, 0.03], [0.0, -0.02, 0.03]], 0.5));
    ShadedScene { triangles, textures }
}

#[test]
fn textured_turns_agree_with_the_clear_renderer() {
    with_gpu(|gpu| {
        for wrap in [[Wrap::Repeat, Wrap::Clamp], [Wrap::Mirror, Wrap::Repeat]] {
            compare(gpu, "a sheet", &textured(wrap), &small("reference"), &plan(Projection::Planar, Halftone::Grey));
        }
        let Some(path) = shared("data/gltf/FlightHelmet/FlightHelmet.gltf") else { return };
        let mut helmet = Scene::load(path).expect("the helmet");
        helmet.fit(0.1);
        let helmet = shade(&helmet, Shading::Unlit, false);
        let rig = small("reference");
        let plan = Plan { edges: Edges::Straight, ..plan(Projection::Planar, Halftone::BlueNoise) };
        compare(gpu, "FlightHelmet", &helmet, &rig, &plan);
    });
}

#[test]
fn wanted_slices_alone_change() {
    with_gpu(|gpu| {
        let (scene, rig) = (builtin(), small("reference"));
        let plan = plan(Projection::Planar, Halftone::AlternatingBlueNoise);
        for way in Way::ALL {
            gpu.set_way(Some(way));
            let mut job = gpu.prepare(&scene, &rig, &plan).expect("a small scene");
            let mut turn = dark_turn(&rig, &plan).expect("a small turn");
            turn.bytes_mut().fill(0x5A);
            let done = AtomicUsize::new(0);
            let count = || {
                done.fetch_add(1, Ordering::Relaxed);
            };
            job.render(Wanted { slices: &[5, 17], number: 1, done: &count }, &mut turn).expect("two slices");
            assert_eq!(done.into_inner(), 2);
            let mut exact = dark_turn(&rig, &plan).expect("a small turn");
            let wanted = Wanted { slices: &[5, 17], number: 1, done: &|| () };
            ClearRenderer.prepare(&scene, &rig, &plan).unwrap().render(wanted, &mut exact).unwrap();
            for slice in 0..24 {
                match slice {
                    5 | 17 => assert!(turn.slice(slice) != exact.slice(0) && turn.mean(slice) < 0.3, "{way:?} {slice}"),
                    _ => assert!(turn.slice(slice).iter().all(|byte| *byte == 0x5A), "{way:?} {slice}"),
                }
            }
        }
    });
}

#[test]
fn nothing_and_one_triangle_are_drawn() {
    with_gpu(|gpu| {
        let (rig, plan) = (small("reference"), plan(Projection::Planar, Halftone::Bayer));
        for way in Way::ALL {
            gpu.set_way(Some(way));
            let turn = |scene: &ShadedScene| gpu.render_turn(scene, &rig, &plan, &|| ()).expect("it is small");
            assert!(turn(&scene_of(Vec::new())).bytes().iter().all(|byte| *byte == 0), "{way:?}");
            let one = scene_of(vec![triangle([[-0.03, 0.0, 0.0], [0.03, 0.0, 0.0], [0.0, 0.04, 0.0]], 1.0)]);
            assert!((0..24).any(|slice| turn(&one).mean(slice) > 0.001), "{way:?}");
        }
    });
}

#[test]
fn halftones_that_are_no_masks_come_second() {
    with_gpu(|gpu| {
        gpu.set_way(Some(Way::Atlas));
        let (scene, rig) = (builtin(), small("reference"));
        let plan = plan(Projection::Planar, Halftone::FloydSteinberg);
        let turn = gpu.render_turn(&scene, &rig, &plan, &|| ()).expect("a small scene");
        let exact = ClearRenderer.render_turn(&scene, &rig, &plan, &|| ()).expect("a small scene");
        for slice in 0..24 {
            assert!((turn.mean(slice) - exact.mean(slice)).abs() < 1e-3, "{slice}");
        }
    });
}

#[test]
fn the_quicker_way_is_found() {
    with_gpu(|gpu| {
        gpu.set_way(None);
        compare_one(gpu, &builtin(), &small("reference"), &plan(Projection::Planar, Halftone::BlueNoise));
    });
}

fn compare_one(gpu: &GpuRenderer, scene: &ShadedScene, rig: &Rig, plan: &Plan) {
    let exact = ClearRenderer.render_turn(scene, rig, plan, &|| ()).expect("a small scene");
    let (lit, wrong) = differing(&exact, &gpu.render_turn(scene, rig, plan, &|| ()).expect("a small scene"));
    assert!((wrong as f64) < 3e-3 * lit as f64, "{wrong} of {lit}");
}

#[test]
fn what_only_the_cpu_renders_is_refused() {
    with_gpu(|gpu| {
        let (scene, rig, usual) = (builtin(), small("reference"), plan(Projection::Planar, Halftone::Grey));
        let refused = |gpu: &GpuRenderer, rig: &Rig, plan: &Plan| match gpu.prepare(&scene, rig, plan) {
            Err(RenderError::Gpu(GpuError::Unsupported { what })) => what,
            other => panic!("{:?}", other.err()),
        };
        gpu.set_way(Some(Way::Compute));
        assert!(refused(gpu, &rig, &Plan { precision: Precision::Double, ..usual }).contains("double"));
        assert!(refused(gpu, &rig, &Plan { edges: Edges::Rays, ..usual }).contains("ray"));
        assert!(refused(gpu, &rig, &Plan { edges: Edges::Discard, ..usual }).contains("pixel"));
        assert!(refused(gpu, &rig, &Plan { depth: DepthTest::Exact, ..usual }).contains("depth"));
        let mut fine = rig.clone();
        fine.projector.focal_px = fine.projector.focal_px.map(|focal| 4e3 * focal);
        assert!(refused(gpu, &fine, &usual).contains("single"));
        let mut wide = rig;
        (wide.projector.width_px, wide.projector.height_px) = (60_000, 8);
        gpu.set_way(Some(Way::Atlas));
        let error = gpu.prepare(&scene, &wide, &usual).err();
        assert!(matches!(error, Some(RenderError::Gpu(GpuError::TooLarge { needed: 60_000, .. }))), "{error:?}");
    });
}

#[test]
fn the_cpu_goes_on_where_a_device_is_lost() {
    if GPU.is_none() {
        println!("skipped: no GPU adapter");
        return;
    }
    let gpu = GpuRenderer::open(None, Some(Way::Compute)).expect("as before");
    let said = Arc::new(Mutex::new(Vec::new()));
    let hears = said.clone();
    let renderer = WithFallback::new(gpu, Box::new(move |error| hears.lock().unwrap().push(error.to_string())));
    let (scene, rig, plan) = (builtin(), small("reference"), plan(Projection::Planar, Halftone::Bayer));
    let slices: Vec<_> = (0..24).collect();
    let wanted = Wanted { slices: &slices, number: 0, done: &|| () };
    let mut job = renderer.prepare(&scene, &rig, &plan).expect("a small scene");
    let mut turn = dark_turn(&rig, &plan).expect("a small turn");
    job.render(wanted, &mut turn).expect("a device");
    assert!(said.lock().unwrap().is_empty());
    renderer.gpu().destroy();
    for _ in 0..2 {
        let mut again = dark_turn(&rig, &plan).expect("a small turn");
        job.render(wanted, &mut again).expect("the CPU");
        let (lit, wrong) = differing(&turn, &again);
        assert!(lit > 1000 && (wrong as f64) < 3e-3 * lit as f64, "{wrong} of {lit}");
    }
    renderer.render_turn(&scene, &rig, &plan, &|| ()).expect("the CPU");
    let said = said.lock().unwrap();
    assert!(said.len() == 1 && said[0].starts_with("GPU ") && !said[0].contains('\n'), "{said:?}");
}

#[test]
fn an_adapter_that_is_not_there_is_named() {
    let error = GpuRenderer::open(Some("no such thing"), None).err().expect("there is none");
    assert!(error.to_string().contains("\"no such thing\""), "{error}");
}
