//! The worked points in `vectors/`: float64, planar fan and cone, one file a rig.

use glam::{DVec2, DVec3};
use shaders::project::{Model, SliceOptics};
use std::path::Path;

/// The largest disagreement in pixels with the columns of `model`, which begin with V' at `column`.
fn worst_px(name: &str, model: Model, column: usize) -> f64 {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let rig = tests::rig(name);
    let table = std::fs::read_to_string(root.join(format!("vectors/vectors-{name}.csv"))).unwrap();
    let mut worst = 0.0;
    for line in table.lines().skip(1) {
        let fields: Vec<f64> = line.split(',').map(|field| field.trim().parse().unwrap()).collect();
        let optics = SliceOptics::new(&rig, fields[1] as usize, rig.slice_angle(fields[0] as u32), model);
        let projected = optics.project(DVec3::from_slice(&fields[2..]));
        let viewer = projected.viewer.unwrap().vector();
        assert!(viewer.distance(DVec3::from_slice(&fields[column..])) < 1e-8, "{name} {model:?}: {line}");
        worst = projected.pixel.unwrap().distance(DVec2::from_slice(&fields[column + 3..])).max(worst);
    }
    assert!(table.lines().count() > 60);
    worst
}

#[test]
fn projection_agrees_with_the_worked_points() {
    for name in ["reference", "high-viewer", "tent"] {
        let (planar, cone) = (worst_px(name, Model::Planar, 5), worst_px(name, Model::Cone, 10));
        println!("{name}: planar {planar:.1e} px, cone {cone:.1e} px");
        assert!(planar < 1e-6 && cone < 1e-5, "{name}: planar {planar:e} px, cone {cone:e} px");
    }
}
