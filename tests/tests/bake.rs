//! What the searched halftones are worth to eyes that nobody searched for, by the measure.

use glam::DVec3;
use host::bake::Bake;
use host::render::Renderer;
use host::render::clear::ClearRenderer;
use host::render::plan::{Halftone, Plan, Projection};
use host::render::turn::Turn;
use host::scene::ShadedScene;
use tests::{builtin, bunny, measure, rig};

/// Eyes between and beside the slices' own azimuths, in degrees.
const AZIMUTHS: [f64; 3] = [0.64, 3.1, -4.4];

/// The mean PSNR at the eyes.
fn psnr(scene: &ShadedScene, turn: &Turn) -> f64 {
    let eyes = AZIMUTHS.map(|azimuth| azimuth.to_radians().sin_cos());
    let figures =
        eyes.map(|(sin, cos)| measure(scene, &rig("reference"), turn, DVec3::new(0.9 * sin, 0.35, 0.9 * cos)).psnr_db);
    figures.iter().sum::<f64>() / 3.0
}

/// Error diffusion, live search, joint search, and grey; of the slices that reach the eyes.
fn figures(scene: &ShadedScene, projection: Projection) -> [f64; 4] {
    let rig = rig("reference");
    let sector: Vec<u32> = (0..20).chain(rig.rotation.slices - 20..rig.rotation.slices).collect();
    let render = |halftone| {
        let plan = Plan { projection, halftone, ..Plan::default() };
        ClearRenderer.render_slices(scene, &rig, &plan, &sector, &|| ()).expect("a scene of moderate size")
    };
    let grey = render(Halftone::Grey);
    let folder = tempfile::tempdir().expect("a folder");
    let (mut bake, _) = Bake::begin(&rig, &grey, 3, &folder.path().join("turn")).expect("a job");
    while bake.step(&|| ()).expect("a stage") {}
    let turns = [render(Halftone::FloydSteinberg), render(Halftone::Search), bake.turn().clone(), grey];
    let figures = turns.map(|turn| psnr(scene, &turn));
    println!("{projection:?}: error diffusion, search, joint search, grey: {figures:.2?} dB");
    figures
}

#[test]
fn the_bunny() {
    let Some(scene) = bunny() else { return };
    for (projection, live, baked) in [(Projection::Planar, 41.0, 42.1), (Projection::ConeNewton, 41.8, 43.2)] {
        let [diffused, searched, joint, grey] = figures(&scene, projection);
        assert!(searched >= diffused + 1.5 && searched >= live, "{searched}");
        assert!(joint >= searched + 0.7 && joint >= baked && joint < grey, "{joint}");
    }
}

#[test]
fn the_built_in_scene() {
    let [diffused, searched, joint, grey] = figures(&builtin(), Projection::ConeNewton);
    assert!(searched >= diffused + 0.1 && joint >= searched + 0.1 && joint < grey);
}
