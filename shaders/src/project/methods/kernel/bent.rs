//! Sight lines where viewers are on a bent piece of a curve: the planar fan's and the cone's, both by Newton's steps in the tangent of
//! half the azimuth in the mirror's frame, from which all else follows by few operations.

use super::super::Real;
use super::lines::{CANCELLATION, Course};
use super::{Line, Place, SliceProjector};
use crate::project::SliceOptics;
use crate::wgsl::BENDS;
use core::array::from_fn;
use core::f64::consts::PI;
use protocol::rig::Viewers;
use protocol::rig::curve::{Bend, Spot, ViewingCurve};

/// Newton's steps to the planar fan's line.
const PLANAR_STEPS: usize = 3;
/// The largest last of them, in radians over the root of [`Real::TOLERANCE_PX`], after which it is taken: its error is about the square
/// of that, times 12 where the curve goes 1.1 m away within 10°.
const PLANAR_LAST: f64 = 1e-3;
/// Newton's steps to the cone's line until the answer is left to the reference.
const CONE_STEPS: usize = 8;
/// How much a sight line's slant and the curve's may make of each other: at 1 a line may touch the curve and cross it twice more.
const SLANT: f64 = 0.7;
/// At so many places of a fan the curve's slant is taken.
const SAMPLES: i32 = 64;

/// Viewers' places in the fan of a slice.
#[derive(Clone, Copy, Debug)]
pub(super) struct Bent<F> {
    /// Distance and height where the first bend begins.
    pub(super) from: [F; 2],
    /// In order; those that are not needed lead nowhere.
    bends: [Piece<F>; BENDS],
    /// Lines that pass the axis at less than the root of this cross the curve once.
    pub(super) passing: F,
    /// As [`SliceProjector::grazing`], which here refuses all lines of the circle.
    pub(super) grazing: F,
    count: u32,
}

/// A bend: its start in the mirror's frame, 1 / its width, and what it adds to distance and height.
#[derive(Clone, Copy, Debug)]
struct Piece<F> {
    start: F,
    scale: F,
    rise: [F; 2],
}

/// A place of the curve.
struct Stand<F> {
    /// V' in the mirror's frame.
    at: [F; 3],
    /// How it moves with its azimuth, per radian.
    moves: [F; 3],
    /// Radians for a step of the tangent of half the azimuth.
    turn: F,
}

/// Newton's method on its way.
#[derive(Clone, Copy)]
struct Search<F> {
    half: F,
    /// How fast the defect rose, as [`super::lines::Search::rise`].
    rise: F,
    /// The size of the last step in radians.
    last: F,
}

impl<F: Real> Search<F> {
    #[inline(always)]
    fn from(half: F) -> Self {
        Self { half, rise: F::zero(), last: F::of(0.5) }
    }

    #[inline(always)]
    fn on(course: &Course<F>) -> Self {
        let [half, rise, last, ..] = course.numbers;
        Self { half, rise, last }
    }

    #[inline(always)]
    fn course(&self, marks: i32) -> Course<F> {
        Course { numbers: [self.half, self.rise, self.last, F::zero(), F::zero()], marks }
    }
}

/// One of its steps.
struct Step<F> {
    /// The line before it.
    line: Line<F>,
    /// Whether that is the answer.
    is_settled: bool,
    converges: bool,
    next: Search<F>,
}

/// Where the viewers of a slice are.
pub(super) enum Sector<F> {
    /// At infinity.
    Infinity { elevation: f64 },
    /// On the rig's circle.
    Rest(Spot),
    /// On another circle.
    Circle(Spot),
    /// On bends, from this place on.
    Bent(Spot, Bent<F>),
    /// Where only the reference knows, about this place.
    Unknown(Spot),
}

impl<F: Real> Sector<F> {
    /// Of the fan of a slice.
    pub(super) fn of(exact: &SliceOptics) -> Self {
        match &exact.viewers {
            Viewers::Infinity { elevation } => Self::Infinity { elevation: *elevation },
            Viewers::Circle { distance_m, height_m } => {
                Self::Rest(Spot { distance_m: *distance_m, height_m: *height_m })
            }
            Viewers::Curve(curve) => Self::on(curve, exact),
        }
    }

    /// Of `curve` in that fan.
    fn on(curve: &ViewingCurve, exact: &SliceOptics) -> Self {
        let azimuth = exact.azimuth();
        let Some(fan) = exact.fan().filter(|[from, to]| to - from < PI) else {
            return Self::Unknown(curve.spot(azimuth));
        };
        let (spot, bends) = curve.sector(fan);
        match bends.len() {
            0 if spot == curve.rest() => Self::Rest(spot),
            0 => Self::Circle(spot),
            1..=BENDS if is_resolved::<F>(spot, &bends, curve.distances()[0], exact) => {
                Self::Bent(spot, Bent::new(curve, spot, &bends, fan, azimuth))
            }
            _ => Self::Unknown(spot),
        }
    }
}

/// Whether adding `bends` up from `spot`, no nearer to the axis than `least_m`, rounds a place by too little to be seen: a viewer 4 km below
/// another one would be misplaced by half a millimetre in single precision.
fn is_resolved<F: Real>(spot: Spot, bends: &[Bend], least_m: f64, exact: &SliceOptics) -> bool {
    let sum = |of: fn(&Spot) -> f64| {
        bends.iter().fold(of(&spot).abs(), |sum, bend| sum + (of(&bend.to) - of(&bend.from)).abs())
    };
    let largest_m = sum(|spot| spot.distance_m).max(sum(|spot| spot.height_m));
    F::epsilon().wide() * largest_m / least_m * exact.reach_m() * exact.px_per_m() < F::TOLERANCE_PX
}

impl<F: Real> Bent<F> {
    fn new(curve: &ViewingCurve, spot: Spot, bends: &[Bend], [from, to]: [f64; 2], azimuth: f64) -> Self {
        let away = azimuth - from;
        let whole_turns = 2.0 * PI * (away / (2.0 * PI)).round();
        let piece = |bend: &Bend| Piece {
            start: F::of(bend.start - azimuth + whole_turns),
            scale: F::of(bend.width.recip()),
            rise: [bend.to.distance_m - bend.from.distance_m, bend.to.height_m - bend.from.height_m].map(F::of),
        };
        let nowhere = Piece { start: F::zero(), scale: F::one(), rise: [F::zero(); 2] };
        let distance = |part: i32| {
            let azimuth = from + (to - from) * f64::from(part) / f64::from(SAMPLES);
            curve.spot(azimuth).distance_m
        };
        let step = (to - from) / f64::from(SAMPLES);
        let slants = (0..SAMPLES).map(|part| (distance(part + 1) / distance(part)).ln().abs() / step);
        let steepest = slants.fold(0.0, f64::max) / SLANT;
        let least = (0..=SAMPLES).map(distance).fold(f64::INFINITY, f64::min);
        Self {
            from: [spot.distance_m, spot.height_m].map(F::of),
            bends: from_fn(|index| bends.get(index).map_or(nowhere, piece)),
            passing: F::of(least * least / (1.0 + steepest * steepest)),
            grazing: F::infinity(),
            count: bends.len() as u32,
        }
    }

    /// The same where lines are refused that are less steep than [`SliceProjector::grazing`] says.
    pub(super) fn refusing(self, grazing: F) -> Self {
        Self { grazing, ..self }
    }

    /// Where the first `PIECES` bends lead; there are no more of them, or others would count.
    #[inline(always)]
    fn stand<const PIECES: usize>(&self, half: F) -> Stand<F> {
        let one = F::one();
        let square = half * half;
        let scale = (one + square).recip();
        let (sin, cos) = ((half + half) * scale, (one - square) * scale);
        let azimuth = F::twice_arctangent(half);
        let [mut distance, mut height] = self.from;
        let [mut outward, mut upward] = [F::zero(); 2];
        for Piece { start, scale, rise } in &self.bends[..PIECES] {
            let way = ((azimuth - *start) * *scale).max(F::zero()).min(one);
            let left = one - way;
            let share = way * way * (left + left + one);
            let slope = (way + way) * (left + left + left) * *scale;
            (distance, height) = (distance + share * rise[0], height + share * rise[1]);
            (outward, upward) = (outward + slope * rise[0], upward + slope * rise[1]);
        }
        Stand {
            at: [distance * sin, height, distance * cos],
            moves: [outward * sin + distance * cos, upward, outward * cos - distance * sin],
            turn: one + cos,
        }
    }

    /// The line of a point toward a place.
    #[inline(always)]
    fn line(&self, slice: &SliceProjector<F>, place: &Place<F>, half: F, stand: &Stand<F>) -> Line<F> {
        let [x, height, z] = stand.at;
        let from_origin = (x * x + height * height + z * z).sqrt();
        let line =
            slice.line_toward(place, [x - place.x, z - place.z], [height, from_origin], |above| place.above / above);
        Line { half, ..line }
    }

    /// The planar fan's line, and whether its digits do not cancel and it is the only one.
    #[inline]
    pub(super) fn planar_line(&self, slice: &SliceProjector<F>, place: &Place<F>) -> (Line<F>, bool) {
        let (mut half, mut last) = (self.first_guess(slice, place), F::zero());
        for _ in 0..PLANAR_STEPS {
            [half, last] = self.planar_step::<BENDS>(slice, place, half);
        }
        self.planar_end::<BENDS>(slice, place, [half, last])
    }

    /// Where the planar fan's half line meets the circle on which the curve begins.
    #[inline(always)]
    fn first_guess(&self, slice: &SliceProjector<F>, place: &Place<F>) -> F {
        let ([x, z], _) = slice.fan_of(place);
        let radius = self.from[0];
        let along = place.x * x + place.z * z;
        let range = (along * along + (radius * radius - place.level_squared)).sqrt() - along;
        (place.x + range * x) / (radius + (place.z + range * z))
    }

    /// One of Newton's steps to where it meets the curve, and its size in radians.
    #[inline(always)]
    fn planar_step<const PIECES: usize>(&self, slice: &SliceProjector<F>, place: &Place<F>, half: F) -> [F; 2] {
        let ([x, z], _) = slice.fan_of(place);
        let Stand { at, moves, turn } = self.stand::<PIECES>(half);
        let step = ((at[0] - place.x) * z - (at[2] - place.z) * x) / (moves[0] * z - moves[2] * x);
        [half - step / turn, step]
    }

    /// The line after these steps, and whether it is the answer.
    #[inline(always)]
    fn planar_end<const PIECES: usize>(
        &self,
        slice: &SliceProjector<F>,
        place: &Place<F>,
        [half, last]: [F; 2],
    ) -> (Line<F>, bool) {
        let ([x, z], square) = slice.fan_of(place);
        let passing = place.x * z - place.z * x;
        let line = self.line_at::<PIECES>(slice, place, half);
        let range = line.toward[0] * x + line.toward[2] * z;
        let few = F::of(CANCELLATION);
        let is_sound = (few * few * square >= slice.image_squared + place.level_squared)
            & (few * range >= self.from[0])
            & (last.abs() < F::of(PLANAR_LAST * F::TOLERANCE_PX.sqrt()))
            & (half.abs() < F::one())
            & (passing * passing <= self.passing);
        (line, is_sound & slice.is_steeper(place, &line, self.grazing))
    }

    /// Newton's method on the cone's equation in the azimuth of V', as that of a circle is in its place across; `None` where it does not
    /// converge at once.
    #[inline]
    pub(super) fn newton(
        &self,
        slice: &SliceProjector<F>,
        place: &Place<F>,
        planar: Line<F>,
        settled: F,
    ) -> Option<Line<F>> {
        let mut search = Search::from(planar.half);
        for _ in 0..CONE_STEPS {
            let step = self.step::<BENDS>(slice, place, &search, settled);
            if step.is_settled {
                return slice.is_steeper(place, &step.line, self.grazing).then_some(step.line);
            }
            if !step.converges {
                return None;
            }
            search = step.next;
        }
        None
    }

    /// One of Newton's steps.
    #[inline(always)]
    fn step<const PIECES: usize>(
        &self,
        slice: &SliceProjector<F>,
        place: &Place<F>,
        search: &Search<F>,
        settled: F,
    ) -> Step<F> {
        let Search { half, rise, last } = *search;
        let stand = self.stand::<PIECES>(half);
        let line = self.line(slice, place, half, &stand);
        let defect = slice.defect(&line);
        let is_settled = defect.value.abs() < settled * rise;
        let slope = self.slope(slice, &line, stand.moves, [defect.across, defect.up, defect.inward]);
        // As it is with the place across: a radian moves that by the place ahead.
        let rise = slope / (defect.outward * line.viewer[1]);
        let step = defect.value / slope;
        let converges = (rise > F::of(CANCELLATION.recip())) & (step.abs() < last * F::of(0.25));
        Step { line, is_settled, converges, next: Search { half: half - step / stand.turn, rise, last: step.abs() } }
    }

    /// As many parts lead to the planar line without a branch, one after the other.
    pub(super) const PLANAR_PARTS: usize = PLANAR_STEPS + 2;

    /// One of them.
    #[inline(always)]
    pub(super) fn start<const PIECES: usize>(
        &self,
        slice: &SliceProjector<F>,
        place: &Place<F>,
        part: usize,
        course: Course<F>,
    ) -> Course<F> {
        let [half, last, ..] = course.numbers;
        let on = |half, last, marks| Search { half, rise: last, last: F::zero() }.course(marks);
        match part {
            0 => on(self.first_guess(slice, place), F::zero(), 0),
            _ if part <= PLANAR_STEPS => {
                let [half, last] = self.planar_step::<PIECES>(slice, place, half);
                on(half, last, 0)
            }
            _ => {
                let (planar, is_sound) = self.planar_end::<PIECES>(slice, place, [half, last]);
                Search::from(planar.half).course(slice.marks(&planar, is_sound))
            }
        }
    }

    /// One of the steps of [`Bent::newton`] without a branch.
    #[inline(always)]
    pub(super) fn advance<const PIECES: usize>(
        &self,
        slice: &SliceProjector<F>,
        place: &Place<F>,
        course: Course<F>,
        settled: F,
    ) -> Course<F> {
        let Step { is_settled, converges, next, .. } = self.step::<PIECES>(slice, place, &Search::on(&course), settled);
        course.after(is_settled, converges, next.course(course.marks))
    }

    /// The line, and whether [`Bent::newton`] returns it.
    #[inline(always)]
    pub(super) fn arrive<const PIECES: usize>(
        &self,
        slice: &SliceProjector<F>,
        place: &Place<F>,
        course: &Course<F>,
        settled: F,
    ) -> (Line<F>, bool) {
        let search = Search::on(course);
        let line = self.line_at::<PIECES>(slice, place, search.half);
        let is_settled = slice.defect(&line).value.abs() < settled * search.rise;
        (line, course.has_arrived(is_settled) & slice.is_steeper(place, &line, self.grazing))
    }

    /// The planar line of a course that has just begun.
    #[inline(always)]
    pub(super) fn begun<const PIECES: usize>(
        &self,
        slice: &SliceProjector<F>,
        place: &Place<F>,
        course: &Course<F>,
    ) -> Line<F> {
        self.line_at::<PIECES>(slice, place, Search::on(course).half)
    }

    #[inline(always)]
    fn line_at<const PIECES: usize>(&self, slice: &SliceProjector<F>, place: &Place<F>, half: F) -> Line<F> {
        self.line(slice, place, half, &self.stand::<PIECES>(half))
    }

    /// As `o·e − i·e` rises with the azimuth of V', which moves by `moves`.
    #[inline(always)]
    fn slope(&self, slice: &SliceProjector<F>, line: &Line<F>, moves: [F; 3], [across, up, inward]: [F; 3]) -> F {
        let [sin, cos] = slice.tilt;
        let ([x, y, z], [dx, dy, dz]) = (line.toward, moves);
        let outward = line.square.sqrt().recip();
        let range = -line.range * (cos * dy + sin * dz) / line.toward_above;
        let mirror_across = -(range * x + line.range * dx);
        let mirror_up = -(range * line.toward_slope + line.range * (sin * dy - cos * dz));
        let incident = inward * (mirror_across - across * inward * inward * (across * mirror_across + up * mirror_up));
        outward * (dx - x * outward * outward * (x * dx + y * dy + z * dz)) - incident
    }
}

impl<F> Bent<F> {
    /// How many bends there are.
    pub(super) fn count(&self) -> u32 {
        self.count
    }
}

impl Bent<f32> {
    /// The bends as the WGSL twin reads them.
    pub(super) fn shared(&self) -> [[f32; 4]; BENDS] {
        self.bends.map(|Piece { start, scale, rise: [distance, height] }| [start, scale, distance, height])
    }
}
