//! One slice in the mirror's frame: e is x, the axis is y, and the viewing circle, which turns into itself, stays as it is. The face's
//! plane is written in panel coordinates: across (x), up the slope, and above the plane.
//!
//! What a vertex runs through is inlined: with calls it took twice as long (60 ns for 29 ns, planar, double precision).

mod bent;
mod lines;
mod shared;

use super::lanes::{NOWHERE, UNLIT};
use super::table::SliceTable;
use super::{Method, Real, SightLine, Vertex};
use crate::project::{SliceOptics, Viewer, Visibility};
use bent::{Bent, Sector};
use glam::{DMat3, DVec2, DVec3};
pub(super) use lines::Course;
use lines::{CANCELLATION, NEAR, NEWTON_PX, NEWTON_TURN, SOUND};

/// One face in one slice.
#[derive(Clone, Debug)]
pub struct SliceProjector<F> {
    /// Answers what cancels too many digits here, or has no single root nearby.
    exact: SliceOptics,
    pub(super) method: Method,
    table: Option<SliceTable<F>>,
    /// Sine and cosine of the face's azimuth, and of its tilt.
    azimuth: [F; 2],
    tilt: [F; 2],
    offset: F,
    half_width: F,
    slope_span: [F; 2],
    guard: F,
    /// P in panel coordinates.
    projector: [F; 3],
    /// P' seen from above, in the mirror's frame, and the square of its distance from the axis.
    image: [F; 2],
    image_squared: F,
    /// 1 for viewers at a distance. For those at infinity 0: the circle is then one of unit directions, and points are all at its centre.
    near: F,
    /// Radius of the circle, its height, and its distance from the origin.
    circle: [F; 3],
    /// The last of these before it was rounded.
    from_origin_m: f64,
    /// What viewers' places are made of where the fan of this slice meets a curve that is no circle there.
    bent: Option<Bent<F>>,
    /// Homogeneous pixels from (across, slope, 1) on the plane.
    pixels: [[F; 3]; 3],
    /// Its inverse.
    mirrors: [[F; 3]; 3],
    lens: Option<Lens<F>>,
    /// The square of the panel's reach from the origin.
    reach_squared: F,
    /// The square of the sine of the angle to the mirror's plane, per square metre of distance, above which rounding stays tolerable.
    grazing: F,
    /// The largest step, in radians of the sight line, after which the cone's root is reached.
    pub(super) settled: F,
}

#[derive(Clone, Copy, Debug)]
struct Lens<F> {
    principal: [F; 2],
    focal: [F; 2],
    radial: [F; 2],
    fold_squared: F,
}

/// What [`SliceProjector::last_part`] finds.
pub(super) struct Trial<F> {
    pub pixel: [F; 2],
    pub depth_m: F,
    /// As [`super::lanes::Lanes::state`], or [`UNSURE`].
    pub state: i32,
}

/// [`Trial::state`]: to be asked of [`SliceProjector::vertex`].
pub(super) const UNSURE: i32 = 0x40;

/// A point of the scene.
#[derive(Clone, Copy)]
struct Place<F> {
    x: F,
    y: F,
    z: F,
    slope: F,
    above: F,
    level_squared: F,
}

/// A sight line of a point.
#[derive(Clone, Copy)]
struct Line<F> {
    /// V' from above, in the mirror's frame.
    viewer: [F; 2],
    /// The height of V', and its distance from the origin.
    height: F,
    from_origin: F,
    /// The tangent of half the azimuth of V' in the mirror's frame, where the curve is bent.
    half: F,
    /// V' − Q in the mirror's frame, and its square.
    toward: [F; 3],
    square: F,
    /// The same along the slope, and above the plane.
    toward_slope: F,
    toward_above: F,
    /// (Q − M) / (V' − Q).
    range: F,
    /// M: across, slope.
    mirror: [F; 2],
}

impl<F: Real> SliceProjector<F> {
    pub(super) fn new(exact: SliceOptics, method: Method, table: Option<SliceTable<F>>) -> Self {
        let frame = exact.frame;
        let level = DVec3::Y.cross(-frame.across);
        let panel = |point: DVec3| DVec3::new(frame.across.dot(point), frame.slope.dot(point), frame.normal.dot(point));
        let projector = panel(exact.camera.position) - DVec3::Z * exact.offset_m;
        let image = DVec2::new(frame.across.dot(exact.projector_image), level.dot(exact.projector_image));
        let sector = Sector::of(&exact);
        let (near, radius, height) = match sector {
            Sector::Infinity { elevation } => (0.0, elevation.cos(), elevation.sin()),
            Sector::Circle(spot) | Sector::Rest(spot) | Sector::Bent(spot, _) | Sector::Unknown(spot) => {
                (1.0, spot.distance_m, spot.height_m)
            }
        };
        let camera = exact.camera.pixel_from_world();
        let pixels = DMat3::from_cols(
            camera * frame.across,
            camera * frame.slope,
            camera * (exact.offset_m * frame.normal - exact.camera.position),
        );
        // A homogeneous matrix has no scale; one of about 1 stays within the range of single precision.
        let rows = |matrix: DMat3| {
            let scale =
                matrix.to_cols_array().into_iter().fold(0.0, |largest: f64, entry| largest.max(entry.abs())).recip();
            [0, 1, 2].map(|row| (matrix.row(row) * scale).to_array().map(F::of))
        };
        let reach = exact.reach_m();
        let px_per_m = exact.px_per_m();
        // The terms of a pixel's coordinate are as large as it is, or as the panel is in the image.
        let resolves_pixels = 8.0 * F::epsilon().wide() * (exact.largest_px() + reach * px_per_m) < F::TOLERANCE_PX;
        let grazing = F::of(if resolves_pixels {
            // The rounding of the point and of the direction times the lever to the mirror grow by CANCELLATION at worst.
            (CANCELLATION * F::epsilon().wide() * px_per_m / F::TOLERANCE_PX).powi(2)
        } else {
            f64::INFINITY
        });
        let is_round = !matches!(sector, Sector::Unknown(_) | Sector::Bent(..));
        let is_elsewhere = matches!(sector, Sector::Circle(_));
        let of2 = |[a, b]: [f64; 2]| [F::of(a), F::of(b)];
        Self {
            method,
            // A table is the resting circle's.
            table: table.filter(|_| !is_elsewhere),
            azimuth: of2([level.x, level.z]),
            tilt: of2([frame.normal.dot(level), frame.normal.y]),
            offset: F::of(exact.offset_m),
            half_width: F::of(exact.half_width_m),
            slope_span: of2(exact.slope_span_m),
            guard: F::of(exact.guard_m),
            projector: projector.to_array().map(F::of),
            image: of2(image.to_array()),
            image_squared: F::of(image.length_squared()),
            near: F::of(near),
            circle: [radius, height, radius.hypot(height)].map(F::of),
            from_origin_m: if near == 0.0 { f64::INFINITY } else { radius.hypot(height) },
            bent: if let Sector::Bent(_, bent) = sector { Some(bent.refusing(grazing)) } else { None },
            pixels: rows(pixels),
            mirrors: rows(pixels.inverse()),
            lens: exact.camera.lens().map(|lens| Lens {
                principal: of2(lens.principal_px.to_array()),
                focal: of2(lens.focal_px.to_array()),
                radial: of2(lens.radial),
                fold_squared: F::of(lens.fold_squared),
            }),
            reach_squared: F::of(reach * reach),
            grazing: if is_round { grazing } else { F::infinity() },
            settled: F::of((NEWTON_PX / (2.0 * reach * px_per_m)).min(NEWTON_TURN * radius / radius.hypot(height))),
            exact,
        }
    }

    /// Where world point `point` in metres appears; `None` where it has no pixel: no viewer, no mirror point in front of the viewer,
    /// behind the projector, or so far off the panel that nothing near it is on it.
    #[inline]
    pub fn vertex(&self, point: [F; 3]) -> Option<Vertex<F>> {
        let place = self.place(point);
        let Some(planar) = self.planar(&place) else { return self.exact_vertex(point) };
        if !self.is_near(planar.mirror) {
            return None;
        }
        let Some(line) = self.follow(&place, planar) else { return self.exact_vertex(point) };
        // The mirror is behind the viewer.
        if line.range * self.near <= -F::one() {
            return None;
        }
        let (pixel, is_imaged) = self.pixel(line.mirror);
        is_imaged.then(|| Vertex {
            pixel,
            depth_m: self.depth(&place, &line),
            sides: self.sides(line.mirror) as u8,
            lit: self.is_lit(&line),
        })
    }

    /// Whether viewers are on a bent piece of a curve in this slice.
    pub fn is_bent(&self) -> bool {
        self.bent.is_some()
    }

    /// How many bends the curve has in this slice.
    pub(super) fn bends(&self) -> u32 {
        self.bent.as_ref().map_or(0, Bent::count)
    }

    /// How many parts come first: the planar line is one of them on a circle, and several where viewers are on bends, at most `PIECES` of
    /// them as everywhere here.
    pub(super) const fn first_parts<const PIECES: usize>() -> usize {
        if PIECES > 0 { Bent::<F>::PLANAR_PARTS } else { 1 }
    }

    /// The first of the parts of [`SliceProjector::vertex`] without a branch, in order. Between them and the last come steps.
    #[inline(always)]
    pub(super) fn first_part<const PIECES: usize>(&self, point: [F; 3], part: usize, course: Course<F>) -> Course<F> {
        let place = self.place(point);
        match &self.bent {
            Some(bent) if PIECES > 0 => bent.start::<PIECES>(self, &place, part, course),
            _ => self.start(&place),
        }
    }

    /// A step toward the cone's line.
    #[inline(always)]
    pub(super) fn next_part<const PIECES: usize>(&self, point: [F; 3], course: Course<F>, settled: F) -> Course<F> {
        let place = self.place(point);
        match &self.bent {
            Some(bent) if PIECES > 0 => bent.advance::<PIECES>(self, &place, course, settled),
            _ => self.advance(&place, course, settled),
        }
    }

    /// The last part. With `CONE` it asks for the cone's line.
    #[inline(always)]
    pub(super) fn last_part<const PIECES: usize, const CONE: bool>(
        &self,
        point: [F; 3],
        course: Course<F>,
        settled: F,
    ) -> Trial<F> {
        let place = self.place(point);
        let (line, is_reached) = match (&self.bent, CONE) {
            (Some(bent), true) if PIECES > 0 => bent.arrive::<PIECES>(self, &place, &course, settled),
            (Some(bent), false) if PIECES > 0 => (bent.begun::<PIECES>(self, &place, &course), true),
            (_, true) => self.arrive(&place, &course, settled),
            (_, false) => (self.search(&place, &course).line, true),
        };
        let (pixel, is_imaged) = self.pixel(line.mirror);
        let is_near = course.marks & NEAR != 0;
        let is_sure = (course.marks & SOUND != 0) & (is_reached | !is_near);
        let is_somewhere = is_near & is_imaged & (line.range * self.near > -F::one());
        let state = self.sides(line.mirror) | if self.is_lit(&line) { 0 } else { UNLIT };
        let state = if is_somewhere { state } else { NOWHERE };
        Trial { pixel, depth_m: self.depth(&place, &line), state: if is_sure { state } else { UNSURE } }
    }

    /// What `pixel` shows; `None` where its ray misses the panel with its guard band, or where no lit viewer sees it.
    pub fn sight(&self, pixel: [F; 2]) -> Option<SightLine<F>> {
        let mirror = self.mirror_of(pixel)?;
        if self.sides(mirror) != 0 {
            return None;
        }
        let place = self.place_on_panel(mirror);
        let Some(line) = self.planar(&place).and_then(|planar| self.follow(&place, planar)) else {
            return self.exact_sight(pixel);
        };
        let length = line.square.sqrt();
        self.is_lit(&line).then(|| SightLine {
            mirror: self.to_world([place.x, place.y, place.z]),
            toward_viewer: self.to_world(line.toward.map(|component| component / length)),
            depth_m: self.depth(&place, &line),
            from_origin_m: if self.bent.is_some() { line.from_origin.wide() } else { self.from_origin_m },
        })
    }

    #[cold]
    fn exact_vertex(&self, point: [F; 3]) -> Option<Vertex<F>> {
        let point = DVec3::from_array(point.map(F::wide));
        if !self.exact.is_near(point) {
            return None;
        }
        let projected = self.exact.project(point);
        if projected.visibility == Visibility::NoMirror {
            return None;
        }
        let vertex = Vertex {
            pixel: projected.pixel?.to_array().map(F::of),
            depth_m: F::of(self.exact.depth_from_circle(point, projected.viewer?)),
            sides: self.exact.sides(projected.mirror?),
            lit: self.exact.is_lit(projected.viewer?),
        };
        // Single precision ends at 3e38.
        vertex.pixel.into_iter().chain([vertex.depth_m]).all(F::is_finite).then_some(vertex)
    }

    #[cold]
    fn exact_sight(&self, pixel: [F; 2]) -> Option<SightLine<F>> {
        let mirror = self.exact.mirror_of(DVec2::from_array(pixel.map(F::wide)))?;
        let viewer = self.exact.sight_of(mirror)?.viewer;
        let (toward, from_origin_m) = match viewer {
            Viewer::At(position) => ((position - mirror).normalize(), self.exact.origin_distance_m(position)),
            Viewer::Toward(direction) => (direction, f64::INFINITY),
        };
        Some(SightLine {
            mirror: mirror.to_array().map(F::of),
            toward_viewer: toward.to_array().map(F::of),
            depth_m: F::of(self.exact.depth_from_circle(mirror, viewer)),
            from_origin_m,
        })
    }

    #[inline(always)]
    fn place(&self, [x, y, z]: [F; 3]) -> Place<F> {
        let [sin, cos] = self.azimuth;
        self.place_in_frame([cos * x - sin * z, y, sin * x + cos * z])
    }

    /// A point given in the mirror's frame.
    #[inline(always)]
    fn place_in_frame(&self, [x, y, z]: [F; 3]) -> Place<F> {
        let [sin, cos] = self.tilt;
        Place {
            x,
            y,
            z,
            slope: sin * y - cos * z,
            above: cos * y + sin * z - self.offset,
            level_squared: x * x + z * z,
        }
    }

    fn place_on_panel(&self, [across, slope]: [F; 2]) -> Place<F> {
        let [sin, cos] = self.tilt;
        let (y, z) = (cos * self.offset + sin * slope, sin * self.offset - cos * slope);
        Place { x: across, y, z, slope, above: F::zero(), level_squared: across * across + z * z }
    }

    fn to_world(&self, [x, y, z]: [F; 3]) -> [F; 3] {
        let [sin, cos] = self.azimuth;
        [cos * x + sin * z, y, cos * z - sin * x]
    }

    /// |V' − Q| less the distance of V' from the origin: the difference of the squares over the sum.
    #[inline(always)]
    fn depth(&self, place: &Place<F>, line: &Line<F>) -> F {
        let squared = self.near * (place.level_squared + place.y * place.y);
        let along = place.x * line.viewer[0] + place.y * line.height + place.z * line.viewer[1];
        (squared - along - along) / (line.square.sqrt() + line.from_origin)
    }

    /// The pixel of M, and whether there is one: M is in front of the projector, and the lens does not fold it back.
    #[inline(always)]
    fn pixel(&self, [across, slope]: [F; 2]) -> ([F; 2], bool) {
        let [u, v, w] = self.pixels.map(|[a, b, c]| a * across + b * slope + c);
        let scale = w.recip();
        let (pixel, is_ahead) = ([u * scale, v * scale], w > F::zero());
        let Some(lens) = &self.lens else { return (pixel, is_ahead) };
        let (pixel, is_unfolded) = lens.distort(pixel);
        (pixel, is_ahead & is_unfolded)
    }

    /// M of a pixel; `None` where the projector's ray does not meet the plane.
    fn mirror_of(&self, pixel: [F; 2]) -> Option<[F; 2]> {
        let [u, v] = match self.lens {
            None => pixel,
            Some(_) => self.exact.camera.undistort(DVec2::from_array(pixel.map(F::wide))).to_array().map(F::of),
        };
        let [across, slope, w] = self.mirrors.map(|[a, b, c]| a * u + b * v + c);
        (w > F::zero()).then(|| [across / w, slope / w])
    }

    /// As [`SliceOptics::is_near`].
    #[inline(always)]
    fn is_near(&self, [across, slope]: [F; 2]) -> bool {
        let [low, high] = self.slope_span;
        let size = high - low;
        (across.abs() <= self.half_width * F::of(3.0)) & (low - size <= slope) & (slope <= high + size)
    }

    #[inline(always)]
    fn sides(&self, [across, slope]: [F; 2]) -> i32 {
        let ([low, high], half_width, guard) = (self.slope_span, self.half_width, self.guard);
        i32::from(across < -half_width - guard)
            | i32::from(across > half_width + guard) << 1
            | i32::from(slope < low - guard) << 2
            | i32::from(slope > high + guard) << 3
    }

    #[inline(always)]
    fn is_lit(&self, line: &Line<F>) -> bool {
        let [sin, cos] = self.tilt;
        self.exact.projector_is_above & (sin * line.viewer[1] + cos * line.height > self.near * self.offset)
    }

    /// Whether the panel's corners, and points its reach above and below them, are answered in `F` itself.
    pub(super) fn is_sound(&self) -> bool {
        let reach = self.reach_squared.sqrt();
        let places = [-1.0, 0.0, 1.0].map(|part| reach * F::of(part));
        places.into_iter().all(|y| {
            places
                .into_iter()
                .all(|x| places.into_iter().all(|z| self.planar(&self.place_in_frame([x, y, z])).is_some()))
        })
    }
}

impl<F: Real> Lens<F> {
    /// Where an ideal pixel goes, and whether the lens does not fold it back.
    #[inline(always)]
    fn distort(&self, pixel: [F; 2]) -> ([F; 2], bool) {
        let ideal = [0, 1].map(|axis| (pixel[axis] - self.principal[axis]) / self.focal[axis]);
        let squared = ideal[0] * ideal[0] + ideal[1] * ideal[1];
        let gain = F::one() + squared * (self.radial[0] + squared * self.radial[1]);
        ([0, 1].map(|axis| self.principal[axis] + self.focal[axis] * ideal[axis] * gain), squared < self.fold_squared)
    }
}
