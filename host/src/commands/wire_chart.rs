//! `praxi wire-chart`: how small planes become on the wire, and how fast.

mod draw;

use super::args::{RendererArgs, positive, progress};
use super::{Failure, say, say_json};
use crate::output::Folder;
use crate::render::plan::Halftone;
use crate::rigs;
use crate::scene::{Animated, Scene};
use crate::wire_chart::{Coding, Job, Motion, Point};
use protocol::rig::Rig;
use serde::Serialize;
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// What a link must carry for the display to show 20 fresh turns a second over USB high speed, which moves 40 MB/s.
const NEEDED: f64 = 10.6;

/// How small planes become on the wire and how fast, beside lz4 and zstd
#[derive(clap::Args)]
#[command(after_help = "Example: praxi wire-chart builtin bunny.obj --out wire-chart\n\n\
    Writes wire-chart.png, wire-chart.svg, wire-chart.json and summary.md. Each scene turns by so much from turn to turn, or goes on \
    with a clip of its file, from the clip's middle; the second of two turns is compressed plane by plane.")]
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
    /// Clips of the scenes that have one of that name
    #[arg(long = "clip", value_name = "NAME")]
    clips: Vec<String>,
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
    let cases = cases(args, &rig)?;
    let folder = Folder::begin(&args.out)?;
    let bar = progress("compressing turns", (cases.len() * args.halftones.len()) as u64);
    let mut points = Vec::new();
    for of_scene in cases.chunk_by(|one, next| one.0 == next.0) {
        for &halftone in &args.halftones {
            for (_, motion, scenes) in of_scene {
                points.extend(Job { scenes, motion, rig: &rig, halftone }.measure(renderer.as_ref())?);
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

/// A scene's place among the scenes, what happens with it, and how it is at two turns.
type Case = (usize, Motion, [Scene; 2]);

/// Every scene as it turns and moves.
fn cases(args: &Args, rig: &Rig) -> Result<Vec<Case>, Failure> {
    let scenes = args.scenes.iter().map(|path| load(path, args.fit_m)).collect::<Result<Vec<_>, _>>()?;
    let is_there = |name: &String| scenes.iter().flat_map(Animated::clips).any(|clip| clip.name == *name);
    if let Some(name) = args.clips.iter().find(|name| !is_there(name)) {
        let names: Vec<&str> = scenes.iter().flat_map(Animated::clips).map(|clip| clip.name.as_str()).collect();
        let allowed = if names.is_empty() { "none: no scene has a clip".to_owned() } else { names.join(", ") };
        return Err(Failure(format!("--clip {name}: no scene has a clip of this name, allowed are {allowed}")));
    }
    let mut cases = Vec::new();
    for (place, scene) in scenes.iter().enumerate() {
        let still = scene.at_rest();
        let turned = |&degrees: &f64| {
            (place, Motion::Degrees(degrees), [0.0, degrees].map(|degrees| still.turned(degrees as f32)))
        };
        cases.extend(args.degrees.iter().map(turned));
        for (index, clip) in scene.clips().iter().enumerate().filter(|(_, clip)| args.clips.contains(&clip.name)) {
            let middle = clip.seconds / 2.0;
            let moments = [scene.at(index, middle)?, scene.at(index, middle + 1.0 / rig.turns_per_second())?];
            cases.push((place, Motion::Clip(clip.name.clone()), moments));
        }
    }
    Ok(cases)
}

fn load(path: &str, fit_m: f64) -> Result<Animated, Failure> {
    let mut scene = Animated::load(path)?;
    if Path::new(path).extension().is_some() {
        scene.fit(fit_m as f32)?;
    }
    Ok(scene)
}

/// The points of one scene, halftone and motion: those of all codings, in their order.
fn by_case(points: &[Point]) -> impl Iterator<Item = &[Point]> {
    points.chunks(Coding::ALL.len())
}

/// Fits a terminal of 80 columns.
fn summary(chart: &WireChart) -> String {
    let mut text = format!(
        "# Planes on the wire\n\nRig {}. Bytes of planes over bytes on the wire; 20 turns a second over\n\
         USB high speed need {NEEDED}.\n\n\
         | scene     | halftone            | motion |  wire | runs |  lz4 | zstd |  XOR |\n\
         |-----------|---------------------|-------:|------:|-----:|-----:|-----:|-----:|\n",
        chart.rig
    );
    for case in by_case(&chart.points) {
        let Some(first) = case.first() else { continue };
        let Point { scene, halftone, motion, .. } = first;
        let digits = |ratio: f64| if ratio < 100.0 { 1 } else { 0 };
        let ratio = |point: &Point| format!(" {:>4.*} |", digits(point.ratio), point.ratio);
        let ratios: String = case[1..].iter().map(ratio).collect();
        let halftone = halftone.to_string();
        let motion = motion.to_string();
        let _ = writeln!(text, "| {scene:<9.9} | {halftone:<19} | {motion:>6.6} | {:>5.1} |{ratios}", first.ratio);
    }
    text += "\nMotion: what happens from turn to turn. Wire: the wire's own coding; runs: its\n\
             runs of bytes; zstd at level 1; XOR: zstd of the difference to the turn before.\n";
    text += &too_large(&chart.points);
    text += "\nSpeed, MB of planes a second of one core's time, over all of these:\n\n\
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

/// At which rate the wire can keep up where it cannot at 20 turns a second.
fn too_large(points: &[Point]) -> String {
    let slow: Vec<&Point> =
        points.iter().filter(|point| point.coding == Coding::Wire && point.ratio < NEEDED).collect();
    if slow.is_empty() {
        return "\nThe wire carries 20 turns a second of each.\n".to_owned();
    }
    let mut text = String::from("\nThe wire carries fewer than 20 turns a second of:\n\n");
    for point in slow {
        let Point { scene, halftone, motion, turns_a_second, .. } = point;
        let _ = writeln!(text, "- {scene:.20}, {halftone}, {motion}: {turns_a_second:.1}");
    }
    text
}
