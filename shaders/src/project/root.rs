//! Roots of the cone's equation in the viewer's azimuth.

use core::f64::consts::{PI, TAU};

/// How far the cone's root may lie from the planar azimuth before it is looked for by bracketing: on physical rigs it is
/// within 4.4 slices of 1.25°, 0.1 rad.
const SECANT_REACH: f64 = 0.12;

/// Nearer to the start than this, in radians, no other root is looked for: the signs between would be rounding's.
const ONE_ROOT: f64 = 1e-6;

/// The root of `defect` near `start`; `None` where the secant leaves the neighbourhood, does not settle, or passes a nearer root.
///
/// Three steps reach 1e-9 rad on the reference rigs; the step after that confirms it.
pub(super) fn secant(defect: &impl Fn(f64) -> Option<f64>, start: f64) -> Option<f64> {
    let first = defect(start)?;
    let (mut previous, mut previous_defect) = (start, first);
    // The defect rises about as fast as the azimuth, so this is close to a Newton step; 1e-7 keeps the two starts apart.
    let mut azimuth = start - previous_defect.clamp(-0.01, 0.01) + 1e-7;
    for _ in 0..8 {
        let value = defect(azimuth)?;
        let rise = value - previous_defect;
        if rise == 0.0 {
            return (value.abs() < 1e-13).then_some(azimuth);
        }
        let moved = azimuth - previous;
        let step = value * moved / rise;
        (previous, previous_defect) = (azimuth, value);
        azimuth -= step;
        if (azimuth - start).abs() > SECANT_REACH {
            return None;
        }
        if step.abs() < 1e-11 {
            let reach = azimuth - start;
            // At the nearest root the defect leaves the sign that it has at the start, and as far on the other side it still has it.
            let leaves = rise * moved * reach * first < 0.0;
            let is_nearest = || leaves && defect(start - reach).is_some_and(|value| value * first > 0.0);
            return (reach.abs() < ONE_ROOT || is_nearest()).then_some(azimuth);
        }
    }
    None
}

/// The sign change of `defect` nearest to `start`, by a scan outward in steps of a degree and bisection.
///
/// The defect is about a sine of the azimuth less a constant: where it has one sign at 16 places around the circle, and at every
/// degree around the place where it is smallest, the cone misses the circle, and the scan, which costs more, is left out.
pub(super) fn nearest_root(defect: &impl Fn(f64) -> Option<f64>, start: f64) -> Option<f64> {
    const PLACES: i32 = 16;
    const DEGREE: f64 = PI / 180.0;
    let around = |place: i32| start + f64::from(place) * (TAU / f64::from(PLACES));
    let values = (0..PLACES).map(|place| (around(place), defect(around(place))));
    let size = |value: Option<f64>| value.map_or(f64::INFINITY, f64::abs);
    let smallest = values.min_by(|a, b| size(a.1).total_cmp(&size(b.1))).map_or(start, |(azimuth, _)| azimuth);
    let sign = |azimuth: f64| defect(azimuth).map(f64::is_sign_positive);
    let first = sign(start);
    let near = (-23..=23).map(|step| smallest + f64::from(step) * DEGREE);
    if first.is_some() && (1..PLACES).map(around).chain(near).all(|azimuth| sign(azimuth) == first) {
        return None;
    }
    const STEPS: i32 = 180;
    let at = |step: i32| start + f64::from(step) * DEGREE;
    let away = |root: &f64| (root - start).abs();
    (0..STEPS).find_map(|step| {
        let sides = [(step, step + 1), (-step, -step - 1)];
        let roots = sides.into_iter().filter_map(|(near, far)| bisect(defect, at(near), at(far)));
        roots.min_by(|a, b| away(a).total_cmp(&away(b)))
    })
}

fn bisect(defect: &impl Fn(f64) -> Option<f64>, mut low: f64, mut high: f64) -> Option<f64> {
    let low_defect = defect(low)?;
    let high_defect = defect(high)?;
    if low_defect * high_defect > 0.0 {
        return None;
    }
    for _ in 0..60 {
        let middle = (low + high) / 2.0;
        if defect(middle)? * low_defect > 0.0 { low = middle } else { high = middle }
    }
    // A sign also changes at a pole, where the mirror point runs to infinity: there the defect does not vanish.
    let root = (low + high) / 2.0;
    (defect(root)?.abs() < 1e-6).then_some(root)
}
