//! `praxi rig`: what a rig is.

use super::{Failure, say, say_json, warn};
use crate::rigs;
use crate::seen::{View, reaching_slices};
use crate::volume::display_radius_m;
use glam::DVec3;
use protocol::rig::curve::Spot;
use protocol::rig::{Rig, Viewers};
use serde_json::json;

/// Look at rigs
#[derive(clap::Args)]
#[command(after_help = "Example: praxi rig check reference")]
pub(super) struct Args {
    #[command(subcommand)]
    command: Command,
}

#[derive(clap::Subcommand)]
enum Command {
    Check(Check),
}

/// Say what a rig is, or what is wrong with it
#[derive(clap::Args)]
#[command(after_help = "Example: praxi rig check reference")]
struct Check {
    /// A rig file, or reference, reference-180hz, high-viewer, tent
    rig: String,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

pub(super) fn run(args: &Args) -> Result<(), Failure> {
    let Command::Check(args) = &args.command;
    let rig = rigs::find(&args.rig)?;
    let facts = Facts::of(&rig);
    let warnings = warnings(&rig, &facts);
    if args.json {
        say_json(&json!({
            "name": rig.name, "turns_per_second": rig.turns_per_second(), "slice_time_us": rig.slice_seconds() * 1e6,
            "slices": rig.rotation.slices, "frames": rig.rotation().frames(), "faces": rig.mirror.face.len(),
            "view_spacing_deg": facts.spacing_deg, "view_spacing_mm": facts.spacing_mm,
            "display_radius_mm": facts.radius_mm, "pixels_per_mm": facts.pixels_per_mm,
            "slices_reaching_an_eye": facts.reaching, "warnings": warnings,
        }));
        return Ok(());
    }
    let spacing =
        facts.spacing_mm.map(|spacing| format!(", {spacing:.1} mm at the viewing distance")).unwrap_or_default();
    say(format!(
        "{}\n  rotation        {:.3} turns/s, {} slices in {}, {:.1} us a slice\n  \
         views           {:.3} degrees apart{spacing}\n  display volume  a ball of {:.1} mm radius about the origin\n  \
         resolution      {:.2} projector pixels a millimetre there\n  reach           {} slices a turn reach an eye",
        rig.name,
        rig.turns_per_second(),
        rig.rotation.slices,
        match rig.rotation().frames() {
            1 => "1 frame".to_string(),
            frames => format!("{frames} frames"),
        },
        rig.slice_seconds() * 1e6,
        facts.spacing_deg,
        facts.radius_mm,
        facts.pixels_per_mm,
        facts.reaching,
    ));
    warnings.iter().for_each(|warning| warn(format!("{}: {warning}", args.rig)));
    Ok(())
}

struct Facts {
    spacing_deg: f64,
    /// None for viewers at infinity.
    spacing_mm: Option<f64>,
    radius_mm: f64,
    pixels_per_mm: f64,
    reaching: usize,
}

impl Facts {
    fn of(rig: &Rig) -> Self {
        let spacing_deg = 360.0 / f64::from(rig.rotation.slices);
        let radius = display_radius_m(rig);
        // Viewers at infinity are taken as standing 100 m away.
        let from = rig.viewers().place(0.0, 100.0);
        let spacing_mm = rig.viewing.distance_m.map(|distance_m| distance_m * spacing_deg.to_radians() * 1e3);
        let view = View { from, look_at: DVec3::ZERO, window_m: 2.0 * radius.max(1e-3), pixels: 32, rays: 1 };
        Self {
            spacing_deg,
            spacing_mm,
            radius_mm: radius * 1e3,
            pixels_per_mm: pixels_per_metre(rig) * 1e-3,
            reaching: reaching_slices(rig, &view),
        }
    }
}

/// Projector pixels that a metre across the mirror's middle covers, seen along the face's horizontal, for the first face.
fn pixels_per_metre(rig: &Rig) -> f64 {
    let frame = rig.mirror.face[0].frame(rig.slice_angle(0));
    let middle = frame.normal * rig.mirror.face[0].offset_m;
    let [left, right] = [-0.5e-3, 0.5e-3].map(|way| rig.camera().project(middle + way * frame.across));
    left.zip(right).map_or(0.0, |(left, right)| left.distance(right) * 1e3)
}

fn warnings(rig: &Rig, facts: &Facts) -> Vec<String> {
    let mut warnings = Vec::new();
    for (index, face) in rig.mirror.face.iter().enumerate() {
        let tilt = face.tilt_deg.to_radians();
        let steep = |Spot { distance_m, height_m }: Spot| {
            (height_m > distance_m * tilt.tan()).then(|| {
                format!(
                    "viewers {height_m} m high look down more steeply than mirror.face[{index}] stands: above {:.3} m \
                     = distance_m tan(tilt_deg) they also see it facing away, as ghosts",
                    distance_m * tilt.tan()
                )
            })
        };
        match rig.viewers() {
            Viewers::Circle { distance_m, height_m } => warnings.extend(steep(Spot { distance_m, height_m })),
            Viewers::Curve(curve) => warnings.extend(curve.spots().filter_map(steep)),
            Viewers::Infinity { elevation } if elevation > tilt => warnings.push(format!(
                "viewers at infinity look down more steeply than mirror.face[{index}] stands: above {} degrees they also \
                 see it facing away, as ghosts",
                face.tilt_deg
            )),
            _ => (),
        }
    }
    if facts.radius_mm == 0.0 {
        warnings.push("no point at the origin is visible from every side: the display volume is empty".into());
    }
    if facts.reaching == 0 {
        warnings.push("no slice reaches an eye where viewers are".into());
    }
    warnings
}
