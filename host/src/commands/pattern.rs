//! `praxi pattern` and `praxi verify-markers`: pictures to align a projector by, and the proof of which plane was lit when.

use super::args::progress;
use super::{Failure, say, say_json};
use crate::input::{self, PICTURE_BYTES_MAX};
use crate::output::Folder;
use crate::pattern::block::Block;
use crate::pattern::sequence::Sequence;
use crate::pattern::trace::{Proof, prove, read_csv};
use crate::pattern::{Pattern, draw};
use crate::render::plan::{Halftone, Plan};
use crate::rendered::{Method, Rotation, SceneNote, write};
use crate::rigs;
use glam::DVec2;
use serde_json::json;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Write a turn of a test pattern, as praxi render writes one of a scene
#[derive(clap::Args)]
#[command(
    after_help = "Example: praxi pattern markers --rig reference --out markers\n\nOn a display: praxi run, mode pattern."
)]
pub(super) struct Args {
    /// What is shown
    #[arg(value_enum)]
    pattern: Pattern,
    /// A rig file, or reference, reference-180hz, high-viewer, tent
    #[arg(long)]
    rig: String,
    /// The folder to write
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

pub(super) fn run(args: &Args) -> Result<(), Failure> {
    let rig = rigs::find(&args.rig)?;
    let folder = Folder::begin(&args.out)?;
    let turn = draw(&rig, args.pattern)?;
    let name = serde_json::to_value(args.pattern)?.as_str().unwrap_or_default().to_string();
    let note = SceneNote { source: format!("pattern {name}"), triangles: 0, fit_m: None };
    // A pattern has bits of its own: the plan says only that there are bits.
    let plan = Plan { halftone: Halftone::BlueNoise, ..Plan::default() };
    let rotation = Rotation::new(&rig, note, Method { plan, shading: "unlit".into(), smooth: false });
    let bar = progress("writing pictures", rotation.frames.into());
    write(folder.path(), &turn, &rotation, &|| bar.inc(1))?;
    bar.finish_and_clear();
    folder.finish()?;
    if args.json {
        say_json(
            &json!({ "out": args.out, "rig": rig.name, "pattern": name, "slices": rotation.slices, "frames": rotation.frames }),
        );
    } else {
        say(format!("{}: {} frames of {} slices", args.out.display(), rotation.frames, rig.rotation.planes_per_frame));
    }
    Ok(())
}

/// Check by a recording of the pattern markers which planes were lit when: order, gaps, jitter
#[derive(clap::Args)]
#[command(after_help = "Examples: praxi verify-markers trace.csv --rig reference\n          \
    praxi verify-markers frames --rig reference --corners 40,30,150,50,140,170,30,120\n\n\
    Exit code 1 where something is not as it should be.")]
pub(super) struct VerifyArgs {
    /// A photodiode's trace, lines of seconds and level with at least 4 a plane; or a folder of a camera's pictures, PNG, in the order of
    /// their names
    recording: PathBuf,
    /// A rig file, or reference, reference-180hz, high-viewer, tent
    #[arg(long)]
    rig: String,
    /// Where the block of cells with its dark border stands in a camera's pictures: x,y in pixels of the corners upper left, upper right,
    /// lower right, lower left
    #[arg(long, value_name = "X,Y,X,Y,X,Y,X,Y", value_parser = corners)]
    corners: Option<[DVec2; 4]>,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

fn corners(text: &str) -> Result<[DVec2; 4], String> {
    let numbers: Vec<f64> = text.split(',').filter_map(|part| part.trim().parse().ok()).collect();
    let corners: Vec<_> = numbers.chunks_exact(2).map(DVec2::from_slice).filter(|corner| corner.is_finite()).collect();
    <[DVec2; 4]>::try_from(corners).map_err(|_| "must be eight numbers with commas".into())
}

pub(super) fn verify(args: &VerifyArgs) -> Result<(), Failure> {
    let rig = rigs::find(&args.rig)?;
    let slices = rig.rotation.slices;
    let is_right = match (args.recording.is_dir(), args.corners) {
        (true, Some(corners)) => verify_pictures(args, corners, slices)?,
        (true, None) => {
            return Err(Failure(format!("{}: a folder of pictures needs --corners", args.recording.display())));
        }
        (false, Some(_)) => return Err(Failure("--corners belongs to a folder of pictures".into())),
        (false, None) => {
            let plane_s = 1.0 / (rig.rotation.refresh_hz * f64::from(rig.rotation.planes_per_frame));
            verify_trace(args, slices, plane_s)?
        }
    };
    if !is_right {
        // Not an error of the program: what it looked for is there.
        std::process::exit(1);
    }
    Ok(())
}

fn verify_trace(args: &VerifyArgs, slices: u32, plane_s: f64) -> Result<bool, Failure> {
    let named = |error: &dyn std::fmt::Display| Failure(format!("{}: {error}", args.recording.display()));
    let text = input::read(&args.recording, input::RECORDING_BYTES_MAX).map_err(|error| named(&error))?;
    let samples = read_csv(&String::from_utf8_lossy(&text)).map_err(|error| named(&error))?;
    let proof = prove(&samples, &Sequence::new(slices), slices, plane_s).map_err(|error| named(&error))?;
    let Proof { planes, first_slice, plane_s, jitter_s, findings } = &proof;
    if args.json {
        say_json(&serde_json::to_value(&proof)?);
    } else {
        say(format!(
            "{planes} planes from slice {first_slice} on, {:.3} us each, edges within {:.3} us RMS",
            plane_s * 1e6,
            jitter_s * 1e6
        ));
        findings.iter().for_each(say);
        let verdict = if findings.is_empty() {
            "every plane is in its place".into()
        } else {
            format!("{} findings", findings.len())
        };
        say(verdict);
    }
    Ok(findings.is_empty())
}

fn verify_pictures(args: &VerifyArgs, corners: [DVec2; 4], slices: u32) -> Result<bool, Failure> {
    let named = |path: &Path, error: &dyn std::fmt::Display| Failure(format!("{}: {error}", path.display()));
    let entries = std::fs::read_dir(&args.recording).map_err(|error| named(&args.recording, &error))?;
    let mut paths: Vec<_> = entries.filter_map(|entry| entry.ok().map(|entry| entry.path())).collect();
    paths.retain(|path| path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("png")));
    paths.sort();
    if paths.len() < 3 {
        return Err(named(&args.recording, &"fewer than 3 pictures, PNG: a recording has more"));
    }
    let bar = progress("reading pictures", paths.len() as u64);
    let mut seen = Vec::new();
    for path in &paths {
        let bytes = input::read(path, PICTURE_BYTES_MAX).map_err(|error| named(path, &error))?;
        let picture = image::load_from_memory(&bytes).map_err(|error| named(path, &error))?.into_luma16();
        let light = |at: DVec2| {
            let last = DVec2::new(f64::from(picture.width() - 1), f64::from(picture.height() - 1));
            let pixel = at.clamp(DVec2::ZERO, last).as_uvec2();
            f64::from(picture.get_pixel(pixel.x, pixel.y)[0]) / 65_535.0
        };
        seen.push(Block::read(light, corners).and_then(|block| block.slice()).filter(|slice| *slice < slices));
        bar.inc(1);
    }
    bar.finish_and_clear();
    let steps: Vec<_> = seen.windows(2).map(|pair| Some((pair[1]? + slices - pair[0]?) % slices)).collect();
    let usual = usual(&steps)
        .ok_or_else(|| named(&args.recording, &"no two pictures in a row show a block: are --corners right?"))?;
    let is_usual = |step: u32| step == usual || step == (usual + 1) % slices;
    let wrong: Vec<_> = (1..).zip(&steps).filter(|(_, step)| !step.is_some_and(is_usual)).map(|(at, _)| at).collect();
    let unreadable = seen.iter().filter(|slice| slice.is_none()).count();
    if args.json {
        say_json(
            &json!({ "pictures": paths.len(), "unreadable": unreadable, "slices_a_picture": usual, "slices": seen,
            "wrong_pictures": wrong }),
        );
    } else {
        say(format!(
            "{} pictures, {unreadable} without a block that can be read, {usual} or {} slices apart",
            paths.len(),
            usual + 1
        ));
        for at in &wrong {
            let slice = |slice: Option<u32>| slice.map_or("none".into(), |slice| slice.to_string());
            say(format!("{}: slice {} after slice {}", paths[*at].display(), slice(seen[*at]), slice(seen[*at - 1])));
        }
    }
    Ok(wrong.is_empty())
}

/// The smaller of the two neighbouring steps that most pictures are apart: a camera whose rate is no multiple of the planes' has both.
fn usual(steps: &[Option<u32>]) -> Option<u32> {
    let mut counts = BTreeMap::new();
    steps.iter().flatten().for_each(|step| *counts.entry(*step).or_insert(0_usize) += 1);
    let both = |step: u32| counts.get(&step).unwrap_or(&0) + counts.get(&(step + 1)).unwrap_or(&0);
    counts
        .keys()
        .flat_map(|step| [*step, step.saturating_sub(1)])
        .max_by_key(|step| (both(*step), counts.get(step).copied()))
}
