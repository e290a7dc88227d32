//! `praxi truth`: what a pinhole sees of the scene itself.

use super::args::{PictureArgs, SceneArgs, ViewArgs, progress};
use super::{Failure, say, say_json};
use crate::output::File;
use crate::render::truth::Caster;
use serde_json::json;

/// Render what a pinhole camera sees of the scene itself: the picture that `see` is compared with
#[derive(clap::Args)]
#[command(after_help = "Example: praxi truth builtin --from 0.01,0.35,0.9 --out truth.png")]
pub(super) struct Args {
    #[command(flatten)]
    scene: SceneArgs,
    #[command(flatten)]
    view: ViewArgs,
    #[command(flatten)]
    picture: PictureArgs,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

pub(super) fn run(args: &Args) -> Result<(), Failure> {
    let pinhole = args.view.pinhole()?;
    let (_, shaded) = args.scene.load()?;
    let file = File::begin(&args.picture.out)?;
    let bar = progress("casting rays", pinhole.pixels.into());
    let picture = Caster::new(&shaded).picture(&pinhole, &|| bar.inc(1));
    bar.finish_and_clear();
    file.finish(&args.picture.png(&picture))?;
    let mean = picture.luminance().iter().sum::<f32>() / picture.known.len() as f32;
    if args.json {
        say_json(&json!({ "out": args.picture.out, "from_m": pinhole.from.to_array(), "mean_luminance": mean }));
    } else {
        say(format!("{}: mean luminance {mean:.4}", args.picture.out.display()));
    }
    Ok(())
}
