//! How fast this machine is, in the prices that a plan's cost is counted in.

use super::cost::{Work, turn_ns};
use super::{Edges, Halftone, Plan, Precision, Projection};
use crate::render::tessellate::tessellate;
use crate::render::{RenderError, Renderer};
use crate::scene::ShadedScene;
use protocol::rig::Rig;
use std::time::Instant;

/// Milliseconds that pass here for each millisecond of cost: the quicker of two runs over some slices of `scene`, by the cheapest plan.
pub fn ms_per_cost(renderer: &dyn Renderer, scene: &ShadedScene, rig: &Rig) -> Result<f64, RenderError> {
    const SLICES: u32 = 6;
    let plan = Plan {
        projection: Projection::Planar,
        precision: Precision::Single,
        edges: Edges::Straight,
        halftone: Halftone::Grey,
        ..Plan::default()
    };
    let slices: Vec<u32> = (0..SLICES).map(|index| index * rig.rotation.slices / SLICES).collect();
    let mut quickest = f64::INFINITY;
    for _ in 0..2 {
        let start = Instant::now();
        renderer.render_slices(scene, rig, &plan, &slices, &|| ())?;
        quickest = quickest.min(start.elapsed().as_secs_f64());
    }
    let cost_s = turn_ns(&plan, &Work::of(&tessellate(scene, rig, &plan)?, rig)) / 1e9;
    Ok(quickest * f64::from(rig.rotation.slices) / f64::from(SLICES) / cost_s)
}
