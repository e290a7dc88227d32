//! `praxi plan`: which methods a turn would be rendered by, and why.

use super::args::{PlanArgs, RigArgs, SceneArgs, busy, pixels};
use super::{Failure, say, say_json};
use crate::render::plan::Plan;
use crate::render::plan::choose::{Budget, Candidate, PlanError};
use crate::render::plan::speed::ms_per_cost;
use serde_json::json;

/// Choose the methods for a scene on a rig within a budget, and say what others would cost
#[derive(clap::Args)]
#[command(after_help = "Example: praxi plan builtin --rig high-viewer --budget-px 0.5")]
pub(super) struct Args {
    #[command(flatten)]
    scene: SceneArgs,
    #[command(flatten)]
    rig: RigArgs,
    #[command(flatten)]
    plan: PlanArgs,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

pub(super) fn run(args: &Args) -> Result<(), Failure> {
    let rig = args.rig.find()?;
    let (_, shaded) = args.scene.load()?;
    let planned = args.plan.choose(&shaded, &rig)?;
    let chosen = planned.choice.chosen;
    let weighing = busy("weighing other methods");
    let scale = match planned.ms_per_cost {
        Some(scale) => scale,
        None => ms_per_cost(&shaded, &rig)?,
    };
    // What half the error costs and what twice the error saves. That nothing reaches half of it is an answer too.
    let other = |px: f64| match args.plan.with_budget(&shaded, &rig, Budget::Error(px)) {
        Ok(choice) => Ok(Some(choice.chosen).filter(|other| other.plan != chosen.plan)),
        Err(PlanError::TooAccurate { .. }) => Ok(None),
        Err(error) => Err(error),
    };
    let (better, cheaper) = (other(chosen.error_px / 2.0)?, other(chosen.error_px * 2.0)?);
    drop(weighing);
    let cheaper = cheaper.filter(|cheaper| cheaper.cost_ms < 0.99 * chosen.cost_ms);
    if args.json {
        say_json(&json!({
            "scene": args.scene.scene, "rig": rig.name, "ms_per_cost": scale, "chosen": chosen,
            "next_better": better, "next_cheaper": cheaper, "weighed": planned.choice.candidates,
        }));
        return Ok(());
    }
    say(format!("{} on {}: {}", args.scene.scene, rig.name, chosen.plan));
    say(format!(" {:<51} {:>7} {:>6} {:>6} {:>7}", "plan", "px", "arcmin", "ms", "triangles"));
    let candidates = &planned.choice.candidates;
    // Whether the chosen plan needs exact depth is found out for that one alone.
    let same = |one: &Candidate| Plan { depth: chosen.plan.depth, ..one.plan } == chosen.plan;
    // What another one with the same treatment of edges does as well for less is left out; JSON has all.
    let is_beaten = |one: &Candidate| {
        let beats = |other: &&Candidate| other.plan.edges == one.plan.edges && other.error_px <= 1.05 * one.error_px;
        candidates.iter().take_while(|other| other.plan != one.plan).any(|other| beats(&other))
    };
    for candidate in candidates.iter().filter(|one| same(one) || !is_beaten(one)) {
        let mark = if same(candidate) { '>' } else { ' ' };
        say(format!("{mark}{}", line(if same(candidate) { &chosen } else { candidate }, scale)));
    }
    let versus = |what: &str, other: Option<Candidate>| match other {
        Some(other) => format!(
            "next {what}: {} with {} px for {:.2} x the time",
            other.plan,
            pixels(other.error_px),
            other.cost_ms / chosen.cost_ms
        ),
        None => format!("next {what}: none"),
    };
    say(versus("better", better));
    say(versus("cheaper", cheaper));
    Ok(())
}

fn line(candidate: &Candidate, scale: f64) -> String {
    format!(
        "{:<51} {:>7} {:>6.3} {:>6.0} {:>7}",
        candidate.plan.to_string(),
        pixels(candidate.error_px),
        candidate.error_arcmin,
        candidate.cost_ms * scale,
        candidate.work.triangles_a_slice
    )
}
