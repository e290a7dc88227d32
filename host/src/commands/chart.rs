//! `praxi chart`: speed against accuracy, in one folder.

use super::args::{load_fitted, positive};
use super::{Failure, say, say_json};
use crate::chart::{self, Chart, Effort, Job};
use crate::output::Folder;
use crate::rigs;
use crate::scene::ShadedScene;
use indicatif::{ProgressBar, ProgressStyle};
use protocol::rig::Rig;
use std::path::PathBuf;

/// Time and measure every method on scenes and rigs: chart.svg, chart.png, chart.csv, chart.json, summary.md
#[derive(clap::Args)]
#[command(
    after_help = "Example: praxi chart --quick --out chart\n         praxi chart builtin bunny.obj --rig reference --out chart"
)]
pub(super) struct Args {
    /// .gltf, .glb, .obj or .ply files, builtin, boxes, knot-5k, knot-20k, knot-70k
    #[arg(default_values = ["builtin", "boxes", "knot-5k"])]
    scenes: Vec<String>,
    /// Rig files, or reference, reference-180hz, high-viewer, tent
    #[arg(long = "rig", value_name = "RIG", default_values = ["reference", "high-viewer", "tent"])]
    rigs: Vec<String>,
    /// Scale the largest extent of scenes from files to M metres
    #[arg(long, value_name = "M", value_parser = positive, allow_negative_numbers = true, default_value = "0.1")]
    fit_m: f64,
    /// Fewer methods, smaller pictures, fewer runs: within two minutes for three scenes and three rigs
    #[arg(long)]
    quick: bool,
    /// The folder to write; an earlier result of praxi is replaced
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

pub(super) fn run(args: &Args) -> Result<(), Failure> {
    let rigs: Vec<Rig> = args.rigs.iter().map(|name| rigs::find(name)).collect::<Result<_, _>>()?;
    let scenes: Vec<(String, ShadedScene)> =
        args.scenes.iter().map(|name| load_fitted(name, args.fit_m)).collect::<Result<_, _>>()?;
    let folder = Folder::begin(&args.out)?;
    let jobs: Vec<Job<'_>> =
        scenes.iter().flat_map(|(name, scene)| rigs.iter().map(move |rig| Job { name, scene, rig })).collect();
    let effort = if args.quick { Effort::Quick } else { Effort::Full };
    let style =
        ProgressStyle::with_template("{msg:<34.34} {bar:24} {percent:>3} % {eta:>4}").expect("a fixed template");
    let bar = ProgressBar::new(1000).with_style(style.progress_chars("█▌ "));
    let chart = chart::run(&jobs, effort, &mut |what, part| {
        bar.set_message(what.to_string());
        bar.set_position((part * 1000.0) as u64);
    })?;
    bar.finish_and_clear();
    folder.write("chart.json", format!("{:#}\n", serde_json::to_value(&chart).expect("figures")).as_bytes())?;
    folder.write("chart.csv", chart::csv(&chart).as_bytes())?;
    folder.write("chart.svg", chart::draw::svg(&chart).as_bytes())?;
    folder.write("chart.png", &chart::draw::png(&chart))?;
    let summary = chart::summary::summary(&chart);
    folder.write("summary.md", summary.as_bytes())?;
    folder.finish()?;
    report(args, &chart, &summary);
    Ok(())
}

fn report(args: &Args, chart: &Chart, summary: &str) {
    if args.json {
        say_json(&serde_json::to_value(chart).expect("figures"));
        return;
    }
    let advice =
        summary.split("## What to use when").nth(1).and_then(|rest| rest.split("\n## ").next()).unwrap_or_default();
    say(format!("{}: {} methods on {} scenes and rigs", args.out.display(), chart.optics.len(), chart.jobs()));
    say(advice.trim().replace("**", ""));
}
