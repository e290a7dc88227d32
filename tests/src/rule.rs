//! The rule of the projection: for every finite input an answer within the stated error, or a refusal that says so. Never NaN or
//! infinity, never a pixel that is wrong. [`Case`] draws inputs from bytes, for property tests and the fuzzer alike.

use core::f64::consts::{PI, TAU};
use glam::{DVec2, DVec3};
use protocol::rig::{Rig, RigError, TrackedViewer, Viewers};
use shaders::project::methods::{FaceOptics, Method, Real};
use shaders::project::{Model, Projected, SliceOptics, Viewer, Visibility};

const REFERENCE: &str = include_str!("../../host/rigs/reference.toml");

/// How far, in pixels, a method may be from its model's reference.
pub fn stated_px<F: Real>(method: Method) -> f64 {
    match method {
        Method::Planar | Method::ConeRoot => 2.0 * F::TOLERANCE_PX,
        Method::ConeTable | Method::ConeNewton => 0.05,
    }
}

/// A rig's face in a slice, a point, and how it is projected.
#[derive(Clone, Debug)]
pub struct Case {
    /// The rig.
    pub rig: Rig,
    /// The slice.
    pub slice: u32,
    /// World metres.
    pub point: DVec3,
    /// The method, in either precision.
    pub method: Method,
}

/// Bytes as numbers; 0 where they have run out.
struct Numbers<'a>(&'a [u8]);

impl Numbers<'_> {
    fn byte(&mut self) -> u8 {
        let Some((first, rest)) = self.0.split_first() else { return 0 };
        self.0 = rest;
        *first
    }

    fn fraction(&mut self) -> f64 {
        f64::from(u16::from_le_bytes([self.byte(), self.byte()])) / 65535.0
    }

    /// `usual`, or a number of the physical range, of any size, or of any bits.
    fn number(&mut self, usual: f64, [low, high]: [f64; 2]) -> f64 {
        match self.byte() % 32 {
            0..=15 => usual,
            16..=28 => low + (high - low) * self.fraction(),
            29 | 30 => {
                let size = 10f64.powf(20.0 * self.fraction() - 10.0);
                if self.byte().is_multiple_of(2) { size } else { -size }
            }
            _ => f64::from_le_bytes(core::array::from_fn(|_| self.byte())),
        }
    }
}

impl Case {
    /// The case that `bytes` describe; an error where the rig is refused.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, RigError> {
        let mut numbers = Numbers(bytes);
        let mut rig = Rig::parse(REFERENCE)?;
        let position = [0.0, 0.6, 0.0].map(|usual| numbers.number(usual, [usual - 0.2, usual + 0.4]));
        rig.projector.position_m = Some(position);
        rig.projector.look_at_m = Some([0.0; 3].map(|usual| numbers.number(usual, [-0.02, 0.02])));
        rig.projector.focal_px = Some(numbers.number(3072.0, [500.0, 10_000.0]));
        rig.projector.principal_px = Some([384.0; 2].map(|usual| numbers.number(usual, [0.0, 768.0])));
        rig.projector.radial = [0.0; 2].map(|usual| numbers.number(usual, [-0.5, 0.5]));
        let face = &mut rig.mirror.face[0];
        face.azimuth_deg = numbers.number(0.0, [-180.0, 180.0]);
        face.tilt_deg = numbers.number(45.0, [20.0, 70.0]);
        face.offset_m = numbers.number(0.0, [-0.02, 0.05]);
        face.width_m = numbers.number(0.14, [0.05, 0.3]);
        face.slope_span_m = [numbers.number(-0.1, [-0.2, -0.05]), numbers.number(0.1, [0.05, 0.2])];
        if numbers.byte().is_multiple_of(4) {
            rig.viewing.distance_m = None;
            rig.viewing.height_m = None;
            rig.viewing.elevation_deg = Some(numbers.number(20.0, [-20.0, 80.0]));
        } else {
            rig.viewing.distance_m = Some(numbers.number(0.9, [0.15, 3.0]));
            rig.viewing.height_m = Some(numbers.number(0.35, [-1.0, 2.0]));
        }
        let rig = rig.checked()?;
        let slice = u32::from(numbers.byte()) * 9 % rig.rotation.slices;
        let point = DVec3::from_array([0.0; 3].map(|usual| numbers.number(usual, [-0.1, 0.1])));
        // Tables take milliseconds to make: they come seldom.
        let method = match numbers.byte() % 16 {
            0..=4 => Method::Planar,
            5..=9 => Method::ConeRoot,
            10..=14 => Method::ConeNewton,
            _ => Method::ConeTable,
        };
        let viewers = if rig.viewing.elevation_deg.is_some() { 0 } else { numbers.byte() % 4 };
        let mut viewer = || TrackedViewer {
            azimuth_deg: numbers.number(0.0, [-90.0, 90.0]),
            distance_m: numbers.number(0.9, [0.3, 3.0]),
            height_m: numbers.number(0.35, [-0.5, 1.5]),
        };
        let mut rig = rig;
        rig.viewing.tracked = (0..viewers).map(|_| viewer()).collect();
        let rig = rig.checked()?;
        Ok(Self { rig, slice, point, method })
    }

    /// Whether the method in either precision, and the reference itself, keeps the rule; if not, what is wrong.
    pub fn check(&self) -> Result<(), String> {
        self.check_in::<f32>().and_then(|()| self.check_in::<f64>()).map_err(|problem| format!("{problem}\n{self:?}"))
    }

    fn check_in<F: Real>(&self) -> Result<(), String> {
        let point = self.point.to_array().map(F::of);
        let theta = self.rig.slice_angle(self.slice);
        let exact = SliceOptics::new(&self.rig, 0, theta, self.method.model());
        let slice = FaceOptics::<F>::new(&self.rig, 0, self.method).slice(theta);
        let wide = DVec3::from_array(point.map(F::wide));
        if !wide.is_finite() {
            // Not a finite input in this precision.
            return if slice.vertex(point).is_none() { Ok(()) } else { Err("infinitely far".into()) };
        }
        let expected = exact.project(wide);
        keeps_the_equations(&self.rig, theta, self.method.model(), wide, &expected)?;
        let visible = expected.visibility == Visibility::Visible;
        let Some(vertex) = slice.vertex(point) else {
            return if visible && exact.is_near(wide) { Err(format!("refused {expected:?}")) } else { Ok(()) };
        };
        let pixel = DVec2::from_array(vertex.pixel.map(F::wide));
        if !pixel.is_finite() || !vertex.depth_m.wide().is_finite() {
            return Err(format!("{vertex:?} is not finite"));
        }
        let Some(right) = expected.pixel else {
            // Nothing is drawn from an unlit vertex without a look at each pixel; and of sight lines that all but lie in the mirror's
            // plane the reference says nothing.
            let normal = self.rig.mirror.face[0].frame(theta).normal;
            let grazes = expected.viewer.is_some_and(|viewer| match viewer {
                Viewer::At(position) => normal.dot((position - wide).normalize()).abs() < 1e-8,
                Viewer::Toward(direction) => normal.dot(direction).abs() < 1e-8,
            });
            let is_allowed = !vertex.lit || grazes;
            return if is_allowed { Ok(()) } else { Err(format!("{vertex:?} where there is no pixel")) };
        };
        let error = pixel.distance(right);
        let stated = stated_px::<F>(self.method) + 4.0 * F::epsilon().wide() * right.length();
        if visible && error > stated {
            return Err(format!("{error} px from {right}"));
        }
        let within = pixel.cmpge(DVec2::ONE).all() && pixel.cmplt(image(&self.rig) - 1.0).all();
        if within && vertex.lit && vertex.sides == 0 && error > stated {
            return Err(format!("{vertex:?} is shown {error} px from {right}, {:?}", expected.visibility));
        }
        Ok(())
    }
}

fn image(rig: &Rig) -> DVec2 {
    DVec2::new(rig.projector.width_px.into(), rig.projector.height_px.into())
}

/// Whether what the reference answers is finite and, for what is visible, solves the patent's equations (columns 5–6) or the cone's,
/// written anew.
fn keeps_the_equations(rig: &Rig, theta: f64, model: Model, point: DVec3, projected: &Projected) -> Result<(), String> {
    let wrong = |what: &str| Err(format!("{what}: {projected:?}"));
    let Projected { viewer, pixel, mirror, depth_m, visibility } = *projected;
    let finite = viewer.is_none_or(|viewer| viewer.vector().is_finite())
        && pixel.is_none_or(DVec2::is_finite)
        && mirror.is_none_or(DVec3::is_finite)
        && depth_m.is_none_or(f64::is_finite);
    if !finite {
        return wrong("not finite");
    }
    let (Visibility::Visible, Some(viewer), Some(mirror), Some(pixel)) = (visibility, viewer, mirror, pixel) else {
        return if visibility == Visibility::Visible { wrong("visible, but incomplete") } else { Ok(()) };
    };
    if pixel.min_element() < 0.0 || !pixel.cmplt(image(rig)).all() {
        return wrong("outside the image");
    }
    let face = &rig.mirror.face[0];
    let frame = face.frame(theta);
    let toward = match viewer {
        Viewer::At(position) => position - point,
        Viewer::Toward(direction) => direction,
    };
    let at = viewer.vector();
    let circle = match rig.viewers() {
        Viewers::Circle { distance_m, height_m } => [distance_m, height_m],
        Viewers::Infinity { elevation } => [elevation.cos(), elevation.sin()],
        Viewers::Curve(curve) => {
            let spot = curve.spot(at.x.atan2(at.z));
            [spot.distance_m, spot.height_m]
        }
    };
    let level = |vector: DVec3| DVec2::new(vector.x, vector.z);
    let size = point.length() + mirror.length() + face.offset_m.abs();
    if (frame.normal.dot(mirror) - face.offset_m).abs() > 1e-12 * size + 1e-15 {
        return wrong("M is not on the mirror");
    }
    if toward.normalize().cross(mirror - point).length() > 1e-12 * size * (1.0 + circle[0] / toward.length()) + 1e-15 {
        return wrong("M is not on the sight line");
    }
    // A bend of metres within degrees is steep: the azimuth's rounding moves it, by a share of the curve's highest place.
    let rounding = match rig.viewers() {
        Viewers::Curve(curve) => {
            let sizes = curve.spots().map(|spot| spot.distance_m + spot.height_m.abs());
            1e-12 * (1.0 + sizes.fold(0.0, f64::max))
        }
        _ => 0.0,
    };
    if (level(at).length() - circle[0]).abs() > 1e-12 * (circle[0] + point.length()) + rounding
        || (at.y - circle[1]).abs() > rounding
    {
        return wrong("V' is not where viewers are");
    }
    let position = rig.camera().position;
    let image = position - 2.0 * (frame.normal.dot(position) - face.offset_m) * frame.normal;
    let outward = match viewer {
        Viewer::At(position) => (position - mirror).normalize(),
        Viewer::Toward(direction) => direction,
    };
    let defect = (outward - (mirror - position).normalize()).dot(frame.across);
    match model {
        Model::Planar
            if level(point - image).perp_dot(level(toward)).abs()
                > 1e-12 * (size + image.length()) * (circle[0] + level(toward).length()) =>
        {
            wrong("P', Q and V' are not in one vertical plane")
        }
        // A far point's rounding moves M, and the ray to it from a projector that all but touches the mirror turns by more.
        Model::Cone if defect.abs() > 1e-6 + 1e-14 * size / mirror.distance(position) => wrong("V' is not on the cone"),
        Model::Cone if has_nearer_root(rig, theta, point, level(at)) => wrong("another root is nearer"),
        _ => Ok(()),
    }
}

/// Whether the cone's equation has another root nearer to the planar azimuth than `viewer`, seen from above, is: by its signs at a
/// few azimuths between, where it is continuous. It jumps where M runs to infinity and where it runs through V'.
fn has_nearer_root(rig: &Rig, theta: f64, point: DVec3, viewer: DVec2) -> bool {
    let planar = SliceOptics::new(rig, 0, theta, Model::Planar).project(point).viewer.map(Viewer::vector);
    let Some(planar) = planar.map(|planar| planar.x.atan2(planar.z)) else { return false };
    let (frame, position, offset) =
        (rig.mirror.face[0].frame(theta), rig.camera().position, rig.mirror.face[0].offset_m);
    let viewers = rig.viewers();
    let defect = |azimuth: f64| {
        let toward = viewers.place(azimuth, 1.0);
        let is_far = matches!(viewers, Viewers::Infinity { .. });
        let away = if is_far { toward } else { toward - point };
        let approach = frame.normal.dot(away);
        let reach = (offset - frame.normal.dot(point)) / approach;
        let mirror = point + away * reach;
        let outward = if is_far { away } else { (away + point - mirror).normalize() };
        let branch = (approach > 0.0, is_far || reach < 1.0);
        (branch, (outward - (mirror - position).normalize()).dot(frame.across))
    };
    let reach = (viewer.x.atan2(viewer.y) - planar + PI).rem_euclid(TAU) - PI;
    let at = |part: i32| defect(planar + 0.95 * reach.abs() * f64::from(part) / 16.0);
    // Nearer than this the signs are rounding's.
    reach.abs() > 1e-6
        && (-16..16).any(|part| {
            let ((branch, here), (other, next)) = (at(part), at(part + 1));
            branch == other && here * next < 0.0 && (next - here).abs() < 0.1
        })
}
