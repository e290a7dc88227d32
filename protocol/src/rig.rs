//! A rig as in `host/rigs/*.toml`: the hardware's geometry and rates, checked on load.
//!
//! World: right-handed, metres, origin at the centre of the mirror, +y up along the rotation axis, +z toward the front.
//! Units stand in the key names: angles are degrees in files and radians in code.

mod camera;
mod check;
pub mod curve;
mod tracking;

pub use camera::{Camera, Lens};
pub use tracking::{PATRIOT_BAUD, SourceError, TrackerSource, Tracking};

use crate::timing::{Direction, Rotation};
use crate::units::Turns;
use core::f64::consts::TAU;
use curve::{Spot, ViewingCurve};
use glam::DVec3;
use serde::{Deserialize, Deserializer, Serialize};
use std::collections::BTreeMap;
use thiserror::Error;

/// The hardware. Fields are the keys of the file. [`Rig::parse`] and [`Rig::checked`] give only possible rigs; methods may panic on
/// others.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Rig {
    /// What people call it.
    pub name: String,
    /// How a turn is cut.
    pub rotation: RotationKeys,
    /// The projector.
    pub projector: Projector,
    /// The mirror.
    pub mirror: Mirror,
    /// The curve on which perspective is correct when nobody is tracked.
    pub viewing: Viewing,
    /// Filters that faces name.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub filters: BTreeMap<String, Filter>,
    /// What follows viewers' heads, where anything does.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tracking: Option<Tracking>,
}

/// `[rotation]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RotationKeys {
    /// Binary images a turn.
    pub slices: u32,
    /// Binary images a frame: 24.
    pub planes_per_frame: u32,
    /// Frames a second.
    pub refresh_hz: f64,
    /// Mirror angle at the index pulse.
    #[serde(default)]
    pub phase_offset_deg: f64,
    /// Seen from above.
    #[serde(default)]
    pub direction: Direction,
}

/// `[projector]`: either a pinhole by its pose, or `matrix`, 3 × 4, from a calibration.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Projector {
    /// Nodal point P.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub position_m: Option<[f64; 3]>,
    /// A point on the optical axis.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub look_at_m: Option<[f64; 3]>,
    /// World direction toward which image rows increase.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub image_down: Option<[f64; 3]>,
    /// Focal length in pixels.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub focal_px: Option<f64>,
    /// Where the optical axis meets the image; the origin is its top left corner.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub principal_px: Option<[f64; 2]>,
    /// Homogeneous world metres to homogeneous pixels, three rows of four (or all twelve in a row); w > 0 in front.
    #[serde(default, skip_serializing_if = "Option::is_none", deserialize_with = "matrix_rows")]
    pub matrix: Option<[[f64; 4]; 3]>,
    /// k1, k2 of the radial polynomial, in units of the focal length.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub radial: [f64; 2],
    /// Image width.
    pub width_px: u32,
    /// Image height.
    pub height_px: u32,
    /// The channel shown first, second, third.
    #[serde(default)]
    pub plane_order: PlaneOrder,
    /// From the frame pulse to the first plane lit.
    #[serde(default)]
    pub frame_latency_us: f64,
}

fn is_zero(radial: &[f64; 2]) -> bool {
    *radial == [0.0; 2]
}

fn matrix_rows<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<[[f64; 4]; 3]>, D::Error> {
    three_rows(deserializer).map(Some)
}

/// Three rows of four numbers, or twelve numbers row by row.
fn three_rows<'de, D: Deserializer<'de>>(deserializer: D) -> Result<[[f64; 4]; 3], D::Error> {
    #[derive(Deserialize)]
    #[serde(untagged, expecting = "matrix must be three rows of four numbers, row major")]
    enum Matrix {
        Rows([[f64; 4]; 3]),
        Flat([f64; 12]),
    }
    Ok(match Matrix::deserialize(deserializer)? {
        Matrix::Rows(rows) => rows,
        Matrix::Flat(numbers) => core::array::from_fn(|row| core::array::from_fn(|column| numbers[row * 4 + column])),
    })
}

/// The order in which the projector shows the channels of a frame; least significant bit first in each.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[expect(missing_docs, reason = "the names say it")]
pub enum PlaneOrder {
    #[default]
    Rgb,
    Rbg,
    Grb,
    Gbr,
    Brg,
    Bgr,
}

impl PlaneOrder {
    /// The index (R 0, G 1, B 2) of the channel that is shown first, second, third.
    pub const fn channels(self) -> [usize; 3] {
        match self {
            Self::Rgb => [0, 1, 2],
            Self::Rbg => [0, 2, 1],
            Self::Grb => [1, 0, 2],
            Self::Gbr => [1, 2, 0],
            Self::Brg => [2, 0, 1],
            Self::Bgr => [2, 1, 0],
        }
    }
}

/// `[mirror]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Mirror {
    /// The faces, each calibrated on its own.
    pub face: Vec<Face>,
}

/// `[[mirror.face]]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Face {
    /// Azimuth of this face at mirror angle 0.
    pub azimuth_deg: f64,
    /// Between the face's normal and the rotation axis.
    pub tilt_deg: f64,
    /// Distance of the face's plane from the origin, along its normal.
    pub offset_m: f64,
    /// Along the horizontal direction in the face.
    pub width_m: f64,
    /// Extent up the slope, from the foot of the perpendicular from the origin.
    pub slope_span_m: [f64; 2],
    /// Half base of the triangular horizontal lobe.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub diffuser_hat_radius_deg: Option<f64>,
    /// A measured lobe in place of the triangle: pairs of degrees and weight, linear between, 0 outside.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub diffuser_lobe: Option<Vec<[f64; 2]>>,
    /// `"none"` or the name of a filter.
    #[serde(default = "no_filter")]
    pub filter: String,
}

fn no_filter() -> String {
    "none".into()
}

/// `[viewing]`: a circle by its distance and height, or viewers at infinity by their elevation.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Viewing {
    /// Radius of the circle about the axis.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub distance_m: Option<f64>,
    /// Height of the circle.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub height_m: Option<f64>,
    /// Elevation of viewers at infinity.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub elevation_deg: Option<f64>,
    /// Viewers through whom the circle is bent: see [`ViewingCurve`]. None at infinity.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub tracked: Vec<TrackedViewer>,
}

/// `[[viewing.tracked]]`: somebody who looks at the display; the middle of the eyes.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrackedViewer {
    /// From the front of the display toward its right.
    pub azimuth_deg: f64,
    /// From the axis.
    pub distance_m: f64,
    /// Above the middle of the mirror.
    pub height_m: f64,
}

impl TrackedViewer {
    /// World metres.
    pub fn place(&self) -> DVec3 {
        let Self { azimuth_deg, distance_m, height_m } = *self;
        Viewers::Circle { distance_m, height_m }.place(azimuth_deg.to_radians(), 0.0)
    }
}

/// Where viewers are.
#[derive(Clone, Debug, PartialEq)]
pub enum Viewers {
    /// On a circle about the axis.
    Circle {
        /// Its radius.
        distance_m: f64,
        /// Its height.
        height_m: f64,
    },
    /// On a curve about the axis, which passes through tracked viewers.
    Curve(ViewingCurve),
    /// At infinity, this many radians above the horizon.
    Infinity {
        /// Elevation in radians.
        elevation: f64,
    },
}

impl Viewers {
    /// The viewer at `azimuth` radians from the front toward the right, metres; one at infinity `far_m` metres away.
    pub fn place(&self, azimuth: f64, far_m: f64) -> DVec3 {
        let (distance_m, height_m) = match self {
            Self::Circle { distance_m, height_m } => (*distance_m, *height_m),
            Self::Curve(curve) => {
                let Spot { distance_m, height_m } = curve.spot(azimuth);
                (distance_m, height_m)
            }
            Self::Infinity { elevation } => (far_m * elevation.cos(), far_m * elevation.sin()),
        };
        let (sin, cos) = azimuth.sin_cos();
        DVec3::new(distance_m * sin, height_m, distance_m * cos)
    }
}

/// `[filters.NAME]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Filter {
    /// The filter's colour on white as `#RRGGBB`, sRGB.
    pub srgb: String,
}

impl Filter {
    /// In linear light, Rec. 709 primaries.
    pub fn linear(&self) -> [f64; 3] {
        let byte =
            |at: usize| self.srgb.get(at..at + 2).and_then(|hex| u8::from_str_radix(hex, 16).ok()).unwrap_or(255);
        [byte(1), byte(3), byte(5)].map(|value| {
            let value = f64::from(value) / 255.0;
            if value <= 0.04045 { value / 12.92 } else { ((value + 0.055) / 1.055).powf(2.4) }
        })
    }
}

/// A face's frame at one mirror angle, unit vectors in world space.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frame {
    /// Normal n, up and outward.
    pub normal: DVec3,
    /// Across e: horizontal, in the face, the diffuser's dominant axis.
    pub across: DVec3,
    /// Up the slope, s = n × e.
    pub slope: DVec3,
}

impl Face {
    /// The frame at mirror angle `theta` radians.
    pub fn frame(&self, theta: f64) -> Frame {
        let (sin_a, cos_a) = (theta + self.azimuth_deg.to_radians()).sin_cos();
        let (sin_t, cos_t) = self.tilt_deg.to_radians().sin_cos();
        let normal = DVec3::new(sin_a * sin_t, cos_t, cos_a * sin_t);
        let across = DVec3::new(cos_a, 0.0, -sin_a);
        Frame { normal, across, slope: normal.cross(across) }
    }

    /// The diffuser's lobe as points (radians, weight) with rising angle, linear between and 0 outside.
    pub fn lobe(&self) -> Vec<[f64; 2]> {
        match (&self.diffuser_lobe, self.diffuser_hat_radius_deg) {
            (Some(lobe), _) => lobe.iter().map(|[degrees, weight]| [degrees.to_radians(), *weight]).collect(),
            (None, radius) => {
                let radius = radius.unwrap_or(0.0).to_radians();
                vec![[-radius, 0.0], [0.0, 1.0], [radius, 0.0]]
            }
        }
    }
}

/// Why a rig is refused.
#[derive(Debug, Error)]
pub enum RigError {
    /// Not TOML, or not a rig's keys: line, key, and the parser's words.
    #[error("{0}")]
    Syntax(String),
    /// A value is impossible.
    #[error("{key} {problem}")]
    Value {
        /// The key with its table.
        key: String,
        /// What it is and what is allowed.
        problem: String,
    },
}

impl Rig {
    /// Reads and checks a rig file's text.
    pub fn parse(text: &str) -> Result<Self, RigError> {
        toml::from_str::<Self>(text).map_err(|error| RigError::Syntax(toml_problem(text, &error)))?.checked()
    }

    /// The rig, if it is possible: for one that came another way than through [`Rig::parse`].
    pub fn checked(self) -> Result<Self, RigError> {
        self.check().map(|()| self)
    }

    /// The turn in integers.
    pub fn rotation(&self) -> Rotation {
        check::rotation(&self.rotation).expect("a rig is checked when it is made")
    }

    /// The mirror angle, in radians, for which slice `slice` is rendered: the middle of its exposure,
    /// θ = 2π (k + ½) / slices + phase offset; minus where the mirror turns clockwise.
    pub fn slice_angle(&self, slice: u32) -> f64 {
        let progress = TAU * (f64::from(slice) + 0.5) / f64::from(self.rotation.slices);
        self.rotation.phase_offset_deg.to_radians()
            + match self.rotation.direction {
                Direction::CounterClockwise => progress,
                Direction::Clockwise => -progress,
            }
    }

    /// Turns a second.
    pub fn turns_per_second(&self) -> f64 {
        self.rotation.refresh_hz * f64::from(self.rotation.planes_per_frame) / f64::from(self.rotation.slices)
    }

    /// Seconds that one slice is on screen.
    pub fn slice_seconds(&self) -> f64 {
        1.0 / (self.rotation.refresh_hz * f64::from(self.rotation.planes_per_frame))
    }

    /// Where viewers are.
    pub fn viewers(&self) -> Viewers {
        match (self.viewing.elevation_deg, self.viewing.distance_m, self.viewing.height_m) {
            (Some(elevation), ..) => Viewers::Infinity { elevation: elevation.to_radians() },
            (None, distance, height) => {
                let (distance_m, height_m) = (distance.unwrap_or(1.0), height.unwrap_or(0.0));
                match self.viewing.tracked.as_slice() {
                    [] => Viewers::Circle { distance_m, height_m },
                    tracked => Viewers::Curve(ViewingCurve::new(Spot { distance_m, height_m }, tracked)),
                }
            }
        }
    }

    /// The same with nobody tracked.
    pub fn at_rest(&self) -> Self {
        let viewing = Viewing { tracked: Vec::new(), ..self.viewing.clone() };
        Self { viewing, ..self.clone() }
    }

    /// The colour of face `face`'s filter in linear light; white for `"none"`.
    pub fn filter_colour(&self, face: usize) -> [f64; 3] {
        self.filters.get(&self.mirror.face[face].filter).map_or([1.0; 3], Filter::linear)
    }
}

/// A TOML error on one line: the line's number, the key that stands there, and the parser's words, which name keys that are
/// unknown or missing.
pub fn toml_problem(text: &str, error: &toml::de::Error) -> String {
    let at = error.span().map_or(0, |span| span.start).min(text.len());
    let line = text.get(..at).unwrap_or("").matches('\n').count();
    let key = text.lines().nth(line).and_then(|line| line.split_once('=')).map(|(key, _)| key.trim());
    let message = error.message().split_whitespace().collect::<Vec<_>>().join(" ");
    match key.filter(|key| !message.contains(&format!("`{key}`"))) {
        Some(key) => format!("line {}: {key}: {message}", line + 1),
        None => format!("line {}: {message}", line + 1),
    }
}

impl RotationKeys {
    fn phase_offset(&self) -> Turns {
        Turns::from_turns(self.phase_offset_deg / 360.0)
    }
}

#[cfg(test)]
mod tests;
