//! The space in which a rig can show something.

use core::f64::consts::TAU;
use glam::DVec3;
use protocol::rig::Rig;
use shaders::project::{Model, SliceOptics, Visibility};

/// The radius in metres of the display volume: the largest ball about the origin of which every point is visible in some slice
/// for every viewer azimuth. 0 where not even the origin is. To a fiftieth of a millimetre for panels of some decimetres.
pub fn display_radius_m(rig: &Rig) -> f64 {
    let optics: Vec<Vec<_>> = (0..rig.mirror.face.len())
        .map(|face| {
            let at = |slice| SliceOptics::new(rig, face, rig.slice_angle(slice), Model::Cone);
            (0..rig.rotation.slices).map(at).collect()
        })
        .collect();
    let panel = |face: &protocol::rig::Face| face.width_m.max(face.slope_span_m[1] - face.slope_span_m[0]);
    let mut outside = rig.mirror.face.iter().map(panel).fold(0.0, f64::max);
    let mut inside = 0.0;
    if !shows(&optics, DVec3::ZERO) {
        return 0.0;
    }
    for _ in 0..13 {
        let middle = (inside + outside) / 2.0;
        if (0..96).all(|index| shows(&optics, spread(index, 96) * middle)) { inside = middle } else { outside = middle }
    }
    inside
}

/// Whether `point` is visible from every azimuth: in some slice, and between those no gap wider than two slices and a half.
fn shows(optics: &[Vec<SliceOptics>], point: DVec3) -> bool {
    let seen_from = |optics: &SliceOptics| {
        let projected = optics.project(point);
        let viewer = projected.viewer.filter(|_| projected.visibility == Visibility::Visible)?.vector();
        Some(viewer.x.atan2(viewer.z).rem_euclid(TAU))
    };
    let mut azimuths: Vec<f64> = optics.iter().flatten().filter_map(seen_from).collect();
    azimuths.sort_by(f64::total_cmp);
    let (Some(first), Some(last)) = (azimuths.first(), azimuths.last()) else { return false };
    let gap = azimuths.windows(2).map(|pair| pair[1] - pair[0]).fold(first + TAU - last, f64::max);
    gap < 2.5 * TAU / optics[0].len() as f64
}

/// Point `index` of `count` spread evenly over the unit sphere (a Fibonacci lattice).
fn spread(index: u32, count: u32) -> DVec3 {
    let height = (2.0 * f64::from(index) + 1.0) / f64::from(count) - 1.0;
    let (sin, cos) = (f64::from(index) * 2.399_963_229_728_653).sin_cos();
    let level = (1.0 - height * height).sqrt();
    DVec3::new(level * sin, height, level * cos)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn radius(text: &str) -> f64 {
        display_radius_m(&Rig::parse(text).unwrap())
    }

    #[test]
    fn the_reference_rig_shows_60_to_70_mm() {
        let radius = radius(include_str!("../rigs/reference.toml"));
        assert!((0.060..0.070).contains(&radius), "{radius}");
    }

    #[test]
    fn a_panel_of_half_the_size_shows_half_as_much() {
        let text = include_str!("../rigs/reference.toml");
        let small = text.replace("width_m = 0.14", "width_m = 0.07").replace("[-0.10, 0.10]", "[-0.05, 0.05]");
        let ratio = radius(&small) / radius(text);
        assert!((ratio - 0.5).abs() < 0.05, "{ratio}");
    }
}
