//! Where the projector stands and how the mirror leans, from clicks: the projector's pixels that light fiducials of known places.
//!
//! The patent's procedure (columns 6–7): fiducials on the mirror, clicked with the mirror at 0° and at 180°, eight corners of a box in
//! space. A direct linear transform of normalised coordinates (Hartley and Zisserman, Multiple View Geometry, 4.4 and 7.1) gives a
//! start; Levenberg and Marquardt's method then makes the clicks' squared errors least, over the projector's pose and focal length, its
//! principal point, and each clicked face's tilt and offset. The turn's phase is the encoder's to tell: clicks cannot tell it from the
//! projector's yaw.

pub mod clicks;
mod dlt;
mod fit;
pub mod meaning;
mod model;
mod outlier;
mod phase;
pub mod simulated;

pub use fit::{Fit, Free, Spread};
pub use phase::Phase;

use glam::{DVec2, DVec3};
use protocol::rig::{Rig, RigError};
use thiserror::Error;

/// Clicks that a projector is found from.
pub const CLICKS_MIN: usize = dlt::PAIRS_MIN;

/// Where a fiducial is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Place {
    /// In the world, metres.
    World(DVec3),
    /// On a face of the mirror.
    Face(OnFace),
}

/// A fiducial on a face of the mirror at one of its stops.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OnFace {
    /// Which face.
    pub face: usize,
    /// Metres across and up the slope, from the foot of the perpendicular from the origin on the face's plane.
    pub at_m: DVec2,
    /// The azimuth toward which the face looks at this stop, degrees.
    pub stop_deg: f64,
    /// What the encoder says there: degrees since the index, growing as the mirror turns.
    pub encoder_deg: Option<f64>,
}

/// A fiducial and the pixel that lights it.
#[derive(Clone, Debug, PartialEq)]
pub struct Click {
    /// What it is called where it came from, as in "line 4".
    pub label: String,
    /// Where the fiducial is.
    pub place: Place,
    /// The projector's pixel; (0, 0) is the image's top left corner, centres of pixels are at halves.
    pub pixel: DVec2,
}

/// What was found.
#[derive(Clone, Debug)]
pub struct Calibration {
    /// The rig that was given, with what was found in it.
    pub rig: Rig,
    /// How it fits.
    pub fit: Fit,
    /// The clicks that it was found from: those given less the wrong ones.
    pub clicks: Vec<Click>,
    /// Clicks that the others contradict.
    pub wrong: Vec<Wrong>,
    /// What the encoder told.
    pub phase: Phase,
}

/// A click that was left out.
#[derive(Clone, Debug, PartialEq)]
pub struct Wrong {
    /// The click.
    pub click: Click,
    /// How far it is from where the others put its fiducial, pixels.
    pub off_px: f64,
}

/// Why clicks give no calibration.
#[derive(Debug, Error)]
#[expect(missing_docs, reason = "the messages say it")]
pub enum CalibrationError {
    #[error("{0} clicks: must be at least {CLICKS_MIN}, not all in one plane")]
    TooFew(usize),
    #[error("face {face} of {label}: the rig has {faces}, counted from 0")]
    NoFace { label: String, face: usize, faces: usize },
    #[error(
        "all fiducials lie within {off_mm:.1} mm of one plane: click them at a second stop too, or add some well above or below it"
    )]
    Coplanar { off_mm: f64 },
    #[error(
        "the clicks are those of a mirrored image: u must grow to the right and v downward as the projector sees it, and across to the \
         right of who looks at the face; look for swapped columns or a wrong sign"
    )]
    Mirrored,
    #[error("the clicks do not tell {0}: add fiducials elsewhere, or keep it as the rig has it")]
    Undetermined(String),
    #[error("no projector explains the clicks: look for swapped columns, stops or units (metres, pixels)")]
    Unexplained,
    #[error(
        "the clicks disagree by {off_px:.2} px RMS, allowed are {allowed_px}: the worst is {worst}, {worst_px:.1} px off"
    )]
    Loose { off_px: f64, allowed_px: f64, worst: String, worst_px: f64 },
    #[error("one of {0} is wrong, and the others do not say which: click them again, or more fiducials")]
    OneOf(String),
    #[error("some clicks of face {0} come with an encoder's angle and some without: all must, or none")]
    HalfEncoded(usize),
    #[error(
        "the encoder puts the stops of face {face} {off_deg:.2} degrees apart from where they are said to be: must agree within {allowed_deg}"
    )]
    Stops { face: usize, off_deg: f64, allowed_deg: f64 },
    #[error("what the clicks say is no possible rig: {0}")]
    Rig(#[from] RigError),
}

/// Finds the projector of `rig`, and what `free` names besides, from `clicks`, which may disagree by `allowed_px` RMS once those that the
/// others contradict are left out. `rig` gives what the clicks do not: sizes, rates, where viewers are.
pub fn calibrate(rig: &Rig, clicks: &[Click], free: Free, allowed_px: f64) -> Result<Calibration, CalibrationError> {
    let faces = rig.mirror.face.len();
    for click in clicks {
        if let Place::Face(OnFace { face, .. }) = click.place
            && face >= faces
        {
            return Err(CalibrationError::NoFace { label: click.label.clone(), face, faces });
        }
    }
    let phase = Phase::of(rig, clicks)?;
    let rig = phase.applied(rig);
    let clicks: Vec<_> = clicks.iter().map(|click| phase::turned(&rig, click)).collect();
    let (fit, clicks, wrong) = outlier::fit(&rig, &clicks, free)?;
    let off_px = fit.rms_px();
    if off_px > allowed_px {
        let worst = (0..clicks.len()).max_by(|a, b| fit.off_px(*a).total_cmp(&fit.off_px(*b))).unwrap_or(0);
        let (worst, worst_px) = (clicks[worst].label.clone(), fit.off_px(worst));
        return Err(CalibrationError::Loose { off_px, allowed_px, worst, worst_px });
    }
    Ok(Calibration { rig: fit.rig(&rig)?, fit, clicks, wrong, phase })
}

#[cfg(test)]
mod tests;
