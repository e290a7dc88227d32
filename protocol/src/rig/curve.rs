//! The closed curve of distance and height over azimuth on which perspective is correct: it passes through tracked viewers, blends
//! between them, and rests on the rig's circle elsewhere.
//!
//! Source: Jones et al., columns 4–5 of the patent. How it blends is this project's own.

use super::TrackedViewer;
use core::f64::consts::{PI, TAU};
use std::sync::Arc;

const DEGREE: f64 = PI / 180.0;

/// To either side of a viewer the curve keeps their distance and height as far as this, in radians, so that both eyes (2° to either
/// side at 0.93 m) and a moving head meet a flat piece. A neighbour within 20° leaves a quarter of the way to it.
pub const FLAT: f64 = 5.0 * DEGREE;
/// Beyond, it blends as far as this, in radians: 15° from a viewer it rests. A neighbour within 20° leaves half of the way to it, and
/// the curve blends between the two.
pub const BLEND: f64 = 10.0 * DEGREE;
/// Of viewers less than this apart, in radians, the curve passes through the one nearer to the axis, or of as near ones through the one
/// that is named first: nearer eyes see a wrong height under a larger angle, they stand before the others, and both eyes of a viewer
/// need [`FLAT`]'s quarter.
pub const APART: f64 = 8.0 * DEGREE;

/// Angles that differ by no more, in radians, are the same.
const ROUNDING: f64 = 1e-12;

/// A place of the curve at some azimuth.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spot {
    /// Distance from the axis, metres.
    pub distance_m: f64,
    /// Height, metres.
    pub height_m: f64,
}

/// Where the curve goes from one place to another: by 3 v² − 2 v³ of the share v of the way.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bend {
    /// Azimuth at which it begins, radians.
    pub start: f64,
    /// How far it goes toward larger azimuths, radians.
    pub width: f64,
    /// Where it comes from.
    pub from: Spot,
    /// Where it goes to.
    pub to: Spot,
}

/// The curve. Once (C¹) smooth, closed, never beyond the distances and heights of the circle and the viewers; cheap to clone.
#[derive(Clone, Debug, PartialEq)]
pub struct ViewingCurve {
    rest: Spot,
    /// By rising azimuth.
    stays: Arc<[Stay]>,
}

/// A viewer through whom the curve passes.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Stay {
    /// 0 … 2π.
    azimuth: f64,
    spot: Spot,
    /// Toward smaller azimuths and larger ones.
    shoulders: [Shoulder; 2],
}

/// One side of a viewer, radians.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Shoulder {
    flat: f64,
    blend: f64,
    /// Whether the blend is the neighbour's too.
    is_shared: bool,
}

impl Shoulder {
    fn new(gap: f64) -> Self {
        Self { flat: FLAT.min(gap / 4.0), blend: BLEND.min(gap / 2.0), is_shared: gap <= 2.0 * BLEND + ROUNDING }
    }

    fn reach(self) -> f64 {
        self.flat + self.blend
    }
}

/// `angle` as −π … π.
fn turned(angle: f64) -> f64 {
    angle - TAU * (angle / TAU).round()
}

impl Stay {
    /// Its share of the place at an azimuth that is `aside` of its own: 1 on the flat piece, 0 beyond the blend.
    fn weight(&self, aside: f64) -> f64 {
        let Shoulder { flat, blend, .. } = self.shoulders[usize::from(aside >= 0.0)];
        let way = ((aside.abs() - flat) / blend).clamp(0.0, 1.0);
        1.0 - way * way * (3.0 - 2.0 * way)
    }
}

impl ViewingCurve {
    /// Through those of `viewers` who are [`APART`] from nearer ones, and at rest on the circle of `rest`. Distances are above 0, and all
    /// numbers finite.
    pub fn new(rest: Spot, viewers: &[TrackedViewer]) -> Self {
        let mut nearest: Vec<_> = viewers.iter().collect();
        nearest.sort_by(|a, b| a.distance_m.total_cmp(&b.distance_m));
        let mut spots: Vec<(f64, Spot)> = Vec::new();
        for viewer in nearest {
            let azimuth = viewer.azimuth_deg.to_radians().rem_euclid(TAU);
            if spots.iter().all(|(other, _)| turned(azimuth - other).abs() > APART - ROUNDING) {
                spots.push((azimuth, Spot { distance_m: viewer.distance_m, height_m: viewer.height_m }));
            }
        }
        spots.sort_by(|a, b| a.0.total_cmp(&b.0));
        let count = spots.len();
        let gap = |from: usize| {
            let to = (from + 1) % count;
            let gap = (spots[to].0 - spots[from].0).rem_euclid(TAU);
            Shoulder::new(if from == to { TAU } else { gap })
        };
        let stays = spots.iter().enumerate().map(|(index, (azimuth, spot))| Stay {
            azimuth: *azimuth,
            spot: *spot,
            shoulders: [gap((index + count - 1) % count), gap(index)],
        });
        Self { rest, stays: stays.collect() }
    }

    /// Its place at `azimuth` radians from the front toward the right.
    pub fn spot(&self, azimuth: f64) -> Spot {
        let (mut left, mut spot) = (1.0, Spot { distance_m: 0.0, height_m: 0.0 });
        let mut add = |weight: f64, other: Spot| {
            spot.distance_m += weight * other.distance_m;
            spot.height_m += weight * other.height_m;
        };
        for stay in self.stays.iter() {
            let weight = stay.weight(turned(azimuth - stay.azimuth));
            if weight > 0.0 {
                add(weight, stay.spot);
                left -= weight;
            }
        }
        // What two viewers share adds up to 1 and a rounding.
        add(if left > 1e-12 { left } else { 0.0 }, self.rest);
        spot
    }

    /// The circle on which it rests.
    pub fn rest(&self) -> Spot {
        self.rest
    }

    /// Places between whose distances and between whose heights it stays: the circle's, and those of the viewers that it passes through.
    pub fn spots(&self) -> impl Iterator<Item = Spot> {
        core::iter::once(self.rest).chain(self.stays.iter().map(|stay| stay.spot))
    }

    /// The least and the largest distance.
    pub fn distances(&self) -> [f64; 2] {
        let distances = self.spots().map(|spot| spot.distance_m);
        distances.fold([f64::INFINITY, 0.0], |[least, most], distance| [least.min(distance), most.max(distance)])
    }

    /// All bends, by their starts.
    fn bends(&self) -> impl Iterator<Item = Bend> {
        let count = self.stays.len();
        let of_pair = move |index: usize| {
            let (stay, next) = (self.stays[index], self.stays[(index + 1) % count]);
            let [after, before] = [stay.shoulders[1], next.shoulders[0]];
            let leaves = stay.azimuth + after.flat;
            let to = if after.is_shared { next.spot } else { self.rest };
            let falls = Bend { start: leaves, width: after.blend, from: stay.spot, to };
            let rises =
                Bend { start: next.azimuth - before.reach(), width: before.blend, from: self.rest, to: next.spot };
            [Some(falls), (!after.is_shared).then_some(rises)]
        };
        (0..count).flat_map(of_pair).flatten()
    }

    /// What the curve does between two azimuths that are less than π apart: its place where the first of the bends begins that meet
    /// this sector, and those bends, by their starts, but for those that lead nowhere; their starts are near `from`, not within 0 … 2π.
    /// The place at an azimuth of the sector is that place with each bend's share of its way added.
    pub fn sector(&self, [from, to]: [f64; 2]) -> (Spot, Vec<Bend>) {
        let near = |bend: Bend| {
            let ahead = (bend.start - from).rem_euclid(TAU);
            let start = if ahead <= to - from { ahead } else { ahead - TAU };
            (start + bend.width >= 0.0).then_some(Bend { start: from + start, ..bend })
        };
        let mut bends: Vec<_> = self.bends().filter_map(near).collect();
        bends.sort_by(|a, b| a.start.total_cmp(&b.start));
        let spot = bends.first().map_or_else(|| self.spot(from), |first| first.from);
        bends.retain(|bend| bend.from != bend.to);
        (spot, bends)
    }

    /// Whether the curve has the same places between two azimuths as `other`, by what it is made of. The same where it is true; they
    /// may be the same where it is false.
    pub fn is_alike(&self, other: &Self, [from, to]: [f64; 2]) -> bool {
        let meets = |stay: &&Stay| {
            let [before, after] = stay.shoulders.map(Shoulder::reach);
            (from - (stay.azimuth - before)).rem_euclid(TAU) <= before + after
                || (stay.azimuth - before - from).rem_euclid(TAU) <= to - from
        };
        let within = |curve: &Self| curve.stays.iter().filter(meets).copied().collect::<Vec<_>>();
        self.rest == other.rest && within(self) == within(other)
    }
}

#[cfg(test)]
mod tests;
