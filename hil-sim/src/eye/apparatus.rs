//! Mirror and projector as light meets them on its way back from the eye.

use super::{Picture, Pixel};
use glam::{DMat3, DVec2, DVec3};
use protocol::rig::{Face, Projector, Rig};

/// The rig, ready for tracing.
pub(super) struct Apparatus {
    faces: Vec<Panel>,
    lens: Lens,
    width: u32,
    height: u32,
}

/// One face in its own frame at mirror angle 0.
struct Panel {
    azimuth: f64,
    tilt: f64,
    offset: f64,
    half_width: f64,
    slope: [f64; 2],
    lobe: Vec<[f64; 2]>,
    colour: [f64; 3],
}

/// One face at one mirror angle.
pub(super) struct FaceAt {
    /// Columns: across, up the slope, out of the face.
    axes: DMat3,
}

struct Lens {
    centre: DVec3,
    /// Rows: right, down, forward.
    axes: DMat3,
    focal: DVec2,
    principal: DVec2,
    radial: [f64; 2],
}

impl Apparatus {
    pub(super) fn new(rig: &Rig) -> Self {
        let faces = rig.mirror.face.iter().enumerate();
        Self {
            faces: faces.map(|(index, face)| Panel::new(face, rig.filter_colour(index))).collect(),
            lens: Lens::new(&rig.projector),
            width: rig.projector.width_px,
            height: rig.projector.height_px,
        }
    }

    pub(super) fn faces(&self) -> usize {
        self.faces.len()
    }

    pub(super) fn colour(&self, face: usize) -> [f64; 3] {
        self.faces[face].colour
    }

    pub(super) fn face_at(&self, face: usize, angle: f64) -> FaceAt {
        let panel = &self.faces[face];
        // A level panel faces up with its slope toward −z; tipping it about x brings the normal down toward +z.
        let level = DMat3::from_cols(DVec3::X, DVec3::NEG_Z, DVec3::Y);
        let axes = DMat3::from_rotation_y(angle + panel.azimuth) * DMat3::from_rotation_x(panel.tilt) * level;
        FaceAt { axes }
    }

    /// How strongly, and from which pixel, light of `face` arrives at `eye` against `direction`; `None` where it does not.
    pub(super) fn arrival(&self, face: usize, at: &FaceAt, eye: DVec3, direction: DVec3) -> Option<(f64, Pixel)> {
        let panel = &self.faces[face];
        let (sight, height) = (at.axes.z_axis.dot(direction), at.axes.z_axis.dot(eye) - panel.offset);
        if height <= 0.0 || sight >= 0.0 || !self.shines_on(panel, at) {
            return None;
        }
        let hit = eye + direction * (-height / sight);
        let slope = at.axes.y_axis.dot(hit);
        if at.axes.x_axis.dot(hit).abs() > panel.half_width || slope < panel.slope[0] || slope > panel.slope[1] {
            return None;
        }
        let weight = panel.weight(self.skew(at, hit, -direction));
        if weight <= 0.0 {
            return None;
        }
        let pixel = self.lens.pixel(hit)?;
        let inside = pixel.x >= 0.0 && pixel.y >= 0.0 && pixel.x < self.width.into() && pixel.y < self.height.into();
        inside.then_some((weight, pixel))
    }

    /// Whether the projector is on the panel's bright side.
    fn shines_on(&self, panel: &Panel, at: &FaceAt) -> bool {
        at.axes.z_axis.dot(self.lens.centre) > panel.offset
    }

    /// asin(o·e) − asin(i·e): how far, across the diffuser, light to the eye leaves from where the mirror alone would send it.
    fn skew(&self, at: &FaceAt, hit: DVec3, toward_eye: DVec3) -> f64 {
        let across = |direction: DVec3| (at.axes.x_axis.dot(direction) / direction.length()).clamp(-1.0, 1.0).asin();
        across(toward_eye) - across(hit - self.lens.centre)
    }

    /// Whether light of `face` can arrive at `eye` along any direction between those of `probes`, to be on the safe side.
    pub(super) fn may_reach(&self, face: usize, angle: f64, eye: DVec3, probes: &[DVec3]) -> bool {
        let panel = &self.faces[face];
        let at = self.face_at(face, angle);
        let height = at.axes.z_axis.dot(eye) - panel.offset;
        if height <= 0.0 || !self.shines_on(panel, &at) {
            return false;
        }
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        let mut away = 0;
        for probe in probes {
            let sight = at.axes.z_axis.dot(*probe);
            if sight >= -0.02 * probe.length() {
                // Grazing: the hit runs away within the square, and tells nothing about its neighbours.
                away += 1;
                continue;
            }
            let skew = self.skew(&at, eye + *probe * (-height / sight), -*probe);
            (low, high) = (low.min(skew), high.max(skew));
        }
        let margin = (high - low).max(0.001);
        let (first, last) = (panel.lobe[0][0], panel.lobe[panel.lobe.len() - 1][0]);
        away > 0 || (low - margin <= last && high + margin >= first)
    }

    pub(super) fn luminance(&self, picture: Picture<'_>, pixel: Pixel) -> f64 {
        let (x, y) = (pixel.x as usize, pixel.y as usize);
        match picture {
            Picture::Dark => 0.0,
            Picture::Binary(bits) => f64::from(bits[y * self.width.div_ceil(8) as usize + x / 8] >> (x % 8) & 1),
            Picture::Grey(bytes) => f64::from(bytes[y * self.width as usize + x]) / 255.0,
        }
    }
}

impl Panel {
    fn new(face: &Face, colour: [f64; 3]) -> Self {
        Self {
            azimuth: face.azimuth_deg.to_radians(),
            tilt: face.tilt_deg.to_radians(),
            offset: face.offset_m,
            half_width: face.width_m / 2.0,
            slope: face.slope_span_m,
            lobe: face.lobe(),
            colour,
        }
    }

    /// The lobe at `skew` radians: linear between its points, 0 outside.
    fn weight(&self, skew: f64) -> f64 {
        self.lobe.windows(2).find(|pair| pair[0][0] <= skew && skew < pair[1][0]).map_or(0.0, |pair| {
            let [[from, start], [to, end]] = [pair[0], pair[1]];
            start + (end - start) * (skew - from) / (to - from)
        })
    }
}

impl Lens {
    fn new(projector: &Projector) -> Self {
        match (projector.matrix, projector.position_m, projector.look_at_m, projector.image_down) {
            (Some(matrix), ..) => Self::calibrated(&matrix, projector.radial),
            (None, Some(position), Some(look_at), Some(down)) => {
                let centre = DVec3::from(position);
                let forward = (DVec3::from(look_at) - centre).normalize();
                let down = DVec3::from(down);
                let down = (down - down.dot(forward) * forward).normalize();
                let axes = DMat3::from_cols(down.cross(forward), down, forward).transpose();
                let focal = DVec2::splat(projector.focal_px.unwrap_or(1.0));
                let principal = projector.principal_px.unwrap_or_default().into();
                Self { centre, axes, focal, principal, radial: projector.radial }
            }
            _ => unreachable!("a rig has a pose or a matrix"),
        }
    }

    /// Splits K·R off a 3 × 4 matrix, taking K's skew as none, and finds the centre as its null vector.
    fn calibrated(matrix: &[[f64; 4]; 3], radial: [f64; 2]) -> Self {
        let row = |index: usize| DVec3::new(matrix[index][0], matrix[index][1], matrix[index][2]);
        let scale = row(2).length();
        let [u, v, w] = [row(0), row(1), row(2)].map(|row| row / scale);
        let principal = DVec2::new(u.dot(w), v.dot(w));
        let (right, down) = (u - principal.x * w, v - principal.y * w);
        let constants = DVec3::new(matrix[0][3], matrix[1][3], matrix[2][3]) / scale;
        let centre = -(DMat3::from_cols(u, v, w).transpose().inverse() * constants);
        Self {
            centre,
            axes: DMat3::from_cols(right.normalize(), down.normalize(), w).transpose(),
            focal: DVec2::new(right.length(), down.length()),
            principal,
            radial,
        }
    }

    fn pixel(&self, point: DVec3) -> Option<Pixel> {
        let local = self.axes * (point - self.centre);
        if local.z <= 0.0 {
            return None;
        }
        let slope = DVec2::new(local.x, local.y) / local.z;
        let r2 = slope.length_squared();
        Some(self.principal + self.focal * slope * (1.0 + self.radial[0] * r2 + self.radial[1] * r2 * r2))
    }
}
