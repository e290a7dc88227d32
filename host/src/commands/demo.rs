//! `praxi demo`: the whole way of the data, on a simulated rig.

mod pictures;
mod show;

use super::args::{DEFAULT_BUDGET_PX, RendererArgs, filling_extent_m, progress};
use super::{Failure, say, say_json, sim, warn};
use crate::output::Folder;
use crate::render::Renderer;
use crate::render::plan::Plan;
use crate::render::plan::choose::{Budget, Fixed, choose};
use crate::render::turn::Turn;
use crate::rigs;
use crate::scene::{BUILTIN, Scene, Shading, shade};
use pictures::Places;
use protocol::rig::Rig;
use serde_json::{Value, json};
use show::Show;
use std::path::PathBuf;

/// Render a scene, stream it to a simulated rig that spins up and locks, and show what eyes around it see
#[derive(clap::Args)]
#[command(after_help = "Example: praxi demo model.glb --out my-demo")]
pub(super) struct Args {
    /// A .gltf, .glb, .obj or .ply file, scaled to fill the display, or the built-in scene
    #[arg(default_value = BUILTIN)]
    scene: String,
    /// A rig file, or reference, reference-180hz, high-viewer, tent
    #[arg(long, default_value = "reference")]
    rig: String,
    /// Centre the scene and scale its largest extent to M metres, in place of filling the display
    #[arg(long, value_name = "M", value_parser = super::args::positive, allow_negative_numbers = true)]
    fit_m: Option<f64>,
    /// The folder to write; an earlier result of praxi is replaced
    #[arg(long, value_name = "DIR", default_value = "praxi-demo")]
    out: PathBuf,
    #[command(flatten)]
    renderer: RendererArgs,
    /// All noise of motor, sensors and projector follows from it
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

/// By how much the scene is turned in each of the turns that are streamed: it swings in and comes to rest.
const SWING_DEG: [f32; 3] = [-4.0, -1.5, 0.0];

pub(super) fn run(args: &Args) -> Result<(), Failure> {
    let rig = rigs::find(&args.rig)?;
    let renderer = args.renderer.open()?;
    let scene = load(args, &rig)?;
    let folder = Folder::begin(&args.out)?;
    let lit = shade(&scene, Shading::Lambert, false);
    let plan = choose(&lit, &rig, Fixed::default(), Budget::Error(DEFAULT_BUDGET_PX))?.chosen.plan;
    let turns = render(renderer.as_ref(), &scene, &rig, &plan)?;
    let show = show::run(&rig, &turns, plan.halftone, args.seed)?;
    let places = Places::new(&rig);
    let seen = pictures::write(&folder, &rig, &lit, &show, &turns[turns.len() - 1], &places)?;
    let report = report(args, &rig, &scene, &plan, &show, &seen);
    folder.write("report.json", format!("{report:#}\n").as_bytes())?;
    folder.finish()?;
    if args.json {
        say_json(&report);
    } else {
        say(table(args, &show, &seen));
    }
    if show.statistics.verdict.is_clean() {
        return Ok(());
    }
    let first = show.statistics.verdict.first.as_deref().unwrap_or("a checker failed");
    let seed = args.seed;
    Err(Failure(format!("{first}; repeat with: praxi demo {} --rig {} --seed {seed}", args.scene, args.rig)))
}

/// The scene, at the size asked for, or filling the display volume of `rig`.
fn load(args: &Args, rig: &Rig) -> Result<Scene, Failure> {
    let mut scene = Scene::load(&args.scene)?;
    for note in &scene.notes {
        warn(format!("{}: {note}", args.scene));
    }
    let extent_m =
        args.fit_m.map_or_else(|| filling_extent_m(&args.scene, &scene, rig), |extent| Ok(Some(extent as f32)))?;
    extent_m.into_iter().for_each(|extent_m| scene.fit(extent_m));
    Ok(scene)
}

/// The turns that are streamed.
fn render(renderer: &dyn Renderer, scene: &Scene, rig: &Rig, plan: &Plan) -> Result<Vec<Turn>, Failure> {
    let bar = progress("rendering slices", u64::from(rig.rotation.slices) * SWING_DEG.len() as u64);
    let mut turns = Vec::new();
    for degrees in SWING_DEG {
        let lit = shade(&scene.turned(degrees), Shading::Lambert, false);
        turns.push(renderer.render_turn(&lit, rig, plan, &|| bar.inc(1))?);
    }
    bar.finish_and_clear();
    Ok(turns)
}

fn report(args: &Args, rig: &Rig, scene: &Scene, plan: &Plan, show: &Show, seen: &[pictures::Seen]) -> Value {
    json!({
        "program": "praxi", "version": env!("CARGO_PKG_VERSION"), "seed": args.seed,
        "scene": { "source": args.scene, "triangles": scene.triangles.len(), "radius_m": scene.radius() },
        "rig": rig.name, "plan": plan,
        "eyes": seen, "lock": sim::as_json(&show.statistics),
        "stream": {
            "turns": show.stream.turns, "bytes_raw": show.stream.bytes_raw, "bytes_on_wire": show.stream.bytes_on_wire,
            "packets": show.stream.packets, "retries": show.stream.retries,
        },
    })
}

fn table(args: &Args, show: &Show, seen: &[pictures::Seen]) -> String {
    let statistics = &show.statistics;
    let start = statistics.recoveries.first().and_then(|start| Some((start.settled_s?, start.ratio()?)));
    let psnr: Vec<_> = seen.iter().map(|seen| format!("{:.1}", seen.likeness.psnr_db)).collect();
    let places: Vec<_> = seen.iter().map(|seen| format!("{:.0}°", seen.azimuth_deg)).collect();
    let megabytes = |bytes: u64| bytes as f64 / 1e6;
    let rows = [
        ("eye against pinhole", format!("{} dB PSNR from {}", psnr.join(", "), places.join(", "))),
        (
            "time to lock",
            start
                .map_or("none".into(), |(time, ratio)| format!("{time:.3} s, {ratio:.2} x the torque-limited spin-up")),
        ),
        (
            "phase error",
            format!(
                "{:.4} RMS, {:.4} peak slices ({:.2}, {:.2} us)",
                statistics.rms_slices, statistics.peak_slices, statistics.rms_us, statistics.peak_us
            ),
        ),
        ("planes", format!("{} shown, {} misplaced", statistics.verdict.lit, statistics.verdict.misplaced)),
        (
            "turns streamed",
            format!(
                "{}: {:.1} MB of planes in {:.1} MB on the wire",
                show.stream.turns,
                megabytes(show.stream.bytes_raw),
                megabytes(show.stream.bytes_on_wire)
            ),
        ),
        ("written", format!("{}/: report.json and {} pictures", args.out.display(), pictures::NAMES.len())),
    ];
    rows.map(|(name, value)| format!("{name:<19} {value}")).join("\n")
}
