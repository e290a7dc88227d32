//! Whole turns of every way of drawing against the clear renderer's, what is refused, and what is lost.

use super::{GPU, random_texture, with_gpu};
use glam::{Vec2, Vec3};
use host::render::clear::ClearRenderer;
use host::render::gpu::{GpuError, GpuRenderer, Way};
use host::render::pick::WithFallback;
use host::render::plan::{DepthTest, Edges, Halftone, Plan, Precision, Projection};
use host::render::turn::{Depth, Turn};
use host::render::{RenderError, Renderer, Wanted, dark_turn};
use host::scene::{Scene, ShadedScene, ShadedTriangle, Shading, Wrap, shade};
use protocol::rig::{Rig, TrackedViewer};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use tests::{builtin, rig, scene, scene_of, shared, triangle};

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

/// Three viewers, at other heights and distances.
fn curve() -> Rig {
    let mut rig = small("reference");
    rig.viewing.tracked = [(10.0, 0.9, 0.6), (30.0, 1.2, 0.2), (150.0, 0.8, 0.7)]
        .map(|(azimuth_deg, distance_m, height_m)| TrackedViewer { azimuth_deg, distance_m, height_m })
        .to_vec();
    rig.checked().expect("possible viewers")
}

fn plan(projection: Projection, halftone: Halftone) -> Plan {
    Plan { projection, halftone, ..Plan::default() }
}

/// Lit pixels of `exact`, and those in which `drawn` differs, in grey by more than rounding.
fn differing(exact: &Turn, drawn: &Turn) -> (usize, usize) {
    let pairs = || exact.bytes().iter().zip(drawn.bytes());
    match exact.depth() {
        Depth::Binary => (
            exact.bytes().iter().map(|byte| byte.count_ones() as usize).sum(),
            pairs().map(|(exact, drawn)| (exact ^ drawn).count_ones() as usize).sum(),
        ),
        Depth::Grey => (
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
        let around = |place: usize| [place.saturating_sub(1), place, place + 1];
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
        compare(gpu, "curve", &builtin(), &curve(), &plan(Projection::ConeNewton, Halftone::Grey));
        compare(gpu, "curve", &builtin(), &curve(), &plan(Projection::Planar, Halftone::BlueNoise));
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
                    5 | 17 => {
                        let pairs = || turn.slice(slice).iter().zip(exact.slice(slice));
                        let wrong: u32 = pairs().map(|(drawn, exact)| (drawn ^ exact).count_ones()).sum();
                        assert!(wrong < 20, "{way:?} {slice}: {wrong} pixels");
                    }
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
        let (scene, rig) = (builtin(), small("reference"));
        let plan = plan(Projection::Planar, Halftone::BlueNoise);
        let exact = ClearRenderer.render_turn(&scene, &rig, &plan, &|| ()).expect("a small scene");
        let drawn = gpu.render_turn(&scene, &rig, &plan, &|| ()).expect("a small scene");
        let (lit, wrong) = differing(&exact, &drawn);
        assert!((wrong as f64) < 3e-3 * lit as f64, "{wrong} of {lit}");
    });
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
        // An image of so few pixels is borders for the most part, and the CPU's vertices are snapped to 1/32 pixel.
        assert!(lit > 1000 && (wrong as f64) < 5e-3 * lit as f64, "{wrong} of {lit}");
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
