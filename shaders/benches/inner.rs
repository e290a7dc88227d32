//! The inner operations on one core with the instructions that the target has at least: `cargo bench -p shaders`. With
//! `RUSTFLAGS=-Ctarget-cpu=native` those of this machine, as a caller's `target_feature` gives them.

use criterion::{BatchSize, Criterion, Throughput, criterion_group, criterion_main};
use protocol::rig::{PlaneOrder, Rig, TrackedViewer};
use shaders::halftone::diffusion::{Kernel, Slices, diffuse_lanes};
use shaders::halftone::{Blur, Halftone, Slot, halftone, plane_stride};
use shaders::pack::pack;
use shaders::project::methods::{FaceOptics, Method};
use std::hint::black_box;

const SIDE: u32 = 768;
const LANES: usize = 32;

/// A fixed scatter in 0 … 1.
fn fraction(index: usize) -> f32 {
    ((index as f64 * 0.618_033_988_75).fract()) as f32
}

fn vertices(criterion: &mut Criterion) {
    let rig = Rig::parse(include_str!("../../host/rigs/reference.toml")).unwrap();
    let points: [[f32; LANES]; 3] = core::array::from_fn(|axis| {
        core::array::from_fn(|lane| 0.1 * (fraction(1 + 3 * lane + 7 * axis + lane * lane) - 0.5))
    });
    let mut followed = rig.clone();
    followed.viewing.tracked = vec![TrackedViewer { azimuth_deg: 22.0, distance_m: 0.8, height_m: 0.5 }];
    let mut group = criterion.benchmark_group("vertices");
    group.throughput(Throughput::Elements(LANES as u64));
    let methods = [Method::Planar, Method::ConeNewton, Method::ConeRoot, Method::ConeTable].map(|method| (method, ""));
    for (method, how) in methods.into_iter().chain([(Method::Planar, ", bent"), (Method::ConeNewton, ", bent")]) {
        let projector = FaceOptics::<f32>::new(if how.is_empty() { &rig } else { &followed }, 0, method).slice(0.3);
        assert_eq!(projector.is_bent(), !how.is_empty());
        group.bench_function(format!("{method:?} one by one{how}"), |bencher| {
            bencher.iter(|| {
                let points = black_box(&points);
                core::array::from_fn::<_, LANES, _>(|lane| projector.vertex(points.map(|axis| axis[lane])))
            });
        });
        group.bench_function(format!("{method:?} in lanes{how}"), |bencher| {
            bencher.iter(|| {
                let [x, y, z] = black_box(&points);
                projector.vertices([x, y, z])
            });
        });
    }
}

/// A disc of shades on a dark ground, a quarter of the image.
fn disc() -> Vec<f32> {
    let shade = |x: f32, y: f32| if x * x + y * y < 0.32 { 0.5 + 0.4 * x * y + 0.3 * y } else { 0.0 };
    let place = |pixel: u32| 2.0 * pixel as f32 / SIDE as f32 - 1.0;
    (0..SIDE * SIDE).map(|cell| shade(place(cell % SIDE), place(cell / SIDE))).collect()
}

fn halftones(criterion: &mut Criterion) {
    let luminance = disc();
    let mut plane = vec![0; plane_stride(SIDE) * SIDE as usize];
    let slot = Slot { slice: 5, turn: 0, blur: Blur::ROUND };
    let mut group = criterion.benchmark_group("halftones");
    group.throughput(Throughput::Elements(luminance.len() as u64)).sample_size(20);
    for method in [
        Halftone::BlueNoise,
        Halftone::BlueNoise3d,
        Halftone::FloydSteinberg,
        Halftone::OptimisedDiffusion,
        Halftone::Search,
    ] {
        group.bench_function(format!("{method:?}"), |bencher| {
            bencher.iter(|| halftone(method, slot, SIDE, black_box(&luminance), &mut plane));
        });
    }
}

/// Lanes of [`diffuse_lanes`].
const SLICES: usize = 16;

fn diffused_slices(criterion: &mut Criterion) {
    let luminance: Vec<_> = disc().into_iter().map(|value| (value * 32767.0) as i16).collect();
    let mut planes = vec![0; SLICES * plane_stride(SIDE) * SIDE as usize];
    let mut group = criterion.benchmark_group("slices in lanes");
    group.throughput(Throughput::Elements((SLICES * luminance.len()) as u64)).sample_size(10);
    group.bench_function("OptimisedDiffusion", |bencher| {
        bencher.iter(|| {
            let slices = Slices {
                seeds: core::array::from_fn(|lane| lane as u32),
                width: SIDE,
                luminance: [black_box(luminance.as_slice()); SLICES],
                lit: [0..SIDE as usize, 0..SIDE as usize],
                shade: |value| f32::from(value) * (1.0 / 32767.0),
            };
            let mut planes = planes.chunks_exact_mut(plane_stride(SIDE) * SIDE as usize);
            let planes = core::array::from_fn(|_| planes.next().unwrap());
            diffuse_lanes::<SLICES, _, _>(&Kernel::OPTIMISED, slices, planes);
        });
    });
}

fn packing(criterion: &mut Criterion) {
    let planes: Vec<_> =
        (0..24 * plane_stride(SIDE) * SIDE as usize).map(|index| (256.0 * fraction(index)) as u8).collect();
    let mut group = criterion.benchmark_group("pack");
    group.throughput(Throughput::Bytes(planes.len() as u64));
    group.bench_function("a frame", |bencher| {
        bencher.iter_batched_ref(
            || vec![0; 3 * (SIDE * SIDE) as usize],
            |frame| pack(SIDE, SIDE, PlaneOrder::Rgb, black_box(&planes), frame),
            BatchSize::LargeInput,
        );
    });
}

criterion_group!(benches, vertices, halftones, diffused_slices, packing);
criterion_main!(benches);
