//! The chart in words: what to use when, what is behind something else and why it is kept, and where methods fail.

use super::limits::Limit;
use super::{Chart, over_jobs, pareto_front};
use crate::render::plan::{DepthTest, Edges, Halftone, Plan, Precision, Projection};
use std::fmt::Write;

/// Times within this factor of each other are taken to be alike: the machine's noise.
const ALIKE: f64 = 1.1;

/// The summary as Markdown.
pub fn summary(chart: &Chart) -> String {
    let mut text = String::new();
    let kind = if chart.quick { "a quick run" } else { "a full run" };
    let _ = writeln!(
        text,
        "# Speed against accuracy\n\nBy praxi {}, {kind} on {} threads. Times are medians of interleaved runs, as ratios to the first \
         method's; errors are the largest on the projector's image against the cone's root in double precision; PSNR is what a \
         simulated eye sees of grey slices against a pinhole render. Means over scenes and rigs are geometric.\n",
        chart.version, chart.threads
    );
    use_when(&mut text, chart);
    optics(&mut text, chart);
    halftones(&mut text, chart);
    predictions(&mut text, chart);
    fails(&mut text, &chart.limits);
    text
}

fn use_when(text: &mut String, chart: &Chart) {
    let means = over_jobs(&chart.optics, |point| point.plan, |point| (point.ratio, point.error_px));
    let cheapest = |px: f64| {
        let within = means.iter().filter(|(plan, _)| {
            chart.optics.iter().filter(|point| point.plan == *plan).all(|point| point.error_px <= px)
        });
        within.min_by(|a, b| a.1.0.total_cmp(&b.1.0))
    };
    let _ = writeln!(text, "## What to use when\n");
    for px in [4.0, 1.0, 0.5, 0.2, 0.01] {
        let _ = match cheapest(px) {
            Some((plan, (ratio, _))) => {
                writeln!(text, "- Within {px} px on every scene and rig here: **{plan}**, {ratio:.2} x.")
            }
            None => writeln!(
                text,
                "- Within {px} px on every scene and rig here: nothing charted; `praxi plan` finds what is."
            ),
        };
    }
    let best = |wanted: &dyn Fn(Halftone) -> bool| {
        let of_kind: Vec<_> = chart.halftones.iter().filter(|point| wanted(point.halftone)).cloned().collect();
        let means =
            over_jobs(&of_kind, |point| point.halftone, |point| (point.ratio, 10f64.powf(point.psnr_db / 10.0)));
        means.into_iter().max_by(|a, b| a.1.1.total_cmp(&b.1.1))
    };
    let mut say = |what: &str, found: Option<(Halftone, (f64, f64))>| {
        if let Some((halftone, (ratio, power))) = found {
            let _ = writeln!(
                text,
                "- {what}: **{halftone}**, {:.1} dB on average, {ratio:.1} x Bayer's time.",
                10.0 * power.log10()
            );
        }
    };
    say("Binary slices that are cheap", best(&|halftone| halftone.is_mask() && halftone.turns() == 1));
    say(
        "Binary slices one by one, at any price",
        best(&|halftone| halftone.binary().is_some() && halftone.turns() == 1),
    );
    say(
        "Binary slices that may know each other",
        best(&|halftone| halftone != Halftone::Grey && halftone.turns() == 1),
    );
    say("Where flicker at half the turn rate may be", best(&|halftone| halftone.turns() > 1));
    let _ = writeln!(text);
}

fn optics(text: &mut String, chart: &Chart) {
    let means = over_jobs(&chart.optics, |point| point.plan, |point| (point.ratio, point.error_px));
    let front = front_within_noise(&means.iter().map(|(_, figures)| *figures).collect::<Vec<_>>());
    let _ = writeln!(
        text,
        "## Geometry\n\n| method | time | worst error, px | arc min | PSNR, dB | |\n|---|---|---|---|---|---|"
    );
    for ((plan, (ratio, px)), behind) in means.iter().zip(front) {
        let of_plan: Vec<_> = chart.optics.iter().filter(|point| point.plan == *plan).collect();
        let arcmin = super::geometric_mean(of_plan.iter().map(|point| point.error_arcmin));
        let psnr = of_plan.iter().map(|point| point.psnr_db).sum::<f64>() / of_plan.len() as f64;
        let lost = of_plan.iter().filter(|point| point.error_px.is_infinite()).count();
        let mut notes = match behind {
            Some(other) => format!("behind *{}*; kept: {}", means[other].0, why_kept(plan)),
            None => "on the front".into(),
        };
        if lost > 0 {
            let _ = write!(notes, "; loses parts on {lost} of {}", of_plan.len());
        }
        let _ = writeln!(text, "| {plan} | {ratio:.2} | {px:.4} | {arcmin:.3} | {psnr:.1} | {notes} |");
    }
    let _ = writeln!(text);
}

/// For each point another that is better in both by more than the noise, if there is one: the one with the smallest error.
fn front_within_noise(points: &[(f64, f64)]) -> Vec<Option<usize>> {
    let beats =
        |a: (f64, f64), b: (f64, f64)| a.0 * ALIKE < b.0 && a.1 <= b.1 * 1.02 || a.0 <= b.0 * ALIKE && a.1 * 1.05 < b.1;
    let exact = pareto_front(points);
    let behind = |index: usize| {
        let better = (0..points.len()).filter(|other| beats(points[*other], points[index]));
        better.min_by(|a, b| points[*a].1.total_cmp(&points[*b].1))
    };
    (0..points.len()).map(|index| if exact[index] { None } else { behind(index) }).collect()
}

/// Why a method that another beats is there.
fn why_kept(plan: &Plan) -> &'static str {
    match plan {
        Plan { edges: Edges::Rays, .. } => "the exact end of the scale, which the others are judged by",
        Plan { depth: DepthTest::Exact, .. } => "right where surfaces cross, which this error does not count",
        Plan { edges: Edges::Discard, .. } => {
            "the patent's alternative: right with the fewest triangles, and exact depth"
        }
        Plan { edges: Edges::Uniform, .. } => "the yardstick of adaptive cutting",
        Plan { projection: Projection::ConeRoot, .. } => "the reference of the other cones, and what they fall back to",
        Plan { precision: Precision::Double, .. } => "for rigs on which single precision errs, which a plan finds out",
        Plan { projection: Projection::ConeTable, .. } => {
            "the patent's suggestion: a vertex costs two thirds of Newton's, for renderers that are bound by vertices"
        }
        Plan { projection: Projection::Planar, .. } => {
            "the patent's way; enough near the mirror's height and for small scenes"
        }
        Plan { edges: Edges::Straight, .. } => "enough for scenes of short edges",
        Plan { edges: Edges::Adaptive, .. } => {
            "the fewest triangles for its bound, which counts where triangles are dear"
        }
    }
}

fn halftones(text: &mut String, chart: &Chart) {
    let means =
        over_jobs(&chart.halftones, |point| point.halftone, |point| (point.ratio, 10f64.powf(point.psnr_db / 10.0)));
    let of_one_turn = |halftone: Halftone| halftone != Halftone::Grey && halftone.turns() == 1;
    let _ = writeln!(
        text,
        "## Halftones\n\nEyes that nothing was tuned to; the fine measure has 8 x 8 rays and 8 exposures in the middle of the window. \
         A turn on the wire and by zstd -1.\n\n| halftone | time | PSNR, dB | fine, dB | SSIM | wire, MB | zstd, MB | |\n|---|---|---|---|---|---|---|---|"
    );
    for (halftone, (ratio, power)) in &means {
        let of_kind: Vec<_> = chart.halftones.iter().filter(|point| point.halftone == *halftone).collect();
        let mean = |figure: &dyn Fn(&super::halftones::Point) -> f64| {
            of_kind.iter().map(|point| figure(point)).sum::<f64>() / of_kind.len() as f64
        };
        let behind = means.iter().find(|(other, figures)| {
            of_one_turn(*halftone) && of_one_turn(*other) && figures.0 * ALIKE < *ratio && figures.1 > power * 1.02
        });
        let notes = match behind {
            _ if *halftone == Halftone::Grey => "no halftone: what optics alone reach".to_string(),
            _ if halftone.turns() > 1 => {
                format!("flickers at half the turn rate by {:.3} of white", mean(&|point| point.flicker))
            }
            Some((other, _)) => format!("behind *{other}*; kept: {}", why_halftone(*halftone)),
            None => "on the front".into(),
        };
        let (wire, zstd) = (mean(&|point| point.wire_bytes / 1e6), mean(&|point| point.zstd_bytes / 1e6));
        let _ = writeln!(
            text,
            "| {halftone} | {ratio:.1} | {:.2} | {:.2} | {:.4} | {wire:.2} | {zstd:.2} | {notes} |",
            10.0 * power.log10(),
            mean(&|point| point.fine_db),
            mean(&|point| point.ssim),
        );
    }
    let _ = writeln!(text);
}

/// Why a halftone that another beats is there.
fn why_halftone(halftone: Halftone) -> &'static str {
    match halftone {
        Halftone::Grey => "it is the limit",
        Halftone::Bayer => "the smallest on the wire and in hardware",
        Halftone::WhiteNoise => "the floor that the others are judged by",
        Halftone::FloydSteinberg => "the textbook's error diffusion; needs no rig",
        halftone if halftone.is_mask() => "a mask that both ends of a wire can know",
        _ => "independent of its neighbours, so fit for a slice at a time",
    }
}

fn predictions(text: &mut String, chart: &Chart) {
    let ratios = chart.optics.iter().filter(|point| point.error_px.is_finite());
    let mut ratios: Vec<f64> =
        ratios.filter_map(|point| Some(point.predicted_px?.max(1e-3) / point.error_px.max(1e-3))).collect();
    if ratios.is_empty() {
        return;
    }
    let median = super::median(&mut ratios);
    let _ = writeln!(
        text,
        "## Predictions\n\nWhat a plan predicts of its error is {:.2} to {:.2} times what was measured, {median:.2} in the median of {} \
         methods, scenes and rigs.\n",
        ratios[0],
        ratios[ratios.len() - 1],
        ratios.len()
    );
}

fn fails(text: &mut String, limits: &[(String, Vec<Limit>)]) {
    let _ =
        writeln!(text, "## Where methods fail\n\nLargest errors in px over visible points of the display volume.\n");
    for (rig, limits) in limits {
        let _ = writeln!(
            text,
            "### {rig}\n\n| property | value | visible | planar | Newton | table | single precision |\n|---|---|---|---|---|---|---|"
        );
        for limit in limits {
            let px = |value: f64| if limit.visible == 0.0 { "–".into() } else { format!("{value:.4}") };
            let _ = writeln!(
                text,
                "| {} | {} | {:.0} % | {} | {} | {} | {} |",
                limit.property,
                limit.value,
                limit.visible * 100.0,
                px(limit.planar_px),
                px(limit.newton_px),
                px(limit.table_px),
                px(limit.single_px)
            );
        }
        let _ = writeln!(text);
    }
}
