//! What a simulated eye sees of each halftone, by the measure, at azimuths that nothing was optimised for.

use glam::DVec3;
use host::measure::{compare, flicker};
use host::render::Renderer;
use host::render::clear::ClearRenderer;
use host::render::halftone::{halftone_slices, slices_read};
use host::render::plan::{Halftone, Plan, Projection};
use host::render::turn::Turn;
use host::scene::ShadedScene;
use host::seen::{Brightness, View, see, see_turns};
use protocol::rig::Rig;
use tests::{builtin, bunny, rig, truth, view};

/// The slices that reach an eye up to 5 degrees from the front.
fn slices() -> Vec<u32> {
    (0..18).chain(270..288).collect()
}

/// Grey slices from which all methods are made, and the eyes.
struct Bench {
    rig: Rig,
    grey: Turn,
    eyes: Vec<View>,
    truths: Vec<host::picture::Picture>,
}

impl Bench {
    fn new(scene: &ShadedScene, rig: Rig, projection: Projection) -> Self {
        let plan = Plan { projection, halftone: Halftone::Grey, ..Plan::default() };
        let read = slices_read(&rig, &slices());
        let grey = ClearRenderer.render_slices(scene, &rig, &plan, &read, &|| ()).expect("a scene of moderate size");
        let height = rig.viewing.height_m.expect("a rig with a circle");
        let at = |azimuth: f64| DVec3::new(0.9 * azimuth.to_radians().sin(), height, 0.9 * azimuth.to_radians().cos());
        let eyes: Vec<_> = [0.64, 3.1, -4.4].map(|azimuth| view(at(azimuth))).into();
        let truths = eyes.iter().map(|eye| truth(scene, eye.from)).collect();
        Self { rig, grey, eyes, truths }
    }

    fn turns(&self, method: Halftone) -> Vec<Turn> {
        (0..method.turns())
            .map(|turn| halftone_slices(&self.grey, &self.rig, method, turn, &slices(), &|| ()))
            .collect()
    }

    /// The least and the mean PSNR over the eyes, for an eye that sums the turns of a pattern.
    fn psnr(&self, method: Halftone) -> [f64; 2] {
        let turns = self.turns(method);
        let turns: Vec<_> = turns.iter().collect();
        let of_eye = |(eye, truth)| {
            let seen = see_turns(&self.rig, &turns, eye, 4, Brightness::Divided, &|| ());
            compare(&seen, truth).expect("pictures of one size").psnr_db
        };
        let psnr: Vec<f64> = self.eyes.iter().zip(&self.truths).map(of_eye).collect();
        let mean = psnr.iter().sum::<f64>() / psnr.len() as f64;
        println!("{} {method:?}: {psnr:.2?}, mean {mean:.2} dB", self.rig.name);
        [psnr.into_iter().fold(f64::INFINITY, f64::min), mean]
    }

    /// Each method within 1 dB of its figure.
    fn expect(&self, figures: &[(Halftone, f64)]) {
        for (method, figure) in figures {
            let [_, mean] = self.psnr(*method);
            assert!((mean - figure).abs() < 1.0, "{method:?}: {mean:.2} dB, expected {figure}");
        }
    }
}

#[test]
fn the_bunny_by_the_planar_fan() {
    let Some(scene) = bunny() else { return };
    let bench = Bench::new(&scene, rig("reference"), Projection::Planar);
    bench.expect(&[
        (Halftone::WhiteNoise, 32.2),
        (Halftone::Bayer, 37.1),
        (Halftone::BlueNoiseFixed, 37.5),
        (Halftone::BlueNoiseHalf, 39.2),
        (Halftone::BlueNoise, 38.9),
        (Halftone::BlueNoise3d, 38.9),
        (Halftone::FloydSteinberg, 39.4),
    ]);
    // The live target, and what may be baked in passing, at every eye.
    let [live, of_live] = bench.psnr(Halftone::OptimisedDiffusion);
    assert!(live >= 40.9, "{live}");
    let [_, carried] = bench.psnr(Halftone::SightLine);
    assert!(carried >= of_live + 0.1, "{carried} against {of_live}");
}

#[test]
fn the_bunny_by_the_cone() {
    let Some(scene) = bunny() else { return };
    let bench = Bench::new(&scene, rig("reference"), Projection::ConeNewton);
    let [_, floyd_steinberg] = bench.psnr(Halftone::FloydSteinberg);
    let [live, of_live] = bench.psnr(Halftone::OptimisedDiffusion);
    let [_, carried] = bench.psnr(Halftone::SightLine);
    assert!((floyd_steinberg - 40.1).abs() < 1.0, "{floyd_steinberg}");
    assert!(live >= 41.7 && of_live >= floyd_steinberg + 1.7, "{live}, {of_live} against {floyd_steinberg}");
    assert!(carried >= of_live + 0.1, "{carried} against {of_live}");
}

#[test]
fn the_built_in_scene_from_high_up() {
    let bench = Bench::new(&builtin(), rig("high-viewer"), Projection::ConeNewton);
    let [mask, floyd_steinberg, live, carried] =
        [Halftone::BlueNoise, Halftone::FloydSteinberg, Halftone::OptimisedDiffusion, Halftone::SightLine]
            .map(|method| bench.psnr(method)[1]);
    assert!(live > floyd_steinberg + 1.0 && live > mask + 1.0, "{live}, {floyd_steinberg}, {mask}");
    assert!(carried > live, "{carried} against {live}");
}

/// Two turns make up for each other, at the price of a flicker at half the turn rate.
#[test]
fn patterns_that_alternate() {
    let bench = Bench::new(&builtin(), rig("reference"), Projection::ConeNewton);
    for (method, alone) in [
        (Halftone::AlternatingBlueNoise, Halftone::BlueNoise),
        (Halftone::AlternatingDiffusion, Halftone::OptimisedDiffusion),
    ] {
        let [_, both] = bench.psnr(method);
        let [_, alone] = bench.psnr(alone);
        let pictures: Vec<_> = bench
            .turns(method)
            .iter()
            .map(|turn| see(&bench.rig, turn, &bench.eyes[0], 4, Brightness::Divided, &|| ()))
            .collect();
        let flicker = flicker(&pictures[0], &pictures[1]).expect("pictures of one size");
        println!("{method:?}: {both:.2} dB, {alone:.2} dB alone, flicker {flicker:.4}");
        assert!(both > alone + 0.5, "{method:?}: {both} against {alone}");
        assert!((0.003..0.03).contains(&flicker), "{method:?}: {flicker}");
    }
}
