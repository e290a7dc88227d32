//! Ways to project, to bend edges and to compare depth: time against where things are drawn, and against what an eye sees.

use super::{Effort, Job, exposure, median, truth, view};
use crate::measure::compare;
use crate::render::fast::FastRenderer;
use crate::render::plan::choose::predict;
use crate::render::plan::cost::Work;
use crate::render::plan::error::geometric_error;
use crate::render::plan::{DepthTest, Edges, Halftone, Plan, Precision, Projection};
use crate::render::tessellate::tessellate;
use crate::render::truth::Caster;
use crate::render::{RenderError, Renderer};
use crate::seen::{Brightness, reaching, see};
use serde::Serialize;
use std::time::Instant;

/// A method on a scene and a rig.
#[derive(Clone, Debug, Serialize)]
pub struct Point {
    /// The scene.
    pub scene: String,
    /// The rig.
    pub rig: String,
    /// The methods.
    pub plan: Plan,
    /// Median time for a turn, cutting of the scene included, in milliseconds.
    pub turn_ms: f64,
    /// The same as a ratio to the baseline's, which is the first method.
    pub ratio: f64,
    /// Median time for cutting the scene, in milliseconds.
    pub cut_ms: f64,
    /// The cost that [`crate::render::plan::cost`] predicts, as a ratio to the baseline's.
    pub predicted_ratio: f64,
    /// Largest distance between drawn and exact, in projector pixels; parts of the scene that are lost count as infinite.
    pub error_px: f64,
    /// Root of the mean square of it.
    pub rms_px: f64,
    /// Largest as an eye sees it, in minutes of arc.
    pub error_arcmin: f64,
    /// The largest that a plan predicts.
    pub predicted_px: Option<f64>,
    /// Grey slices as an eye sees them against a pinhole render, in dB.
    pub psnr_db: f64,
    /// Their structural similarity.
    pub ssim: f64,
    /// What there is to do.
    pub work: Work,
}

/// The methods of a chart, the baseline first.
pub fn plans(effort: Effort) -> Vec<Plan> {
    use Edges::{Adaptive, Discard, Rays, Straight, Uniform};
    use Precision::{Double, Single};
    use Projection::{ConeNewton, ConeRoot, ConeTable, Planar};
    let plan = |projection, precision, edges, bow_px| Plan {
        projection,
        precision,
        edges,
        bow_px,
        depth: DepthTest::Linear,
        halftone: Halftone::Grey,
    };
    let mut plans = vec![
        plan(Planar, Single, Straight, 0.5),
        plan(Planar, Single, Adaptive, 0.5),
        plan(ConeNewton, Single, Straight, 0.5),
        plan(ConeNewton, Single, Adaptive, 2.0),
        plan(ConeNewton, Single, Adaptive, 0.5),
        plan(ConeNewton, Single, Adaptive, 0.1),
        plan(ConeNewton, Single, Uniform, 0.5),
        plan(ConeTable, Single, Adaptive, 0.5),
        plan(ConeRoot, Single, Adaptive, 0.5),
        plan(ConeRoot, Double, Adaptive, 0.1),
        Plan { depth: DepthTest::Exact, ..plan(ConeNewton, Single, Adaptive, 0.5) },
        plan(ConeNewton, Single, Discard, 8.0),
        plan(ConeRoot, Double, Rays, 0.5),
    ];
    if effort == Effort::Full {
        plans.extend([
            plan(Planar, Double, Adaptive, 0.5),
            plan(ConeNewton, Double, Adaptive, 0.5),
            plan(ConeNewton, Double, Adaptive, 0.1),
            plan(ConeTable, Single, Adaptive, 0.1),
            plan(ConeRoot, Double, Adaptive, 0.5),
            plan(ConeNewton, Single, Adaptive, 0.025),
            plan(ConeNewton, Single, Uniform, 2.0),
            plan(ConeNewton, Single, Uniform, 0.1),
            plan(Planar, Single, Discard, 8.0),
            plan(ConeNewton, Single, Rays, 0.5),
        ]);
    }
    plans
}

/// Measures all methods on one scene and rig. `done` is called with the share that has been done.
pub fn measure(job: &Job<'_>, effort: Effort, done: &mut dyn FnMut(f64)) -> Result<Vec<Point>, RenderError> {
    let plans = plans(effort);
    let steps = 3.0 * plans.len() as f64;
    let times = times(job, &plans, effort, &mut |part| done(part * 2.0 / 3.0))?;
    let (pixels, rays, exposures, pairs) = match effort {
        Effort::Quick => (96, 2, 2, 3_000),
        Effort::Full => (256, 4, 4, 60_000),
    };
    let view = view(job.rig, 0.64, pixels, rays);
    let truth = truth(&Caster::new(job.scene), &view);
    let slices = reaching(job.rig, &crate::seen::View { pixels: 32, rays: 2, ..view });
    let mut points = Vec::new();
    for (index, (plan, (turn_ms, cut_ms))) in plans.iter().zip(times).enumerate() {
        let mesh = tessellate(job.scene, job.rig, plan)?;
        let error = geometric_error(&mesh, job.rig, plan, pairs);
        let turn = FastRenderer::new().render_slices(job.scene, job.rig, plan, &slices, &|| ())?;
        let seen = see(job.rig, &turn, &view, exposures, Brightness::Divided, &|| ()).exposed(exposure(job.rig));
        let likeness = compare(&seen, &truth).ok();
        let predicted = predict(&mesh, job.rig, plan);
        points.push(Point {
            scene: job.name.into(),
            rig: job.rig.name.clone(),
            plan: *plan,
            turn_ms,
            ratio: f64::NAN,
            cut_ms,
            predicted_ratio: predicted.map_or(f64::NAN, |predicted| predicted.cost_ms),
            error_px: if error.lost > 0 { f64::INFINITY } else { error.worst_px },
            rms_px: error.rms_px,
            error_arcmin: error.worst_arcmin,
            predicted_px: predicted.map(|predicted| predicted.error_px),
            psnr_db: likeness.map_or(f64::NAN, |likeness| likeness.psnr_db),
            ssim: likeness.map_or(f64::NAN, |likeness| likeness.ssim),
            work: Work::of(&mesh, job.rig),
        });
        done((2.0 * plans.len() as f64 + index as f64 + 1.0) / steps);
    }
    let (baseline_ms, baseline_cost) = (points[0].turn_ms, points[0].predicted_ratio);
    for point in &mut points {
        point.ratio = point.turn_ms / baseline_ms;
        point.predicted_ratio /= baseline_cost;
    }
    Ok(points)
}

/// For each plan the median milliseconds of a turn, and of cutting the scene for it: the plans take turns, so that what disturbs the
/// machine disturbs all of them alike. A turn is taken from evenly spread slices, fewer of them where a method is slow.
fn times(
    job: &Job<'_>,
    plans: &[Plan],
    effort: Effort,
    done: &mut dyn FnMut(f64),
) -> Result<Vec<(f64, f64)>, RenderError> {
    let (rounds, slices_max, allowed_s) = match effort {
        Effort::Quick => (3, 8, 0.05),
        Effort::Full => (5, 24, 0.5),
    };
    let all = job.rig.rotation.slices;
    let spread = |count: u32| (0..count).map(|index| index * all / count).collect::<Vec<_>>();
    // Milliseconds for cutting the scene, and for cutting it and drawing some slices.
    let timed = |plan: &Plan, count: u32| -> Result<(f64, f64), RenderError> {
        let start = Instant::now();
        tessellate(job.scene, job.rig, plan)?;
        let cut_ms = start.elapsed().as_secs_f64() * 1e3;
        let start = Instant::now();
        FastRenderer::new().render_slices(job.scene, job.rig, plan, &spread(count), &|| ())?;
        Ok((cut_ms, start.elapsed().as_secs_f64() * 1e3))
    };
    // Differences of medians: the difference of two single times may be anything where cutting takes most of both.
    let turn_ms = |cut_ms: f64, drawn_ms: f64, count: u32| {
        cut_ms + (drawn_ms - cut_ms).max(0.0) * f64::from(all) / f64::from(count)
    };
    let threads = rayon::current_num_threads() as u32;
    let mut counts = Vec::new();
    for plan in plans {
        let (cut_ms, drawn_ms) = timed(plan, threads)?;
        let affordable =
            (allowed_s * 1e3 * f64::from(all) / turn_ms(cut_ms, drawn_ms, threads)) as u32 / threads * threads;
        counts.push(affordable.clamp(threads, slices_max.max(threads)));
    }
    let mut samples = vec![(Vec::new(), Vec::new()); plans.len()];
    for round in 0..rounds {
        for (index, plan) in plans.iter().enumerate() {
            let (cut_ms, drawn_ms) = timed(plan, counts[index])?;
            samples[index].0.push(cut_ms);
            samples[index].1.push(drawn_ms);
        }
        done((f64::from(round) + 1.0) / f64::from(rounds));
    }
    let medians = samples.iter_mut().zip(counts).map(|((cuts, drawn), count)| {
        let cut_ms = median(cuts);
        (turn_ms(cut_ms, median(drawn), count), cut_ms)
    });
    Ok(medians.collect())
}
