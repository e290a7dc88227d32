//! The sight line of a point: the planar fan's, and the cone's from there by table, by a few of Newton's steps, or by all of them.

use super::super::table::SliceTable;
use super::super::{Method, Real};
use super::{Line, Place, SliceProjector};

/// How often lengths may be larger than the difference that a direction is taken from. Beyond it too many digits cancel.
pub(super) const CANCELLATION: f64 = 4.0;
/// How far Newton's steps may stay from the root, in pixels.
pub(super) const NEWTON_PX: f64 = 0.02;
/// The same in radians of the viewer's azimuth, for images so coarse that pixels bound nothing.
pub(super) const NEWTON_TURN: f64 = 1e-3;
/// Newton's steps until the answer is left to the reference. Two reach 0.02 px on physical rigs, four the last digit.
const STEPS: usize = 6;

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
    /// The planar fan's line; `None` where too many digits cancel: near the axis of P', near the viewing circle, at grazing lines.
    #[inline]
    pub(super) fn planar(&self, place: &Place<F>) -> Option<Line<F>> {
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
    #[inline]
    fn is_steep(&self, place: &Place<F>, line: &Line<F>) -> bool {
        let squared = self.reach_squared + place.level_squared + place.y * place.y;
        let least = self.grazing * line.square * squared;
        line.toward_above * line.toward_above >= least && least.is_finite()
    }

    /// The line of a point toward a viewer who is `away` from it, seen from above.
    #[inline]
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
    #[inline]
    fn line_across(&self, place: &Place<F>, line: &Line<F>, x: F) -> Line<F> {
        let [radius, ..] = self.circle;
        let z = ((radius - x) * (radius + x)).sqrt().copysign(line.viewer[1]);
        self.line(place, [x - self.near * place.x, z - self.near * place.z])
    }

    /// From the planar fan's line to the method's; `None` where the method has no sure answer.
    #[inline]
    pub(super) fn follow(&self, place: &Place<F>, planar: Line<F>) -> Option<Line<F>> {
        match self.method {
            Method::Planar => Some(planar),
            Method::ConeRoot => self.root(place, planar),
            Method::ConeNewton => self.newton(place, planar, self.settled),
            Method::ConeTable => self.tabulated(place, &planar).or_else(|| self.newton(place, planar, self.settled)),
        }
    }

    /// The line by the table's correction of the viewer's place across; `None` outside the table.
    #[inline]
    fn tabulated(&self, place: &Place<F>, planar: &Line<F>) -> Option<Line<F>> {
        let correction = self.table.as_ref()?.correction([place.x, place.y, place.z])?;
        let line = self.line_across(place, planar, planar.viewer[0] + correction * planar.toward[0]);
        self.is_steep(place, &line).then_some(line)
    }

    /// The cone's line, to the last digits of `F` that [`Real::TOLERANCE_PX`] asks for.
    fn root(&self, place: &Place<F>, planar: Line<F>) -> Option<Line<F>> {
        self.newton(place, planar, self.settled * Self::root_part())
    }

    /// What part of the step after which Newton's method has settled is the root's.
    pub(super) fn root_part() -> F {
        F::of(0.1 * F::TOLERANCE_PX / NEWTON_PX)
    }

    /// What the table holds for a point of the mirror's frame: how far the cone moves the viewer across, over the planar line's way
    /// across.
    pub(in super::super) fn correction(&self, [x, y, z]: [F; 3]) -> Option<F> {
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
    pub(in super::super) fn with_table(self, table: SliceTable<F>) -> Self {
        Self { table: Some(table), ..self }
    }

    /// How far the table's M is from the root's, in metres, for a point of the mirror's frame; `None` where one of them has no answer,
    /// or the viewer is elsewhere.
    pub(in super::super) fn table_error_m(&self, point: [F; 3]) -> Option<F> {
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
    #[inline]
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
    #[inline]
    fn defect(&self, line: &Line<F>) -> Defect<F> {
        let across = line.mirror[0] - self.projector[0];
        let up = line.mirror[1] - self.projector[1];
        let inward = (across * across + up * up + self.projector[2] * self.projector[2]).sqrt().recip();
        let outward = line.square.sqrt().recip();
        Defect { value: line.toward[0] * outward - across * inward, across, up, inward, outward }
    }

    /// The defect's derivative by the viewer's place across.
    #[inline]
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
}
