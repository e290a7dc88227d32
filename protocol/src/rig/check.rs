//! What a possible rig is. Every refusal names the key and what is allowed.

use super::camera::{Camera, CameraError};
use super::{Rig, RigError, RotationKeys, Tracking};
use crate::codec::ImageSize;
use crate::timing::{Rotation, RotationError};
use core::ops::RangeInclusive;
use glam::DVec3;

/// More viewers than stand around a display.
const TRACKED_MAX: usize = 64;

pub(super) fn refuse<T>(key: impl Into<String>, problem: impl Into<String>) -> Result<T, RigError> {
    Err(RigError::Value { key: key.into(), problem: problem.into() })
}

pub(super) fn within(key: impl Into<String>, value: f64, allowed: RangeInclusive<f64>) -> Result<(), RigError> {
    if allowed.contains(&value) {
        return Ok(());
    }
    refuse(key, format!("= {value}: must be from {} to {}", allowed.start(), allowed.end()))
}

pub(super) fn rotation(keys: &RotationKeys) -> Result<Rotation, RotationError> {
    let refresh = (keys.refresh_hz * 1e6).round() as u64;
    Rotation::new(keys.slices, keys.planes_per_frame, refresh, keys.phase_offset(), keys.direction)
}

impl Rig {
    pub(super) fn check(&self) -> Result<(), RigError> {
        within("rotation.phase_offset_deg", self.rotation.phase_offset_deg, -360.0..=360.0)?;
        within("rotation.refresh_hz", self.rotation.refresh_hz, 1.0..=10_000.0)?;
        if let Err(error) = rotation(&self.rotation) {
            let text = error.to_string();
            let (key, problem) = text.split_once(' ').unwrap_or(("slices", &text));
            return refuse(format!("rotation.{}", key.trim_end_matches(':')), problem);
        }
        self.check_projector()?;
        self.check_viewing()?;
        self.tracking.iter().try_for_each(Tracking::check)?;
        for (name, filter) in &self.filters {
            let hex =
                filter.srgb.strip_prefix('#').filter(|hex| hex.len() == 6 && u32::from_str_radix(hex, 16).is_ok());
            if hex.is_none_or(|hex| hex.starts_with('+')) {
                return refuse(format!("filters.{name}.srgb"), format!("= {:?}: must be \"#RRGGBB\"", filter.srgb));
            }
        }
        if self.mirror.face.is_empty() || self.mirror.face.len() > 64 {
            return refuse("mirror.face", format!("stands {} times: must be from 1 to 64", self.mirror.face.len()));
        }
        (0..self.mirror.face.len()).try_for_each(|face| self.check_face(face))
    }

    fn check_projector(&self) -> Result<(), RigError> {
        let projector = &self.projector;
        let key = |name: &str| format!("projector.{name}");
        within(key("width_px"), projector.width_px.into(), 1.0..=f64::from(ImageSize::PIXELS_MAX))?;
        within(key("height_px"), projector.height_px.into(), 1.0..=f64::from(ImageSize::PIXELS_MAX))?;
        within(key("frame_latency_us"), projector.frame_latency_us, 0.0..=1e6)?;
        for (name, vector) in [
            ("position_m", projector.position_m),
            ("look_at_m", projector.look_at_m),
            ("image_down", projector.image_down),
        ] {
            vector.into_iter().flatten().try_for_each(|value| within(key(name), value, -1e6..=1e6))?;
        }
        projector.focal_px.into_iter().try_for_each(|value| within(key("focal_px"), value, 1.0..=1e7))?;
        projector
            .principal_px
            .into_iter()
            .flatten()
            .try_for_each(|value| within(key("principal_px"), value, -1e6..=1e6))?;
        projector.radial.into_iter().try_for_each(|value| within(key("radial"), value, -1e3..=1e3))?;
        if projector.matrix.iter().flatten().flatten().any(|value| !value.is_finite()) {
            return refuse(key("matrix"), "must be finite");
        }
        let camera = Camera::new(projector).or_else(|error| match error {
            CameraError::Incomplete => refuse(
                "projector",
                "needs position_m, look_at_m, image_down, focal_px and principal_px, or matrix in their place",
            ),
            CameraError::Overdetermined => refuse(
                key("matrix"),
                "stands in place of position_m, look_at_m, image_down, focal_px and principal_px: remove those or it",
            ),
            CameraError::LooksNowhere => {
                refuse(key("look_at_m"), "must differ from position_m, and image_down must not point along the axis")
            }
            CameraError::Affine => refuse(key("matrix"), "is affine or singular: must have a nodal point"),
            CameraError::Behind => refuse(
                key("matrix"),
                "gives the origin w <= 0: what is in front of the projector must have w > 0; negate it if it has the wrong sign",
            ),
            CameraError::Mirrored => {
                refuse(key("matrix"), "mirrors the image: its left 3 × 3 needs a positive determinant")
            }
            CameraError::Folded => {
                refuse(key("radial"), "folds the image over: its polynomial must rise to the corners")
            }
        })?;
        if camera.project(DVec3::ZERO).is_none() {
            return refuse("projector", "looks away from the mirror: the origin must be in front of it, w > 0");
        }
        Ok(())
    }

    fn check_viewing(&self) -> Result<(), RigError> {
        let viewing = &self.viewing;
        match (viewing.distance_m, viewing.height_m, viewing.elevation_deg) {
            (Some(distance), Some(height), None) => {
                within("viewing.distance_m", distance, 0.01..=1e9)?;
                within("viewing.height_m", height, -1e9..=1e9)
            }
            (None, None, Some(elevation)) => within("viewing.elevation_deg", elevation, -89.0..=89.0),
            _ => refuse(
                "viewing",
                "needs distance_m and height_m, or elevation_deg in their place for viewers at infinity",
            ),
        }?;
        self.check_tracked()
    }

    fn check_tracked(&self) -> Result<(), RigError> {
        let viewing = &self.viewing;
        if viewing.elevation_deg.is_some() && !viewing.tracked.is_empty() {
            return refuse("viewing.tracked", "needs distance_m and height_m: viewers at infinity stand on no curve");
        }
        if viewing.tracked.len() > TRACKED_MAX {
            return refuse(
                "viewing.tracked",
                format!("stands {} times: must be up to {TRACKED_MAX}", viewing.tracked.len()),
            );
        }
        viewing.tracked.iter().enumerate().try_for_each(|(index, viewer)| {
            let key = |name: &str| format!("viewing.tracked[{index}].{name}");
            within(key("azimuth_deg"), viewer.azimuth_deg, -360.0..=360.0)?;
            within(key("distance_m"), viewer.distance_m, 0.01..=1e9)?;
            within(key("height_m"), viewer.height_m, -1e9..=1e9)
        })
    }

    fn check_face(&self, index: usize) -> Result<(), RigError> {
        let face = &self.mirror.face[index];
        let key = |name: &str| format!("mirror.face[{index}].{name}");
        within(key("azimuth_deg"), face.azimuth_deg, -360.0..=360.0)?;
        within(key("tilt_deg"), face.tilt_deg, 0.1..=89.9)?;
        within(key("offset_m"), face.offset_m, -1e3..=1e3)?;
        within(key("width_m"), face.width_m, 1e-6..=1e3)?;
        face.slope_span_m.into_iter().try_for_each(|value| within(key("slope_span_m"), value, -1e3..=1e3))?;
        if face.slope_span_m[0] >= face.slope_span_m[1] {
            return refuse(key("slope_span_m"), format!("= {:?}: must rise", face.slope_span_m));
        }
        self.check_diffuser(index)?;
        if face.filter != "none" && !self.filters.contains_key(&face.filter) {
            let names: Vec<_> = self.filters.keys().map(String::as_str).chain(["none"]).collect();
            return refuse(key("filter"), format!("= {:?}: must be one of {}", face.filter, names.join(", ")));
        }
        let position = self.camera().position;
        let lit = |slice| face.frame(self.slice_angle(slice)).normal.dot(position) > face.offset_m;
        if !(0..self.rotation.slices).any(lit) {
            return refuse(
                "projector.position_m",
                format!("is below the plane of mirror.face[{index}] in every slice: it must be on its lit side"),
            );
        }
        Ok(())
    }

    fn check_diffuser(&self, index: usize) -> Result<(), RigError> {
        let face = &self.mirror.face[index];
        let key = |name: &str| format!("mirror.face[{index}].{name}");
        match (&face.diffuser_lobe, face.diffuser_hat_radius_deg) {
            (None, None) => refuse(key("diffuser_hat_radius_deg"), "is missing: give it, or diffuser_lobe"),
            (None, Some(radius)) => within(key("diffuser_hat_radius_deg"), radius, 1e-3..=90.0),
            (Some(_), Some(_)) => {
                refuse(key("diffuser_lobe"), "stands in place of diffuser_hat_radius_deg: remove one")
            }
            (Some(lobe), None) => {
                for [degrees, weight] in lobe {
                    within(key("diffuser_lobe"), *degrees, -90.0..=90.0)?;
                    within(key("diffuser_lobe"), *weight, 0.0..=1e6)?;
                }
                if lobe.len() < 2 || lobe.windows(2).any(|pair| pair[0][0] >= pair[1][0]) {
                    return refuse(
                        key("diffuser_lobe"),
                        "must hold two or more pairs [degrees, weight] with rising degrees",
                    );
                }
                if lobe.iter().all(|[_, weight]| *weight == 0.0) {
                    return refuse(key("diffuser_lobe"), "must have a weight above 0");
                }
                Ok(())
            }
        }
    }

    /// The projector as a camera.
    pub fn camera(&self) -> Camera {
        Camera::new(&self.projector).expect("a rig is checked when it is made")
    }
}
