//! The projector and the mirror's lean that make the clicks' squared errors least.

use super::dlt::{DltError, PAIRS_MIN, dlt};
use super::model::{Model, Parameter, in_world, residuals};
use super::{CalibrationError, Click, Place};
use glam::DVec2;
use levenberg_marquardt::{LeastSquaresProblem, LevenbergMarquardt};
use nalgebra::storage::Owned;
use nalgebra::{DMatrix, DVector, Dyn};
use protocol::rig::{Rig, RigError};

/// What is looked for besides the projector's place, direction, focal length and principal point.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Free {
    /// The tilt of each face that has clicks on it.
    pub tilt: bool,
    /// Its offset.
    pub offset: bool,
    /// The radial distortion.
    pub radial: bool,
}

impl Default for Free {
    fn default() -> Self {
        Self { tilt: true, offset: true, radial: false }
    }
}

impl Free {
    fn parameters(self, clicks: &[Click]) -> Vec<Parameter> {
        use Parameter::{Focal, Offset, Position, Principal, Radial, Tilt, Turn};
        let mut parameters: Vec<_> = (0..3).map(Turn).chain((0..3).map(Position)).collect();
        parameters.extend([Focal, Principal(0), Principal(1)]);
        if self.radial {
            parameters.extend([Radial(0), Radial(1)]);
        }
        let mut faces: Vec<_> = clicks.iter().filter_map(|click| face_of(click.place)).collect();
        faces.sort_unstable();
        faces.dedup();
        for face in faces {
            parameters.extend(self.tilt.then_some(Tilt(face)).into_iter().chain(self.offset.then_some(Offset(face))));
        }
        parameters
    }
}

fn face_of(place: Place) -> Option<usize> {
    match place {
        Place::World(_) => None,
        Place::Face(at) => Some(at.face),
    }
}

/// A change of one of these, relative to what the clicks tell best, that no click shows, is not told: of clicks in double precision.
const TOLD: f64 = 1e-8;

/// The best fit to some clicks.
#[derive(Clone, Debug)]
pub struct Fit {
    model: Model,
    parameters: Vec<Parameter>,
    /// u and v of each click less the model's.
    residuals: Vec<f64>,
    /// (JᵀJ)⁻¹: the parameters' covariance where clicks have a standard deviation of one pixel along u and along v.
    covariance: DMatrix<f64>,
    condition: f64,
}

/// A parameter with its standard deviation.
#[derive(Clone, Debug, PartialEq)]
pub struct Spread {
    /// What it is, with its unit.
    pub name: String,
    /// What was found, in that unit; `None` for turns, which are from where they are.
    pub value: Option<f64>,
    /// The standard deviation in that unit, where clicks have one of one pixel along u and along v.
    pub per_px: f64,
}

impl Fit {
    /// Fits `rig` to `clicks`.
    pub fn new(rig: &Rig, clicks: &[Click], free: Free) -> Result<Self, CalibrationError> {
        if clicks.len() < PAIRS_MIN {
            return Err(CalibrationError::TooFew(clicks.len()));
        }
        let start = start(rig, clicks)?;
        let parameters = free.parameters(clicks);
        if 2 * clicks.len() < parameters.len() {
            let more = parameters.len().div_ceil(2);
            return Err(CalibrationError::Undetermined(format!(
                "{} numbers, {more} clicks or more do",
                parameters.len()
            )));
        }
        let model = descend(start, &parameters, clicks)?;
        let found = Descent::new(model, &parameters, clicks);
        let (Some(residuals), Some(slopes)) = (found.residuals(), found.jacobian()) else {
            return Err(CalibrationError::Unexplained);
        };
        let (covariance, condition) = covariance(&slopes, &parameters)?;
        let (model, residuals) = (found.start, residuals.data.into());
        Ok(Self { model, parameters, residuals, covariance, condition })
    }

    /// `rig` with what was found.
    pub fn rig(&self, rig: &Rig) -> Result<Rig, RigError> {
        self.model.rig(rig)
    }

    /// How far click `click` is from where the fit has it, pixels.
    pub fn off_px(&self, click: usize) -> f64 {
        DVec2::new(self.residuals[2 * click], self.residuals[2 * click + 1]).length()
    }

    /// How far any click is from where the fit puts its fiducial, pixels; infinite where that is not in front of the projector.
    pub fn distance_px(&self, click: &Click) -> f64 {
        self.model.pixel(click.place).map_or(f64::INFINITY, |pixel| pixel.distance(click.pixel))
    }

    /// The root of the mean squared distance of the clicks from where the fit has them, pixels.
    pub fn rms_px(&self) -> f64 {
        (2.0 * self.squares() / self.residuals.len() as f64).sqrt()
    }

    /// The sum of the squared errors of the clicks, pixels squared.
    pub(super) fn squares(&self) -> f64 {
        self.residuals.iter().map(|residual| residual * residual).sum()
    }

    /// Numbers told by the clicks, u and v of each, beyond those that are looked for.
    pub fn spare(&self) -> usize {
        self.residuals.len() - self.parameters.len()
    }

    /// The clicks' standard deviation along u and along v by what is left of them, pixels; `None` where nothing is spare.
    pub fn click_px(&self) -> Option<f64> {
        (self.spare() > 0).then(|| (self.squares() / self.spare() as f64).sqrt())
    }

    /// How many times larger the least certain combination of parameters is than the most certain one, each in units of what it moves.
    pub fn condition(&self) -> f64 {
        self.condition
    }

    /// Each parameter's standard deviation: the bound of Cramér and Rao, which no unbiased calibration from these clicks is below.
    pub fn spreads(&self) -> Vec<Spread> {
        let each = self.parameters.iter().enumerate();
        each.map(|(index, parameter)| Spread {
            name: parameter.name(),
            value: self.model.value(*parameter).map(|value| parameter.shown(value)),
            per_px: parameter.shown(self.covariance[(index, index)].sqrt()),
        })
        .collect()
    }

    /// Each parameter of this fit less that of `other`, which has the same ones, in the units of [`Fit::spreads`].
    pub fn differences(&self, other: &Self) -> Vec<f64> {
        let moved = self.model.steps_from(&other.model, &self.parameters);
        self.parameters.iter().zip(moved).map(|(parameter, step)| parameter.shown(step)).collect()
    }

    /// The variance of a number whose derivatives by the parameters are `slopes`, where clicks have a variance of one pixel squared.
    pub(super) fn variance_of(&self, slopes: &[f64]) -> f64 {
        let slopes = DVector::from_column_slice(slopes);
        (slopes.transpose() * &self.covariance * &slopes)[(0, 0)].max(0.0)
    }

    /// The derivatives of each of `values` by the parameters.
    pub(super) fn slopes_of<const N: usize>(
        &self,
        values: impl Fn(&Model) -> Option<[f64; N]>,
    ) -> Option<[Vec<f64>; N]> {
        let mut slopes = core::array::from_fn(|_| Vec::with_capacity(self.parameters.len()));
        for parameter in &self.parameters {
            let at = |step: f64| values(&self.model.moved(&[*parameter], &[step])).map(Vec::from);
            let of_parameter = derivatives(*parameter, at)?;
            slopes.iter_mut().zip(of_parameter).for_each(|(slopes, slope)| slopes.push(slope));
        }
        Some(slopes)
    }
}

/// Derivatives of `values` by `parameter`, from its values a step before and a step after.
fn derivatives(parameter: Parameter, values: impl Fn(f64) -> Option<Vec<f64>>) -> Option<Vec<f64>> {
    let step = parameter.step();
    let (before, after) = (values(-step)?, values(step)?);
    Some(before.into_iter().zip(after).map(|(before, after)| (after - before) / (2.0 * step)).collect())
}

/// By the direct linear transform, with the faces as the rig has them.
fn start(rig: &Rig, clicks: &[Click]) -> Result<Model, CalibrationError> {
    let pairs: Vec<_> = clicks.iter().map(|click| (in_world(&rig.mirror.face, click.place), click.pixel)).collect();
    match dlt(&pairs) {
        Ok(pinhole) => Ok(Model::new(&pinhole, rig)),
        Err(DltError::Coplanar(aside)) => Err(CalibrationError::Coplanar { off_mm: aside * 1e3 }),
        Err(DltError::Mirrored) => Err(CalibrationError::Mirrored),
        Err(DltError::None) => Err(CalibrationError::Unexplained),
    }
}

/// (JᵀJ)⁻¹ and its condition, by the singular values of J with columns of length 1.
fn covariance(slopes: &DMatrix<f64>, parameters: &[Parameter]) -> Result<(DMatrix<f64>, f64), CalibrationError> {
    let lengths: Vec<f64> = slopes.column_iter().map(|column| column.norm()).collect();
    let mut scaled = slopes.clone();
    for (mut column, length) in scaled.column_iter_mut().zip(&lengths) {
        column /= length.max(f64::MIN_POSITIVE);
    }
    let svd = scaled.svd(false, true);
    let right = svd.v_t.expect("asked for");
    let (most, least) = (svd.singular_values.max(), svd.singular_values.min());
    if least <= TOLD * most {
        let row = right.row(svd.singular_values.imin());
        let unseen = (0..parameters.len()).filter(|index| row[*index].abs() > 0.3);
        let names: Vec<_> = unseen.map(|index| parameters[index].name()).collect();
        return Err(CalibrationError::Undetermined(names.join(" from ")));
    }
    let count = parameters.len();
    let covariance = DMatrix::from_fn(count, count, |a, b| {
        let terms = svd.singular_values.iter().enumerate();
        terms.map(|(k, value)| right[(k, a)] * right[(k, b)] / (value * value)).sum::<f64>() / (lengths[a] * lengths[b])
    });
    Ok((covariance, most / least))
}

/// Levenberg and Marquardt's method from `start`.
fn descend(start: Model, parameters: &[Parameter], clicks: &[Click]) -> Result<Model, CalibrationError> {
    let (descent, report) =
        LevenbergMarquardt::new().with_patience(200).minimize(Descent::new(start, parameters, clicks));
    let is_end = report.termination.was_successful() && report.objective_function.is_finite();
    is_end.then(|| descent.model()).ok_or(CalibrationError::Unexplained)
}

struct Descent<'a> {
    start: Model,
    parameters: &'a [Parameter],
    clicks: &'a [Click],
    steps: DVector<f64>,
}

impl<'a> Descent<'a> {
    fn new(start: Model, parameters: &'a [Parameter], clicks: &'a [Click]) -> Self {
        Self { start, parameters, clicks, steps: DVector::zeros(parameters.len()) }
    }

    fn model(&self) -> Model {
        self.start.moved(self.parameters, self.steps.as_slice())
    }
}

impl LeastSquaresProblem<f64, Dyn, Dyn> for Descent<'_> {
    type ResidualStorage = Owned<f64, Dyn>;
    type JacobianStorage = Owned<f64, Dyn, Dyn>;
    type ParameterStorage = Owned<f64, Dyn>;

    fn set_params(&mut self, steps: &DVector<f64>) {
        self.steps.copy_from(steps);
    }

    fn params(&self) -> DVector<f64> {
        self.steps.clone()
    }

    fn residuals(&self) -> Option<DVector<f64>> {
        residuals(&self.model(), self.clicks).map(DVector::from_vec)
    }

    fn jacobian(&self) -> Option<DMatrix<f64>> {
        let mut slopes = DMatrix::zeros(2 * self.clicks.len(), self.parameters.len());
        for (index, parameter) in self.parameters.iter().enumerate() {
            let at = |step: f64| {
                let mut steps = self.steps.clone();
                steps[index] += step;
                residuals(&self.start.moved(self.parameters, steps.as_slice()), self.clicks)
            };
            slopes.column_mut(index).copy_from_slice(&derivatives(*parameter, at)?);
        }
        Some(slopes)
    }
}
