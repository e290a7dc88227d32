//! `[tracking]`: where a tracker stands and what it is.

use super::{RigError, check};
use core::fmt;
use core::str::FromStr;
use glam::{DAffine3, DMat3, DVec3};
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use thiserror::Error;

/// `[tracking]`. `praxi register` finds the first two.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Tracking {
    /// World metres from metres in the tracker's frame, three rows of four (or all twelve in a row): a rotation and where the tracker's
    /// origin stands. All sources share it.
    #[serde(deserialize_with = "super::three_rows")]
    pub world_from_tracker: [[f64; 4]; 3],
    /// From the sensor to the middle between the eyes, in the sensor's own frame, which turns with the head.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub sensor_to_eye_m: [f64; 3],
    /// What the tracker is: one or several, as `"opentrack:4242"`, `"freed:40000"`, `"patriot:/dev/ttyUSB0@115200"`. None: places come over
    /// HTTP only.
    #[serde(default, skip_serializing_if = "Vec::is_empty", deserialize_with = "one_or_several")]
    pub source: Vec<TrackerSource>,
    /// A head is at least and at most this far from the axis; other readings are refused.
    #[serde(default = "plausible_distance")]
    pub plausible_distance_m: [f64; 2],
    /// A head is at least and at most this high above the middle of the mirror; other readings are refused.
    #[serde(default = "plausible_height")]
    pub plausible_height_m: [f64; 2],
}

impl Default for Tracking {
    /// Places come in world metres, and from nobody.
    fn default() -> Self {
        Self {
            world_from_tracker: [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]],
            sensor_to_eye_m: [0.0; 3],
            source: Vec::new(),
            plausible_distance_m: plausible_distance(),
            plausible_height_m: plausible_height(),
        }
    }
}

/// Nearer than the first a head is in the machine; trackers reach hardly further than the second.
fn plausible_distance() -> [f64; 2] {
    [0.2, 6.0]
}

/// From somebody who sits on the floor by a high table to somebody who stands over a low one.
fn plausible_height() -> [f64; 2] {
    [-1.0, 2.0]
}

fn is_zero(offset: &[f64; 3]) -> bool {
    *offset == [0.0; 3]
}

fn one_or_several<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Vec<TrackerSource>, D::Error> {
    #[derive(Deserialize)]
    #[serde(untagged, expecting = "source must be a text or a list of texts")]
    enum Sources {
        One(String),
        Several(Vec<String>),
    }
    let texts = match Sources::deserialize(deserializer)? {
        Sources::One(text) => vec![text],
        Sources::Several(texts) => texts,
    };
    texts.iter().map(|text| text.parse().map_err(serde::de::Error::custom)).collect()
}

/// What sends a head's places. Its name is `opentrack:[ADDRESS:]PORT`, `freed:[ADDRESS:]PORT` or `patriot:PORT[@BAUD]`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum TrackerSource {
    /// opentrack's "UDP over network", received here.
    Opentrack(SocketAddr),
    /// FreeD over UDP, received here.
    FreeD(SocketAddr),
    /// A Polhemus Patriot on a serial port.
    Patriot {
        /// As the system calls it, as in /dev/ttyUSB0.
        port: String,
        /// Bits a second.
        baud: u32,
    },
}

/// Bits a second of a Patriot as it is delivered.
pub const PATRIOT_BAUD: u32 = 115_200;

/// Why a text is no source.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[error(
    "{0:?} is no tracker: must be opentrack:PORT, freed:PORT (with an address as in freed:0.0.0.0:40000 for other machines), or patriot:/dev/ttyUSB0@115200"
)]
pub struct SourceError(String);

impl FromStr for TrackerSource {
    type Err = SourceError;

    fn from_str(text: &str) -> Result<Self, SourceError> {
        let refused = || SourceError(text.into());
        let socket = |place: &str| {
            let loopback = |port: u16| SocketAddr::new(IpAddr::V4(Ipv4Addr::LOCALHOST), port);
            let address = place.parse().ok().or_else(|| place.parse().ok().map(loopback));
            address.filter(|address| address.port() != 0).ok_or_else(refused)
        };
        match text.split_once(':').ok_or_else(refused)? {
            ("opentrack", place) => socket(place).map(Self::Opentrack),
            ("freed", place) => socket(place).map(Self::FreeD),
            ("patriot", place) => {
                let (port, baud) = match place.rsplit_once('@') {
                    Some((port, baud)) => (port, baud.parse().map_err(|_| refused())?),
                    None => (place, PATRIOT_BAUD),
                };
                let is_possible = !port.is_empty() && (300..=50_000_000).contains(&baud);
                is_possible.then(|| Self::Patriot { port: port.into(), baud }).ok_or_else(refused)
            }
            _ => Err(refused()),
        }
    }
}

impl fmt::Display for TrackerSource {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut udp = |name, address: &SocketAddr| match address.ip() {
            IpAddr::V4(Ipv4Addr::LOCALHOST) => write!(out, "{name}:{}", address.port()),
            _ => write!(out, "{name}:{address}"),
        };
        match self {
            Self::Opentrack(address) => udp("opentrack", address),
            Self::FreeD(address) => udp("freed", address),
            Self::Patriot { port, baud } => write!(out, "patriot:{port}@{baud}"),
        }
    }
}

impl Serialize for TrackerSource {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

/// Sources that a rig may have.
const SOURCES_MAX: usize = 8;
/// How far the rotation may be from one: what is written with four digits is not exact.
const RIGID: f64 = 1e-3;

impl Tracking {
    pub(super) fn check(&self) -> Result<(), RigError> {
        let key = |name: &str| format!("tracking.{name}");
        let rows = &self.world_from_tracker;
        for row in rows {
            row[..3].iter().try_for_each(|value| check::within(key("world_from_tracker"), *value, -1.001..=1.001))?;
            check::within(key("world_from_tracker"), row[3], -100.0..=100.0)?;
        }
        let rotation = rotation(rows);
        let error = rotation.transpose() * rotation - DMat3::IDENTITY;
        if error.to_cols_array().iter().any(|value| value.abs() > RIGID) {
            return check::refuse(
                key("world_from_tracker"),
                format!("is no rigid motion: its left 3 × 3 must be a rotation within {RIGID}"),
            );
        }
        if rotation.determinant() < 0.0 {
            return check::refuse(
                key("world_from_tracker"),
                "mirrors: the tracker's frame must be right-handed, as the world is",
            );
        }
        self.sensor_to_eye_m
            .into_iter()
            .try_for_each(|value| check::within(key("sensor_to_eye_m"), value, -1.0..=1.0))?;
        for (name, range, allowed) in [
            ("plausible_distance_m", self.plausible_distance_m, 0.01..=100.0),
            ("plausible_height_m", self.plausible_height_m, -100.0..=100.0),
        ] {
            range.into_iter().try_for_each(|value| check::within(key(name), value, allowed.clone()))?;
            if range[0] >= range[1] {
                return check::refuse(key(name), format!("= {range:?}: must rise"));
            }
        }
        if self.source.len() > SOURCES_MAX {
            return check::refuse(key("source"), format!("names {}: must be at most {SOURCES_MAX}", self.source.len()));
        }
        Ok(())
    }

    /// World metres from metres in the tracker's frame, its rotation exact: the file's digits are rounded.
    pub fn motion(&self) -> DAffine3 {
        let rows = &self.world_from_tracker;
        let rotation = rotation(rows);
        let x = rotation.x_axis.normalize();
        let y = rotation.y_axis.reject_from_normalized(x).normalize();
        let origin = DVec3::new(rows[0][3], rows[1][3], rows[2][3]);
        DAffine3::from_mat3_translation(DMat3::from_cols(x, y, x.cross(y)), origin)
    }
}

fn rotation(rows: &[[f64; 4]; 3]) -> DMat3 {
    DMat3::from_cols_array_2d(&core::array::from_fn(|column| core::array::from_fn(|row| rows[row][column])))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rig::Rig;

    const REFERENCE: &str = include_str!("../../../host/rigs/reference.toml");
    /// The tracker's x, y, z (forward, right, down) are the world's -z, x, -y.
    const TRACKING: &str = "\n[tracking]\nworld_from_tracker = [[0.0, 1.0, 0.0, 0.5], [0.0, 0.0, -1.0, 1.2], [-1.0, 0.0, 0.0, -0.3]]\n\
        sensor_to_eye_m = [0.05, 0.0, 0.09]\nsource = \"opentrack:4242\"\n";

    fn with(from: &str, to: &str) -> Result<Rig, RigError> {
        let text = format!("{REFERENCE}{TRACKING}");
        let changed = text.replacen(from, to, 1);
        assert!(from == to || changed != text, "{from} is not in the file");
        Rig::parse(&changed)
    }

    #[test]
    fn a_tracker_stands_where_its_rows_say() {
        let rig = with("", "").unwrap();
        assert_eq!(Rig::parse(&toml::to_string(&rig).unwrap()).unwrap(), rig);
        let tracking = rig.tracking.unwrap();
        let world = tracking.motion().transform_point3(DVec3::new(1.0, 2.0, 3.0));
        assert!((world - DVec3::new(2.5, -1.8, -1.3)).length() < 1e-12, "{world}");
        assert_eq!(tracking.source, ["opentrack:4242".parse().unwrap()]);
        assert_eq!(Rig::parse(REFERENCE).unwrap().tracking, None);
        assert!(!toml::to_string(&Rig::parse(REFERENCE).unwrap()).unwrap().contains("tracking"));
    }

    #[test]
    fn rounded_rows_are_a_rotation() {
        let rounded = "[[0.8660, -0.5, 0.0, 0.0], [0.5, 0.8660, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]]";
        let rows = "[[0.0, 1.0, 0.0, 0.5], [0.0, 0.0, -1.0, 1.2], [-1.0, 0.0, 0.0, -0.3]]";
        let motion = with(rows, rounded).unwrap().tracking.unwrap().motion();
        assert!((motion.matrix3.determinant() - 1.0).abs() < 1e-12);
        let error = (motion.matrix3.transpose() * motion.matrix3 - DMat3::IDENTITY).to_cols_array();
        assert!(error.iter().all(|value| value.abs() < 1e-12), "{error:?}");
    }

    #[test]
    fn impossible_trackers_are_refused_by_name() {
        let nine = format!("{:?}", ["freed:40000"; 9]);
        for (from, to, expected) in [
            ("[0.0, 1.0, 0.0, 0.5]", "[0.0, 1.002, 0.0, 0.5]", "tracking.world_from_tracker = 1.002"),
            ("[0.0, 1.0, 0.0, 0.5]", "[0.0, 0.998, 0.0, 0.5]", "no rigid motion"),
            ("[0.0, 1.0, 0.0, 0.5]", "[0.1, 1.0, 0.0, 0.5]", "no rigid motion"),
            ("[0.0, 1.0, 0.0, 0.5]", "[0.0, -1.0, 0.0, 0.5]", "tracking.world_from_tracker mirrors"),
            ("[0.0, 1.0, 0.0, 0.5]", "[0.0, 1.0, 0.0, nan]", "tracking.world_from_tracker = NaN"),
            ("[0.0, 1.0, 0.0, 0.5], ", "", "three rows of four"),
            ("world_from_tracker", "world_from_sensor", "unknown field `world_from_sensor`"),
            (
                "sensor_to_eye_m = [0.05",
                "sensor_to_eye_m = [50.0",
                "tracking.sensor_to_eye_m = 50: must be from -1 to 1",
            ),
            ("\"opentrack:4242\"", "\"kinect:4242\"", "opentrack:PORT, freed:PORT"),
            ("\"opentrack:4242\"", "\"opentrack:0\"", "is no tracker"),
            ("\"opentrack:4242\"", "4242", "must be a text or a list"),
            ("\"opentrack:4242\"", "[\"opentrack:4242\", \"freed:0\"]", "\"freed:0\" is no tracker"),
            ("\"opentrack:4242\"", &nine, "tracking.source names 9: must be at most 8"),
            (
                "source",
                "plausible_height_m = [1.0, 0.0]\nsource",
                "tracking.plausible_height_m = [1.0, 0.0]: must rise",
            ),
            ("source", "plausible_distance_m = [0.0, 1.0]\nsource", "tracking.plausible_distance_m = 0: must be"),
        ] {
            let refused = with(from, to).unwrap_err().to_string();
            assert!(refused.contains(expected), "{to}: {refused}");
            assert_eq!(refused.lines().count(), 1, "{refused}");
        }
        let missing = format!("{REFERENCE}\n[tracking]\nsource = \"freed:40000\"\n");
        assert!(Rig::parse(&missing).unwrap_err().to_string().contains("world_from_tracker"));
    }

    #[test]
    fn sources_are_what_their_names_say() {
        for (text, printed) in [
            ("opentrack:4242", "opentrack:4242"),
            ("opentrack:127.0.0.1:4242", "opentrack:4242"),
            ("freed:0.0.0.0:40000", "freed:0.0.0.0:40000"),
            ("freed:[::]:40000", "freed:[::]:40000"),
            ("patriot:/dev/ttyUSB0", "patriot:/dev/ttyUSB0@115200"),
            ("patriot:COM3@9600", "patriot:COM3@9600"),
        ] {
            let source: TrackerSource = text.parse().unwrap();
            assert_eq!(source.to_string(), printed);
            assert_eq!(printed.parse(), Ok(source));
        }
        for text in [
            "",
            "opentrack",
            "opentrack:",
            "opentrack:99999",
            "freed:host:1",
            "patriot:",
            "patriot:/dev/x@",
            "patriot:/dev/x@7",
            "Freed:1",
        ] {
            assert_eq!(text.parse::<TrackerSource>(), Err(SourceError(text.into())));
        }
    }
}
