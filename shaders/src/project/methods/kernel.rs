//! One slice in the mirror's frame: e is x, the axis is y, and the viewing circle, which turns into itself, stays as it is. The face's
//! plane is written in panel coordinates: across (x), up the slope, and above the plane.

use super::table::SliceTable;
use super::{Method, Real, SightLine, Vertex};
use crate::project::{SliceOptics, Viewer, Visibility};
use glam::{DMat3, DVec2, DVec3};
use protocol::rig::Viewers;

/// How often lengths may be larger than the difference that a direction is taken from. Beyond it too many digits cancel.
const CANCELLATION: f64 = 4.0;
/// How far Newton's steps may stay from the root, in pixels.
const NEWTON_PX: f64 = 0.02;
/// The same in radians of the viewer's azimuth, for images so coarse that pixels bound nothing.
const NEWTON_TURN: f64 = 1e-3;
/// Newton's steps until the answer is left to the reference. Two reach 0.02 px on physical rigs, four the last digit.
const STEPS: usize = 6;

/// One face in one slice.
#[derive(Clone, Debug)]
pub struct SliceProjector<F> {
    /// Answers what cancels too many digits here, or has no single root nearby.
    exact: SliceOptics,
    method: Method,
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
    settled: F,
}

#[derive(Clone, Copy, Debug)]
struct Lens<F> {
    principal: [F; 2],
    focal: [F; 2],
    radial: [F; 2],
    fold_squared: F,
}

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

/// How far a line is from the cone.
struct Defect<F> {
    /// `o·e − i·e`.
    value: F,
    /// M − P across and along the slope.
    across: F,
    up: F,
    /// 1 / |M − P| and 1 / |V' − Q|.
    inward: F,
    outward: F,
}

impl<F: Real> SliceProjector<F> {
    pub(super) fn new(exact: SliceOptics, method: Method, table: Option<SliceTable<F>>) -> Self {
        let frame = exact.frame;
        let level = DVec3::Y.cross(-frame.across);
        let panel = |point: DVec3| DVec3::new(frame.across.dot(point), frame.slope.dot(point), frame.normal.dot(point));
        let projector = panel(exact.camera.position) - DVec3::Z * exact.offset_m;
        let image = DVec2::new(frame.across.dot(exact.projector_image), level.dot(exact.projector_image));
        let (near, radius, height) = match exact.viewers {
            Viewers::Circle { distance_m, height_m } => (1.0, distance_m, height_m),
            Viewers::Infinity { elevation } => (0.0, elevation.cos(), elevation.sin()),
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
        let of2 = |[a, b]: [f64; 2]| [F::of(a), F::of(b)];
        Self {
            method,
            table,
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
            pixels: rows(pixels),
            mirrors: rows(pixels.inverse()),
            lens: exact.camera.lens().map(|lens| Lens {
                principal: of2(lens.principal_px.to_array()),
                focal: of2(lens.focal_px.to_array()),
                radial: of2(lens.radial),
                fold_squared: F::of(lens.fold_squared),
            }),
            reach_squared: F::of(reach * reach),
            grazing: F::of(if resolves_pixels {
                // The point's digits, and those of the direction times the lever to the mirror, each lose CANCELLATION at worst.
                (2.0 * CANCELLATION * F::epsilon().wide() * px_per_m / F::TOLERANCE_PX).powi(2)
            } else {
                f64::INFINITY
            }),
            settled: F::of((NEWTON_PX / (2.0 * reach * px_per_m)).min(NEWTON_TURN * radius / radius.hypot(height))),
            exact,
        }
    }

    /// Where world point `point` in metres appears; `None` where it has no pixel: no viewer, no mirror point in front of the viewer,
    /// behind the projector, or so far off the panel that nothing near it is on it.
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
        Some(Vertex {
            pixel: self.pixel(line.mirror)?,
            depth_m: self.depth(&place, &line),
            sides: self.sides(line.mirror),
            lit: self.is_lit(&line),
        })
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
        })
    }

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

    fn exact_sight(&self, pixel: [F; 2]) -> Option<SightLine<F>> {
        let mirror = self.exact.mirror_of(DVec2::from_array(pixel.map(F::wide)))?;
        let viewer = self.exact.sight_of(mirror)?.viewer;
        let toward = match viewer {
            Viewer::At(position) => (position - mirror).normalize(),
            Viewer::Toward(direction) => direction,
        };
        Some(SightLine {
            mirror: mirror.to_array().map(F::of),
            toward_viewer: toward.to_array().map(F::of),
            depth_m: F::of(self.exact.depth_from_circle(mirror, viewer)),
        })
    }

    fn place(&self, [x, y, z]: [F; 3]) -> Place<F> {
        let [sin, cos] = self.azimuth;
        self.place_in_frame([cos * x - sin * z, y, sin * x + cos * z])
    }

    /// A point given in the mirror's frame.
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

    /// The planar fan's line; `None` where too many digits cancel: near the axis of P', near the viewing circle, at grazing lines.
    fn planar(&self, place: &Place<F>) -> Option<Line<F>> {
        let away = [place.x - self.image[0], place.z - self.image[1]];
        let square = away[0] * away[0] + away[1] * away[1];
        let scale = square.sqrt().recip();
        let [x, z] = away.map(|component| component * scale);
        let [radius, ..] = self.circle;
        let along = self.near * (place.x * x + place.z * z);
        let within = radius * radius - self.near * place.level_squared;
        let range = (along * along + within).sqrt() - along;
        let line = self.line(place, [range * x, range * z]);
        let few = F::of(CANCELLATION);
        let sound = few * few * square >= self.image_squared + place.level_squared && few * range >= radius;
        (sound && self.is_steep(place, &line)).then_some(line)
    }

    /// Whether a line is so steep to the mirror that the rounding of point and direction stays tolerable in M. Also false where a
    /// number is not finite.
    fn is_steep(&self, place: &Place<F>, line: &Line<F>) -> bool {
        let squared = self.reach_squared + place.level_squared + place.y * place.y;
        let least = self.grazing * line.square * squared;
        line.toward_above * line.toward_above >= least && least.is_finite()
    }

    /// The line of a point toward a viewer who is `away` from it, seen from above.
    fn line(&self, place: &Place<F>, away: [F; 2]) -> Line<F> {
        let [x, z] = away;
        let y = self.circle[1] - self.near * place.y;
        let [sin, cos] = self.tilt;
        let toward_slope = sin * y - cos * z;
        let toward_above = cos * y + sin * z;
        let range = place.above / toward_above;
        Line {
            viewer: [self.near * place.x + x, self.near * place.z + z],
            toward: [x, y, z],
            square: x * x + y * y + z * z,
            toward_slope,
            toward_above,
            range,
            mirror: [place.x - range * x, place.slope - range * toward_slope],
        }
    }

    /// The line to the place on the circle `x` across, on the same side of the axis as `line`.
    fn line_across(&self, place: &Place<F>, line: &Line<F>, x: F) -> Line<F> {
        let [radius, ..] = self.circle;
        let z = ((radius - x) * (radius + x)).sqrt().copysign(line.viewer[1]);
        self.line(place, [x - self.near * place.x, z - self.near * place.z])
    }

    /// From the planar fan's line to the method's; `None` where the method has no sure answer.
    fn follow(&self, place: &Place<F>, planar: Line<F>) -> Option<Line<F>> {
        match self.method {
            Method::Planar => Some(planar),
            Method::ConeRoot => self.root(place, planar),
            Method::ConeNewton => self.newton(place, planar, self.settled),
            Method::ConeTable => self.tabulated(place, &planar).or_else(|| self.newton(place, planar, self.settled)),
        }
    }

    /// The line by the table's correction of the viewer's place across; `None` outside the table.
    fn tabulated(&self, place: &Place<F>, planar: &Line<F>) -> Option<Line<F>> {
        let correction = self.table.as_ref()?.correction([place.x, place.y, place.z])?;
        let line = self.line_across(place, planar, planar.viewer[0] + correction * planar.toward[0]);
        self.is_steep(place, &line).then_some(line)
    }

    /// The cone's line, to the last digits of `F` that [`Real::TOLERANCE_PX`] asks for.
    fn root(&self, place: &Place<F>, planar: Line<F>) -> Option<Line<F>> {
        self.newton(place, planar, self.settled * F::of(0.1 * F::TOLERANCE_PX / NEWTON_PX))
    }

    /// What the table holds for a point of the mirror's frame: how far the cone moves the viewer across, over the planar line's way
    /// across.
    pub(super) fn correction(&self, [x, y, z]: [F; 3]) -> Option<F> {
        // Straight ahead both are 0, and their quotient is as it is a little aside.
        let aside = x + F::of(1e-4) * self.reach_squared.sqrt();
        [x, aside].into_iter().find_map(|x| {
            let place = self.place_in_frame([x, y, z]);
            let planar = self.planar(&place)?;
            let quotient = (self.root(&place, planar)?.viewer[0] - planar.viewer[0]) / planar.toward[0];
            (planar.toward[0].abs() > F::of(1e-6) * planar.square.sqrt()).then_some(quotient)
        })
    }

    /// The same projector with a table.
    pub(super) fn with_table(self, table: SliceTable<F>) -> Self {
        Self { table: Some(table), ..self }
    }

    /// How far the table's M is from the root's, in metres, for a point of the mirror's frame; `None` where one of them has no answer,
    /// or the viewer is elsewhere.
    pub(super) fn table_error_m(&self, point: [F; 3]) -> Option<F> {
        let place = self.place_in_frame(point);
        let planar = self.planar(&place)?;
        let (table, root) = (self.tabulated(&place, &planar)?, self.root(&place, planar)?);
        let turn = (table.viewer[0] - root.viewer[0]).abs() / root.viewer[1].abs();
        let apart = (table.mirror[0] - root.mirror[0]).hypot(table.mirror[1] - root.mirror[1]);
        (turn < F::of(NEWTON_TURN)).then_some(apart)
    }

    /// Newton's method on `o·e − i·e` in the viewer's place across, from the planar line, until a step turns the line by less than
    /// `settled` radians. `None` where it does not converge at once, as near a double root: the root may not be the nearest then.
    ///
    /// The place across is a better unknown than the azimuth: the defect is nearly linear in it.
    fn newton(&self, place: &Place<F>, planar: Line<F>, settled: F) -> Option<Line<F>> {
        let mut line = planar;
        // Unknown: near a double root the defect is small where there is no root.
        let mut rise = F::zero();
        // The first step stays below an eighth of a radian in the azimuth.
        let mut last = planar.viewer[1].abs() * F::of(0.5);
        for _ in 0..STEPS {
            let defect = self.defect(&line);
            if defect.value.abs() < settled * rise {
                return self.is_steep(place, &line).then_some(line);
            }
            let slope = self.slope(&line, &defect);
            rise = slope / defect.outward;
            let step = defect.value / slope;
            let converges = rise > F::of(CANCELLATION.recip()) && step.abs() < last * F::of(0.25);
            if !converges {
                return None;
            }
            last = step.abs();
            line = self.line_across(place, &line, line.viewer[0] - step);
        }
        None
    }

    /// `o·e − i·e`.
    fn defect(&self, line: &Line<F>) -> Defect<F> {
        let across = line.mirror[0] - self.projector[0];
        let up = line.mirror[1] - self.projector[1];
        let inward = (across * across + up * up + self.projector[2] * self.projector[2]).sqrt().recip();
        let outward = line.square.sqrt().recip();
        Defect { value: line.toward[0] * outward - across * inward, across, up, inward, outward }
    }

    /// The defect's derivative by the viewer's place across.
    fn slope(&self, line: &Line<F>, defect: &Defect<F>) -> F {
        let [sin, cos] = self.tilt;
        let [x, _, z] = line.toward;
        let Defect { across, up, inward, outward, .. } = *defect;
        // How the viewer's other coordinate, the range, and M follow.
        let viewer_z = -line.viewer[0] / line.viewer[1];
        let range = -line.range * sin * viewer_z / line.toward_above;
        let mirror_across = -(range * x + line.range);
        let mirror_up = -(range * line.toward_slope - line.range * cos * viewer_z);
        let incident = inward * (mirror_across - across * inward * inward * (across * mirror_across + up * mirror_up));
        outward * (F::one() - x * outward * outward * (x + z * viewer_z)) - incident
    }

    /// |V' − Q| less the circle's distance: the difference of the squares over the sum.
    fn depth(&self, place: &Place<F>, line: &Line<F>) -> F {
        let [_, height, distance] = self.circle;
        let squared = self.near * (place.level_squared + place.y * place.y);
        let along = place.x * line.viewer[0] + place.y * height + place.z * line.viewer[1];
        (squared - along - along) / (line.square.sqrt() + distance)
    }

    fn pixel(&self, [across, slope]: [F; 2]) -> Option<[F; 2]> {
        let [u, v, w] = self.pixels.map(|[a, b, c]| a * across + b * slope + c);
        if w.is_nan() || w <= F::zero() {
            return None;
        }
        let scale = w.recip();
        let pixel = [u * scale, v * scale];
        match &self.lens {
            None => Some(pixel),
            Some(lens) => lens.distort(pixel),
        }
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
    fn is_near(&self, [across, slope]: [F; 2]) -> bool {
        let [low, high] = self.slope_span;
        let size = high - low;
        across.abs() <= self.half_width * F::of(3.0) && low - size <= slope && slope <= high + size
    }

    fn sides(&self, [across, slope]: [F; 2]) -> u8 {
        let ([low, high], half_width, guard) = (self.slope_span, self.half_width, self.guard);
        u8::from(across < -half_width - guard)
            | u8::from(across > half_width + guard) << 1
            | u8::from(slope < low - guard) << 2
            | u8::from(slope > high + guard) << 3
    }

    fn is_lit(&self, line: &Line<F>) -> bool {
        let [sin, cos] = self.tilt;
        sin * line.viewer[1] + cos * self.circle[1] > self.near * self.offset
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
    fn distort(&self, pixel: [F; 2]) -> Option<[F; 2]> {
        let ideal = [0, 1].map(|axis| (pixel[axis] - self.principal[axis]) / self.focal[axis]);
        let squared = ideal[0] * ideal[0] + ideal[1] * ideal[1];
        let gain = F::one() + squared * (self.radial[0] + squared * self.radial[1]);
        (squared < self.fold_squared)
            .then(|| [0, 1].map(|axis| self.principal[axis] + self.focal[axis] * ideal[axis] * gain))
    }
}
