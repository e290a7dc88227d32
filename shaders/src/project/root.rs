//! Roots of the cone's equation in the viewer's azimuth.

use core::f64::consts::{PI, TAU};

/// How far the cone's root may lie from the planar azimuth before it is looked for by bracketing: on physical rigs it is
/// within 4.4 slices of 1.25°, 0.1 rad.
const SECANT_REACH: f64 = 0.12;

/// The root of `defect` near `start`; `None` where the secant leaves the neighbourhood or does not settle.
///
/// Three steps reach 1e-9 rad on the reference rigs; the step after that confirms it.
pub(super) fn secant(defect: &impl Fn(f64) -> Option<f64>, start: f64) -> Option<f64> {
    let (mut previous, mut previous_defect) = (start, defect(start)?);
    // The defect rises about as fast as the azimuth, so this is close to a Newton step; 1e-7 keeps the two starts apart.
    let mut azimuth = start - previous_defect.clamp(-0.01, 0.01) + 1e-7;
    for _ in 0..8 {
        let value = defect(azimuth)?;
        let rise = value - previous_defect;
        if rise == 0.0 {
            return (value.abs() < 1e-13).then_some(azimuth);
        }
        let step = value * (azimuth - previous) / rise;
        (previous, previous_defect) = (azimuth, value);
        azimuth -= step;
        if (azimuth - start).abs() > SECANT_REACH {
            return None;
        }
        if step.abs() < 1e-11 {
            return Some(azimuth);
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
    (0..STEPS).find_map(|step| {
        [(step, step + 1), (-step, -step - 1)].into_iter().find_map(|(near, far)| bisect(defect, at(near), at(far)))
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
    (defect(root)?.abs() < 1e-6).then_some(root.rem_euclid(TAU))
}
