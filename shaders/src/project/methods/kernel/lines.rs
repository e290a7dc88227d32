//! The sight line of a point: the planar fan's, and the cone's from there by table, by a few of Newton's steps, or by all of them.

use super::super::table::SliceTable;
use super::super::{Method, Real};
use super::{Line, Place, SliceProjector};
use core::array::from_fn;

/// How often lengths may be larger than the difference that a direction is taken from. Beyond it too many digits cancel.
pub(super) const CANCELLATION: f64 = 4.0;
/// How far Newton's steps may stay from the root, in pixels.
pub(super) const NEWTON_PX: f64 = 0.02;
/// The same in radians of the viewer's azimuth, for images so coarse that pixels bound nothing.
pub(super) const NEWTON_TURN: f64 = 1e-3;
/// Newton's steps until the answer is left to the reference. Two reach 0.02 px on physical rigs, four the last digit.
const STEPS: usize = 6;

/// How far a line is from the cone.
pub(super) struct Defect<F> {
    /// `o·e − i·e`.
    pub value: F,
    /// M − P across and along the slope.
    pub across: F,
    pub up: F,
    /// 1 / |M − P| and 1 / |V' − Q|.
    pub inward: F,
    pub outward: F,
}

/// Newton's method on its way.
#[derive(Clone, Copy)]
pub(super) struct Search<F> {
    pub(super) line: Line<F>,
    /// How fast the defect, times |V' − Q|, rose with the viewer's place across.
    rise: F,
    /// The size of the last step.
    last: F,
}

impl<F: Real> Search<F> {
    #[inline(always)]
    fn from(line: Line<F>) -> Self {
        // The rise is unknown: near a double root the defect is small where there is no root. The first step is to stay below an
        // eighth of a radian in the azimuth.
        Self { line, rise: F::zero(), last: line.viewer[1].abs() * F::of(0.5) }
    }

    #[inline(always)]
    fn is_settled(&self, defect: &Defect<F>, settled: F) -> bool {
        defect.value.abs() < settled * self.rise
    }
}

/// A [`Search`], or one on a bent piece, as few numbers, for many to lie in lanes.
#[derive(Clone, Copy)]
pub(in super::super) struct Course<F> {
    /// Of a [`Search`]: the line toward the viewer from above, its range, [`Search::rise`], [`Search::last`].
    pub numbers: [F; 5],
    /// [`NEAR`], [`SOUND`], [`SETTLED`], [`ASTRAY`].
    pub marks: i32,
}

/// [`Course::marks`]: the planar line's M is near the panel.
pub(super) const NEAR: i32 = 1;
/// [`Course::marks`]: the planar line's digits do not cancel.
pub(super) const SOUND: i32 = 2;
/// [`Course::marks`]: no step is needed any more.
const SETTLED: i32 = 4;
/// [`Course::marks`]: a step did not converge.
const ASTRAY: i32 = 8;

impl<F: Real> Course<F> {
    /// Where a step leads to, `next`, if one is needed.
    #[inline(always)]
    pub(super) fn after(self, is_settled: bool, converges: bool, next: Self) -> Self {
        let is_settled = (self.marks & SETTLED != 0) | is_settled;
        let marks = self.marks | if is_settled { SETTLED } else { 0 };
        let marks = marks | if is_settled | converges { 0 } else { ASTRAY };
        Self { numbers: from_fn(|index| if is_settled { self.numbers[index] } else { next.numbers[index] }), marks }
    }

    /// Whether it ends at a line that is settled.
    #[inline(always)]
    pub(super) fn has_arrived(&self, is_settled: bool) -> bool {
        ((self.marks & SETTLED != 0) | is_settled) & (self.marks & ASTRAY == 0)
    }

    #[inline(always)]
    fn of(search: &Search<F>, marks: i32) -> Self {
        let Search { line, rise, last } = *search;
        Self { numbers: [line.toward[0], line.toward[2], line.range, rise, last], marks }
    }
}

impl<F: Real> SliceProjector<F> {
    /// The planar fan's line; `None` where too many digits cancel: near the axis of P', near the viewing circle, at grazing lines.
    #[inline]
    pub(super) fn planar(&self, place: &Place<F>) -> Option<Line<F>> {
        let (line, is_sound) = match &self.bent {
            None => self.planar_line(place),
            Some(bent) => bent.planar_line(self, place),
        };
        is_sound.then_some(line)
    }

    /// The same with whether the digits do not cancel.
    #[inline(always)]
    pub(super) fn planar_line(&self, place: &Place<F>) -> (Line<F>, bool) {
        let ([x, z], square) = self.fan_of(place);
        let [radius, ..] = self.circle;
        let along = self.near * (place.x * x + place.z * z);
        let within = radius * radius - self.near * place.level_squared;
        let range = (along * along + within).sqrt() - along;
        let line = self.line(place, [range * x, range * z]);
        let few = F::of(CANCELLATION);
        let is_sound = (few * few * square >= self.image_squared + place.level_squared) & (few * range >= radius);
        (line, is_sound & self.is_steep(place, &line))
    }

    /// Seen from above, the direction from P' to a point, and the square of its distance.
    #[inline(always)]
    pub(super) fn fan_of(&self, place: &Place<F>) -> ([F; 2], F) {
        let away = [place.x - self.image[0], place.z - self.image[1]];
        let square = away[0] * away[0] + away[1] * away[1];
        let scale = square.sqrt().recip();
        (away.map(|component| component * scale), square)
    }

    /// Whether a line is so steep to the mirror that the rounding of point and direction stays tolerable in M. Also false where a
    /// number is not finite.
    #[inline(always)]
    fn is_steep(&self, place: &Place<F>, line: &Line<F>) -> bool {
        self.is_steeper(place, line, self.grazing)
    }

    #[inline(always)]
    pub(super) fn is_steeper(&self, place: &Place<F>, line: &Line<F>, grazing: F) -> bool {
        let squared = self.reach_squared + place.level_squared + place.y * place.y;
        let least = grazing * line.square * squared;
        (line.toward_above * line.toward_above >= least) & (least < F::infinity())
    }

    /// The line of a point toward a viewer who is `away` from it, seen from above.
    #[inline(always)]
    fn line(&self, place: &Place<F>, away: [F; 2]) -> Line<F> {
        self.line_of(place, away, |toward_above| place.above / toward_above)
    }

    /// The same, with its range from [`Line::toward_above`].
    #[inline(always)]
    fn line_of(&self, place: &Place<F>, away: [F; 2], range: impl FnOnce(F) -> F) -> Line<F> {
        let [_, height, from_origin] = self.circle;
        self.line_toward(place, away, [height, from_origin], range)
    }

    /// The same toward somebody at a height and a distance from the origin.
    #[inline(always)]
    pub(super) fn line_toward(
        &self,
        place: &Place<F>,
        [x, z]: [F; 2],
        [height, from_origin]: [F; 2],
        range: impl FnOnce(F) -> F,
    ) -> Line<F> {
        let y = height - self.near * place.y;
        let [sin, cos] = self.tilt;
        let toward_slope = sin * y - cos * z;
        let toward_above = cos * y + sin * z;
        let range = range(toward_above);
        Line {
            viewer: [self.near * place.x + x, self.near * place.z + z],
            height,
            from_origin,
            half: F::zero(),
            toward: [x, y, z],
            square: x * x + y * y + z * z,
            toward_slope,
            toward_above,
            range,
            mirror: [place.x - range * x, place.slope - range * toward_slope],
        }
    }

    /// The line to the place on the circle `x` across, on the same side of the axis as `line`.
    #[inline(always)]
    fn line_across(&self, place: &Place<F>, line: &Line<F>, x: F) -> Line<F> {
        let [radius, ..] = self.circle;
        let z = ((radius - x) * (radius + x)).sqrt().copysign(line.viewer[1]);
        self.line(place, [x - self.near * place.x, z - self.near * place.z])
    }

    /// From the planar fan's line to the method's; `None` where the method has no sure answer.
    #[inline]
    pub(super) fn follow(&self, place: &Place<F>, planar: Line<F>) -> Option<Line<F>> {
        if let Some(bent) = &self.bent {
            return match self.method {
                Method::Planar => Some(planar),
                Method::ConeRoot => bent.newton(self, place, planar, self.root_settled()),
                Method::ConeNewton | Method::ConeTable => bent.newton(self, place, planar, self.settled),
            };
        }
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
        self.newton(place, planar, self.root_settled())
    }

    /// [`SliceProjector::settled`] for [`Method::ConeRoot`].
    #[inline]
    pub(in super::super) fn root_settled(&self) -> F {
        self.settled * F::of(0.1 * F::TOLERANCE_PX / NEWTON_PX)
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
        let mut search = Search::from(planar);
        for _ in 0..STEPS {
            let defect = self.defect(&search.line);
            if search.is_settled(&defect, settled) {
                return self.is_steep(place, &search.line).then_some(search.line);
            }
            let converges;
            (search, converges) = self.step(place, &search, &defect);
            if !converges {
                return None;
            }
        }
        None
    }

    /// From the planar line.
    #[inline(always)]
    pub(super) fn start(&self, place: &Place<F>) -> Course<F> {
        let (planar, is_sound) = self.planar_line(place);
        Course::of(&Search::from(planar), self.marks(&planar, is_sound))
    }

    /// What a course begins with.
    #[inline(always)]
    pub(super) fn marks(&self, planar: &Line<F>, is_sound: bool) -> i32 {
        let near = if self.is_near(planar.mirror) { NEAR } else { 0 };
        near | if is_sound { SOUND } else { 0 }
    }

    /// One of the steps of [`SliceProjector::newton`] without a branch.
    #[inline(always)]
    pub(super) fn advance(&self, place: &Place<F>, course: Course<F>, settled: F) -> Course<F> {
        let search = self.search(place, &course);
        let defect = self.defect(&search.line);
        let (next, converges) = self.step(place, &search, &defect);
        course.after(search.is_settled(&defect, settled), converges, Course::of(&next, course.marks))
    }

    /// The line, and whether [`SliceProjector::newton`] returns it.
    #[inline(always)]
    pub(super) fn arrive(&self, place: &Place<F>, course: &Course<F>, settled: F) -> (Line<F>, bool) {
        let search = self.search(place, course);
        let is_settled = search.is_settled(&self.defect(&search.line), settled);
        (search.line, course.has_arrived(is_settled) & self.is_steep(place, &search.line))
    }

    #[inline(always)]
    pub(super) fn search(&self, place: &Place<F>, course: &Course<F>) -> Search<F> {
        let [x, z, range, rise, last] = course.numbers;
        Search { line: self.line_of(place, [x, z], |_| range), rise, last }
    }

    /// One of Newton's steps, and whether it is so small that it converges.
    #[inline(always)]
    fn step(&self, place: &Place<F>, search: &Search<F>, defect: &Defect<F>) -> (Search<F>, bool) {
        let slope = self.slope(&search.line, defect);
        let rise = slope / defect.outward;
        let step = defect.value / slope;
        let converges = (rise > F::of(CANCELLATION.recip())) & (step.abs() < search.last * F::of(0.25));
        let line = self.line_across(place, &search.line, search.line.viewer[0] - step);
        (Search { line, rise, last: step.abs() }, converges)
    }

    /// `o·e − i·e`.
    #[inline(always)]
    pub(super) fn defect(&self, line: &Line<F>) -> Defect<F> {
        let across = line.mirror[0] - self.projector[0];
        let up = line.mirror[1] - self.projector[1];
        let inward = (across * across + up * up + self.projector[2] * self.projector[2]).sqrt().recip();
        let outward = line.square.sqrt().recip();
        Defect { value: line.toward[0] * outward - across * inward, across, up, inward, outward }
    }

    /// The defect's derivative by the viewer's place across.
    #[inline(always)]
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
