//! What a plan predicts against what is measured, and what is chosen when.

use glam::{Quat, Vec3};
use host::render::plan::choose::{Budget, Fixed, PlanError, choose, predict};
use host::render::plan::error::geometric_error;
use host::render::plan::{Edges, Plan, Precision, Projection};
use host::render::tessellate::tessellate;
use host::scene::{Scene, ShadedScene, Shading, shade};
use protocol::rig::Rig;
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use tests::{builtin, bunny, rig, scene, scene_of, triangle};

fn boxes() -> ShadedScene {
    shade(&Scene::load("boxes").expect("built in"), Shading::Lambert, false)
}

/// Predicted over measured.
fn ratio(scene: &ShadedScene, rig: &Rig, plan: &Plan, pairs: usize) -> Option<f64> {
    let mesh = tessellate(scene, rig, plan).expect("a scene of moderate size");
    let predicted = predict(&mesh, rig, plan)?;
    let measured = geometric_error(&mesh, rig, plan, pairs);
    // Below a thousandth of a pixel only rounding is left.
    (measured.points > 0).then(|| predicted.error_px.max(1e-3) / measured.worst_px.max(1e-3))
}

fn plans() -> Vec<Plan> {
    let mut plans = Vec::new();
    for projection in Projection::ALL {
        for (edges, bow_px) in [
            (Edges::Straight, 0.5),
            (Edges::Uniform, 1.0),
            (Edges::Adaptive, 2.0),
            (Edges::Adaptive, 0.5),
            (Edges::Adaptive, 0.1),
            (Edges::Discard, 8.0),
            (Edges::Rays, 0.5),
        ] {
            for precision in [Precision::Single, Precision::Double] {
                plans.push(Plan { projection, precision, edges, bow_px, ..Plan::default() });
            }
        }
    }
    plans
}

fn judge(name: &str, mut ratios: Vec<f64>) {
    ratios.sort_by(f64::total_cmp);
    let median = ratios[ratios.len() / 2];
    println!(
        "{name}: predicted / measured from {:.2} to {:.2}, median {median:.2}, of {}",
        ratios[0],
        ratios[ratios.len() - 1],
        ratios.len()
    );
    assert!(ratios[0] >= 0.8 && median <= 2.0, "{name}: {} and {median}", ratios[0]);
}

#[test]
fn predictions_hold_on_two_hundred_random_rigs() {
    let mut random = ChaCha8Rng::seed_from_u64(20);
    let (builtin, boxes) = (builtin(), boxes());
    let plans = plans();
    let mut ratios = Vec::new();
    let mut rigs = 0;
    while rigs < 200 {
        let Some(rig) = random_rig(&mut random) else { continue };
        rigs += 1;
        let scene = turned(if rigs % 2 == 0 { &builtin } else { &boxes }, &mut random);
        let plan = &plans[random.random_range(0..plans.len())];
        let found = ratio(&scene, &rig, plan, 10_000);
        if let Some(found) = found.filter(|found| !(0.8..4.0).contains(found)) {
            println!(
                "{found:.2}: {plan}, viewers {:?}, {:?}, tilt {}",
                rig.viewing, rig.projector.position_m, rig.mirror.face[0].tilt_deg
            );
        }
        ratios.extend(found);
    }
    assert!(ratios.len() > 150, "only {} rigs show the scene whole", ratios.len());
    judge("random rigs", ratios);
}

/// A rig that might be built: the reference with every length and angle drawn anew.
fn random_rig(random: &mut impl Rng) -> Option<Rig> {
    let mut rig = rig("reference");
    let mut draw = |low: f64, high: f64| random.random_range(low..high);
    rig.projector.position_m = Some([draw(-0.1, 0.1), draw(0.4, 1.5), draw(-0.1, 0.1)]);
    let distance = rig.projector.position_m.map_or(0.6, |position| position[1]);
    rig.projector.focal_px = Some(3072.0 * distance / 0.6 * draw(0.7, 1.2));
    let face = &mut rig.mirror.face[0];
    face.tilt_deg = draw(35.0, 55.0);
    face.offset_m = draw(-0.02, 0.02);
    face.azimuth_deg = draw(-180.0, 180.0);
    face.width_m *= draw(0.7, 1.5);
    match draw(0.0, 1.0) {
        far if far < 0.15 => {
            rig.viewing.distance_m = None;
            rig.viewing.height_m = None;
            rig.viewing.elevation_deg = Some(draw(0.0, 40.0));
        }
        _ => {
            let distance = 0.3 * 10f64.powf(draw(0.0, 1.5));
            rig.viewing.distance_m = Some(distance);
            rig.viewing.height_m = Some(distance * draw(-0.1, 0.85));
        }
    }
    rig.rotation.slices = 24 * random.random_range(4..40);
    rig.checked().ok()
}

/// The scene in another pose and size.
fn turned(scene: &ShadedScene, random: &mut impl Rng) -> ShadedScene {
    let axis = Vec3::from_array([0, 1, 2].map(|_| random.random_range(-1.0..1.0f32))).normalize_or(Vec3::X);
    let pose = Quat::from_axis_angle(axis, random.random_range(0.0..3.0));
    let size = random.random_range(0.1..1.1f32);
    let mut turned = scene.clone();
    for triangle in &mut turned.triangles {
        triangle.positions = triangle.positions.map(|position| pose * position * size);
    }
    turned
}

#[test]
fn predictions_hold_on_known_scenes() {
    let scenes = [Some(builtin()), Some(boxes()), bunny()];
    let mut ratios = Vec::new();
    for scene in scenes.iter().flatten() {
        for name in ["reference", "high-viewer", "tent"] {
            for plan in plans().iter().step_by(11) {
                ratios.extend(ratio(scene, &rig(name), plan, 20_000));
            }
        }
    }
    judge("known scenes", ratios);
}

fn chosen(scene: &ShadedScene, rig: &Rig, px: f64) -> Result<Plan, PlanError> {
    choose(scene, rig, Fixed::default(), Budget::Error(px)).map(|choice| choice.chosen.plan)
}

/// Model no more than a scene needs.
#[test]
fn a_small_scene_and_level_viewers_need_the_planar_fan_alone() {
    let mut small = builtin();
    for triangle in &mut small.triangles {
        triangle.positions = triangle.positions.map(|position| position * 0.05);
    }
    let reference = rig("reference");
    let plan = chosen(&small, &reference, 0.5).unwrap();
    assert_eq!((plan.projection, plan.precision), (Projection::Planar, Precision::Single));
    assert_eq!(plan.edges, Edges::Straight);

    let mut level = reference.clone();
    level.viewing.height_m = Some(0.02);
    assert_eq!(chosen(&builtin(), &level, 0.5).unwrap().projection, Projection::Planar);

    let steep = chosen(&builtin(), &rig("high-viewer"), 0.5).unwrap();
    assert_ne!(steep.projection, Projection::Planar);
}

#[test]
fn budgets_that_nothing_meets_say_what_is_possible() {
    let (scene, reference) = (builtin(), rig("reference"));
    let error = chosen(&scene, &reference, 1e-13).unwrap_err();
    assert!(matches!(error, PlanError::TooAccurate { reached, .. } if reached > 0.0 && reached < 1e-3), "{error}");
    let error = choose(&scene, &reference, Fixed::default(), Budget::Cost(1e-6)).unwrap_err();
    assert!(matches!(error, PlanError::TooFast { possible, .. } if possible > 1.0), "{error}");
    let mut far = scene;
    for triangle in &mut far.triangles {
        triangle.positions = triangle.positions.map(|position| position + Vec3::X * 100.0);
    }
    assert_eq!(chosen(&far, &reference, 0.5), Err(PlanError::NothingVisible("reference".into())));
}

#[test]
fn a_larger_time_budget_never_buys_a_larger_error() {
    let (scene, reference) = (builtin(), rig("reference"));
    let within = |ms| choose(&scene, &reference, Fixed::default(), Budget::Cost(ms)).ok();
    let errors: Vec<f64> =
        [1e2, 5e3, 1e6].into_iter().filter_map(within).map(|choice| choice.chosen.error_px).collect();
    assert!(errors.len() > 1 && errors.is_sorted_by(|a, b| a >= b), "{errors:?}");
}

#[test]
fn what_nobody_sees_changes_no_plan() {
    let (mut scene, rig) = (scene("knot-5k"), rig("reference"));
    let alone = chosen(&scene, &rig, 0.5).unwrap();
    for far in [Vec3::new(1000.0, 0.0, 0.0), Vec3::new(0.0, 1000.0, 0.0)] {
        let corners = [Vec3::ZERO, Vec3::Y, Vec3::X].map(|corner| (far + corner).to_array());
        scene.triangles.push(triangle(corners, 0.6));
    }
    assert_eq!(chosen(&scene, &rig, 0.5).unwrap().edges, alone.edges);
}

/// A wall through the display that passes its viewers: pieces of it have no pixel for some, which a sample need not meet.
#[test]
fn a_scene_that_passes_the_viewers_is_drawn_by_rays() {
    for side in [1.0, 10.0, 1000.0] {
        let wall = scene_of(vec![triangle([[-side, -side, 0.0], [side, -side, 0.0003], [0.0, side, -0.0002]], 0.8)]);
        let plan = chosen(&wall, &rig("reference"), 0.5).unwrap();
        assert_eq!((plan.edges, plan.projection), (Edges::Rays, Projection::ConeRoot), "{side} m");
    }
}
