//! The built-in scene, and the meshes that are not part of this repository, where they are at hand.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use glam::{DVec3, Vec3};

use super::{BUILT_IN, Scene, Shading, luminance, shade};

/// Triangles by the solid that they belong to: solids share no vertices.
fn solids(scene: &Scene) -> Vec<Vec<[u32; 3]>> {
    let mut parent: Vec<u32> = (0..scene.positions.len() as u32).collect();
    fn root(parent: &[u32], mut i: u32) -> u32 {
        while parent[i as usize] != i {
            i = parent[i as usize];
        }
        i
    }
    for &[a, b, c] in &scene.triangles {
        for other in [b, c] {
            let (from, to) = (root(&parent, other), root(&parent, a));
            parent[from as usize] = to;
        }
    }
    let mut solids: HashMap<u32, Vec<[u32; 3]>> = HashMap::new();
    for &corners in &scene.triangles {
        solids.entry(root(&parent, corners[0])).or_default().push(corners);
    }
    solids.into_values().collect()
}

#[test]
fn built_in_scenes_fit_the_display() {
    for name in BUILT_IN {
        let scene = Scene::load(name).unwrap();
        assert!(scene.radius() <= 0.060 && scene.radius() > 0.055, "{name}: {}", scene.radius());
        assert!(scene.triangles.len() < 75_000);
        assert!(scene.notes.is_empty(), "{name}: {:?}", scene.notes);
        assert_eq!(scene.positions, Scene::load(name).unwrap().positions, "the same every time");
    }
}

#[test]
fn boxes_have_long_edges_and_the_knot_has_short_ones() {
    let longest = |name: &str| {
        let scene = Scene::load(name).unwrap();
        let edges = scene.triangles.iter().flat_map(|[a, b, c]| [[a, b], [b, c], [c, a]]);
        let lengths = edges.map(|ends| ends.map(|&end| scene.positions[end as usize])).map(|[a, b]| a.distance(b));
        (scene.triangles.len(), lengths.fold(0.0, f32::max))
    };
    let (boxes, knot) = (longest("boxes"), longest("knot-5k"));
    assert!(boxes.0 == 96 && boxes.1 > 0.1 && boxes.1 < 0.12, "{boxes:?}");
    assert!(knot.0 == 5120 && knot.1 < 0.01, "{knot:?}");
}

#[test]
fn built_in_scenes_are_made_of_closed_solids_with_their_outside_out() {
    for (name, count) in BUILT_IN.into_iter().zip([20, 8, 1, 1, 1]) {
        let scene = Scene::load(name).unwrap();
        let solids = solids(&scene);
        assert!(solids.len() >= count, "{name}: {}", solids.len());
        solids.iter().for_each(|solid| assert_closed(&scene, solid));
    }
}

fn assert_closed(scene: &Scene, solid: &[[u32; 3]]) {
    let mut edges: HashMap<(u32, u32), i32> = HashMap::new();
    let mut volume = 0.0;
    for &[a, b, c] in solid {
        for (from, to) in [(a, b), (b, c), (c, a)] {
            *edges.entry((from, to)).or_default() += 1;
        }
        let [a, b, c] = [a, b, c].map(|i| DVec3::from(scene.positions[i as usize]));
        volume += a.dot(b.cross(c)) / 6.0;
    }
    assert!(edges.iter().all(|(&(a, b), &count)| count == 1 && edges.get(&(b, a)) == Some(&1)), "a hole");
    assert!(volume > 1e-9, "inside out: {volume} m3");
}

#[test]
fn builtin_is_bright_and_has_shades() {
    let scene = Scene::builtin();
    let shaded = shade(&scene, Shading::Lambert, false);
    let lights: Vec<f32> = shaded.triangles.iter().map(|t| luminance(t.radiance[0])).collect();
    assert!(lights.iter().all(|light| (0.03..=0.96).contains(light)));
    let mut weight = [0.0_f32; 10];
    for (triangle, light) in shaded.triangles.iter().zip(&lights) {
        let [a, b, c] = triangle.positions;
        weight[(light * 10.0) as usize] += (b - a).cross(c - a).length();
    }
    let total: f32 = weight.iter().sum();
    assert!(weight.iter().filter(|w| **w > 0.02 * total).count() >= 5, "{weight:?}");
}

#[test]
fn builtin_differs_from_side_to_side() {
    let scene = Scene::builtin();
    let near = |p: Vec3| scene.positions.iter().any(|q| q.distance(p) < 0.004);
    let quarter = |p: Vec3| Vec3::new(p.z, p.y, -p.x);
    let mut different = [0; 3];
    for &p in &scene.positions {
        let turned = [quarter(p), quarter(quarter(p)), quarter(quarter(quarter(p)))];
        (0..3).for_each(|i| different[i] += usize::from(!near(turned[i])));
    }
    assert!(different.iter().all(|d| *d > scene.positions.len() / 10), "{different:?}");
}

/// A file of the data folder that is not part of the project; says so where it is missing.
pub fn shared(path: &str) -> Option<PathBuf> {
    let default = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared");
    let file = std::env::var_os("PRAXI_SHARED").map_or(default, PathBuf::from).join("data").join(path);
    if !file.is_file() {
        println!("skipped: {} is missing", file.display());
        return None;
    }
    Some(file)
}

/// Triangles, and whether there are textures, of files that are too large for this repository.
#[test]
fn known_meshes_load() {
    for (file, triangles, textured) in [
        ("meshes/stanford-bunny.obj", 69_451, false),
        ("meshes/teapot.obj", 6_320, false),
        ("meshes/spot.obj", 5_856, false),
        ("gltf/Fox.glb", 576, true),
        ("gltf/cakeBirthday.glb", 1_331, false),
        ("gltf/FlightHelmet/FlightHelmet.gltf", 94_722, true),
    ] {
        let Some(path) = shared(file) else { continue };
        let mut scene = Scene::load(&path).unwrap();
        assert_eq!(scene.triangles.len(), triangles, "{file}");
        assert_eq!(scene.materials.iter().any(|m| m.texture.is_some()), textured, "{file}");
        scene.fit(0.1);
        assert!(scene.radius() > 0.05 && scene.radius() < 0.1, "{file}");
        if file.ends_with("Fox.glb") {
            // Skinned from a model that lies down: it stands on its feet and is longer than high.
            let (low, high) = scene.bounds();
            let size = high - low;
            assert!(size.z > size.y && size.y > 2.0 * size.x, "{size}");
        }
    }
}
