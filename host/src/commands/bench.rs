//! `praxi bench`: how long renderers take.

use super::args::{DEFAULT_BUDGET_PX, budget, load_fitted, positive, progress};
use super::{Failure, say, say_json};
use crate::bench::rounds::{Effort, ROUNDS_MAX, ROUNDS_MIN, render_once, run as measure};
use crate::bench::who::Who;
use crate::bench::{Case, Report, Row, Wish, cases, draw, table};
use crate::machine::peak_memory;
use crate::output::Folder;
use crate::render::Renderer;
use crate::render::gpu::{GpuRenderer, Way};
use crate::render::plan::cost::Work;
use crate::render::plan::{Halftone, Plan, Projection};
use crate::rigs;
use crate::scene::ShadedScene;
use indicatif::ProgressBar;
use std::cell::RefCell;
use std::path::PathBuf;
use std::process::{Command, Stdio};

/// Time renderers on scenes, in turns in random order: medians, ratios, memory, where the time goes
#[derive(clap::Args)]
#[command(
    after_help = "Example: praxi bench --scene knot-5k --seconds 20\n         praxi bench --slices-sweep --out bench"
)]
pub(super) struct Args {
    /// A .gltf, .glb, .obj or .ply file, builtin, boxes, knot-5k, knot-20k, knot-70k; as often as you like
    #[arg(long = "scene", value_name = "SCENE", default_values = ["knot-5k", "knot-20k", "knot-70k"])]
    scenes: Vec<String>,
    /// A rig file, or reference, reference-180hz, high-viewer, tent
    #[arg(long, default_value = "reference")]
    rig: String,
    /// Scale the largest extent of scenes from files to M metres
    #[arg(long, value_name = "M", value_parser = positive, allow_negative_numbers = true, default_value = "0.1")]
    fit_m: f64,
    /// Who renders [default: all that this machine has]
    #[arg(long = "renderer", value_name = "WHO", value_enum)]
    renderers: Vec<Who>,
    /// The GPU whose name contains NAME, in any case
    #[arg(long, value_name = "NAME")]
    adapter: Option<String>,
    /// How the diffuser's light is followed to its viewer
    #[arg(long = "projection", value_enum, default_values = ["planar", "cone-newton"])]
    projections: Vec<Projection>,
    /// How luminance becomes bits
    #[arg(long = "halftone", value_enum, default_values = ["blue-noise"])]
    halftones: Vec<Halftone>,
    /// Cut edges so that everything is drawn within E projector pixels of where it belongs
    #[arg(long, value_name = "E", value_parser = budget, allow_negative_numbers = true, default_value_t = DEFAULT_BUDGET_PX)]
    budget_px: f64,
    /// Measure about so long, in three rounds at least
    #[arg(long, value_name = "T", value_parser = seconds, allow_negative_numbers = true, default_value = "60")]
    seconds: f64,
    /// Measure so many rounds, however long they take
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=i64::from(ROUNDS_MAX)), conflicts_with = "seconds")]
    rounds: Option<u32>,
    /// Three rounds of the first scene by the first projection and halftone, without memory
    #[arg(long)]
    quick: bool,
    /// The first scene, projection and halftone with 48 to 1,152 slices a turn, too
    #[arg(long)]
    slices_sweep: bool,
    /// The seed of the order in which everything is measured
    #[arg(long, value_name = "N", default_value = "1")]
    seed: u64,
    /// Write bench.txt, bench.json, bench.svg and bench.png into a folder; an earlier result of praxi is replaced
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Print JSON
    #[arg(long)]
    json: bool,
    /// Render one turn of the first scene by the first renderer by this plan, and print the most memory that it took
    #[arg(long, value_name = "JSON", hide = true)]
    peak_of: Option<String>,
}

pub(super) fn run(args: &Args) -> Result<(), Failure> {
    if let Some(plan) = &args.peak_of {
        return say_peak(args, plan);
    }
    let rig = rigs::find(&args.rig)?;
    let first = |count: usize| if args.quick { count.min(1) } else { count };
    let scenes = load(args, first(args.scenes.len()))?;
    let (renderers, mut notes) = open(args)?;
    let whos: Vec<Who> = renderers.iter().map(|(who, _)| *who).collect();
    let folder = args.out.as_deref().map(Folder::begin).transpose()?;
    let bar = progress("planning", scenes.len() as u64);
    let wish = Wish {
        scenes: &scenes,
        rig: &rig,
        renderers: &whos,
        projections: &args.projections[..first(args.projections.len())],
        halftones: &args.halftones[..first(args.halftones.len())],
        budget_px: args.budget_px,
        sweep: args.slices_sweep,
    };
    let cases = cases(&wish, &|| bar.inc(1))?;
    bar.finish_and_clear();
    let effort = match (args.quick, args.rounds) {
        (_, Some(rounds)) => Effort::Rounds(rounds),
        (true, None) => Effort::Rounds(ROUNDS_MIN),
        (false, None) => Effort::Seconds(args.seconds),
    };
    let bars = Bars::default();
    let mut report = measure(&cases, &renderers, effort, args.seed, &|what, at, of| bars.show(what, at, of))?;
    report.budget_px = args.budget_px;
    report.adapters = adapters(args, &renderers);
    if !args.quick {
        add_memory(args, &mut report, &bars)?;
    }
    bars.clear();
    notes.append(&mut report.notes);
    report.notes = notes;
    show(args, &report, folder)
}

fn show(args: &Args, report: &Report, folder: Option<Folder>) -> Result<(), Failure> {
    let (text, json) = (table::text(report), serde_json::to_value(report)?);
    if let Some(folder) = folder {
        folder.write("bench.txt", text.as_bytes())?;
        folder.write("bench.json", format!("{json:#}\n").as_bytes())?;
        folder.write("bench.svg", draw::svg(report).as_bytes())?;
        folder.write("bench.png", &draw::png(report))?;
        folder.finish()?;
    }
    if args.json {
        say_json(&json);
    } else {
        say(text);
    }
    Ok(())
}

/// The first `count` scenes. Rows tell them apart by their names.
fn load(args: &Args, count: usize) -> Result<Vec<(String, ShadedScene)>, Failure> {
    let mut scenes: Vec<(String, ShadedScene)> = Vec::new();
    for path in &args.scenes[..count] {
        let scene = load_fitted(path, args.fit_m)?;
        if scenes.iter().any(|other| other.0 == scene.0) {
            return Err(Failure(format!(
                "--scene {path}: there is another scene {}, each must have its own name",
                scene.0
            )));
        }
        scenes.push(scene);
    }
    Ok(scenes)
}

type Renderers = Vec<(Who, Box<dyn Renderer>)>;

/// The renderers, and notes on those that are not here. One that was asked for by name must be.
fn open(args: &Args) -> Result<(Renderers, Vec<String>), Failure> {
    let (mut renderers, mut notes) = (Renderers::new(), Vec::new());
    let asked = !args.renderers.is_empty();
    let wanted = if asked { &args.renderers[..] } else { &Who::ALL[..] };
    if let Some(name) = args.adapter.as_ref().filter(|_| !wanted.iter().any(|who| who.is_gpu())) {
        return Err(Failure(format!("--adapter {name}: no GPU renders, --renderer must name one that does")));
    }
    for who in wanted {
        match who.open(args.adapter.as_deref()) {
            Ok(renderer) => renderers.push((*who, renderer)),
            Err(error) if asked || (who.is_gpu() && args.adapter.is_some()) => return Err(error.into()),
            Err(error) => notes.push(format!("{error}; left out")),
        }
    }
    Ok((renderers, notes))
}

/// The GPU that takes part.
fn adapters(args: &Args, renderers: &Renderers) -> Vec<String> {
    let is_used = renderers.iter().any(|(who, _)| who.is_gpu());
    let gpu = is_used.then(|| GpuRenderer::open(args.adapter.as_deref(), Some(Way::Slice)).ok()).flatten();
    gpu.iter().map(|gpu| gpu.adapter().to_string()).collect()
}

/// Sets the peak memory of each scene by each renderer, each in a process of its own, to the first row of both.
fn add_memory(args: &Args, report: &mut Report, bars: &Bars) -> Result<(), Failure> {
    let names: Vec<String> = report.scenes().into_iter().map(str::to_string).collect();
    let pairs: Vec<(usize, Who)> = (0..names.len()).flat_map(|scene| Who::ALL.map(|who| (scene, who))).collect();
    for (at, (scene, who)) in pairs.iter().enumerate() {
        let is_of_pair = |row: &&mut Row| row.scene == names[*scene] && row.who == *who;
        if let Some(row) = report.rows.iter_mut().find(is_of_pair) {
            row.peak_bytes = peak_of_child(args, &args.scenes[*scene], row)?;
        }
        bars.show("measuring memory", at as u64 + 1, pairs.len() as u64);
    }
    Ok(())
}

/// The most memory of a process that renders one turn of `row`; `None` where the system does not say it, or where the process fails.
fn peak_of_child(args: &Args, scene: &str, row: &Row) -> Result<Option<u64>, Failure> {
    let mut child = Command::new(std::env::current_exe()?);
    child.args(["bench", "--scene", scene, "--rig", &args.rig, "--fit-m", &args.fit_m.to_string()]);
    child.args(["--renderer", &row.who.to_string(), "--peak-of", &serde_json::to_string(&row.plan)?]);
    child.args(args.adapter.iter().flat_map(|name| ["--adapter", name]));
    let output = child.stderr(Stdio::null()).output()?;
    Ok(String::from_utf8_lossy(&output.stdout).trim().parse().ok())
}

/// What such a process does.
fn say_peak(args: &Args, plan: &str) -> Result<(), Failure> {
    let plan: Plan = serde_json::from_str(plan)?;
    let (scene_name, scene) = &load_fitted(&args.scenes[0], args.fit_m)?;
    let (renderers, _) = open(args)?;
    for (who, renderer) in &renderers {
        let rig = rigs::find(&args.rig)?;
        let case = Case { scene_name, scene, rig, plan, work: Work::default(), who: *who, is_of_sweep: false };
        render_once(&case, renderer.as_ref())?;
    }
    if let Some(peak) = peak_memory() {
        say(peak);
    }
    Ok(())
}

/// A bar for each of several things to do, one after the other.
#[derive(Default)]
struct Bars(RefCell<Option<(&'static str, ProgressBar)>>);

impl Bars {
    fn show(&self, what: &'static str, at: u64, of: u64) {
        let mut shown = self.0.borrow_mut();
        if shown.as_ref().is_none_or(|(name, _)| *name != what) {
            if let Some((_, bar)) = shown.take() {
                bar.finish_and_clear();
            }
            *shown = Some((what, progress(what, of)));
        }
        if let Some((_, bar)) = shown.as_ref() {
            bar.set_position(at);
        }
    }

    fn clear(&self) {
        if let Some((_, bar)) = self.0.take() {
            bar.finish_and_clear();
        }
    }
}

/// Seconds to measure.
fn seconds(text: &str) -> Result<f64, String> {
    let value: f64 = text.parse().map_err(|_| "must be a number of seconds".to_string())?;
    if (0.1..=86_400.0).contains(&value) { Ok(value) } else { Err("must be from 0.1 to 86400 seconds".into()) }
}
