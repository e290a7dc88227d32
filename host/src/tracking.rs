//! Viewers' heads: what trackers send, where the eyes will be when the light leaves, and how a tracker stands in the world.
//!
//! Bytes become a [`Reading`] ([`opentrack`], [`freed`], [`patriot`]; pure), readings become [`Viewers`] (a [`filter`] each, every time
//! given from outside), and [`source`] has the threads that wait for bytes. [`register`] finds where the tracker stands.

pub mod filter;
pub mod freed;
pub mod opentrack;
pub mod patriot;
pub mod register;
pub mod source;
pub mod viewers;

use glam::{DQuat, DVec3};
use serde::{Deserialize, Serialize};
use std::time::Duration;
use thiserror::Error;

pub use viewers::{Refusal, Viewer, Viewers};

/// A sensor's place, in the tracker's own frame: right-handed, metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// Which sensor: a Patriot's station, a FreeD camera's number; 0 where a source has one only.
    pub sensor: u8,
    /// Where it is.
    pub position_m: DVec3,
    /// The tracker's directions from the sensor's: a unit quaternion.
    pub orientation: DQuat,
}

/// A pose and when it came.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Reading {
    /// The viewer: the source's place in the rig's list times 256, and the sensor.
    pub viewer: u16,
    /// Where the sensor is, in the tracker's frame.
    pub position_m: DVec3,
    /// The tracker's directions from the sensor's.
    pub orientation: DQuat,
    /// When its last byte arrived, by the clock that everything else uses.
    pub at: Duration,
}

impl Reading {
    /// What sensor `pose` of the rig's source `source` says at `at`.
    pub fn new(source: u8, pose: &Pose, at: Duration) -> Self {
        let Pose { sensor, position_m, orientation } = *pose;
        Self { viewer: u16::from(source) << 8 | u16::from(sensor), position_m, orientation, at }
    }
}

/// Why bytes are no pose.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum ParseError {
    /// More or fewer bytes than such a packet has.
    #[error("{found} bytes: {format} has {expected}")]
    Length {
        /// The format.
        format: &'static str,
        /// Bytes of a packet.
        expected: usize,
        /// Bytes that came.
        found: usize,
    },
    /// Another kind of packet.
    #[error("packet of type {0:#04x}: only D1, a camera's place, is read")]
    Kind(u8),
    /// Bits changed on the way.
    #[error("checksum {found:#04x}: the bytes' own is {expected:#04x}")]
    Checksum {
        /// By the bytes.
        expected: u8,
        /// As sent.
        found: u8,
    },
    /// A line that is no record.
    #[error("{0}: must be a station and six numbers, x y z azimuth elevation roll")]
    Line(String),
    /// A line without an end.
    #[error("more than {0} bytes without an end of line")]
    Endless(usize),
    /// The tracker itself doubts the reading.
    #[error("the tracker says error {0:?} of station {1}")]
    Doubted(char, u8),
    /// No number, or one that no head reaches.
    #[error("{field} = {value}: must be from -{limit} to {limit}")]
    Absurd {
        /// Which.
        field: &'static str,
        /// In the tracker's units.
        value: f64,
        /// What is allowed, in the same units.
        limit: f64,
    },
}

/// `values` named `fields`, if each is a number of at most `limit`.
fn sensible<const N: usize>(fields: [&'static str; N], values: [f64; N], limit: f64) -> Result<[f64; N], ParseError> {
    for (field, value) in fields.into_iter().zip(values) {
        // Written so that a NaN is refused.
        if !(-limit..=limit).contains(&value) {
            return Err(ParseError::Absurd { field, value, limit });
        }
    }
    Ok(values)
}

/// No tracker reaches that far: 100 m.
const POSITION_M_MAX: f64 = 100.0;
/// Angles beyond a turn either way are no tracker's.
const ANGLE_DEG_MAX: f64 = 360.0;
