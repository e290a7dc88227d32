//! Where a tracker stands: the rigid motion that takes its places to known places in the world, and where the eye is from the sensor.
//!
//! Horn, "Closed-form solution of absolute orientation using unit quaternions" (J. Opt. Soc. Am. A 4, 1987): the rotation is the eigenvector of
//! the largest eigenvalue of a symmetric 4 × 4 matrix made of the pairs' covariance, and so never a reflection. What does not fit is told by its
//! name: points on a line, a mirrored frame, another unit of length, one wrong pair.

pub mod eigen;
pub mod mean;
pub mod pairs;

use eigen::eigen;
use glam::{DAffine3, DMat3, DQuat, DVec3};
use thiserror::Error;

/// A place as the tracker tells it and as it was measured in the world.
#[derive(Clone, Debug, PartialEq)]
pub struct Pair {
    /// What it is called where it came from, as in "line 4".
    pub label: String,
    /// The sensor's place in the tracker's frame, metres.
    pub tracker_m: DVec3,
    /// The same place in the world, metres.
    pub world_m: DVec3,
}

/// A head's sensor while its eye is at a known place.
#[derive(Clone, Debug, PartialEq)]
pub struct EyePair {
    /// The sensor's place in the tracker's frame, and the eye's in the world.
    pub pair: Pair,
    /// The tracker's directions from the sensor's.
    pub orientation: DQuat,
}

/// What was found.
#[derive(Clone, Debug, PartialEq)]
pub struct Registration {
    /// World metres from metres in the tracker's frame.
    pub world_from_tracker: DAffine3,
    /// How far each pair is off, metres.
    pub residuals_m: Vec<f64>,
    /// How much larger distances are in the world than in the tracker's frame: 1 but for noise.
    pub scale: f64,
    /// All points lie in one plane, nearly: a mirrored tracker fits as well as a right one.
    pub is_flat: bool,
    /// Where the eye is, if readings for that are there.
    pub eye: Option<EyeOffset>,
}

/// From the sensor to the eye.
#[derive(Clone, Debug, PartialEq)]
pub struct EyeOffset {
    /// In the sensor's own frame, metres.
    pub sensor_to_eye_m: DVec3,
    /// How far each reading's eye is off, metres.
    pub residuals_m: Vec<f64>,
}

/// Why a tracker's place cannot be found.
#[derive(Clone, Debug, PartialEq, Error)]
#[expect(missing_docs, reason = "the messages say it")]
pub enum RegisterError {
    #[error("{0} pairs of the sensor's places: must be at least {PAIRS_MIN}, not on one line")]
    TooFew(usize),
    #[error("the {whose} points lie within {off_mm:.1} mm of one line: at least one must be well aside")]
    Collinear { whose: &'static str, off_mm: f64 },
    #[error(
        "the tracker's frame is mirrored ({mirrored_mm:.1} mm RMS; as it is {off_mm:.0} mm): invert one axis where the tracker is set up"
    )]
    Mirrored { off_mm: f64, mirrored_mm: f64 },
    #[error("distances in the world are {0:.4} times the tracker's: both must be metres")]
    Scale(f64),
    #[error(
        "{label} is {off_mm:.0} mm off, the others agree within {rest_mm:.1} mm RMS: measure it again or leave it out"
    )]
    Outlier { label: String, off_mm: f64, rest_mm: f64 },
    #[error("the pairs disagree by {off_mm:.1} mm RMS, allowed are {allowed_mm:.1}: the worst is {worst}")]
    Loose { off_mm: f64, allowed_mm: f64, worst: String },
    #[error("{0} readings with the eye at a known point: must be at least {EYES_MIN}, the head turned in between")]
    EyeTooFew(usize),
    #[error(
        "the head turned by {0:.0} degrees only while the eye was at its point: turn it by {EYES_TURN_DEG:.0} and more"
    )]
    EyeStill(f64),
    #[error(
        "the eye's place from the sensor differs by {off_mm:.1} mm RMS between readings, allowed are {allowed_mm:.1} (the worst is {worst}): \
         keep the eye at its point while the head turns; orientations must turn the sensor's directions to the tracker's"
    )]
    EyeLoose { off_mm: f64, allowed_mm: f64, worst: String },
}

/// Pairs that give a rotation and a translation.
pub const PAIRS_MIN: usize = 3;
/// Readings of which a wrong orientation or a wandering eye shows.
pub const EYES_MIN: usize = 3;
/// A turn by which the same shows, degrees.
const EYES_TURN_DEG: f64 = 20.0;
/// Points nearer than this to a line, RMS, are on it, metres.
const ASIDE_M: f64 = 0.01;
/// And those nearer than this share of their spread along it.
const ASIDE_SHARE: f64 = 0.03;
/// A pair is wrong that is off by so much, metres,
const WRONG_M: f64 = 0.01;
/// and by so many times the others' noise.
const WRONG_TIMES: f64 = 6.0;

/// Finds where the tracker stands from `pairs`, and where the eye is from `eyes` unless there are none. Pairs may disagree by `allowed_m` RMS.
pub fn register(pairs: &[Pair], eyes: &[EyePair], allowed_m: f64) -> Result<Registration, RegisterError> {
    if pairs.len() < PAIRS_MIN {
        return Err(RegisterError::TooFew(pairs.len()));
    }
    let points: Vec<Points> = pairs.iter().map(|pair| [pair.tracker_m, pair.world_m]).collect();
    let [tracker, world] = [0, 1].map(|frame| Spread::of(&points, frame));
    for (whose, spread) in [("world", &world), ("tracker's", &tracker)] {
        if spread.along[1] < ASIDE_M.max(ASIDE_SHARE * spread.along[0]) {
            return Err(RegisterError::Collinear { whose, off_mm: spread.along[1] * 1e3 });
        }
    }
    let motion = fit(&points);
    let residuals_m = residuals(&points, &motion);
    let is_flat = world.along[2] < ASIDE_M.max(ASIDE_SHARE * world.along[0]);
    let scale = world.size() / tracker.size();
    let loose = (rms(&residuals_m) > allowed_m).then(|| misfit(&points, scale, allowed_m));
    match (loose, outlier(&points, allowed_m)) {
        (Some(Misfit::Mirrored(error_m)), _) => {
            return Err(RegisterError::Mirrored { off_mm: rms(&residuals_m) * 1e3, mirrored_mm: error_m * 1e3 });
        }
        (Some(Misfit::Scaled), _) => return Err(RegisterError::Scale(scale)),
        (_, Some(wrong)) => {
            let label = pairs[wrong.index].label.clone();
            return Err(RegisterError::Outlier { label, off_mm: wrong.off_m * 1e3, rest_mm: wrong.rest_m * 1e3 });
        }
        (Some(Misfit::Other), None) => {
            let (off_mm, allowed_mm) = (rms(&residuals_m) * 1e3, allowed_m * 1e3);
            return Err(RegisterError::Loose { off_mm, allowed_mm, worst: pairs[worst(&residuals_m)].label.clone() });
        }
        (None, None) => {}
    }
    let eye = (!eyes.is_empty()).then(|| eye_offset(eyes, &motion, allowed_m)).transpose()?;
    Ok(Registration { world_from_tracker: motion, residuals_m, scale, is_flat, eye })
}

/// A place in the tracker's frame and in the world, metres.
type Points = [DVec3; 2];

/// How points lie about their middle.
struct Spread {
    /// RMS along their three principal directions, falling, metres.
    along: [f64; 3],
}

impl Spread {
    fn of(points: &[Points], frame: usize) -> Self {
        let middle = middle(points)[frame];
        let offsets = points.iter().map(|point| point[frame] - middle);
        let scatter = offsets.map(|offset| outer(offset, offset)).fold(DMat3::ZERO, |sum, one| sum + one);
        let (variances, _) = eigen((scatter * (1.0 / points.len() as f64)).to_cols_array_2d());
        Self { along: variances.map(|variance| variance.max(0.0).sqrt()) }
    }

    fn size(&self) -> f64 {
        DVec3::from(self.along).length()
    }
}

fn middle(points: &[Points]) -> Points {
    [0, 1].map(|frame| points.iter().map(|point| point[frame]).sum::<DVec3>() / points.len() as f64)
}

/// a bᵀ.
fn outer(a: DVec3, b: DVec3) -> DMat3 {
    DMat3::from_cols(a * b.x, a * b.y, a * b.z)
}

/// The rigid motion that takes the first of each point nearest to the second, by least squares. Horn's S is Σ a bᵀ, row by a.
fn fit(points: &[Points]) -> DAffine3 {
    let [from, to] = middle(points);
    let covariance = points.iter().fold(DMat3::ZERO, |sum, [a, b]| sum + outer(*a - from, *b - to));
    let [x, y, z] = [0, 1, 2].map(|row| covariance.row(row).to_array());
    let quaternions = [
        [x[0] + y[1] + z[2], y[2] - z[1], z[0] - x[2], x[1] - y[0]],
        [y[2] - z[1], x[0] - y[1] - z[2], x[1] + y[0], z[0] + x[2]],
        [z[0] - x[2], x[1] + y[0], y[1] - x[0] - z[2], y[2] + z[1]],
        [x[1] - y[0], z[0] + x[2], y[2] + z[1], z[2] - x[0] - y[1]],
    ];
    let [w, x, y, z] = eigen(quaternions).1[0];
    let rotation = DQuat::from_xyzw(x, y, z, w).normalize();
    DAffine3::from_rotation_translation(rotation, to - rotation * from)
}

fn residuals(points: &[Points], motion: &DAffine3) -> Vec<f64> {
    points.iter().map(|[tracker, world]| motion.transform_point3(*tracker).distance(*world)).collect()
}

fn rms(residuals: &[f64]) -> f64 {
    (residuals.iter().map(|residual| residual * residual).sum::<f64>() / residuals.len() as f64).sqrt()
}

fn worst(residuals: &[f64]) -> usize {
    (0..residuals.len()).max_by(|a, b| residuals[*a].total_cmp(&residuals[*b])).unwrap_or(0)
}

/// What is wrong with all of the pairs.
enum Misfit {
    /// They fit mirrored, with this error.
    Mirrored(f64),
    /// They fit in another unit.
    Scaled,
    /// Neither.
    Other,
}

fn misfit(points: &[Points], scale: f64, allowed_m: f64) -> Misfit {
    let error = |scale: DVec3| {
        let scaled: Vec<Points> = points.iter().map(|[tracker, world]| [*tracker * scale, *world]).collect();
        rms(&residuals(&scaled, &fit(&scaled)))
    };
    let mirrored = error(DVec3::new(1.0, 1.0, -1.0));
    if mirrored <= allowed_m {
        Misfit::Mirrored(mirrored)
    } else if error(DVec3::splat(scale)) <= allowed_m {
        Misfit::Scaled
    } else {
        Misfit::Other
    }
}

/// One pair that is wrong among others that agree.
struct Outlier {
    index: usize,
    off_m: f64,
    rest_m: f64,
}

/// The pair without which the others agree best, if they do and it is far from what they say.
fn outlier(points: &[Points], allowed_m: f64) -> Option<Outlier> {
    let without = |index: usize| {
        let rest: Vec<Points> =
            points.iter().enumerate().filter(|(at, _)| *at != index).map(|(_, point)| *point).collect();
        let is_line = Spread::of(&rest, 1).along[1] < ASIDE_M;
        let motion = fit(&rest);
        let off_m = residuals(&points[index..=index], &motion)[0];
        (!is_line).then(|| Outlier { index, off_m, rest_m: rms(&residuals(&rest, &motion)) })
    };
    // Three pairs have three numbers more than a rigid motion; two have none.
    let candidates = (0..points.len()).filter(|_| points.len() > PAIRS_MIN).filter_map(without);
    let best = candidates.min_by(|a, b| a.rest_m.total_cmp(&b.rest_m))?;
    // Noise has worn off in the fit: 3 n numbers less 6.
    let count = 3.0 * (points.len() - 1) as f64;
    let noise_m = best.rest_m * (count / (count - 6.0)).sqrt();
    (best.rest_m <= allowed_m && best.off_m > WRONG_M.max(WRONG_TIMES * noise_m)).then_some(best)
}

/// Where the eye is from the sensor: what q⁻¹ (T⁻¹ w - p) is in the mean, the least squares of T (p + q s) = w, as motions keep lengths.
fn eye_offset(eyes: &[EyePair], motion: &DAffine3, allowed_m: f64) -> Result<EyeOffset, RegisterError> {
    if eyes.len() < EYES_MIN {
        return Err(RegisterError::EyeTooFew(eyes.len()));
    }
    let from_first = |eye: &EyePair| eye.orientation.angle_between(eyes[0].orientation).to_degrees();
    let turned = eyes.iter().map(from_first).fold(0.0, f64::max);
    if turned < EYES_TURN_DEG {
        return Err(RegisterError::EyeStill(turned));
    }
    let tracker_from_world = motion.inverse();
    let offset = |EyePair { pair, orientation }: &EyePair| {
        orientation.inverse() * (tracker_from_world.transform_point3(pair.world_m) - pair.tracker_m)
    };
    let offsets: Vec<DVec3> = eyes.iter().map(offset).collect();
    let sensor_to_eye_m = offsets.iter().sum::<DVec3>() / offsets.len() as f64;
    let residuals_m: Vec<f64> = offsets.iter().map(|offset| offset.distance(sensor_to_eye_m)).collect();
    if rms(&residuals_m) > allowed_m {
        let (off_mm, allowed_mm) = (rms(&residuals_m) * 1e3, allowed_m * 1e3);
        return Err(RegisterError::EyeLoose {
            off_mm,
            allowed_mm,
            worst: eyes[worst(&residuals_m)].pair.label.clone(),
        });
    }
    Ok(EyeOffset { sensor_to_eye_m, residuals_m })
}

#[cfg(test)]
mod tests;
