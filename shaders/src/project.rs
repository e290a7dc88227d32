//! Multiple-centre-of-projection optics of one slice: scene point to projector pixel, and a pixel back to its sight line.
//!
//! Source: Jones et al., columns 5–6 of the patent, for the planar fan; the cone of a horizontal strip of the diffuser,
//! `o·e = i·e`, in place of its vertical plane. World metres, double precision.

pub mod curve;
pub mod methods;
mod root;

use core::f64::consts::PI;
use curve::crossing;
use glam::{DVec2, DVec3};
use protocol::rig::{Camera, Frame, Rig, Viewers};
use root::{nearest_root, secant};

/// How the diffuser is modelled.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Model {
    /// A ray leaves in its vertical plane: the patent's approximation.
    Planar,
    /// A ray i leaves into the cone of directions o with `o·e = i·e`.
    Cone,
}

/// Whether, and why not, a point is seen in a slice.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Visibility {
    /// Some pixel shows it.
    Visible,
    /// No place where viewers are sees it in this slice.
    NoViewer,
    /// The sight line does not meet the mirror's plane in front of the viewer.
    NoMirror,
    /// The viewer, or the projector, is behind the mirror's plane.
    Unlit,
    /// The sight line misses the panel.
    OffPanel,
    /// The mirror point is behind the projector.
    BehindProjector,
    /// The pixel lies outside the image.
    OutsideImage,
}

impl Visibility {
    /// In words.
    pub const fn reason(self) -> &'static str {
        match self {
            Self::Visible => "visible",
            Self::NoViewer => "no place where viewers are sees it in this slice",
            Self::NoMirror => "the sight line does not meet the mirror's plane in front of the viewer",
            Self::Unlit => "the viewer or the projector is behind the mirror",
            Self::OffPanel => "the sight line misses the mirror panel",
            Self::BehindProjector => "the mirror point is behind the projector",
            Self::OutsideImage => "the pixel lies outside the projector's image",
        }
    }
}

/// Where a sight line goes: to a viewer at a point, or in a direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Viewer {
    /// V' in metres.
    At(DVec3),
    /// The unit direction toward a viewer at infinity.
    Toward(DVec3),
}

impl Viewer {
    /// The direction, not of unit length, from `point`.
    fn direction_from(self, point: DVec3) -> DVec3 {
        match self {
            Self::At(position) => position - point,
            Self::Toward(direction) => direction,
        }
    }

    /// |V' − point| in metres; for a viewer at infinity the distance from the plane through the origin, which orders the same.
    pub fn depth_of(self, point: DVec3) -> f64 {
        match self {
            Self::At(position) => position.distance(point),
            Self::Toward(direction) => -direction.dot(point),
        }
    }

    /// V', or the unit direction toward it.
    pub fn vector(self) -> DVec3 {
        match self {
            Self::At(vector) | Self::Toward(vector) => vector,
        }
    }
}

/// A scene point in a slice. Fields that do not exist, because of what `visibility` says, are `None`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Projected {
    /// V'.
    pub viewer: Option<Viewer>,
    /// (u, v) in pixels, also outside image and panel.
    pub pixel: Option<DVec2>,
    /// M, where the sight line meets the mirror's plane.
    pub mirror: Option<DVec3>,
    /// |V' − Q| in metres.
    pub depth_m: Option<f64>,
    /// Whether some pixel shows it.
    pub visibility: Visibility,
}

/// What a pixel shows: everything on the line from `viewer` through `mirror`, also beyond it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sight {
    /// V'.
    pub viewer: Viewer,
    /// M, where the line meets the mirror.
    pub mirror: DVec3,
}

/// One face of the mirror at one angle, under the projector, for the rig's viewing circle or curve.
#[derive(Clone, Debug)]
pub struct SliceOptics {
    model: Model,
    frame: Frame,
    offset_m: f64,
    half_width_m: f64,
    slope_span_m: [f64; 2],
    guard_m: f64,
    camera: Camera,
    image_px: DVec2,
    /// P' = P − 2 (n·P − offset) n.
    projector_image: DVec3,
    /// n·P > offset.
    projector_is_above: bool,
    viewers: Viewers,
}

impl SliceOptics {
    /// Face `face` at mirror angle `theta` radians. `face` must be below `rig.mirror.face.len()`.
    pub fn new(rig: &Rig, face: usize, theta: f64, model: Model) -> Self {
        let keys = &rig.mirror.face[face];
        let frame = keys.frame(theta);
        let camera = rig.camera();
        let height = frame.normal.dot(camera.position) - keys.offset_m;
        Self {
            model,
            frame,
            offset_m: keys.offset_m,
            half_width_m: keys.width_m / 2.0,
            slope_span_m: keys.slope_span_m,
            guard_m: guard_m(rig, face, frame),
            camera,
            image_px: DVec2::new(rig.projector.width_px.into(), rig.projector.height_px.into()),
            projector_image: camera.position - 2.0 * height * frame.normal,
            projector_is_above: height > 0.0,
            viewers: rig.viewers(),
        }
    }

    /// Where scene point `point` appears. Never refuses: an invisible point says why.
    pub fn project(&self, point: DVec3) -> Projected {
        let mut projected =
            Projected { viewer: None, pixel: None, mirror: None, depth_m: None, visibility: Visibility::NoViewer };
        // From 1e154 m on, squares of distances are infinite.
        let Some(viewer) = self.viewer_of(point).filter(|_| point.abs().max_element() < 1e100) else {
            return projected;
        };
        projected.viewer = Some(viewer);
        projected.depth_m = Some(viewer.depth_of(point));
        let Some(mirror) = self.mirror_point(point, viewer) else {
            projected.visibility = Visibility::NoMirror;
            return projected;
        };
        projected.mirror = Some(mirror);
        projected.pixel = self.camera.project(mirror);
        projected.visibility = match projected.pixel {
            _ if !in_front(point, viewer, mirror) => Visibility::NoMirror,
            _ if !self.is_lit(viewer) => Visibility::Unlit,
            None => Visibility::BehindProjector,
            Some(_) if !self.on_panel(mirror) => Visibility::OffPanel,
            Some(pixel) if !self.in_image(pixel) => Visibility::OutsideImage,
            Some(_) => Visibility::Visible,
        };
        projected
    }

    /// Whether the planar fan, which is quickly known, puts the sight line of `point` on the panel or within its size around it. The
    /// cone is some pixels away from it (8.2 at most on the reference rig, viewers up to 1.5 m high), so that others are off the panel.
    pub fn is_near(&self, point: DVec3) -> bool {
        let mirror = self.planar_viewer(point).and_then(|viewer| self.mirror_point(point, viewer));
        mirror.is_some_and(|mirror| {
            let [low, high] = self.slope_span_m;
            let slope = self.frame.slope.dot(mirror);
            let across = self.frame.across.dot(mirror).abs();
            across <= 3.0 * self.half_width_m && 2.0 * low - high <= slope && slope <= 2.0 * high - low
        })
    }

    /// On which sides of the panel and its guard band `mirror` lies outside: bits 0 and 1 across, 2 and 3 along the slope; 0 on it.
    /// What lies between points with a common bit is outside too.
    ///
    /// The panel turns while a slice is on screen. What it does not hold in the middle of the exposure, but does at its ends, is the
    /// guard band: left dark, it would dim the picture's rim.
    pub fn sides(&self, mirror: DVec3) -> u8 {
        self.outside(mirror, self.guard_m)
    }

    fn outside(&self, mirror: DVec3, guard_m: f64) -> u8 {
        let (across, slope) = (self.frame.across.dot(mirror), self.frame.slope.dot(mirror));
        let outside = [
            across < -self.half_width_m - guard_m,
            across > self.half_width_m + guard_m,
            slope < self.slope_span_m[0] - guard_m,
            slope > self.slope_span_m[1] + guard_m,
        ];
        (0..).zip(outside).map(|(bit, outside)| u8::from(outside) << bit).sum()
    }

    /// What `pixel` shows; `None` where its ray misses the panel or no lit viewer sees it.
    pub fn sight(&self, pixel: DVec2) -> Option<Sight> {
        let mirror = self.mirror_of(pixel).filter(|mirror| self.on_panel(*mirror))?;
        self.sight_of(mirror)
    }

    /// The sight line through `mirror`, a point of the face's plane; `None` where no lit viewer sees it.
    pub fn sight_of(&self, mirror: DVec3) -> Option<Sight> {
        let viewer = self.viewer_of_mirror(mirror)?;
        self.is_lit(viewer).then_some(Sight { viewer, mirror })
    }

    /// The pixel, also outside the image and off the panel, at which an eye on the line of `sight`, which may be one of another
    /// slice, looks in this one; `None` where the line misses the plane or the projector.
    pub fn pixel_of(&self, sight: Sight) -> Option<DVec2> {
        self.camera.project(self.mirror_point(sight.mirror, sight.viewer)?)
    }

    /// M of `pixel`, on the panel or off it; `None` where the projector's ray does not meet the plane.
    pub fn mirror_of(&self, pixel: DVec2) -> Option<DVec3> {
        let ray = self.camera.ray(pixel);
        let position = self.camera.position;
        let range = (self.offset_m - self.frame.normal.dot(position)) / self.frame.normal.dot(ray);
        (range > 0.0 && range.is_finite()).then(|| position + range * ray)
    }

    /// [`Viewer::depth_of`] less the viewer's distance from the origin, in metres.
    fn depth_from_circle(&self, point: DVec3, viewer: Viewer) -> f64 {
        match viewer {
            Viewer::At(position) => {
                let distance = self.origin_distance_m(position);
                (point.length_squared() - 2.0 * position.dot(point)) / (position.distance(point) + distance)
            }
            Viewer::Toward(_) => viewer.depth_of(point),
        }
    }

    /// The distance of V' from the origin.
    fn origin_distance_m(&self, viewer: DVec3) -> f64 {
        match self.viewers {
            Viewers::Circle { distance_m, height_m } => distance_m.hypot(height_m),
            _ => viewer.length(),
        }
    }

    /// The panel's corners.
    fn corners(&self) -> [DVec3; 4] {
        let foot = self.offset_m * self.frame.normal;
        let [low, high] = self.slope_span_m;
        [(-1.0, low), (1.0, low), (-1.0, high), (1.0, high)]
            .map(|(side, slope)| foot + side * self.half_width_m * self.frame.across + slope * self.frame.slope)
    }

    /// The distance of the panel's farthest corner from the origin.
    fn reach_m(&self) -> f64 {
        self.corners().map(DVec3::length).into_iter().fold(0.0, f64::max)
    }

    /// The largest distance in the image of two points of the panel a metre apart, by its scale at the corners; infinity where the
    /// projector does not see them.
    fn px_per_m(&self) -> f64 {
        let step = 1e-4 * self.reach_m();
        let scale = |corner: DVec3| {
            let pixel = |point| self.camera.project(point);
            let [across, slope] = [self.frame.across, self.frame.slope].map(|axis| pixel(corner + step * axis));
            let start = pixel(corner)?;
            Some((across? - start).length().hypot((slope? - start).length()) / step)
        };
        self.corners().into_iter().map(|corner| scale(corner).unwrap_or(f64::INFINITY)).fold(0.0, f64::max)
    }

    /// The largest coordinate in the image of the panel's corners, in pixels.
    fn largest_px(&self) -> f64 {
        let pixels = self.corners().map(|corner| self.camera.project(corner));
        pixels.into_iter().flatten().map(|pixel| pixel.abs().max_element()).fold(0.0, f64::max)
    }

    /// |M − P| in metres.
    pub fn throw_m(&self, mirror: DVec3) -> f64 {
        mirror.distance(self.camera.position)
    }

    /// V' of a scene point: by step 2 of the patent, refined to the cone where the model asks for it.
    fn viewer_of(&self, point: DVec3) -> Option<Viewer> {
        let planar = self.planar_viewer(point)?;
        match self.model {
            Model::Planar => Some(planar),
            Model::Cone => self.cone_viewer(planar, |viewer| self.mirror_point(point, viewer)),
        }
    }

    /// V' of a point on the mirror, which is where its own sight line meets the mirror.
    fn viewer_of_mirror(&self, mirror: DVec3) -> Option<Viewer> {
        let planar = self.planar_viewer(mirror)?;
        match self.model {
            Model::Planar => Some(planar),
            Model::Cone => self.cone_viewer(planar, |_| Some(mirror)),
        }
    }

    /// The viewing circle's or curve's crossing with the vertical plane through P' and `point`, on the far side of `point`.
    ///
    /// Written from `point`, which loses no digits where the circle or P' is far away.
    fn planar_viewer(&self, point: DVec3) -> Option<Viewer> {
        let away = point - self.projector_image;
        // Nearer than 1e-100 m its square has lost its digits.
        let away = Some(DVec2::new(away.x, away.z)).filter(|away| away.length_squared() > 1e-200)?.try_normalize()?;
        match self.viewers {
            Viewers::Curve(ref curve) => crossing(curve, DVec2::new(point.x, point.z), away).map(Viewer::At),
            Viewers::Circle { distance_m, height_m } => {
                let level = DVec2::new(point.x, point.z);
                let along = level.dot(away);
                let discriminant = along * along + (distance_m * distance_m - level.length_squared());
                if discriminant < 0.0 {
                    return None;
                }
                let viewer = level + (discriminant.sqrt() - along) * away;
                viewer.is_finite().then(|| Viewer::At(DVec3::new(viewer.x, height_m, viewer.y)))
            }
            Viewers::Infinity { elevation } => {
                let level = away * elevation.cos();
                Some(Viewer::Toward(DVec3::new(level.x, elevation.sin(), level.y)))
            }
        }
    }

    /// The viewer at azimuth `azimuth` radians.
    fn viewer_at(&self, azimuth: f64) -> Viewer {
        let (sin, cos) = azimuth.sin_cos();
        match self.viewers {
            Viewers::Curve(_) => Viewer::At(self.viewers.place(azimuth, 0.0)),
            Viewers::Circle { distance_m, height_m } => {
                Viewer::At(DVec3::new(distance_m * sin, height_m, distance_m * cos))
            }
            Viewers::Infinity { elevation } => {
                let level = elevation.cos();
                Viewer::Toward(DVec3::new(level * sin, elevation.sin(), level * cos))
            }
        }
    }

    /// The root of `o·e − i·e` in the viewer's azimuth that is nearest the planar one.
    fn cone_viewer(&self, planar: Viewer, mirror_of: impl Fn(Viewer) -> Option<DVec3>) -> Option<Viewer> {
        let defect = |azimuth: f64| {
            let viewer = self.viewer_at(azimuth);
            let mirror = mirror_of(viewer)?;
            let outward = viewer.direction_from(mirror).normalize();
            let inward = (mirror - self.camera.position).normalize();
            Some((outward - inward).dot(self.frame.across))
        };
        let start = planar.vector();
        let start = start.x.atan2(start.z);
        let root = secant(&defect, start).or_else(|| nearest_root(&defect, start))?;
        Some(self.viewer_at(root))
    }

    /// M: where the line through `point` toward `viewer` meets the mirror's plane, computed from `point`.
    fn mirror_point(&self, point: DVec3, viewer: Viewer) -> Option<DVec3> {
        let direction = viewer.direction_from(point);
        let approach = self.frame.normal.dot(direction);
        let mirror = point + direction * ((self.offset_m - self.frame.normal.dot(point)) / approach);
        // A sight line within 1e-9 rad of parallel has no mirror point that floating point can tell from any other.
        (approach.abs() > 1e-9 * direction.length() && mirror.is_finite()).then_some(mirror)
    }

    /// Whether `viewer` is on the lit side of the mirror's plane; nobody is where the projector shines on the mirror's back.
    pub fn is_lit(&self, viewer: Viewer) -> bool {
        self.projector_is_above
            && match viewer {
                Viewer::At(position) => self.frame.normal.dot(position) > self.offset_m,
                Viewer::Toward(direction) => self.frame.normal.dot(direction) > 0.0,
            }
    }

    /// Whether `mirror` is on the panel itself.
    pub fn on_panel(&self, mirror: DVec3) -> bool {
        self.outside(mirror, 0.0) == 0
    }

    fn in_image(&self, pixel: DVec2) -> bool {
        pixel.cmpge(DVec2::ZERO).all() && pixel.cmplt(self.image_px).all()
    }
}

/// How far the panel's corners move in half a slice, in metres, and a tenth more.
fn guard_m(rig: &Rig, face: usize, frame: Frame) -> f64 {
    let keys = &rig.mirror.face[face];
    let corner = |slope: f64| keys.offset_m * frame.normal + keys.width_m / 2.0 * frame.across + slope * frame.slope;
    let from_axis = keys.slope_span_m.map(|slope| corner(slope).with_y(0.0).length());
    1.1 * from_axis[0].max(from_axis[1]) * PI / f64::from(rig.rotation.slices)
}

/// Whether `mirror` lies on the half line from `viewer` through `point`.
fn in_front(point: DVec3, viewer: Viewer, mirror: DVec3) -> bool {
    match viewer {
        Viewer::At(position) => (mirror - position).dot(point - position) > 0.0,
        Viewer::Toward(_) => true,
    }
}

#[cfg(test)]
mod tests;
