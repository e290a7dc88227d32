//! Files of pairs: a table with commas, or TOML.

use super::{EyePair, Pair};
use crate::table::{Row, TableError, number, rows};
use core::ops::RangeInclusive;
use glam::{DQuat, DVec3};
use protocol::rig::toml_problem;
use serde::Deserialize;
use thiserror::Error;

/// What stands in a file.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Pairs {
    /// The sensor at known places.
    pub sensor: Vec<Pair>,
    /// The eye at known places.
    pub eye: Vec<EyePair>,
}

/// Why a file holds no pairs.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum PairsError {
    /// Not TOML, or other keys.
    #[error("{0}")]
    Toml(String),
    /// Not such a table, or a field is no number, or too large for a room.
    #[error(transparent)]
    Table(#[from] TableError),
    /// Not sensor or eye.
    #[error("{0}: what = {1:?}: must be sensor or eye")]
    What(String, String),
    /// An orientation is not of length 1.
    #[error("{0}: the orientation x, y, z, w has length {1}: must be 1 within 0.01")]
    Orientation(String, String),
    /// Nothing at all.
    #[error("no pairs")]
    Empty,
}

/// The columns of a table, in any order. `what` and the orientation may be left out where there are no eyes.
pub const COLUMNS: [&str; 11] = [
    "what",
    "tracker_x_m",
    "tracker_y_m",
    "tracker_z_m",
    "world_x_m",
    "world_y_m",
    "world_z_m",
    "qx",
    "qy",
    "qz",
    "qw",
];
/// Metres within which everything stands in a room.
const SENSIBLE: RangeInclusive<f64> = -1000.0..=1000.0;

fn unit(place: &str, [x, y, z, w]: [f64; 4]) -> Result<DQuat, PairsError> {
    let quaternion = DQuat::from_xyzw(x, y, z, w);
    let length = quaternion.length();
    if (length - 1.0).abs() > 0.01 {
        return Err(PairsError::Orientation(place.into(), format!("{length:.3}")));
    }
    Ok(quaternion.normalize())
}

impl Pairs {
    /// Reads TOML: `[[sensor]]` with `tracker_m` and `world_m`, `[[eye]]` with `orientation` too, as x, y, z, w.
    pub fn from_toml(text: &str) -> Result<Self, PairsError> {
        #[derive(Deserialize)]
        #[serde(deny_unknown_fields)]
        struct File {
            #[serde(default)]
            sensor: Vec<Sensor>,
            #[serde(default)]
            eye: Vec<Eye>,
        }
        #[derive(Deserialize)]
        #[serde(deny_unknown_fields)]
        struct Sensor {
            tracker_m: [f64; 3],
            world_m: [f64; 3],
        }
        #[derive(Deserialize)]
        #[serde(deny_unknown_fields)]
        struct Eye {
            tracker_m: [f64; 3],
            world_m: [f64; 3],
            orientation: [f64; 4],
        }
        let pair = |label: String, tracker_m: [f64; 3], world_m: [f64; 3]| {
            for (field, values) in [("tracker_m", tracker_m), ("world_m", world_m)] {
                values
                    .into_iter()
                    .try_for_each(|value| number(&label, field, &value.to_string(), SENSIBLE).map(drop))?;
            }
            Ok::<_, PairsError>(Pair { label, tracker_m: tracker_m.into(), world_m: world_m.into() })
        };
        let file: File = toml::from_str(text).map_err(|error| PairsError::Toml(toml_problem(text, &error)))?;
        let sensors = file.sensor.iter().enumerate();
        let eyes = file.eye.iter().enumerate();
        let pairs = Self {
            sensor: sensors
                .map(|(index, one)| pair(format!("[[sensor]] {}", index + 1), one.tracker_m, one.world_m))
                .collect::<Result<_, _>>()?,
            eye: eyes
                .map(|(index, one)| {
                    let pair = pair(format!("[[eye]] {}", index + 1), one.tracker_m, one.world_m)?;
                    let orientation = unit(&pair.label, one.orientation)?;
                    Ok::<_, PairsError>(EyePair { pair, orientation })
                })
                .collect::<Result<_, _>>()?,
        };
        pairs.filled()
    }

    /// Reads a [`crate::table`] with columns [`COLUMNS`].
    pub fn from_table(text: &str) -> Result<Self, PairsError> {
        let mut pairs = Self::default();
        rows(text, &COLUMNS, &COLUMNS[1..7])?.iter().try_for_each(|row| pairs.add_row(row))?;
        pairs.filled()
    }

    fn add_row(&mut self, row: &Row<'_>) -> Result<(), PairsError> {
        let number = |column: usize| row.number(COLUMNS[column], SENSIBLE);
        let point =
            |first: usize| Ok::<_, TableError>(DVec3::new(number(first)?, number(first + 1)?, number(first + 2)?));
        let pair = Pair { tracker_m: point(1)?, world_m: point(4)?, label: row.label.clone() };
        match row.field("what") {
            "" | "sensor" => self.sensor.push(pair),
            "eye" => {
                let orientation = unit(&row.label, [number(7)?, number(8)?, number(9)?, number(10)?])?;
                self.eye.push(EyePair { pair, orientation });
            }
            other => return Err(PairsError::What(row.label.clone(), other.chars().take(40).collect())),
        }
        Ok(())
    }

    fn filled(self) -> Result<Self, PairsError> {
        if self.sensor.is_empty() && self.eye.is_empty() { Err(PairsError::Empty) } else { Ok(self) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const TABLE: &str = "what, tracker_x_m, tracker_y_m, tracker_z_m, world_x_m, world_y_m, world_z_m, qx, qy, qz, qw\n\
        # the table\n sensor, 1, 2, 3, -4.5, 5, 6\n\neye, 1, 2, 3, 4, 5, 6, 0, 0, 0.6, 0.8 # nose up\n";
    const FILE: &str = "[[sensor]]\ntracker_m = [1.0, 2.0, 3.0]\nworld_m = [-4.5, 5.0, 6.0]\n\
        [[eye]]\ntracker_m = [1.0, 2.0, 3.0]\nworld_m = [4.0, 5.0, 6.0]\norientation = [0.0, 0.0, 0.6, 0.8]\n";

    #[test]
    fn both_forms_say_the_same() {
        let [table, file] = [Pairs::from_table(TABLE).unwrap(), Pairs::from_toml(FILE).unwrap()];
        let [tracker_m, world_m] = [DVec3::new(1.0, 2.0, 3.0), DVec3::new(-4.5, 5.0, 6.0)];
        assert_eq!(table.sensor, [Pair { label: "line 3".into(), tracker_m, world_m }]);
        assert_eq!(file.sensor, [Pair { label: "[[sensor]] 1".into(), tracker_m, world_m }]);
        assert_eq!((&table.eye[0].pair.label[..], &file.eye[0].pair.label[..]), ("line 5", "[[eye]] 1"));
        assert_eq!(table.eye[0].orientation, file.eye[0].orientation);
        let bare = "world_x_m,world_y_m,world_z_m,tracker_x_m,tracker_y_m,tracker_z_m\n-4.5,5,6,1,2,3\n";
        assert_eq!(Pairs::from_table(bare).unwrap().sensor[0].world_m, world_m);
    }

    #[test]
    fn what_is_wrong_is_named_with_its_place() {
        for (from, to, words) in [
            ("-4.5", "four", "line 3: world_x_m = four: must be a number"),
            ("-4.5", "nan", "line 3: world_x_m = nan"),
            ("-4.5", "1e9", "line 3: world_x_m = 1e9"),
            (", 5, 6\n", "\n", "line 3: world_y_m = : must be a number"),
            ("sensor,", "nose,", "line 3: what = \"nose\": must be sensor or eye"),
            ("0.8", "0.9", "line 5: the orientation x, y, z, w has length 1.082: must be 1"),
            ("0, 0, 0.6, 0.8", "", "line 5: qx = : must be"),
            ("qw", "q4", "line 1: \"q4\" is no column: must be what, tracker_x_m"),
            ("qw", "qz", "column qz stands 2 times"),
            ("tracker_x_m, ", "", "column tracker_x_m stands 0 times"),
        ] {
            let text = TABLE.replacen(from, to, 1);
            assert_ne!(text, TABLE);
            let refused = Pairs::from_table(&text).unwrap_err().to_string();
            assert!(refused.contains(words), "{to}: {refused}");
        }
        assert_eq!(Pairs::from_table("# nothing\n"), Err(TableError::Empty.into()));
        assert_eq!(Pairs::from_table(TABLE.lines().next().unwrap()), Err(PairsError::Empty));
        assert_eq!(Pairs::from_toml(""), Err(PairsError::Empty));
        for (from, to, words) in [
            ("-4.5", "nan", "[[sensor]] 1: world_m = NaN: must be"),
            ("0.8", "0.9", "[[eye]] 1: the orientation"),
            ("world_m", "world_mm", "unknown field `world_mm`"),
            ("[[eye]]", "[[nose]]", "unknown field `nose`"),
        ] {
            let refused = Pairs::from_toml(&FILE.replacen(from, to, 1)).unwrap_err().to_string();
            assert!(refused.contains(words) && refused.lines().count() == 1, "{to}: {refused}");
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]
        #[test]
        fn any_text_is_pairs_or_refused(text in "\\PC{0,40}|([a-z_,0-9.e+-]{0,30}\n){0,8}", at in 0..TABLE.len(), byte in " -~") {
            let _ = (Pairs::from_table(&text), Pairs::from_toml(&text));
            let mut changed = TABLE.to_string();
            changed.replace_range(at..=at, &byte);
            let _ = Pairs::from_table(&changed);
        }
    }
}
