//! `praxi project`: one scene point in one slice.

use super::args::RigArgs;
use super::{Failure, say, say_json};
use glam::DVec3;
use serde_json::json;
use shaders::project::{Model, SliceOptics, Viewer, Visibility};

/// Project a scene point: its viewer, its pixel, its depth, and whether or why not it is visible
///
/// Depth is the distance to the viewer; for viewers at infinity it is the distance behind the plane through the origin that faces them.
#[derive(clap::Args)]
#[command(
    allow_negative_numbers = true,
    after_help = "Example: praxi project --rig reference --model cone --slice 39 -- -0.003 0.041 0.026"
)]
pub(super) struct Args {
    #[command(flatten)]
    rig: RigArgs,
    /// How the diffuser is modelled
    #[arg(long, value_enum, default_value = "cone")]
    model: ModelArg,
    /// The slice, from 0
    #[arg(long)]
    slice: u32,
    /// The mirror's face, from 0
    #[arg(long, default_value_t = 0)]
    face: usize,
    /// Metres
    x: f64,
    /// Metres
    y: f64,
    /// Metres
    z: f64,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

/// How the diffuser is modelled.
#[derive(Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum ModelArg {
    /// Light leaves in vertical planes: the patent's approximation
    Planar,
    /// Light leaves in cones, as a horizontal diffuser has it
    Cone,
}

impl From<ModelArg> for Model {
    fn from(model: ModelArg) -> Self {
        match model {
            ModelArg::Planar => Self::Planar,
            ModelArg::Cone => Self::Cone,
        }
    }
}

pub(super) fn run(args: &Args) -> Result<(), Failure> {
    let rig = args.rig.find()?;
    let allowed = |what, value: usize, count: usize| match value < count {
        true => Ok(()),
        false => Err(Failure(format!("--{what} {value}: rig {} has 0 to {}", rig.name, count - 1))),
    };
    allowed("slice", args.slice as usize, rig.rotation.slices as usize)?;
    allowed("face", args.face, rig.mirror.face.len())?;
    let point = DVec3::new(args.x, args.y, args.z);
    if !point.is_finite() {
        return Err(Failure(format!("point {point}: coordinates must be finite numbers of metres")));
    }
    let optics = SliceOptics::new(&rig, args.face, rig.slice_angle(args.slice), args.model.into());
    let projected = optics.project(point);
    let (position, direction) = match projected.viewer {
        Some(Viewer::At(position)) => (Some(position.to_array()), None),
        Some(Viewer::Toward(direction)) => (None, Some(direction.to_array())),
        None => (None, None),
    };
    if args.json {
        say_json(&json!({
            "u_px": projected.pixel.map(|pixel| pixel.x), "v_px": projected.pixel.map(|pixel| pixel.y),
            "viewer_m": position, "viewer_direction": direction, "depth_m": projected.depth_m,
            "visible": projected.visibility == Visibility::Visible, "reason": projected.visibility.reason(),
        }));
        return Ok(());
    }
    let vector = |[x, y, z]: [f64; 3]| format!("{x:.6}, {y:.6}, {z:.6}");
    let unknown = || "none".to_string();
    say(format!(
        "viewer  {}\npixel   {}\ndepth   {}\nvisible {}",
        position
            .map(|at| vector(at) + " m")
            .or(direction.map(|way| format!("toward {}", vector(way))))
            .unwrap_or_else(unknown),
        projected.pixel.map_or_else(unknown, |pixel| format!("u {:.6}, v {:.6} px", pixel.x, pixel.y)),
        projected.depth_m.map_or_else(unknown, |depth| format!("{depth:.6} m")),
        match projected.visibility {
            Visibility::Visible => "yes".to_string(),
            other => format!("no: {}", other.reason()),
        },
    ));
    Ok(())
}
