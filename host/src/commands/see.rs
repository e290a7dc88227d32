//! `praxi see`: what an eye sees of a rendered turn.

use super::args::{PictureArgs, ViewArgs, progress};
use super::{Failure, say, say_json, warn};
use crate::output::{self, File};
use crate::rendered;
use crate::seen::{Brightness, View, see};
use clap::value_parser;
use glam::DVec3;
use serde_json::json;
use std::path::{Path, PathBuf};

/// Show what an eye sees of a rendered turn, by the forward model of mirror and diffuser
#[derive(clap::Args)]
#[command(after_help = "Example: praxi see turn --from 0.01,0.35,0.9 --out eye.png")]
pub(super) struct Args {
    /// The folder that `praxi render` wrote
    dir: PathBuf,
    #[command(flatten)]
    view: ViewArgs,
    /// Mirror angles at which each slice is taken: motion blur
    #[arg(long, value_name = "N", value_parser = value_parser!(u32).range(1..=64), default_value = "4")]
    exposures: u32,
    /// Leave the light as it falls, not divided by the sum of the diffuser's weights
    #[arg(long)]
    physical: bool,
    /// Two pictures, NAME-left and NAME-right, for two eyes this far apart
    #[arg(long, value_name = "M", value_parser = super::args::positive, allow_negative_numbers = true)]
    eyes: Option<f64>,
    #[command(flatten)]
    picture: PictureArgs,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

pub(super) fn run(args: &Args) -> Result<(), Failure> {
    let view = args.view.view()?;
    let eyes = match args.eyes {
        None => vec![(args.picture.out.clone(), view)],
        Some(distance) => {
            let aside = aside(&view) * distance / 2.0;
            vec![
                (named(&args.picture.out, "-left"), View { from: view.from - aside, ..view }),
                (named(&args.picture.out, "-right"), View { from: view.from + aside, ..view }),
            ]
        }
    };
    if let Some((path, _)) = eyes.iter().find(|(path, _)| is_part_of(path, &args.dir)) {
        return Err(Failure(format!("{}: is a picture of the turn itself: name another", path.display())));
    }
    let files: Vec<_> = eyes.iter().map(|(path, _)| File::begin(path)).collect::<Result<_, _>>()?;
    let (rotation, turn) = rendered::load(&args.dir)?;
    let brightness = if args.physical { Brightness::Physical } else { Brightness::Divided };
    let bar = progress("looking", eyes.iter().map(|(_, view)| u64::from(view.parts())).sum());
    let mut answers = Vec::new();
    let (mut pictures, mut lines, mut warnings) = (Vec::new(), Vec::new(), Vec::new());
    for (path, view) in &eyes {
        let picture = see(&rotation.rig, &turn, view, args.exposures, brightness, &|| bar.inc(1));
        let reached = picture.known.iter().filter(|known| **known).count() as f64 / picture.known.len() as f64;
        let clipped = picture.clipped_share();
        if clipped > 0.0 {
            let share = clipped * 100.0;
            warnings
                .push(format!("{}: {share:.1} % of the pixels are brighter than white, and clipped", path.display()));
        }
        let mean = picture.luminance().iter().sum::<f32>() / (picture.known.len() as f32 * reached.max(1e-9) as f32);
        answers.push(json!({
            "out": path, "from_m": view.from.to_array(), "reached_share": reached, "mean_luminance": mean,
        }));
        pictures.push(args.picture.png(&picture));
        lines.push(format!("{}: {:.1} % reached, mean luminance {mean:.4}", path.display(), reached * 100.0));
        if reached == 0.0 {
            warnings.push(format!("{}: no slice reaches any pixel from {}", path.display(), view.from));
        }
    }
    bar.finish_and_clear();
    warnings.iter().for_each(warn);
    for (file, picture) in files.into_iter().zip(&pictures) {
        file.finish(picture)?;
    }
    if args.json {
        say_json(&json!({ "dir": args.dir, "eyes": answers }));
    } else {
        lines.iter().for_each(say);
    }
    Ok(())
}

/// Whether `path` is one of the files of the turn in `folder`.
fn is_part_of(path: &Path, folder: &Path) -> bool {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    if !output::is_ours(&name) {
        return false;
    }
    let parent = path.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."));
    parent.canonicalize().ok().zip(folder.canonicalize().ok()).is_some_and(|(parent, folder)| parent == folder)
}

/// To the right of somebody who looks along `view`, level.
fn aside(view: &View) -> DVec3 {
    (view.look_at - view.from).cross(DVec3::Y).try_normalize().unwrap_or(DVec3::X)
}

/// `path` with `suffix` behind its stem.
fn named(path: &Path, suffix: &str) -> PathBuf {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    let extension = path.extension().map(|extension| format!(".{}", extension.to_string_lossy())).unwrap_or_default();
    path.with_file_name(format!("{stem}{suffix}{extension}"))
}
