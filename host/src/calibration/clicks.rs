//! Tables of clicks.

use super::{Click, OnFace, Place};
use crate::table::{Row, TableError, rows};
use core::ops::RangeInclusive;
use glam::{DVec2, DVec3};
use protocol::rig::Rig;
use thiserror::Error;

/// The columns, in any order: the pixel, and either a place in the world or one on a face at a stop. `face` is 0 where it is left out.
pub const COLUMNS: [&str; 10] =
    ["u_px", "v_px", "x_m", "y_m", "z_m", "face", "across_m", "slope_m", "stop_deg", "encoder_deg"];
const WORLD: [&str; 3] = ["x_m", "y_m", "z_m"];
const ON_FACE: [&str; 3] = ["across_m", "slope_m", "stop_deg"];
/// Metres from the middle of the mirror beyond which no fiducial is.
const REACH: RangeInclusive<f64> = -10.0..=10.0;
const ANGLES: RangeInclusive<f64> = -360.0..=360.0;

/// Why a file holds no clicks.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[expect(missing_docs, reason = "the messages say it")]
pub enum ClicksError {
    #[error(transparent)]
    Table(#[from] TableError),
    #[error("{0}: needs x_m, y_m and z_m, or across_m, slope_m and stop_deg, and not both")]
    Where(String),
}

/// Reads a table of clicks on the projector of `rig`: see [`COLUMNS`].
pub fn read(rig: &Rig, text: &str) -> Result<Vec<Click>, ClicksError> {
    rows(text, &COLUMNS, &["u_px", "v_px"])?.iter().map(|row| click(rig, row)).collect()
}

fn click(rig: &Rig, row: &Row<'_>) -> Result<Click, ClicksError> {
    let [width, height] = [rig.projector.width_px, rig.projector.height_px].map(f64::from);
    let pixel = DVec2::new(row.number("u_px", 0.0..=width)?, row.number("v_px", 0.0..=height)?);
    let has = |columns: [&str; 3]| columns.iter().any(|column| !row.field(column).is_empty());
    let numbers = |columns: [&'static str; 3], allowed: [RangeInclusive<f64>; 3]| {
        let mut each = columns.into_iter().zip(allowed);
        let mut next = || each.next().map_or(Ok(0.0), |(column, allowed)| row.number(column, allowed));
        Ok::<_, TableError>([next()?, next()?, next()?])
    };
    let place = match (has(WORLD), has(ON_FACE)) {
        (true, false) => Place::World(DVec3::from(numbers(WORLD, [REACH, REACH, REACH])?)),
        (false, true) => {
            let [across, slope, stop_deg] = numbers(ON_FACE, [REACH, REACH, ANGLES])?;
            let some = |column| !str::is_empty(row.field(column));
            Place::Face(OnFace {
                face: if some("face") { row.number("face", 0.0..=63.0)? as usize } else { 0 },
                at_m: DVec2::new(across, slope),
                stop_deg,
                encoder_deg: some("encoder_deg").then(|| row.number("encoder_deg", ANGLES)).transpose()?,
            })
        }
        _ => return Err(ClicksError::Where(row.label.clone())),
    };
    Ok(Click { label: row.label.clone(), place, pixel })
}

/// The same clicks as a table.
pub fn write(clicks: &[Click]) -> String {
    let line = |click: &Click| {
        let pixel = click.pixel;
        match click.place {
            Place::World(at) => format!("{:.4},{:.4},{},{},{},,,,,", pixel.x, pixel.y, at.x, at.y, at.z),
            Place::Face(OnFace { face, at_m, stop_deg, encoder_deg }) => {
                let encoder = encoder_deg.map(|angle| angle.to_string()).unwrap_or_default();
                format!("{:.4},{:.4},,,,{face},{},{},{stop_deg},{encoder}", pixel.x, pixel.y, at_m.x, at_m.y)
            }
        }
    };
    let lines = clicks.iter().map(line);
    core::iter::once(COLUMNS.join(",")).chain(lines).collect::<Vec<_>>().join("\n") + "\n"
}
