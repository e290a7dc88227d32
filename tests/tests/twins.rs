//! The WGSL and its twins: function by function on random inputs, and whole turns of every way of drawing against the clear renderer.

use glam::{DVec3, Vec2, Vec3};
use host::render::clear::ClearRenderer;
use host::render::gpu::{GpuError, GpuRenderer, Way};
use host::render::pick::WithFallback;
use host::render::plan::{DepthTest, Edges, Halftone, Plan, Precision, Projection};
use host::render::turn::Turn;
use host::render::{RenderError, Renderer, Wanted, dark_turn};
use host::scene::{Scene, ShadedScene, Shading, Texture, Wrap, shade};
use protocol::rig::Rig;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, LazyLock, Mutex, PoisonError};
use tests::{builtin, rig, scene, shared};

/// One device for all tests: an instance of a software device costs 0.3 s and 340 MB.
static GPU: LazyLock<Option<Mutex<GpuRenderer>>> =
    LazyLock::new(|| GpuRenderer::open(None, Some(Way::Compute)).ok().map(Mutex::new));

/// Calls `test` with the device, if there is one.
fn with_gpu(test: impl FnOnce(&mut GpuRenderer)) {
    match &*GPU {
        Some(gpu) => test(&mut gpu.lock().unwrap_or_else(PoisonError::into_inner)),
        None => println!("skipped: no GPU adapter"),
    }
}

/// A rig of 192 × 192 pixels and 24 slices.
fn small(name: &str) -> Rig {
    let mut rig = rig(name);
    rig.rotation.slices = 24;
    rig.projector.focal_px = rig.projector.focal_px.map(|focal| focal / 4.0);
    rig.projector.principal_px = rig.projector.principal_px.map(|point| point.map(|value| value / 4.0));
    (rig.projector.width_px, rig.projector.height_px) = (192, 192);
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

fn all(rig: &Rig) -> Vec<u32> {
    (0..rig.rotation.slices).collect()
}

/// Lit pixels of `exact`, those in which `drawn` differs, and of these the ones that are not beside a border: inside of 3 × 3 pixels
/// that `exact` and `drawn` show alike but for the one in the middle.
fn differing(exact: &Turn, drawn: &Turn) -> [usize; 3] {
    let (width, height) = (exact.width() as usize, exact.height() as usize);
    let at = |turn: &Turn, slice: u32, x: usize, y: usize| {
        let bytes = turn.slice(slice);
        bytes[y * width.div_ceil(8) + x / 8] >> (x % 8) & 1 == 1
    };
    let mut counts = [0; 3];
    for slice in 0..exact.slices() {
        for cell in 0..width * height {
            let (x, y) = (cell % width, cell / width);
            counts[0] += usize::from(at(exact, slice, x, y));
            counts[1] += usize::from(at(exact, slice, x, y) != at(drawn, slice, x, y));
        }
    }
    counts
}
