//! How fast this machine is, in the prices that a plan's cost is counted in.

use super::cost::{Work, turn_ns};
use super::{Edges, Halftone, Plan, Precision, Projection};
use crate::render::fast::FastRenderer;
use crate::render::tessellate::tessellate;
use crate::render::{RenderError, Renderer, Wanted, dark_turn};
use crate::scene::ShadedScene;
use protocol::rig::Rig;
use std::time::Instant;

/// Milliseconds that pass here for each millisecond of cost: the quickest of some runs on the CPU over a few frames of `scene`, by the
/// cheapest plan.
pub fn ms_per_cost(scene: &ShadedScene, rig: &Rig) -> Result<f64, RenderError> {
    const RUNS: u32 = 4;
    let plan = Plan {
        projection: Projection::Planar,
        precision: Precision::Single,
        edges: Edges::Straight,
        halftone: Halftone::BlueNoise,
        ..Plan::default()
    };
    // A frame for each thread, which is how the work is shared out.
    let frames = rayon::current_num_threads() as u32;
    let slices: Vec<u32> = (0..rig.rotation.slices.min(frames * rig.rotation.planes_per_frame)).collect();
    let renderer = FastRenderer::new();
    let (mut turn, mut prepared) = (dark_turn(rig, &plan)?, renderer.prepare(scene, rig, &plan)?);
    let mut quickest = f64::INFINITY;
    for _ in 0..RUNS {
        let start = Instant::now();
        prepared.render(Wanted { slices: &slices, number: 0, done: &|| () }, &mut turn)?;
        quickest = quickest.min(start.elapsed().as_secs_f64());
    }
    let cost_s = turn_ns(&plan, &Work::of(&tessellate(scene, rig, &plan)?, rig)) / 1e9;
    Ok(quickest * f64::from(rig.rotation.slices) / slices.len() as f64 / cost_s)
}
