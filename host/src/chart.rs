//! Speed against accuracy: every method on every scene and rig, timed and measured in one run.

pub mod draw;
pub mod halftones;
pub mod limits;
pub mod optics;
pub mod summary;

use crate::picture::Picture;
use crate::render::RenderError;
use crate::render::truth::{Caster, Pinhole};
use crate::scene::{ShadedScene, luminance};
use crate::seen::View;
use crate::volume::display_radius_m;
use glam::DVec3;
use protocol::rig::Rig;
use serde::Serialize;

/// How much is measured.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Effort {
    /// Minutes.
    Quick,
    /// A quarter of an hour and more.
    Full,
}

/// A scene on a rig.
pub struct Job<'a> {
    /// What to call the scene.
    pub name: &'a str,
    /// Lit.
    pub scene: &'a ShadedScene,
    /// The hardware.
    pub rig: &'a Rig,
}

/// A figure of one method over all jobs: the geometric mean.
pub fn geometric_mean(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0.0), |(sum, count), value| (sum + value.max(1e-9).ln(), count + 1.0));
    if count == 0.0 { f64::NAN } else { f64::exp(sum / count) }
}

/// Every method in the order in which it was first measured, with the geometric means of two figures over scenes and rigs.
pub fn over_jobs<P, K: PartialEq>(
    points: &[P],
    key: impl Fn(&P) -> K,
    figures: impl Fn(&P) -> (f64, f64),
) -> Vec<(K, (f64, f64))> {
    let mut keys: Vec<K> = Vec::new();
    for point in points {
        let key = key(point);
        if !keys.contains(&key) {
            keys.push(key);
        }
    }
    let mean = |name: &K, figure: &dyn Fn(&P) -> f64| {
        geometric_mean(points.iter().filter(|point| key(point) == *name).map(figure).filter(|value| value.is_finite()))
    };
    let means = keys.into_iter().map(|name| {
        let both = (mean(&name, &|point| figures(point).0), mean(&name, &|point| figures(point).1));
        (name, both)
    });
    means.collect()
}

/// The middle of `values`, which must not be empty; of an even number, the lower of the two in the middle.
pub fn median(values: &mut [f64]) -> f64 {
    values.sort_by(f64::total_cmp);
    values[(values.len() - 1) / 2]
}

/// Which points no other beats in both cost and error: `cost` and `error` are better when smaller.
pub fn pareto_front(points: &[(f64, f64)]) -> Vec<bool> {
    let beats = |a: (f64, f64), b: (f64, f64)| a.0 <= b.0 && a.1 <= b.1 && a != b;
    points.iter().map(|point| !points.iter().any(|other| beats(*other, *point))).collect()
}

/// An eye of a chart, `azimuth_deg` from the front where the rig's viewers are; those at infinity look from 20 m.
pub fn view(rig: &Rig, azimuth_deg: f64, pixels: u32, rays: u32) -> View {
    let radius = display_radius_m(rig);
    View {
        from: rig.viewers().place(azimuth_deg.to_radians(), 20.0),
        look_at: DVec3::ZERO,
        window_m: if radius > 0.0 { 2.0 * radius } else { 0.1 },
        pixels,
        rays,
    }
}

/// What a pinhole in the eye's place sees of the scene itself.
pub fn truth(caster: &Caster<'_>, view: &View) -> Picture {
    let View { from, look_at, window_m, pixels, rays } = *view;
    caster.picture(&Pinhole { from, look_at, window_m, pixels, rays }, &|| ())
}

/// What makes `rig`'s white as bright as the scene's: faces add their filters' colours.
pub fn exposure(rig: &Rig) -> f32 {
    let of_face = |face| luminance(DVec3::from_array(rig.filter_colour(face)).as_vec3());
    1.0 / (0..rig.mirror.face.len()).map(of_face).sum::<f32>()
}

/// Everything that a run measured.
#[derive(Clone, Debug, Serialize)]
pub struct Chart {
    /// `praxi`.
    pub program: &'static str,
    /// Its version.
    pub version: &'static str,
    /// Whether it was a quick run.
    pub quick: bool,
    /// Threads that rendered.
    pub threads: usize,
    /// Geometry: one entry a method, scene and rig.
    pub optics: Vec<optics::Point>,
    /// Halftones: one entry a method, scene and rig; a quick run takes the first rig alone.
    pub halftones: Vec<halftones::Point>,
    /// Where methods fail, by rig.
    pub limits: Vec<(String, Vec<limits::Limit>)>,
}

impl Chart {
    /// How many pairs of a scene and a rig there are.
    pub fn jobs(&self) -> usize {
        let mut jobs: Vec<_> = self.optics.iter().map(|point| (&point.scene, &point.rig)).collect();
        jobs.dedup();
        jobs.len()
    }
}

/// Measures everything. `done` is called with what is next and how much of all has been done, from 0 to 1.
pub fn run(jobs: &[Job<'_>], effort: Effort, done: &mut dyn FnMut(&str, f64)) -> Result<Chart, RenderError> {
    let mut chart = Chart {
        program: "praxi",
        version: env!("CARGO_PKG_VERSION"),
        quick: effort == Effort::Quick,
        threads: rayon::current_num_threads(),
        optics: Vec::new(),
        halftones: Vec::new(),
        limits: Vec::new(),
    };
    let mut rigs: Vec<&Rig> = jobs.iter().map(|job| job.rig).collect();
    rigs.sort_by(|a, b| a.name.cmp(&b.name));
    rigs.dedup_by(|a, b| a.name == b.name);
    for rig in rigs {
        done(&format!("limits of {}", rig.name), 0.0);
        chart.limits.push((rig.name.clone(), limits::limits(rig, 0.06)));
    }
    let steps = 2.0 * jobs.len() as f64;
    for (index, job) in jobs.iter().enumerate() {
        let label = format!("{} on {}", job.name, job.rig.name);
        let at = |part: f64| (2.0 * index as f64 + part) / steps;
        chart.optics.extend(optics::measure(job, effort, &mut |part| done(&label, at(part)))?);
        let is_first_of_scene = !jobs[..index].iter().any(|other| other.name == job.name);
        if effort == Effort::Quick && !is_first_of_scene {
            continue;
        }
        chart.halftones.extend(halftones::measure(job, effort, &mut |part| done(&label, at(1.0 + part)))?);
    }
    Ok(chart)
}

/// Every figure as comma-separated values, with a line of names: geometry first, then halftones, told apart by the first column.
pub fn csv(chart: &Chart) -> String {
    let optics = chart.optics.iter().map(|point| ("geometry", serde_json::to_value(point).expect("figures")));
    let halftones = chart.halftones.iter().map(|point| ("halftone", serde_json::to_value(point).expect("figures")));
    let rows: Vec<(&str, Vec<(String, String)>)> =
        optics.chain(halftones).map(|(kind, value)| (kind, flattened("", &value))).collect();
    let mut names: Vec<&str> = Vec::new();
    for (name, _) in rows.iter().flat_map(|(_, cells)| cells) {
        if !names.contains(&name.as_str()) {
            names.push(name);
        }
    }
    let mut text = format!("kind,{}\n", names.join(","));
    for (kind, cells) in &rows {
        let of_name =
            |name: &&str| cells.iter().find(|(other, _)| other == name).map_or("", |(_, value)| value.as_str());
        let values: Vec<&str> = names.iter().map(of_name).collect();
        text += &format!("{kind},{}\n", values.join(","));
    }
    text
}

/// The fields of a value, those of inner ones with a dot, as text without commas.
fn flattened(prefix: &str, value: &serde_json::Value) -> Vec<(String, String)> {
    match value {
        serde_json::Value::Object(fields) => fields
            .iter()
            .flat_map(|(name, value)| {
                flattened(&format!("{prefix}{}{name}", if prefix.is_empty() { "" } else { "." }), value)
            })
            .collect(),
        serde_json::Value::String(text) => vec![(prefix.into(), text.replace([',', '"', '\n'], " "))],
        serde_json::Value::Null => vec![(prefix.into(), String::new())],
        other => vec![(prefix.into(), other.to_string())],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_front_has_what_nothing_beats() {
        let points = [(1.0, 9.0), (2.0, 3.0), (3.0, 3.0), (4.0, 1.0), (9.0, 2.0), (4.0, 1.0)];
        assert_eq!(pareto_front(&points), [true, true, false, true, false, true]);
    }

    #[test]
    fn means_and_medians() {
        assert!((geometric_mean([1.0, 4.0, 16.0].into_iter()) - 4.0).abs() < 1e-12);
        assert_eq!(median(&mut [3.0, 1.0, 2.0]), 2.0);
        assert_eq!(median(&mut [4.0, 1.0, 2.0, 3.0]), 2.0);
    }
}
