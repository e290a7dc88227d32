//! Where triangles fail: needles, walls, flat sight lines, the lit limit, scenes out of reach.

use host::render::anything_visible;
use host::render::bow::edge_limit_m;
use host::render::plan::choose::{Budget, Fixed, PlanError, choose, predict};
use host::render::plan::error::geometric_error;
use host::render::plan::{Edges, Plan, Precision, Projection};
use host::render::tessellate::tessellate;
use protocol::rig::Rig;
use shaders::project::Model;
use tests::{SLICES, differing, grey_slices, plan, rig, scene, scene_of, triangle};

/// Needles, and triangles far larger than panel and reach, in every way, with rims of the panel across them.
#[test]
fn needles_and_walls_are_drawn() {
    let wall = |luminance| {
        vec![
            triangle([[-2.0, -2.0, -0.02], [2.0, -2.0, 0.03], [2.0, 2.0, 0.01]], luminance),
            triangle([[-2.0, -2.0, -0.02], [2.0, 2.0, 0.01], [-2.0, 2.0, -0.04]], luminance),
        ]
    };
    let mut needles = vec![triangle([[-0.05, -0.03, 0.0], [0.05, 0.03, 0.01], [0.05, 0.0301, 0.0102]], 0.8)];
    needles.push(triangle([[0.0, -0.05, 0.02], [0.0002, 0.05, 0.02], [0.003, -0.05, 0.018]], 0.6));
    needles.push(triangle([[0.01, 0.0, 0.0], [0.01, 0.0, 0.0], [0.02, 0.0, 0.0]], 0.7));
    for (name, triangles, at_least) in [("wall", wall(0.7), 500_000), ("needles", needles, 500)] {
        let scene = scene_of(triangles);
        for rig_name in ["reference", "tent"] {
            let rig = rig(rig_name);
            let rays = grey_slices(&scene, &rig, &plan(Projection::Planar, Edges::Rays, 0.5), &SLICES);
            for (edges, bow_px) in
                [(Edges::Straight, 0.5), (Edges::Uniform, 0.5), (Edges::Adaptive, 0.5), (Edges::Discard, 8.0)]
            {
                let drawn = grey_slices(&scene, &rig, &plan(Projection::Planar, edges, bow_px), &SLICES);
                let (lit, wrong) = differing(&rays, &drawn);
                println!("{name} {rig_name} {edges:?}: {wrong} of {lit} differ");
                assert!(lit >= at_least);
                if name == "wall" || edges == Edges::Discard {
                    assert!(wrong * 100 < lit, "{name} {rig_name} {edges:?}: {wrong} of {lit}");
                } else if edges != Edges::Straight {
                    assert!(wrong * 2 < lit, "{name} {rig_name} {edges:?}: {wrong} of {lit}");
                }
            }
        }
    }
}

/// The reference rig for viewers at another height.
fn seen_from(height_m: &str) -> Rig {
    let reference = include_str!("../../host/rigs/reference.toml");
    let moved = reference.replace("height_m = 0.35", &format!("height_m = {height_m}"));
    assert_ne!(moved, reference);
    Rig::parse(&moved).unwrap()
}

/// Where viewers look up at the display, sight lines are flat to the mirror: pieces are seen much larger, and have corners without a
/// pixel.
#[test]
fn flat_sight_lines_are_drawn_as_rays_find_them() {
    let scene = scene("boxes");
    for (height_m, projection) in
        [("-0.5", Projection::Planar), ("-0.8", Projection::Planar), ("-0.8", Projection::ConeNewton)]
    {
        let rig = seen_from(height_m);
        let rays = grey_slices(&scene, &rig, &plan(projection, Edges::Rays, 0.5), &SLICES);
        for (edges, bow_px) in [(Edges::Adaptive, 0.5), (Edges::Discard, 8.0)] {
            let plan = plan(projection, edges, bow_px);
            let (lit, wrong) = differing(&rays, &grey_slices(&scene, &rig, &plan, &SLICES));
            let mesh = tessellate(&scene, &rig, &plan).unwrap();
            let known = predict(&mesh, &rig, &plan).map(|known| known.error_px);
            println!(
                "{height_m} m {projection:?} {edges:?}: {wrong} of {lit} differ, {} triangles, expected {known:?} px",
                mesh.triangles.len()
            );
            assert!(lit > 10_000 && wrong * 100 < lit, "{height_m} m {projection:?} {edges:?}: {wrong} of {lit}");
            assert!(known.is_some() && mesh.triangles.len() < 50_000, "{height_m} m {projection:?} {edges:?}");
        }
    }
}

/// Where all sight lines graze the mirror, a slice shows a sheet of the scene that is thinner than the finest pieces. They cannot be
/// drawn, and this is known: the planner takes rays.
#[test]
fn at_the_lit_limit_only_rays_are_trusted() {
    let (scene, rig) = (scene("boxes"), seen_from("-0.893"));
    let rays = grey_slices(&scene, &rig, &plan(Projection::Planar, Edges::Rays, 0.5), &SLICES);
    for (edges, bow_px) in
        [(Edges::Straight, 0.5), (Edges::Uniform, 0.5), (Edges::Adaptive, 0.5), (Edges::Discard, 8.0)]
    {
        let plan = plan(Projection::Planar, edges, bow_px);
        let mesh = tessellate(&scene, &rig, &plan).unwrap();
        let (lit, wrong) = differing(&rays, &grey_slices(&scene, &rig, &plan, &SLICES));
        println!("{edges:?}: {wrong} of {lit} differ, {} triangles", mesh.triangles.len());
        assert!(lit > 10_000 && wrong * 10 > lit, "{edges:?}: {wrong} of {lit}: no limit");
        assert!(geometric_error(&mesh, &rig, &plan, 3000).lost > 0, "{edges:?}");
        assert_eq!(predict(&mesh, &rig, &plan), None, "{edges:?}");
        let fixed = Fixed { projection: Some(Projection::Planar), edges: Some(edges), ..Fixed::default() };
        let chosen = choose(&scene, &rig, fixed, Budget::Error(1000.0));
        assert_eq!(chosen.unwrap_err(), PlanError::Lost(rig.name.clone()), "{edges:?}");
    }
    let exact = Plan { precision: Precision::Double, ..plan(Projection::ConeRoot, Edges::Rays, 0.5) };
    let exact = grey_slices(&scene, &rig, &exact, &SLICES);
    for budget in [Budget::Error(8.0), Budget::Cost(1e9)] {
        let chosen = choose(&scene, &rig, Fixed::default(), budget).unwrap().chosen;
        let (lit, wrong) = differing(&exact, &grey_slices(&scene, &rig, &chosen.plan, &SLICES));
        println!("{budget:?}: {}, {:.4} px, {wrong} of {lit} differ", chosen.plan, chosen.error_px);
        assert!(chosen.plan.edges == Edges::Rays && wrong * 100 < lit, "{}: {wrong} of {lit}", chosen.plan);
    }
}

/// On the way there, what is not drawn right is not trusted.
#[test]
fn toward_the_lit_limit_what_is_lost_is_known() {
    let scene = scene("boxes");
    for height_m in ["-0.84", "-0.86", "-0.875", "-0.885"] {
        let rig = seen_from(height_m);
        let rays = grey_slices(&scene, &rig, &plan(Projection::ConeNewton, Edges::Rays, 0.5), &SLICES);
        for (edges, bow_px) in [(Edges::Uniform, 0.5), (Edges::Adaptive, 0.5), (Edges::Discard, 8.0)] {
            let plan = plan(Projection::ConeNewton, edges, bow_px);
            let (lit, wrong) = differing(&rays, &grey_slices(&scene, &rig, &plan, &SLICES));
            let known = predict(&tessellate(&scene, &rig, &plan).unwrap(), &rig, &plan).map(|known| known.error_px);
            println!("{height_m} m {edges:?}: {wrong} of {lit} differ, expected {known:?} px");
            assert!(lit > 10_000 && (known.is_none() || wrong * 100 < lit), "{height_m} m {edges:?}: {wrong} of {lit}");
        }
    }
}

/// 18.8 px for 100 mm and 0.29 px for 12.5 mm, so 0.5 px at 16 mm, less a reserve.
#[test]
fn the_uniform_limit_is_what_the_prototype_measured() {
    let limit_m = edge_limit_m(&rig("reference"), Model::Planar, 0.06, 0.5);
    assert!((0.011..0.018).contains(&limit_m), "{limit_m}");
}

/// A wall of 500 m costs no more than what of it lies within reach.
#[test]
fn a_wall_beyond_the_viewers_costs_little() {
    let (low, high) = (-250.0, 250.0);
    let scene = scene_of(vec![
        triangle([[low, low, 0.0], [high, low, 0.0], [high, high, 0.0]], 1.0),
        triangle([[low, low, 0.0], [high, high, 0.0], [low, high, 0.0]], 1.0),
    ]);
    let rig = rig("reference");
    for projection in [Projection::Planar, Projection::ConeRoot] {
        for (edges, bow_px) in [(Edges::Uniform, 0.5), (Edges::Adaptive, 0.5), (Edges::Discard, 8.0)] {
            let mesh = tessellate(&scene, &rig, &plan(projection, edges, bow_px)).unwrap();
            let edges_m = mesh.triangles.iter().flat_map(|triangle| {
                let [a, b, c] = mesh.corners(triangle);
                [a.distance(b), b.distance(c), c.distance(a)]
            });
            let longest_m = edges_m.fold(0.0, f64::max);
            println!("{projection:?} {edges:?}: {} triangles, edges up to {longest_m:.3} m", mesh.triangles.len());
            assert!((1..400_000).contains(&mesh.triangles.len()), "{projection:?} {edges:?}");
            assert!(mesh.positions.len() < 400_000 && longest_m < 0.15, "{projection:?} {edges:?}: {longest_m} m");
        }
    }
    let [rays, adaptive] = [Edges::Rays, Edges::Adaptive]
        .map(|edges| grey_slices(&scene, &rig, &plan(Projection::Planar, edges, 0.5), &SLICES[..1]));
    let (lit, wrong) = differing(&rays, &adaptive);
    assert!(lit > 100_000 && wrong * 100 < lit, "{wrong} of {lit}");
}

#[test]
fn what_is_out_of_sight_is_known() {
    let at = |x: f32, y: f32| scene_of(vec![triangle([[x, y, 0.0], [x + 0.02, y, 0.0], [x, y + 0.02, 0.01]], 1.0)]);
    for name in ["reference", "high-viewer", "tent"] {
        let rig = rig(name);
        for (scene, expected) in [
            (at(0.0, 0.0), true),
            (at(5.0, 0.0), false),
            (at(0.0, 0.5), false),
            (at(0.5, 0.0), false),
            (scene_of(Vec::new()), false),
        ] {
            assert_eq!(anything_visible(&scene, &rig), expected, "{name} {:?}", scene.triangles);
            let all: Vec<u32> = (0..288).step_by(9).collect();
            let lit = grey_slices(&scene, &rig, &Plan::default(), &all).concat().into_iter().any(|value| value > 0);
            assert_eq!(lit, expected, "{name} {:?}", scene.triangles);
        }
    }
    // What only just reaches the panel's rim is no false alarm: wherever something is lit, it is known.
    let rig = rig("reference");
    for step in 0..40u8 {
        let scene = at(0.0, 0.05 + 0.005 * f32::from(step));
        let all: Vec<u32> = (0..288).step_by(9).collect();
        let lit = grey_slices(&scene, &rig, &Plan::default(), &all).concat().into_iter().any(|value| value > 0);
        assert!(!lit || anything_visible(&scene, &rig), "{step}");
    }
}
