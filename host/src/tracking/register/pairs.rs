//! Files of pairs: a table with commas, or TOML.

use super::{EyePair, Pair};
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
    /// The first line of a table does not name its columns.
    #[error("line {line}: {found:?} is no column: must be {COLUMNS_NAMED}")]
    Column {
        /// The line.
        line: usize,
        /// What stands there.
        found: String,
    },
    /// A column is not there, or twice.
    #[error("column {0} stands {1} times: must stand once")]
    Columns(&'static str, usize),
    /// A field is no number, or too large for a room.
    #[error("{place}: {field} = {found}: must be a number from -1000 to 1000")]
    Number {
        /// The line or the table.
        place: String,
        /// The column or the key.
        field: &'static str,
        /// What stands there.
        found: String,
    },
    /// Not sensor or eye.
    #[error("line {0}: what = {1:?}: must be sensor or eye")]
    What(usize, String),
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
const COLUMNS_NAMED: &str =
    "what, tracker_x_m, tracker_y_m, tracker_z_m, world_x_m, world_y_m, world_z_m, qx, qy, qz or qw";
/// Metres beyond which nothing stands in a room.
const LARGEST: f64 = 1000.0;

fn number(place: &str, field: &'static str, value: Option<f64>, found: &str) -> Result<f64, PairsError> {
    let sensible = value.filter(|value| (-LARGEST..=LARGEST).contains(value));
    sensible.ok_or_else(|| PairsError::Number { place: place.into(), field, found: found.chars().take(40).collect() })
}

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
                    .try_for_each(|value| number(&label, field, Some(value), &value.to_string()).map(drop))?;
            }
            Ok(Pair { label, tracker_m: tracker_m.into(), world_m: world_m.into() })
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
                    Ok(EyePair { pair, orientation })
                })
                .collect::<Result<_, _>>()?,
        };
        pairs.filled()
    }

    /// Reads a table: lines of fields between commas, the first names the columns ([`COLUMNS`]), what follows a # is a note.
    pub fn from_table(text: &str) -> Result<Self, PairsError> {
        let lines =
            text.lines().enumerate().map(|(index, line)| (index + 1, line.split('#').next().unwrap_or("").trim()));
        let mut lines = lines.filter(|(_, line)| !line.is_empty());
        let (line, head) = lines.next().ok_or(PairsError::Empty)?;
        let column = |name: &str| COLUMNS.iter().position(|column| *column == name);
        let unknown = |name: &str| PairsError::Column { line, found: name.chars().take(40).collect() };
        let columns: Vec<usize> = head
            .split(',')
            .map(str::trim)
            .map(|name| column(name).ok_or_else(|| unknown(name)))
            .collect::<Result<_, _>>()?;
        for (index, name) in COLUMNS.into_iter().enumerate() {
            let count = columns.iter().filter(|column| **column == index).count();
            let is_needed = (1..7).contains(&index);
            if count > 1 || (is_needed && count == 0) {
                return Err(PairsError::Columns(name, count));
            }
        }
        let mut pairs = Self::default();
        lines.try_for_each(|(line, text)| pairs.add_row(line, &columns, text))?;
        pairs.filled()
    }

    fn add_row(&mut self, line: usize, columns: &[usize], text: &str) -> Result<(), PairsError> {
        let mut fields = [""; COLUMNS.len()];
        columns.iter().zip(text.split(',')).for_each(|(column, field)| fields[*column] = field.trim());
        let label = format!("line {line}");
        let number = |column: usize| number(&label, COLUMNS[column], fields[column].parse().ok(), fields[column]);
        let point = |first: usize| Ok(DVec3::new(number(first)?, number(first + 1)?, number(first + 2)?));
        let pair = Pair { tracker_m: point(1)?, world_m: point(4)?, label: label.clone() };
        match fields[0] {
            "" | "sensor" => self.sensor.push(pair),
            "eye" => {
                let orientation = unit(&label, [number(7)?, number(8)?, number(9)?, number(10)?])?;
                self.eye.push(EyePair { pair, orientation });
            }
            other => return Err(PairsError::What(line, other.chars().take(40).collect())),
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
        assert_eq!(Pairs::from_table("# nothing\n"), Err(PairsError::Empty));
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
