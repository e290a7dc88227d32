//! How edges are brought to the curves that the optics make of them: the bow that is left, and with how many triangles.

use glam::{DVec2, DVec3, Vec3};
use host::render::mesh::Mesh;
use host::render::plan::{DepthTest, Edges, Plan, Precision, Projection};
use host::render::tessellate::tessellate;
use host::scene::{ShadedScene, ShadedTriangle};
use protocol::rig::Rig;
use shaders::project::methods::Method;
use shaders::project::{Model, Projected, SliceOptics, Visibility};
use std::collections::HashMap;
use tests::{SLICES, bunny, differing, grey_slices, plan, rig, scene, scene_of, triangle};

/// The largest bow left in a mesh, in pixels: along edges and inside pieces.
#[derive(Clone, Copy, Debug, Default)]
struct Bow {
    edges: f64,
    inside: f64,
}

impl Bow {
    fn largest(self) -> f64 {
        self.edges.max(self.inside)
    }
}

/// Weights of the corners: five places along an edge and six inside.
const ALONG: [f64; 5] = [0.125, 0.25, 0.5, 0.75, 0.875];
const INSIDE: [[f64; 3]; 6] = [
    [1.0 / 3.0, 1.0 / 3.0, 1.0 / 3.0],
    [0.5, 0.25, 0.25],
    [0.25, 0.5, 0.25],
    [0.25, 0.25, 0.5],
    [0.4, 0.4, 0.2],
    [0.2, 0.4, 0.4],
];

/// Every piece in every `step`th slice in which it is visible, by the reference optics.
fn measured(mesh: &Mesh, rig: &Rig, plan: &Plan, step: usize) -> Bow {
    let model = Method::from(plan.projection).model();
    let turn: Vec<(u32, usize)> = (0..rig.rotation.slices)
        .step_by(step)
        .flat_map(|slice| (0..rig.mirror.face.len()).map(move |face| (slice, face)))
        .collect();
    let in_slice = |(slice, face): (u32, usize)| {
        let optics = SliceOptics::new(rig, face, rig.slice_angle(slice), model);
        let corners: Vec<_> = mesh.positions.iter().map(|position| optics.project(*position)).collect();
        let mut worst = Bow::default();
        let bow = |points: &[DVec3], pixels: &[DVec2], weights: &[f64]| {
            let point: DVec3 = points.iter().zip(weights).map(|(point, weight)| *point * *weight).sum();
            let straight: DVec2 = pixels.iter().zip(weights).map(|(pixel, weight)| *pixel * *weight).sum();
            let Projected { pixel, visibility, .. } = optics.project(point);
            let shown = matches!(visibility, Visibility::Visible | Visibility::OutsideImage);
            pixel.filter(|_| shown).map_or(0.0, |pixel| pixel.distance(straight))
        };
        for triangle in &mesh.triangles {
            let Some(pixels) = pixels(&corners, triangle.corners) else { continue };
            let points = mesh.corners(triangle);
            for (from, to) in [(0, 1), (1, 2), (2, 0)] {
                for along in ALONG {
                    let bow = bow(&[points[from], points[to]], &[pixels[from], pixels[to]], &[1.0 - along, along]);
                    worst.edges = worst.edges.max(bow);
                }
            }
            for weights in INSIDE {
                worst.inside = worst.inside.max(bow(&points, &pixels, &weights));
            }
        }
        worst
    };
    let half = turn.len() / 2;
    let part = |part: &[(u32, usize)]| {
        part.iter()
            .map(|place| in_slice(*place))
            .fold(Bow::default(), |a, b| Bow { edges: a.edges.max(b.edges), inside: a.inside.max(b.inside) })
    };
    std::thread::scope(|scope| {
        let first = scope.spawn(|| part(&turn[..half]));
        let second = part(&turn[half..]);
        let first = first.join().expect("no panic");
        Bow { edges: first.edges.max(second.edges), inside: first.inside.max(second.inside) }
    })
}

fn pixels(corners: &[Projected], triangle: [u32; 3]) -> Option<[DVec2; 3]> {
    let [a, b, c] = triangle.map(|corner| corners[corner as usize].pixel);
    Some([a?, b?, c?])
}

/// The triangles of a scene that have an edge longer than 12 mm.
fn long(scene: &ShadedScene) -> ShadedScene {
    let is_long = |triangle: &&ShadedTriangle| {
        let [a, b, c] = triangle.positions;
        a.distance(b).max(b.distance(c)).max(c.distance(a)) > 0.012
    };
    ShadedScene {
        triangles: scene.triangles.iter().filter(is_long).copied().collect(),
        textures: scene.textures.clone(),
    }
}

/// Edges cut where they bow keep the bound, with far fewer triangles than edges of one length.
#[test]
fn adaptive_edges_keep_their_bound_with_fewer_triangles() {
    for name in ["boxes", "builtin"] {
        let scene = long(&scene(name));
        for rig_name in ["reference", "high-viewer", "tent"] {
            for projection in [Projection::Planar, Projection::ConeRoot] {
                let rig = rig(rig_name);
                let [adaptive, uniform] = [Edges::Adaptive, Edges::Uniform].map(|edges| {
                    let plan = plan(projection, edges, 0.5);
                    let mesh = tessellate(&scene, &rig, &plan).unwrap();
                    (mesh.triangles.len(), measured(&mesh, &rig, &plan, 7).largest())
                });
                // The fewest triangles of one length that keep the bound in fact.
                let fair = [1.1, 1.0, 0.9, 0.8, 0.7, 0.6].into_iter().find_map(|bow_px| {
                    let plan = plan(projection, Edges::Uniform, bow_px);
                    let mesh = tessellate(&scene, &rig, &plan).unwrap();
                    (measured(&mesh, &rig, &plan, 7).largest() <= 0.5).then_some(mesh.triangles.len())
                });
                let fair = fair.unwrap_or(uniform.0);
                println!(
                    "{name} {rig_name} {projection:?}: {} triangles become {} with {:.3} px; of one length {} with {:.3} px, \
                     at least {fair}",
                    scene.triangles.len(),
                    adaptive.0,
                    adaptive.1,
                    uniform.0,
                    uniform.1
                );
                assert!(adaptive.1 <= 0.5, "{name} {rig_name} {projection:?}: {adaptive:?}");
                assert!(adaptive.0 <= fair, "{name} {rig_name} {projection:?}");
                // The built-in scene's bars need four parts, where halving makes eight: no method can do with half of all.
                let share = if name == "builtin" && rig_name != "reference" { 0.6 } else { 0.5 };
                assert!(adaptive.0 as f64 <= share * uniform.0 as f64, "{name} {rig_name} {projection:?}");
            }
        }
    }
}

/// The same bound over every slice, at other bounds too.
#[test]
fn no_slice_bows_more_than_asked() {
    let scene = scene("boxes");
    for (rig_name, projection) in [("reference", Projection::ConeNewton), ("high-viewer", Projection::Planar)] {
        for (edges, bow_px) in
            [(Edges::Adaptive, 0.5), (Edges::Adaptive, 0.1), (Edges::Discard, 8.0), (Edges::Uniform, 0.5)]
        {
            let (rig, plan) = (rig(rig_name), plan(projection, edges, bow_px));
            let mesh = tessellate(&scene, &rig, &plan).unwrap();
            let bow = measured(&mesh, &rig, &plan, if bow_px < 0.2 { 7 } else { 1 });
            println!(
                "{rig_name} {projection:?} {edges:?} {bow_px} px: {bow:.3?} with {} triangles",
                mesh.triangles.len()
            );
            assert!(bow.largest() <= bow_px, "{rig_name} {projection:?} {edges:?} {bow_px}: {bow:?}");
        }
    }
}

/// In a closed solid every edge is run through as often one way as the other; so are the edges of its pieces.
#[test]
fn no_crack_opens() {
    for name in ["boxes", "builtin", "knot-5k"] {
        for edges in [Edges::Straight, Edges::Uniform, Edges::Adaptive, Edges::Discard] {
            let scene = scene(name);
            let mesh = tessellate(&scene, &rig("high-viewer"), &plan(Projection::ConeNewton, edges, 0.5)).unwrap();
            let mut balance: HashMap<[u32; 2], i32> = HashMap::new();
            for [a, b, c] in mesh.triangles.iter().map(|triangle| triangle.corners) {
                for (from, to) in [(a, b), (b, c), (c, a)] {
                    *balance.entry([from.min(to), from.max(to)]).or_default() += if from < to { 1 } else { -1 };
                }
            }
            assert!(balance.values().all(|sum| *sum == 0), "{name} {edges:?}");
            let area = |corners: [DVec3; 3]| (corners[1] - corners[0]).cross(corners[2] - corners[0]).length() / 2.0;
            let before: f64 = scene.triangles.iter().map(|triangle| area(triangle.positions.map(Vec3::as_dvec3))).sum();
            let after: f64 = mesh.triangles.iter().map(|triangle| area(mesh.corners(triangle))).sum();
            assert!((after / before - 1.0).abs() < 1e-6, "{name} {edges:?}: {before} {after}");
        }
    }
}

/// Every way of drawing against a ray for every pixel.
#[test]
fn all_ways_draw_what_rays_find() {
    let mut scenes = vec![("boxes", scene("boxes")), ("builtin", scene("builtin"))];
    scenes.extend(bunny().map(|bunny| ("bunny", bunny)));
    for (name, scene) in scenes {
        for (rig_name, projection) in
            [("reference", Projection::ConeNewton), ("high-viewer", Projection::Planar), ("tent", Projection::ConeRoot)]
        {
            let rig = rig(rig_name);
            let rays = grey_slices(&scene, &rig, &plan(projection, Edges::Rays, 0.5), &SLICES);
            for (edges, bow_px, precision, share) in [
                (Edges::Straight, 0.5, Precision::Single, 0.3),
                (Edges::Uniform, 0.5, Precision::Single, 0.02),
                (Edges::Adaptive, 0.5, Precision::Single, 0.02),
                (Edges::Adaptive, 0.5, Precision::Double, 0.02),
                (Edges::Discard, 8.0, Precision::Single, 0.0005),
                (Edges::Discard, 2.0, Precision::Double, 0.0005),
            ] {
                let plan = Plan { precision, ..plan(projection, edges, bow_px) };
                let (lit, wrong) = differing(&rays, &grey_slices(&scene, &rig, &plan, &SLICES));
                println!(
                    "{name} {rig_name} {projection:?} {edges:?} {bow_px} px {precision:?}: {wrong} of {lit} lit pixels \
                     differ, {:.3} %",
                    100.0 * wrong as f64 / lit as f64
                );
                assert!(lit > 10_000 && (wrong as f64) <= share * lit as f64, "{name} {rig_name} {edges:?}");
            }
        }
    }
}

/// A closed white solid has no dark pixel where the rays have none around it.
#[test]
fn solids_have_no_holes() {
    let mut scene = scene("boxes");
    scene.triangles.iter_mut().for_each(|triangle| triangle.radiance = [Vec3::ONE; 3]);
    let rig = rig("reference");
    let rays = grey_slices(&scene, &rig, &plan(Projection::ConeNewton, Edges::Rays, 0.5), &SLICES);
    for (edges, bow_px) in
        [(Edges::Straight, 0.5), (Edges::Uniform, 0.5), (Edges::Adaptive, 0.5), (Edges::Discard, 8.0)]
    {
        let drawn = grey_slices(&scene, &rig, &plan(Projection::ConeNewton, edges, bow_px), &SLICES);
        let reach: i32 = if edges == Edges::Straight { 20 } else { 1 };
        let holes: usize = rays.iter().zip(&drawn).map(|(rays, drawn)| holes(rays, drawn, reach)).sum();
        assert_eq!(holes, 0, "{edges:?}");
    }
}

/// Dark pixels that are lit in `rays`, and are so for `reach` pixels around.
fn holes(rays: &[u8], drawn: &[u8], reach: i32) -> usize {
    let at = |x: i32, y: i32| rays[(y * 768 + x) as usize] > 0;
    let dark = (0..768 * 768).filter(|cell| rays[*cell as usize] > 0 && drawn[*cell as usize] == 0);
    let inner = |cell: &i32| {
        let around = |centre: i32| (centre - reach).max(0)..=(centre + reach).min(767);
        around(cell / 768).all(|y| around(cell % 768).all(|x| at(x, y)))
    };
    dark.filter(inner).count()
}

/// Two large triangles that cut through each other, nearly one on the other: where they meet, and not where pieces end in chords of
/// their curved outlines.
#[test]
fn exact_depth_finds_the_line_where_surfaces_meet() {
    let scene = scene_of(vec![
        triangle([[-0.04, -0.04, 0.001], [0.05, -0.02, -0.002], [0.0, 0.05, 0.0015]], 0.9),
        triangle([[-0.045, 0.03, -0.001], [0.0, -0.05, 0.0005], [0.045, 0.035, 0.0]], 0.4),
    ]);
    let rig = rig("reference");
    let rays = grey_slices(&scene, &rig, &plan(Projection::ConeNewton, Edges::Rays, 0.5), &SLICES);
    for bow_px in [0.5f64, 2.0] {
        let outlines: Vec<_> = SLICES.iter().map(|slice| outlines(&scene, &rig, *slice, bow_px.max(1.0))).collect();
        let away = |plan: &Plan| {
            let drawn = grey_slices(&scene, &rig, plan, &SLICES);
            let pixels = rays.iter().flatten().zip(drawn.iter().flatten()).zip(outlines.iter().flatten());
            let wrong = pixels.filter(|((ray, drawn), _)| ray.abs_diff(**drawn) > 2);
            wrong.fold([0, 0], |[away, near], (_, outline)| if *outline { [away, near + 1] } else { [away + 1, near] })
        };
        let [linear, exact] = [DepthTest::Linear, DepthTest::Exact]
            .map(|depth| away(&Plan { depth, ..plan(Projection::ConeNewton, Edges::Adaptive, bow_px) }));
        let discarded = away(&plan(Projection::ConeNewton, Edges::Discard, 8.0));
        println!(
            "pieces of {bow_px} px: linear {linear:?} exact {exact:?} discarded {discarded:?} [away, at outlines]"
        );
        assert!(linear[0] > 100 && exact[0] <= 5 && discarded[0] <= 5, "{linear:?} {exact:?} {discarded:?}");
    }
}

/// The pixels whose middles lie within `reach` pixels of a triangle's outline.
fn outlines(scene: &ShadedScene, rig: &Rig, slice: u32, reach: f64) -> Vec<bool> {
    const STEPS: u32 = 4000;
    let optics = SliceOptics::new(rig, 0, rig.slice_angle(slice), Model::Cone);
    let (width, height) = (f64::from(rig.projector.width_px), f64::from(rig.projector.height_px));
    let mut near = vec![false; (width * height) as usize];
    for corners in scene.triangles.iter().map(|triangle| triangle.positions.map(Vec3::as_dvec3)) {
        for (from, to) in [(0, 1), (1, 2), (2, 0)] {
            for step in 0..=STEPS {
                let point = corners[from].lerp(corners[to], f64::from(step) / f64::from(STEPS));
                let Some(at) = optics.project(point).pixel else { continue };
                let [low, high] = [at - reach, at + reach].map(DVec2::floor);
                for y in low.y.max(0.0) as usize..=high.y.clamp(0.0, height - 1.0) as usize {
                    for x in low.x.max(0.0) as usize..=high.x.clamp(0.0, width - 1.0) as usize {
                        let middle = DVec2::new(x as f64, y as f64) + 0.5;
                        near[y * width as usize + x] |= middle.distance(at) <= reach;
                    }
                }
            }
        }
    }
    near
}

/// Where no symmetry helps.
#[test]
fn a_projector_off_the_axis_keeps_the_bound() {
    let reference = include_str!("../../host/rigs/reference.toml");
    let moved = reference.replace("[0.0, 0.6, 0.0]", "[0.05, 0.5, 0.02]");
    assert_ne!(moved, reference);
    let (rig, scene) = (Rig::parse(&moved).unwrap(), scene("boxes"));
    for projection in [Projection::Planar, Projection::ConeRoot] {
        for (edges, bow_px) in [(Edges::Uniform, 0.5), (Edges::Adaptive, 0.5), (Edges::Adaptive, 0.1)] {
            let plan = plan(projection, edges, bow_px);
            let bow = measured(&tessellate(&scene, &rig, &plan).unwrap(), &rig, &plan, 7);
            println!("{projection:?} {edges:?} {bow_px} px: {bow:.3?}");
            assert!(bow.largest() <= bow_px, "{projection:?} {edges:?} {bow_px}: {bow:?}");
        }
    }
}
