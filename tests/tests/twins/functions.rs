//! Function by function, by shaders that call one each; and that a wrong one is found.

use super::{random_texture, with_gpu};
use glam::{Vec2, Vec3};
use host::render::gpu::GpuRenderer;
use host::render::plan::Halftone;
use host::scene::Wrap;
use protocol::rig::TrackedViewer;
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use shaders::halftone::{Blur, Slot, halftone, plane_stride};
use shaders::project::methods::lanes::{NOWHERE, UNLIT};
use shaders::project::methods::{FaceOptics, Method, SliceProjector};
use shaders::wgsl::{self, HALFTONE, Mask, PROJECT, SHADE, UNSURE};
use tests::rig;

/// A rig near the reference, or with a lens, or for viewers at infinity.
fn random_rig(rng: &mut impl Rng) -> protocol::rig::Rig {
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
        let height_m = rng.random_range(0.0..0.7);
        rig.viewing.height_m = Some(height_m);
        let mut rng = ChaCha8Rng::seed_from_u64(f64::to_bits(height_m));
        let mut viewer = || TrackedViewer {
            azimuth_deg: rng.random_range(0.0..360.0),
            distance_m: rng.random_range(0.7..1.4),
            height_m: rng.random_range(0.0..0.7),
        };
        rig.viewing.tracked = (0..6).map(|_| viewer()).collect();
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
    // What is sure of little is no twin.
    if sure > count / 2 { wrong as f64 / sure as f64 } else { 1.0 }
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
        let away = PROJECT
            .replace("line.viewer.x - move_x", "line.viewer.x + move_x")
            .replace("half -= turn / stand.turn", "half += turn / stand.turn");
        assert!(misplaced(gpu, &away, Method::ConeNewton) > 0.1);
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
