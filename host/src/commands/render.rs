//! `praxi render`: one turn of a scene, as a folder.

use super::args::{PlanArgs, RendererArgs, RigArgs, SceneArgs, pixels, progress};
use super::{Failure, say, say_json};
use crate::output::Folder;
use crate::render::plan::{Halftone, Plan};
use crate::rendered::{Method, Rotation, SceneNote, write};
use serde_json::json;
use std::path::PathBuf;

/// Render one turn of a scene: 12 frames of 24 binary slices, or grey slices, and rotation.json
#[derive(clap::Args)]
#[command(after_help = "Example: praxi render builtin --rig reference --out turn")]
pub(super) struct Args {
    #[command(flatten)]
    scene: SceneArgs,
    #[command(flatten)]
    rig: RigArgs,
    /// The folder to write; an earlier result of praxi is replaced
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    #[command(flatten)]
    plan: PlanArgs,
    #[command(flatten)]
    renderer: RendererArgs,
    /// How luminance becomes bits
    #[arg(long, value_enum, default_value = "optimised-diffusion")]
    halftone: Halftone,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

pub(super) fn run(args: &Args) -> Result<(), Failure> {
    let rig = args.rig.find()?;
    let renderer = args.renderer.open()?;
    let (scene, shaded) = args.scene.load()?;
    let folder = Folder::begin(&args.out)?;
    args.scene.warn_of_size(&scene, &rig);
    let chosen = args.plan.choose(&shaded, &rig)?.choice.chosen;
    let plan = Plan { halftone: args.halftone, ..chosen.plan };
    let bar = progress("rendering slices", rig.rotation.slices.into());
    let turn = renderer.render_turn(&shaded, &rig, &plan, &|| bar.inc(1))?;
    bar.finish_and_clear();
    let note =
        SceneNote { source: args.scene.scene.clone(), triangles: scene.triangles.len(), fit_m: args.scene.fit_m };
    let method = Method { plan, shading: args.scene.shading.name().into(), smooth: args.scene.smooth };
    let rotation = Rotation::new(&rig, note, method);
    let pictures = if plan.halftone == Halftone::Grey { rotation.slices } else { rotation.frames };
    let bar = progress("writing pictures", pictures.into());
    write(folder.path(), &turn, &rotation, &|| bar.inc(1))?;
    bar.finish_and_clear();
    folder.finish()?;
    let lit = (0..turn.slices()).map(|slice| turn.mean(slice)).sum::<f64>() / f64::from(turn.slices());
    if args.json {
        say_json(&json!({
            "out": args.out, "rig": rig.name, "slices": rotation.slices, "frames": rotation.frames,
            "pictures": pictures, "triangles": scene.triangles.len(), "lit_share": lit,
            "renderer": renderer.name(), "plan": plan, "error_px": chosen.error_px,
        }));
    } else {
        let kind = if plan.halftone == Halftone::Grey { "grey slices" } else { "frames of 24 slices" };
        say(format!("{}: {pictures} {kind}, {:.1} % lit", args.out.display(), lit * 100.0));
        say(format!("by {plan}: within {} px, {} triangles", pixels(chosen.error_px), chosen.work.triangles_a_slice));
        say(format!("on {}", renderer.name()));
    }
    Ok(())
}
