//! `praxi calibrate`: where the projector stands and how the mirror leans.

use super::rig_file::{self, matrix, rounded, set};
use super::{Failure, hanging, say, say_json, warn};
use crate::calibration::clicks::{self, COLUMNS};
use crate::calibration::meaning::{Meaning, meaning};
use crate::calibration::simulated::{clicked, shaken, sheet};
use crate::calibration::{Calibration, Click, Free, calibrate};
use crate::input;
use crate::output::File;
use crate::rigs;
use crate::volume::display_radius_m;
use clap::ValueEnum;
use protocol::rig::{Projector, Rig};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use serde_json::{Value as Json, json};
use std::path::{Path, PathBuf};
use toml_edit::{Array, DocumentMut, Item, TableLike};

/// Find where the projector stands and how the mirror leans, from clicks on fiducials
#[derive(clap::Args)]
#[command(after_help = "Example: praxi calibrate --simulate --rig built.toml --noise-px 0.3 > clicks.csv\n         \
    praxi calibrate clicks.csv --rig reference --write calibrated.toml\n\n\
    CLICKS.csv has a line for each fiducial: the projector's pixel that lights it, and where it is. The first line names the columns. A \
    fiducial on the mirror has across_m and slope_m, measured on the face from the middle (the foot of the perpendicular from the axis' \
    middle, as slope_span_m in the rig file), stop_deg, the azimuth that the face looks toward, face where there are several, and \
    encoder_deg, degrees since the index as the mirror turns, where an encoder tells: the turn's phase is found from that alone. A \
    sheet's four corners and its middle, at 0 and at 180 degrees, do. Any other fiducial has x_m, y_m and z_m: right, up and front of the \
    mirror's middle. Eight clicks find everything; ten also say which one is wrong.")]
pub(super) struct Args {
    /// Clicks: a table with commas
    #[arg(required_unless_present = "simulate")]
    file: Option<PathBuf>,
    /// The rig as it is thought to be, which gives what clicks do not: a file, or reference, reference-180hz, high-viewer, tent
    #[arg(long)]
    rig: String,
    /// Write the rig with what was found to this file: the text of --rig, comments too, with its projector as a matrix
    #[arg(long, value_name = "RIG.toml")]
    write: Option<PathBuf>,
    /// Leave this as the rig has it
    #[arg(long, value_enum)]
    keep: Vec<Keep>,
    /// Look for the lens's radial distortion too
    #[arg(long)]
    radial: bool,
    /// How far clicks may be off, RMS
    #[arg(long, value_name = "PX", value_parser = pixels, allow_negative_numbers = true, default_value_t = 2.0)]
    within_px: f64,
    /// Print the clicks that somebody would make on --rig, on a sheet with four corners and a middle
    #[arg(long, conflicts_with_all = ["file", "write", "keep", "radial", "within_px"])]
    simulate: bool,
    /// How unsteady the hand is: a standard deviation along u and along v
    #[arg(long, value_name = "PX", value_parser = pixels, allow_negative_numbers = true, default_value_t = 0.3, requires = "simulate")]
    noise_px: f64,
    /// Another hand
    #[arg(long, value_parser = super::args::seed, default_value_t = 0, requires = "simulate")]
    seed: u64,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Keep {
    /// The tilt of the mirror's faces
    Tilt,
    /// Their distance from the origin
    Offset,
}

fn pixels(text: &str) -> Result<f64, String> {
    let allowed = text.parse().ok().filter(|value| (0.0..=1000.0).contains(value));
    allowed.ok_or_else(|| "must be from 0 to 1000 pixels".into())
}

pub(super) fn run(args: &Args) -> Result<(), Failure> {
    let rig = rigs::find(&args.rig)?;
    match &args.file {
        Some(file) => find(args, &rig, file),
        None => simulate(args, &rig),
    }
}

fn simulate(args: &Args, rig: &Rig) -> Result<(), Failure> {
    let sheets: Vec<_> = (0..rig.mirror.face.len()).flat_map(|face| sheet(rig, face)).collect();
    let clicks = clicked(rig, &sheets);
    let clicks = shaken(&clicks, args.noise_px, &mut ChaCha8Rng::seed_from_u64(args.seed));
    match args.json {
        true => say_json(&json!({ "columns": COLUMNS, "table": clicks::write(&clicks) })),
        false => say(clicks::write(&clicks)),
    }
    Ok(())
}

fn find(args: &Args, rig: &Rig, file: &Path) -> Result<(), Failure> {
    let refused = |error: &dyn std::fmt::Display| Failure(format!("{}: {error}", file.display()));
    let text = input::read_text(file).map_err(|error| refused(&error))?;
    let clicks = clicks::read(rig, &text).map_err(|error| refused(&error))?;
    let free = Free {
        tilt: !args.keep.contains(&Keep::Tilt),
        offset: !args.keep.contains(&Keep::Offset),
        radial: args.radial,
    };
    let found = calibrate(rig, &clicks, free, args.within_px).map_err(|error| refused(&error))?;
    let told = Told::of(&found);
    for wrong in &found.wrong {
        let Click { label, .. } = &wrong.click;
        warn(format!("{}: {label} is {:.1} px off by all others: left out", file.display(), wrong.off_px));
    }
    if let Some(path) = &args.write {
        if path.exists() && rigs::find(&path.to_string_lossy()).is_err() {
            return Err(Failure(format!("{} is there and no rig file: name another", path.display())));
        }
        let text = rig_file::changed(&args.rig, &rigs::text(&args.rig)?, |document| put(document, &found.rig))?;
        File::begin_over(path)?.finish(text.as_bytes())?;
    }
    if args.json {
        say_json(&told.as_json(&found));
        return Ok(());
    }
    say(told.in_words(&found));
    match &args.write {
        Some(path) => say(format!("{} is written", path.display())),
        None => {
            let mut block = DocumentMut::new();
            put_projector(rig_file::table(&mut block, "projector")?, &found.rig.projector);
            say(block);
        }
    }
    Ok(())
}

/// What is said of a calibration.
struct Told {
    /// A hand's standard deviation along u and along v, pixels: by what is left of the clicks, or half a pixel where nothing is.
    hand_px: f64,
    meaning: Option<Meaning>,
}

impl Told {
    fn of(found: &Calibration) -> Self {
        Self {
            hand_px: found.fit.click_px().unwrap_or(0.5),
            meaning: meaning(found, 0.8 * display_radius_m(&found.rig)),
        }
    }

    fn in_words(&self, found: &Calibration) -> String {
        let fit = &found.fit;
        let mut lines = vec![format!(
            "{} clicks, {:.2} px RMS off, {} numbers spare: a hand of {:.2} px{}",
            found.clicks.len(),
            fit.rms_px(),
            fit.spare(),
            self.hand_px,
            if fit.spare() > 0 { "" } else { ", as they mostly are" },
        )];
        let each = found.clicks.iter().enumerate();
        lines.extend(each.map(|(index, click)| format!("  {:<12}{:8.2} px off", click.label, fit.off_px(index))));
        lines.push(format!("{:<42}{:>12}{:>12}", "", "found", "uncertain"));
        lines.extend(fit.spreads().into_iter().map(|spread| {
            let value = spread.value.map(|value| format!("{value:.3}")).unwrap_or_default();
            format!("  {:<40}{value:>12}{:12.3}", spread.name, spread.per_px * self.hand_px)
        }));
        if let Some(offset) = found.phase.phase_offset_deg {
            lines.push(format!("  {:<40}{offset:12.3}  by the encoder", "phase at the index (deg)"));
        }
        for (face, azimuth) in &found.phase.azimuth_deg {
            lines.push(format!("  {:<40}{azimuth:12.3}  by the encoder", format!("azimuth of face {face} (deg)")));
        }
        lines.push(format!("  {:<40}{:12.0}", "condition", fit.condition()));
        if let Some(Meaning { picture_px, viewer_slices }) = self.meaning {
            let text = format!(
                "{:.2} px in the picture and {:.3} slices at the viewer, RMS over the display's volume",
                picture_px * self.hand_px,
                viewer_slices * self.hand_px
            );
            lines.push(hanging("all of it together:", &text));
        }
        lines.join("\n")
    }

    fn as_json(&self, found: &Calibration) -> Json {
        let fit = &found.fit;
        let clicks = found.clicks.iter().enumerate();
        let spread = |spread: crate::calibration::Spread| json!({ "name": spread.name, "found": spread.value, "uncertain": spread.per_px * self.hand_px });
        json!({
            "clicks": clicks.map(|(index, click)| json!({ "click": click.label, "off_px": fit.off_px(index) })).collect::<Vec<_>>(),
            "left_out": found.wrong.iter().map(|wrong| json!({ "click": wrong.click.label, "off_px": wrong.off_px })).collect::<Vec<_>>(),
            "rms_px": fit.rms_px(), "spare": fit.spare(), "hand_px": fit.click_px(), "condition": fit.condition(),
            "parameters": fit.spreads().into_iter().map(spread).collect::<Vec<_>>(),
            "phase_offset_deg": found.phase.phase_offset_deg, "azimuth_deg": found.phase.azimuth_deg,
            "picture_px": self.meaning.map(|meaning| meaning.picture_px * self.hand_px),
            "viewer_slices": self.meaning.map(|meaning| meaning.viewer_slices * self.hand_px),
            "rig": found.rig,
        })
    }
}

/// Puts what was found into a rig file.
fn put(document: &mut DocumentMut, rig: &Rig) -> Result<(), Failure> {
    put_projector(rig_file::table(document, "projector")?, &rig.projector);
    set(rig_file::table(document, "rotation")?, "phase_offset_deg", rounded(rig.rotation.phase_offset_deg).into());
    let faces = rig_file::table(document, "mirror")?.get_mut("face");
    let mut faces: Vec<&mut dyn TableLike> = match faces {
        Some(Item::ArrayOfTables(tables)) => tables.iter_mut().map(|table| table as &mut dyn TableLike).collect(),
        Some(Item::Value(toml_edit::Value::Array(array))) => {
            let tables = array.iter_mut().filter_map(|value| value.as_inline_table_mut());
            tables.map(|table| table as &mut dyn TableLike).collect()
        }
        _ => Vec::new(),
    };
    for (table, face) in faces.iter_mut().zip(&rig.mirror.face) {
        for (key, value) in
            [("azimuth_deg", face.azimuth_deg), ("tilt_deg", face.tilt_deg), ("offset_m", face.offset_m)]
        {
            set(*table, key, rounded(value).into());
        }
    }
    Ok(())
}

fn put_projector(table: &mut dyn TableLike, projector: &Projector) {
    for key in ["position_m", "look_at_m", "image_down", "focal_px", "principal_px"] {
        table.remove(key);
    }
    set(table, "matrix", matrix(projector.matrix.expect("a calibration gives a matrix")));
    if projector.radial != [0.0; 2] {
        set(table, "radial", Array::from_iter(projector.radial.map(rounded)).into());
    }
}
