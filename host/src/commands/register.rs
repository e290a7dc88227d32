//! `praxi register`: where a tracker stands.

use super::rig_file::{self, matrix, rounded, set};
use super::{Failure, say, say_json, until_interrupted, warn};
use crate::input;
use crate::tracking::register::mean::Mean;
use crate::tracking::register::pairs::{COLUMNS, Pairs};
use crate::tracking::register::{EyePair, Pair, Registration, register};
use crate::tracking::source::{Follower, State};
use crate::tracking::{ParseError, Pose, Reading};
use protocol::rig::TrackerSource;
use serde_json::{Value as Json, json};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::time::{Duration, Instant};
use toml_edit::{Array, DocumentMut};

/// Find where a tracker stands, and the eye from its sensor, from a few known points
#[derive(clap::Args)]
#[command(after_help = "Example: praxi register --listen opentrack:4242 --rows 4 > pairs.csv\n         \
    praxi register pairs.csv --write rig.toml\n\n\
    Hold the sensor at four or more points that you have measured from the middle of the mirror (x right, y up, z to the \
    front) and that do not lie in one plane; three that are not on one line will do, less surely. The first line of FILE names the \
    columns: what,tracker_x_m,tracker_y_m,tracker_z_m,world_x_m,world_y_m,world_z_m,qx,qy,qz,qw; what is sensor. --listen prints \
    it all but the world's columns, which are for you to fill in. Lines that begin with eye in place of sensor, three or more, say that an eye was \
    kept at that point of the world while the head with the sensor on it turned by 20 degrees and more: they give \
    sensor_to_eye_m, and need the orientation. The same as TOML: [[sensor]] and [[eye]] with tracker_m, world_m and \
    orientation = [x, y, z, w]. What is printed can be put at the end of a rig file.")]
pub(super) struct Args {
    /// Pairs of points: a table with commas, or TOML if its name ends so
    #[arg(required_unless_present = "listen")]
    file: Option<PathBuf>,
    /// Write it into this rig file; its other keys and comments stay
    #[arg(long, value_name = "RIG.toml")]
    write: Option<PathBuf>,
    /// How far pairs may be off, RMS
    #[arg(long, value_name = "MM", value_parser = millimetres, allow_negative_numbers = true, default_value_t = 20.0)]
    within_mm: f64,
    /// Print a line of FILE each second, the mean of what this tracker says: opentrack:PORT, freed:PORT or patriot:/dev/ttyUSB0
    #[arg(long, value_name = "TRACKER", conflicts_with_all = ["file", "write"])]
    listen: Option<TrackerSource>,
    /// End after so many lines
    #[arg(long, value_name = "N", requires = "listen", value_parser = clap::value_parser!(u32).range(1..))]
    rows: Option<u32>,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

fn millimetres(text: &str) -> Result<f64, String> {
    let allowed = text.parse().ok().filter(|value| (0.001..=1000.0).contains(value));
    allowed.ok_or_else(|| "must be from 0.001 to 1000 millimetres".into())
}

pub(super) fn run(args: &Args) -> Result<(), Failure> {
    match &args.listen {
        Some(source) => listen(source, args.rows, args.json),
        None => find(args, args.file.as_deref().expect("one of the two is required")),
    }
}

fn find(args: &Args, file: &Path) -> Result<(), Failure> {
    let refused = |error: &dyn std::fmt::Display| Failure(format!("{}: {error}", file.display()));
    let text = input::read_text(file).map_err(|error| refused(&error))?;
    let is_toml = file.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("toml"));
    let pairs = if is_toml { Pairs::from_toml(&text) } else { Pairs::from_table(&text) };
    let pairs = pairs.map_err(|error| refused(&error))?;
    let found = register(&pairs.sensor, &pairs.eye, args.within_mm * 1e-3).map_err(|error| refused(&error))?;
    if let Some(rig) = &args.write {
        rig_file::change(rig, |document| put(document, &found))?;
    }
    if found.is_flat {
        warn(format!(
            "{}: all points lie in one plane: a mirrored tracker cannot be told from a right one, so add a point above or below it",
            file.display()
        ));
    }
    if args.json {
        say_json(&as_json(&pairs, &found));
        return Ok(());
    }
    let facts = as_comments(&pairs, &found);
    match &args.write {
        Some(rig) => say(format!("{}: [tracking] is written\n{facts}", rig.display())),
        None => {
            let mut block = DocumentMut::new();
            put(&mut block, &found)?;
            say(format!("{facts}\n{block}"));
        }
    }
    Ok(())
}

fn rms_mm(residuals_m: &[f64]) -> f64 {
    (residuals_m.iter().map(|residual| residual * residual).sum::<f64>() / residuals_m.len() as f64).sqrt() * 1e3
}

/// How well it fits, as comments of a TOML file.
fn as_comments(pairs: &Pairs, found: &Registration) -> String {
    let off = |labels: Vec<&Pair>, residuals: &[f64]| {
        let each = labels.into_iter().zip(residuals);
        each.map(|(pair, off)| format!("#   {:<14}{:7.1} mm", pair.label, off * 1e3)).collect::<Vec<_>>().join("\n")
    };
    let sensor = off(pairs.sensor.iter().collect(), &found.residuals_m);
    let mut text = format!(
        "# {} pairs agree within {:.1} mm RMS; distances are {:.4} times the tracker's\n{sensor}",
        found.residuals_m.len(),
        rms_mm(&found.residuals_m),
        found.scale,
    );
    if let Some(eye) = &found.eye {
        let each = off(pairs.eye.iter().map(|EyePair { pair, .. }| pair).collect(), &eye.residuals_m);
        let rms = rms_mm(&eye.residuals_m);
        text += &format!("\n# {} readings place the eye within {rms:.1} mm RMS\n{each}", eye.residuals_m.len());
    }
    text
}

fn as_json(pairs: &Pairs, found: &Registration) -> Json {
    let off = |label: &str, off: &f64| json!({ "pair": label, "off_mm": off * 1e3 });
    let sensors = pairs.sensor.iter().zip(&found.residuals_m).map(|(pair, residual)| off(&pair.label, residual));
    let eye = found.eye.as_ref().map(|eye| {
        let each = pairs.eye.iter().zip(&eye.residuals_m).map(|(one, residual)| off(&one.pair.label, residual));
        json!({
            "sensor_to_eye_m": eye.sensor_to_eye_m.to_array(), "rms_mm": rms_mm(&eye.residuals_m),
            "residuals": each.collect::<Vec<_>>(),
        })
    });
    json!({
        "world_from_tracker": rows(found), "rms_mm": rms_mm(&found.residuals_m), "scale": found.scale, "flat": found.is_flat,
        "residuals": sensors.collect::<Vec<_>>(), "eye": eye,
    })
}

fn rows(found: &Registration) -> [[f64; 4]; 3] {
    let motion = &found.world_from_tracker;
    [0, 1, 2].map(|row| {
        let [x, y, z] = motion.matrix3.row(row).to_array();
        [x, y, z, motion.translation[row]].map(rounded)
    })
}

/// Puts the keys that were found into `[tracking]`; whatever else stands there stays.
fn put(document: &mut DocumentMut, found: &Registration) -> Result<(), Failure> {
    let tracking = rig_file::table(document, "tracking")?;
    set(tracking, "world_from_tracker", matrix(rows(found)));
    if let Some(eye) = &found.eye {
        set(tracking, "sensor_to_eye_m", Array::from_iter(eye.sensor_to_eye_m.to_array().map(rounded)).into());
    }
    Ok(())
}

type Arrivals = Receiver<Result<Reading, ParseError>>;

/// A line of a table each second for each sensor that says something.
fn listen(source: &TrackerSource, rows: Option<u32>, json: bool) -> Result<(), Failure> {
    let interrupted = until_interrupted();
    let (sender, arrivals) = channel();
    let follower = Follower::start(source, 0, Instant::now(), move |arrived| drop(sender.send(arrived)))?;
    if !json {
        say(COLUMNS.join(","));
    }
    let mut told = None;
    let mut count = 0;
    while rows.is_none_or(|rows| count < rows) && !interrupted.load(Ordering::Relaxed) {
        let (means, refused) = second(&arrivals);
        let state = follower.state();
        if let (State::Closed(why), true) = (&state, told.as_ref() != Some(&state)) {
            warn(why);
        }
        told = Some(state);
        if let Some(error) = refused {
            warn(format!("{source}: {error}"));
        }
        for mean in means.into_values().take(rows.map_or(usize::MAX, |rows| (rows - count) as usize)) {
            say(if json { row_as_json(&mean).to_string() } else { row(&mean) });
            count += 1;
        }
    }
    Ok(())
}

/// What comes within a second: each sensor's mean, and the last of what was refused.
fn second(arrivals: &Arrivals) -> (BTreeMap<u16, Mean>, Option<ParseError>) {
    let end = Instant::now() + Duration::from_secs(1);
    let (mut means, mut refused) = (BTreeMap::<u16, Mean>::new(), None);
    loop {
        match arrivals.recv_timeout(end.saturating_duration_since(Instant::now())) {
            Ok(Ok(Reading { viewer, position_m, orientation, .. })) => {
                let pose = Pose { sensor: (viewer & 0xFF) as u8, position_m, orientation };
                means.entry(viewer).and_modify(|mean| mean.add(&pose)).or_insert_with(|| Mean::of(pose));
            }
            Ok(Err(error)) => refused = Some(error),
            Err(RecvTimeoutError::Timeout | RecvTimeoutError::Disconnected) => return (means, refused),
        }
    }
}

fn row(mean: &Mean) -> String {
    let Pose { sensor, position_m, orientation } = mean.pose();
    let [x, y, z] = position_m.to_array().map(rounded);
    let [qx, qy, qz, qw] = orientation.to_array().map(rounded);
    format!(
        "sensor,{x:.4},{y:.4},{z:.4},,,,{qx:.5},{qy:.5},{qz:.5},{qw:.5} # sensor {sensor}, {} readings within {:.1} mm RMS",
        mean.count(),
        mean.spread_m() * 1e3,
    )
}

fn row_as_json(mean: &Mean) -> Json {
    let Pose { sensor, position_m, orientation } = mean.pose();
    json!({
        "sensor": sensor, "tracker_m": position_m.to_array(), "orientation": orientation.to_array(), "readings": mean.count(),
        "spread_mm": mean.spread_m() * 1e3,
    })
}
