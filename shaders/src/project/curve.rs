//! What of a slice's optics changes where viewers are on a curve in place of a circle.

use super::SliceOptics;
use core::f64::consts::PI;
use glam::{DVec2, DVec3};
use protocol::rig::curve::{Spot, ViewingCurve};
use protocol::rig::{Rig, Viewers};

/// How finely a curve's first crossing is looked for, in radians of azimuth: a twentieth of the narrowest bend there is. A line that leaves
/// the curve for less than that, by a tenth of a millimetre at most, and comes back, is taken to have stayed.
const SCAN: f64 = 0.2 * PI / 180.0;
/// Beyond the fan of a panel and its guard band, in radians. What is tried of the panel finds its fan to a hundredth of this.
const FAN_MARGIN: f64 = PI / 180.0;

/// Where the half line from `level` along the unit vector `away`, both seen from above, first leaves `curve`; `None` from outside it.
pub(super) fn crossing(curve: &ViewingCurve, level: DVec2, away: DVec2) -> Option<DVec3> {
    let along = level.dot(away);
    let reach = |distance: f64| {
        let discriminant = along * along + (distance * distance - level.length_squared());
        (discriminant >= 0.0).then(|| discriminant.sqrt() - along)
    };
    let at = |range: f64| level + range * away;
    let azimuth = |range: f64| {
        let place = at(range);
        place.x.atan2(place.y)
    };
    // Below 0 inside the curve.
    let beyond = |range: f64| at(range).length() - curve.spot(azimuth(range)).distance_m;
    let [least, most] = curve.distances();
    let (inner, outer) = (reach(least), reach(most)?);
    let range = if least == most {
        outer
    } else {
        let from = inner.unwrap_or(0.0).max(0.0);
        let is_outside = from == 0.0 && beyond(0.0) > 0.0;
        first_root(&beyond, [from, outer], azimuth(outer) - azimuth(from)).filter(|_| !is_outside)?
    };
    let viewer = at(range);
    viewer.is_finite().then(|| DVec3::new(viewer.x, curve.spot(azimuth(range)).height_m, viewer.y))
}

/// The first root of `value` between two ranges, at the first of which it is not above 0 and at the last not below, but for rounding.
fn first_root(value: &impl Fn(f64) -> f64, [from, to]: [f64; 2], turn: f64) -> Option<f64> {
    let turn = turn - 2.0 * PI * (turn / (2.0 * PI)).round();
    let parts = (turn.abs() / SCAN).ceil().clamp(1.0, 1800.0);
    let at = |part: f64| from + (to - from) * part / parts;
    let mut part = 0.0;
    while part < parts && value(at(part + 1.0)) < 0.0 {
        part += 1.0;
    }
    let [mut low, mut high] = [at(part), at((part + 1.0).min(parts))];
    let [mut below, mut above] = [value(low), value(high)];
    if below >= 0.0 {
        return low.is_finite().then_some(low);
    }
    // Illinois' variant of the false position: the end that stays counts half.
    for _ in 0..60 {
        if above <= 0.0 || high - low <= f64::EPSILON * high.abs() {
            break;
        }
        let middle = (low - below * (high - low) / (above - below)).clamp(low, high);
        let there = value(middle);
        if there == 0.0 {
            return Some(middle);
        }
        if there < 0.0 {
            (low, below, above) = (middle, there, above / 2.0);
        } else {
            (high, above, below) = (middle, there, below / 2.0);
        }
    }
    (low.is_finite() && high.is_finite()).then_some(if -below < above { low } else { high })
}

impl SliceOptics {
    /// The azimuth of the face in radians.
    pub(super) fn azimuth(&self) -> f64 {
        (-self.frame.across.z).atan2(self.frame.across.x)
    }

    /// The azimuths in radians, the first not above the last, between which are the viewers who see the panel with its guard band, and
    /// a degree to either side; `None` where a place of it has no viewer. Only what is outside has no part in what this slice shows.
    pub fn fan(&self) -> Option<[f64; 2]> {
        let middle = self.azimuth();
        let [low, high] = self.slope_span_m;
        let edge = self.half_width_m + self.guard_m;
        let foot = self.offset_m * self.frame.normal;
        let slopes = [low - self.guard_m, (low + high) / 2.0, high + self.guard_m];
        let mut fan = [f64::INFINITY, f64::NEG_INFINITY];
        for (across, slope) in [-edge, 0.0, edge].into_iter().flat_map(|across| slopes.map(|slope| (across, slope))) {
            let viewer = self.viewer_of_mirror(foot + across * self.frame.across + slope * self.frame.slope)?.vector();
            let aside = viewer.x.atan2(viewer.z) - middle;
            let azimuth = middle + aside - 2.0 * PI * (aside / (2.0 * PI)).round();
            fan = [fan[0].min(azimuth), fan[1].max(azimuth)];
        }
        Some([fan[0] - FAN_MARGIN, fan[1] + FAN_MARGIN])
    }
}

/// Whether slices of `face` at mirror angle `theta` show the same by `before` and `after`, which differ in their tracked viewers alone.
pub fn shows_alike(before: &Rig, after: &Rig, face: usize, theta: f64, model: super::Model) -> bool {
    let curve = |rig: &Rig| match rig.viewers() {
        Viewers::Curve(curve) => Some(curve),
        Viewers::Circle { distance_m, height_m } => Some(ViewingCurve::new(Spot { distance_m, height_m }, &[])),
        Viewers::Infinity { .. } => None,
    };
    let (Some(one), Some(other)) = (curve(before), curve(after)) else { return before.viewing == after.viewing };
    [before, after]
        .into_iter()
        .all(|rig| SliceOptics::new(rig, face, theta, model).fan().is_some_and(|sector| one.is_alike(&other, sector)))
}

#[cfg(test)]
mod tests;
