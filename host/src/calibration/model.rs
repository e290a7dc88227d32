//! What clicks depend on, as a vector of numbers, and what they would be.

use super::dlt::Pinhole;
use super::{Click, Place};
use glam::{DMat3, DQuat, DVec2, DVec3};
use protocol::rig::{Face, Rig, RigError};

/// A projector with square pixels, which every digital mirror has, and the lean of the mirror's faces.
#[derive(Clone, Debug)]
pub struct Model {
    /// Rows: right, down and forward of the projector, unit vectors of the world.
    axes: DMat3,
    position: DVec3,
    focal_px: f64,
    principal_px: DVec2,
    radial: [f64; 2],
    /// The rig's, with what was found of their tilts and offsets.
    faces: Vec<Face>,
}

/// One number of a [`Model`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Parameter {
    /// About the projector's right, down and forward.
    Turn(usize),
    /// The nodal point's x, y, z.
    Position(usize),
    Focal,
    /// u, v.
    Principal(usize),
    /// k1, k2.
    Radial(usize),
    Tilt(usize),
    Offset(usize),
}

impl Parameter {
    /// What people call it, with the unit of [`Parameter::shown`].
    pub fn name(self) -> String {
        match self {
            Self::Turn(axis) => format!("projector turned about its {} (deg)", ["right", "down", "axis"][axis]),
            Self::Position(axis) => format!("projector {} (mm)", ["x", "y", "z"][axis]),
            Self::Focal => "focal length (px)".into(),
            Self::Principal(axis) => format!("principal {} (px)", ["u", "v"][axis]),
            Self::Radial(term) => format!("radial k{}", term + 1),
            Self::Tilt(face) => format!("tilt of face {face} (deg)"),
            Self::Offset(face) => format!("offset of face {face} (mm)"),
        }
    }

    /// A number of the model's units (radians, metres, pixels) in those of [`Parameter::name`].
    pub fn shown(self, value: f64) -> f64 {
        match self {
            Self::Turn(_) | Self::Tilt(_) => value.to_degrees(),
            Self::Position(_) | Self::Offset(_) => value * 1e3,
            Self::Focal | Self::Principal(_) | Self::Radial(_) => value,
        }
    }

    /// A step whose effect on clicks is far above rounding, and over which they bend little.
    pub fn step(self) -> f64 {
        match self {
            Self::Turn(_) | Self::Position(_) | Self::Tilt(_) | Self::Offset(_) => 1e-5,
            Self::Focal | Self::Principal(_) => 1e-2,
            Self::Radial(_) => 1e-3,
        }
    }
}

impl Model {
    /// The projector that is nearest to `pinhole`, over the faces of `rig`.
    pub fn new(pinhole: &Pinhole, rig: &Rig) -> Self {
        let row = |index| pinhole.matrix.row(index);
        let forward = row(2);
        let principal_px = DVec2::new(row(0).dot(forward), row(1).dot(forward));
        let [right, down] = [row(0) - principal_px.x * forward, row(1) - principal_px.y * forward];
        let focal_px = (right.length() * down.length()).sqrt();
        let down = (down - down.project_onto(right)).normalize();
        let axes = DMat3::from_cols(down.cross(forward), down, forward).transpose();
        Self {
            axes,
            position: pinhole.position,
            focal_px,
            principal_px,
            radial: rig.projector.radial,
            faces: rig.mirror.face.clone(),
        }
    }

    /// The model with each of `parameters` larger by the step that belongs to it.
    pub fn moved(&self, parameters: &[Parameter], steps: &[f64]) -> Self {
        let mut moved = self.clone();
        let mut turn = DVec3::ZERO;
        for (parameter, step) in parameters.iter().zip(steps) {
            match *parameter {
                Parameter::Turn(axis) => turn[axis] += step,
                Parameter::Position(axis) => moved.position[axis] += step,
                Parameter::Focal => moved.focal_px += step,
                Parameter::Principal(axis) => moved.principal_px[axis] += step,
                Parameter::Radial(term) => moved.radial[term] += step,
                Parameter::Tilt(face) => moved.faces[face].tilt_deg += step.to_degrees(),
                Parameter::Offset(face) => moved.faces[face].offset_m += step,
            }
        }
        moved.axes = DMat3::from_quat(DQuat::from_scaled_axis(turn)) * self.axes;
        moved
    }

    /// The value of `parameter`; `None` for turns, which are from where they are.
    pub fn value(&self, parameter: Parameter) -> Option<f64> {
        match parameter {
            Parameter::Turn(_) => None,
            Parameter::Position(axis) => Some(self.position[axis]),
            Parameter::Focal => Some(self.focal_px),
            Parameter::Principal(axis) => Some(self.principal_px[axis]),
            Parameter::Radial(term) => Some(self.radial[term]),
            Parameter::Tilt(face) => Some(self.faces[face].tilt_deg.to_radians()),
            Parameter::Offset(face) => Some(self.faces[face].offset_m),
        }
    }

    /// The steps of `parameters` that move `other` to this one.
    pub fn steps_from(&self, other: &Self, parameters: &[Parameter]) -> Vec<f64> {
        let turn = DQuat::from_mat3(&(self.axes * other.axes.transpose())).to_scaled_axis();
        let step = |parameter: &Parameter| match (*parameter, self.value(*parameter).zip(other.value(*parameter))) {
            (Parameter::Turn(axis), _) => turn[axis],
            (_, Some((here, there))) => here - there,
            (_, None) => 0.0,
        };
        parameters.iter().map(step).collect()
    }

    /// The pixel that lights a fiducial; `None` where it is not in front of the projector.
    pub fn pixel(&self, place: Place) -> Option<DVec2> {
        let ray = self.axes * (in_world(&self.faces, place) - self.position);
        let ideal = ray.truncate() / ray.z;
        let r2 = ideal.length_squared();
        let gain = 1.0 + r2 * (self.radial[0] + r2 * self.radial[1]);
        let pixel = self.principal_px + self.focal_px * gain * ideal;
        (ray.z > 0.0 && pixel.is_finite()).then_some(pixel)
    }

    /// `rig` with this projector and these faces.
    pub fn rig(&self, rig: &Rig) -> Result<Rig, RigError> {
        let mut found = rig.clone();
        let projector = &mut found.projector;
        projector.position_m = None;
        projector.look_at_m = None;
        projector.image_down = None;
        projector.focal_px = None;
        projector.principal_px = None;
        let [right, down, forward] = [0, 1, 2].map(|row| self.axes.row(row));
        let rows = [
            self.focal_px * right + self.principal_px.x * forward,
            self.focal_px * down + self.principal_px.y * forward,
            forward,
        ];
        projector.matrix = Some(rows.map(|row| [row.x, row.y, row.z, -row.dot(self.position)]));
        projector.radial = self.radial;
        found.mirror.face.clone_from(&self.faces);
        found.checked()
    }
}

/// Where a fiducial is in the world, metres.
pub fn in_world(faces: &[Face], place: Place) -> DVec3 {
    match place {
        Place::World(place) => place,
        Place::Face(at) => {
            let face = &faces[at.face];
            let frame = face.frame((at.stop_deg - face.azimuth_deg).to_radians());
            face.offset_m * frame.normal + at.at_m.x * frame.across + at.at_m.y * frame.slope
        }
    }
}

/// The pixels of `clicks` less those that `model` has for them, u and v of each.
pub fn residuals(model: &Model, clicks: &[Click]) -> Option<Vec<f64>> {
    let each = clicks.iter().map(|click| Some((click.pixel - model.pixel(click.place)?).to_array()));
    each.collect::<Option<Vec<_>>>().map(|pairs| pairs.into_flattened())
}
