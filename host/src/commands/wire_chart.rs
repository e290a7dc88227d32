//! `praxi wire-chart`: how small planes become on the wire, and how fast.

mod draw;

use super::args::{RendererArgs, positive, progress};
use super::{Failure, say, say_json};
use crate::output::Folder;
use crate::render::plan::Halftone;
use crate::rigs;
use crate::scene::Scene;
use crate::wire_chart::{Coding, Job, Point};
use serde::Serialize;
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// What a link must carry for the display to show 20 fresh turns a second over USB high speed, which moves 40 MB/s.
const NEEDED: f64 = 10.6;

/// How small planes become on the wire and how fast, beside lz4 and zstd
#[derive(clap::Args)]
#[command(after_help = "Example: praxi wire-chart builtin bunny.obj --out wire-chart\n\n\
    Writes wire-chart.png, wire-chart.svg, wire-chart.json and summary.md. Each scene turns by so much from turn to turn; \
    the second of two turns is compressed plane by plane.")]
pub(super) struct Args {
    /// Scenes as for render
    #[arg(default_values = ["builtin", "knot-5k"])]
    scenes: Vec<String>,
    /// A rig file, or reference, reference-180hz, high-viewer, tent
    #[arg(long, default_value = "reference")]
    rig: String,
    /// Scale the largest extent of scenes from files to M metres
    #[arg(long, value_name = "M", value_parser = positive, allow_negative_numbers = true, default_value = "0.1")]
    fit_m: f64,
    /// Halftones
    #[arg(long = "halftone", value_enum, default_values = ["blue-noise", "floyd-steinberg", "optimised-diffusion"])]
    halftones: Vec<Halftone>,
    /// By how much the scenes turn from turn to turn, degrees
    #[arg(long = "degrees", value_name = "D", allow_negative_numbers = true, default_values = ["0", "2", "7"])]
    degrees: Vec<f64>,
    #[command(flatten)]
    renderer: RendererArgs,
    /// The folder to write; an earlier result of praxi is replaced
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

/// All that was found.
#[derive(Serialize)]
struct WireChart {
    program: &'static str,
    version: &'static str,
    rig: String,
    points: Vec<Point>,
}

pub(super) fn run(args: &Args) -> Result<(), Failure> {
    if let Some(grey) = args.halftones.iter().find(|halftone| halftone.binary().is_none()) {
        return Err(Failure(format!(
            "--halftone {grey}: what a turn is made of by itself is allowed, as blue-noise is"
        )));
    }
    if let Some(degrees) = args.degrees.iter().find(|degrees| !degrees.is_finite()) {
        return Err(Failure(format!("--degrees {degrees}: a finite number is allowed")));
    }
    let rig = rigs::find(&args.rig)?;
    let renderer = args.renderer.open()?;
    let scenes = args.scenes.iter().map(|path| load(path, args.fit_m)).collect::<Result<Vec<_>, _>>()?;
    let folder = Folder::begin(&args.out)?;
    let bar = progress("compressing turns", (scenes.len() * args.halftones.len() * args.degrees.len()) as u64);
    let mut points = Vec::new();
    for scene in &scenes {
        for &halftone in &args.halftones {
            for &degrees in &args.degrees {
                points.extend(Job { scene, rig: &rig, halftone, degrees }.measure(renderer.as_ref())?);
                bar.inc(1);
            }
        }
    }
    bar.finish_and_clear();
    let chart = WireChart { program: "praxi", version: env!("CARGO_PKG_VERSION"), rig: rig.name.clone(), points };
    let value = serde_json::to_value(&chart).expect("figures");
    folder.write("wire-chart.json", format!("{value:#}\n").as_bytes())?;
    folder.write("wire-chart.svg", draw::svg(&chart).as_bytes())?;
    folder.write("wire-chart.png", &draw::png(&chart))?;
    let summary = summary(&chart);
    folder.write("summary.md", summary.as_bytes())?;
    folder.finish()?;
    if args.json {
        say_json(&value);
    } else {
        say(summary);
    }
    Ok(())
}

fn load(path: &str, fit_m: f64) -> Result<Scene, Failure> {
    let mut scene = Scene::load(path)?;
    if Path::new(path).extension().is_some() {
        scene.fit(fit_m as f32);
    }
    Ok(scene)
}

/// The points of one scene, halftone and motion: those of all codings, in their order.
fn cases(points: &[Point]) -> impl Iterator<Item = &[Point]> {
    points.chunks(Coding::ALL.len())
}

/// Fits a terminal of 80 columns.
fn summary(chart: &WireChart) -> String {
    let mut text = format!(
        "# Planes on the wire\n\nRig {}. Bytes of planes over bytes on the wire; 20 turns a second over\n\
         USB high speed need {NEEDED}.\n\n\
         | scene       | halftone            |   ° |  wire | runs |  lz4 | zstd |  XOR |\n\
         |-------------|---------------------|----:|------:|-----:|-----:|-----:|-----:|\n",
        chart.rig
    );
    for case in cases(&chart.points) {
        let Some(first) = case.first() else { continue };
        let Point { scene, halftone, degrees, .. } = first;
        let ratios: String = case[1..].iter().map(|point| format!(" {:>4.1} |", point.ratio)).collect();
        let halftone = halftone.to_string();
        let _ = writeln!(text, "| {scene:<11.11} | {halftone:<19} | {degrees:>3} | {:>5.1} |{ratios}", first.ratio);
    }
    text += "\n°: degrees from turn to turn. Wire: the wire's own coding; runs: its runs of\n\
             bytes; zstd at level 1; XOR: zstd of the difference to the turn before.\n\nSpeed, MB of planes a second of one core's time, over all of these:\n\n\
             |          | wire | runs |  lz4 | zstd |  XOR |\n\
             |----------|-----:|-----:|-----:|-----:|-----:|\n";
    let speed = |of: fn(&Point) -> f64| -> String {
        let mean = |coding: Coding| {
            let times = chart.points.iter().filter(|point| point.coding == coding).map(|point| 1.0 / of(point));
            times.clone().count() as f64 / times.sum::<f64>()
        };
        Coding::ALL.map(|coding| format!(" {:>4.0} |", mean(coding))).concat()
    };
    let _ = writeln!(text, "| compress |{}", speed(|point| point.compress_mb_s));
    let _ = writeln!(text, "| expand   |{}", speed(|point| point.expand_mb_s));
    text
}
