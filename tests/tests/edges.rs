//! How edges are brought to the curves that the optics make of them: the bow that is left, and with how many triangles.

use glam::{DVec2, DVec3};
use host::render::mesh::Mesh;
use host::render::plan::{Edges, Plan, Projection};
use host::render::tessellate::tessellate;
use protocol::rig::Rig;
use shaders::project::methods::Method;
use shaders::project::{Projected, SliceOptics, Visibility};
use std::collections::HashMap;
use tests::{rig, scene};

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

fn plan(projection: Projection, edges: Edges, bow_px: f64) -> Plan {
    Plan { projection, edges, bow_px, ..Plan::default() }
}

#[test]
fn explore() {
    for name in ["boxes", "builtin"] {
        let scene = scene(name);
        for rig_name in ["reference", "high-viewer", "tent"] {
            for projection in [Projection::Planar, Projection::ConeRoot] {
                let rig = rig(rig_name);
                for (edges, bow_px) in [(Edges::Uniform, 0.5), (Edges::Adaptive, 0.5), (Edges::Adaptive, 8.0)] {
                    let plan = plan(projection, edges, bow_px);
                    let start = std::time::Instant::now();
                    let mesh = tessellate(&scene, &rig, &plan).unwrap();
                    let ms = start.elapsed().as_millis();
                    println!(
                        "{name} {rig_name} {projection:?} {edges:?} {bow_px}: {} -> {} {:?} {ms} ms",
                        scene.triangles.len(),
                        mesh.triangles.len(),
                        measured(&mesh, &rig, &plan, if name == "boxes" { 11 } else { 29 })
                    );
                }
            }
        }
    }
}

#[test]
fn where_from() {
    let whole = scene("builtin");
    for (name, range) in [("bars", 0..144), ("floor", 144..156), ("rest", 156..whole.triangles.len())] {
        let scene = host::scene::ShadedScene { triangles: whole.triangles[range].to_vec(), textures: vec![] };
        let rig = rig("high-viewer");
        for projection in [Projection::Planar, Projection::ConeRoot] {
            for (edges, bow_px) in [
                (Edges::Uniform, 0.5),
                (Edges::Uniform, 0.8),
                (Edges::Adaptive, 0.5),
                (Edges::Adaptive, 0.48),
                (Edges::Adaptive, 0.52),
                (Edges::Adaptive, 0.55),
            ] {
                let plan = plan(projection, edges, bow_px);
                let mesh = tessellate(&scene, &rig, &plan).unwrap();
                println!(
                    "{name} {projection:?} {edges:?} {bow_px} {} -> {} {:?}",
                    scene.triangles.len(),
                    mesh.triangles.len(),
                    if name == "rest" { Bow::default() } else { measured(&mesh, &rig, &plan, 3) }
                );
            }
        }
    }
}
