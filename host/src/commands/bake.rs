//! `praxi bake`: one turn of a scene with the best halftone that time can buy, as a folder.

use super::args::{PlanArgs, RendererArgs, RigArgs, SceneArgs, progress};
use super::{Failure, say, say_json, warn};
use crate::bake::{Bake, Found};
use crate::output::Folder;
use crate::render::joint::SWEEPS;
use crate::render::plan::{Halftone, Plan};
use crate::rendered::{Method, Rotation, SceneNote, write};
use serde_json::json;
use std::path::PathBuf;

/// Render one turn of a scene and search its bits over all slices together, for content that stays: half a minute and more
#[derive(clap::Args)]
#[command(after_help = "Example: praxi bake builtin --rig reference --out turn\n\
    Stopped, it goes on where it was when the same command is given again: the work is saved in DIR.bake until it is done.")]
pub(super) struct Args {
    #[command(flatten)]
    scene: SceneArgs,
    #[command(flatten)]
    rig: RigArgs,
    /// The folder to write, as praxi render does; an earlier result of praxi is replaced
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    #[command(flatten)]
    plan: PlanArgs,
    #[command(flatten)]
    renderer: RendererArgs,
    /// How often every slice is searched; after 4 times little moves
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1000), default_value_t = SWEEPS)]
    sweeps: u32,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

pub(super) fn run(args: &Args) -> Result<(), Failure> {
    let rig = args.rig.find()?;
    let renderer = args.renderer.open()?;
    let (scene, shaded) = args.scene.load()?;
    // Whether the result has a place is asked before the work; the place is taken after it, so that a stop leaves nothing there.
    drop(Folder::begin(&args.out)?);
    args.scene.warn_of_size(&scene, &rig);
    let chosen = args.plan.choose(&shaded, &rig)?.choice.chosen;
    let plan = Plan { halftone: Halftone::Grey, ..chosen.plan };
    let bar = progress("rendering slices", rig.rotation.slices.into());
    let grey = renderer.render_turn(&shaded, &rig, &plan, &|| bar.inc(1))?;
    bar.finish_and_clear();
    let (mut bake, found) = Bake::begin(&rig, &grey, args.sweeps, &args.out)?;
    let [searched, slices] = bake.progress();
    let place = bake.checkpoint().display();
    match found {
        Found::Nothing => {}
        Found::OtherJob => warn(format!("{place}: of another scene, rig, version or --sweeps: beginning anew")),
        Found::Damaged => warn(format!("{place}: damaged: beginning anew")),
        Found::Halfway => eprintln!("praxi: {place}: going on after {searched} of {slices} searched slices"),
    }
    let bar = progress("searching slices", slices).with_position(searched);
    bar.reset_eta();
    while bake.step(&|| bar.inc(1))? {}
    bar.finish_and_clear();
    let note =
        SceneNote { source: args.scene.scene.clone(), triangles: scene.triangles.len(), fit_m: args.scene.fit_m };
    let plan = Plan { halftone: Halftone::Joint, ..plan };
    let method = Method { plan, shading: args.scene.shading.name().into(), smooth: args.scene.smooth };
    let rotation = Rotation::new(&rig, note, method);
    let folder = Folder::begin(&args.out)?;
    let bar = progress("writing pictures", rotation.frames.into());
    write(folder.path(), bake.turn(), &rotation, &|| bar.inc(1))?;
    bar.finish_and_clear();
    folder.finish()?;
    let turn = bake.turn();
    let lit = (0..turn.slices()).map(|slice| turn.mean(slice)).sum::<f64>() / f64::from(turn.slices());
    bake.forget()?;
    if args.json {
        say_json(&json!({
            "out": args.out, "rig": rig.name, "slices": rotation.slices, "frames": rotation.frames,
            "pictures": rotation.frames, "triangles": scene.triangles.len(), "lit_share": lit,
            "plan": plan, "error_px": chosen.error_px, "sweeps": args.sweeps,
        }));
    } else {
        say(format!("{}: {} frames of 24 slices, {:.1} % lit", args.out.display(), rotation.frames, lit * 100.0));
    }
    Ok(())
}
