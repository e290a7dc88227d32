//! `praxi scene`: what a model file holds.

use super::{Failure, say, say_json, warn};
use crate::daemon::library::Content;
use crate::scene::Animated;
use std::path::PathBuf;

/// Say what a model file holds: triangles, clips, and what could not be used
#[derive(clap::Args)]
#[command(after_help = "Example: praxi scene Fox.glb")]
pub(super) struct Args {
    /// A .gltf, .glb, .obj or .ply file, or a built-in scene
    scene: PathBuf,
    /// Open no other files, also where this one, which must be glTF, names some
    #[arg(long)]
    alone: bool,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

pub(super) fn run(args: &Args) -> Result<(), Failure> {
    let scene = if args.alone { Animated::load_alone(&args.scene)? } else { Animated::load(&args.scene)? };
    let content = Content::of(&scene);
    if args.json {
        say_json(&serde_json::to_value(&content)?);
        return Ok(());
    }
    content.notes.iter().for_each(warn);
    let (low, high) = scene.at_rest().bounds();
    let size = high - low;
    say(format!("triangles  {}", content.triangles));
    say(format!("size       {:.4} x {:.4} x {:.4} m: width, height, depth", size.x, size.y, size.z));
    let clips = if content.clips.is_empty() { "none".into() } else { content.clips.join(", ") };
    say(super::hanging("clips     ", &clips));
    Ok(())
}
