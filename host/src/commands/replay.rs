//! `praxi replay`: a recording against the simulator.

use super::{Failure, hanging, say, say_json};
use crate::input;
use crate::recording::file::Entries;
use crate::render::gpu::GpuError;
use crate::render::pick::{Asked, pick};
use crate::replay::{Means, Replay, ReplayError, Report};
use indicatif::{ProgressBar, ProgressStyle};
use std::io::BufReader;
use std::path::PathBuf;

/// Tell a recording again against the simulator, and say what comes out otherwise
#[derive(clap::Args)]
#[command(after_help = "Examples: praxi replay problem.mcap\n          praxi replay problem.mcap --scene Fox.glb\n\n\
    What was rendered is rendered anew and compared by checksums, readings of trackers go through the filter again, and a simulated \
    controller gets the same orders at the same times. Exit code 1 where something comes out otherwise.")]
pub(super) struct Args {
    /// What praxi record wrote
    file: PathBuf,
    /// The file of the recorded scene, if it is not built in
    #[arg(long, value_name = "FILE")]
    scene: Option<PathBuf>,
    /// Who renders; pictures of another renderer than the recording's may differ in a few pixels
    #[arg(long, value_enum, default_value_t)]
    renderer: Asked,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

pub(super) fn run(args: &Args) -> Result<(), Failure> {
    let report = tell(args)?;
    if args.json {
        say_json(&serde_json::to_value(&report)?);
    } else {
        print(&report);
    }
    if !report.is_same() {
        // Not an error of the program: what it looked for is there.
        std::process::exit(1);
    }
    Ok(())
}

fn tell(args: &Args) -> Result<Report, Failure> {
    let named = |error: &dyn std::fmt::Display| Failure(format!("{}: {error}", args.file.display()));
    let (file, length) = input::open(&args.file).map_err(|error| named(&error))?;
    let bar = ProgressBar::new(length);
    if let Ok(style) = ProgressStyle::with_template("{bar:40} {percent} % of the recording, {eta} left") {
        bar.set_style(style);
    }
    let failed = |error: ReplayError| named(&error);
    let mut entries = Entries::new(bar.wrap_read(BufReader::new(file)));
    let first = entries.next().ok_or_else(|| failed(ReplayError::Empty))?.map_err(|error| named(&error))?;
    let folder = tempfile::tempdir()?;
    let notice = Box::new(|error: &GpuError| super::warn(error));
    let means = Means {
        renderer: pick(args.renderer, None, notice),
        scene: args.scene.clone(),
        folder: folder.path().join("scenes"),
    };
    let mut replay = Replay::begin(first, means).map_err(failed)?;
    for entry in entries.by_ref() {
        replay.tell(entry.map_err(|error| named(&error))?).map_err(failed)?;
    }
    bar.finish_and_clear();
    replay.end(entries.is_cut()).map_err(failed)
}

fn print(report: &Report) {
    let Report { rig, device, seconds, orders, sent: [sent, shown], lost, is_cut, .. } = report;
    say(format!("{seconds:.1} s of rig {rig}, recorded with controller {device}"));
    for (name, part) in report.parts() {
        let [count, same] = [part.count, part.count - part.different.min(part.count)];
        say(format!("{name:<12}{same} of {count} as recorded"));
        for difference in &part.first {
            say(hanging(&format!("  {:>8.2} s  ", difference.at_s), &difference.what));
        }
        if part.different > part.first.len() as u64 {
            say(format!("  and {} more", part.different - part.first.len() as u64));
        }
    }
    say(format!("{:<12}{orders} orders and {sent} turns given again; {shown} turns came on screen", "simulator"));
    if *lost > 0 {
        say(hanging(
            "",
            &format!("{lost} entries are missing: they were not taken in time, and what follows them may differ"),
        ));
    }
    if *is_cut {
        say("the recording ends in the middle: its last second may be missing");
    }
}
