//! Files that move.

use glam::Vec3;
use serde_json::json;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

use super::tests_builtin::shared;
use super::tests_gltf_fixture::{Fixture, animate, bent, everything};
use super::{Animated, Scene};

/// Loads a document from a file of its own.
fn load(fixture: &Fixture) -> (tempfile::TempDir, PathBuf, Animated) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a thing.GLB");
    std::fs::write(&path, fixture.glb()).unwrap();
    let animated = Animated::load(&path).unwrap();
    (folder, path, animated)
}

/// All of a scene, its numbers as they are.
fn all(scene: &Scene) -> String {
    format!("{scene:?}")
}

#[test]
fn what_stands_still_is_as_it_is_loaded() {
    for name in ["builtin", "boxes"] {
        let animated = Animated::load(name).unwrap();
        assert!(animated.clips().is_empty());
        assert_eq!(all(&animated.at(0, 1.0).unwrap()), all(&Scene::load(name).unwrap()));
    }
    let (_folder, path, mut animated) = load(&everything());
    let mut scene = Scene::load(path).unwrap();
    assert_eq!(all(&animated.at(0, 1.0).unwrap()), all(&scene));
    animated.fit(0.1).unwrap();
    scene.fit(0.1);
    assert_eq!(all(&animated.at(3, 1.0).unwrap()), all(&scene));
    assert!(Animated::load("nothing.glb").err().unwrap().to_string().starts_with("nothing.glb: cannot be read"));
    assert!(Animated::load("nothing.obj").err().unwrap().to_string().starts_with("nothing.obj: cannot be read"));
}

#[test]
fn poses_share_textures() {
    let mut f = everything();
    animate(&mut f, [0, 2], "translation", "LINEAR", &[0.0, 1.0], &[0., 0., 1., 0., 5., 1.]);
    f.json["animations"][0]["name"] = json!("rise");
    let (_folder, _, animated) = load(&f);
    assert_eq!((animated.clips()[0].name.as_str(), animated.clips()[0].seconds), ("rise", 1.0));
    let textures =
        [0.0, 0.5, 1.0].map(|seconds| animated.at(0, seconds).unwrap().materials[0].texture.clone().unwrap());
    assert!(textures.iter().all(|texture| Arc::ptr_eq(texture, &textures[0])));
    assert_eq!(animated.at(0, 0.5).unwrap().name, "a thing");
}

#[test]
fn a_fitted_clip_keeps_its_size() {
    let (_folder, _, mut animated) = load(&bent());
    let length = |animated: &Animated, seconds: f64| {
        let scene = animated.at(0, seconds).unwrap();
        scene.positions[0].distance(scene.positions[2])
    };
    let before = [0.25, 0.5].map(|seconds| length(&animated, seconds));
    animated.fit(0.1).unwrap();
    let after = [0.25, 0.5].map(|seconds| length(&animated, seconds));
    assert!((after[0] / before[0] - after[1] / before[1]).abs() < 1e-6, "{before:?} {after:?}");
    let bounds = (0..=50).map(|i| animated.at(0, f64::from(i) / 50.0).unwrap().bounds());
    let (low, high) =
        bounds.fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |all, one| (all.0.min(one.0), all.1.max(one.1)));
    assert!((high - low).max_element() <= 0.1 + 1e-7 && (high - low).max_element() > 0.0999, "{low} {high}");
    assert!((high + low).length() < 1e-4, "{low} {high}");
}

/// Three clips of 24 joints, in a file that is too large for this repository.
#[test]
fn the_fox_looks_walks_and_runs() {
    let Some(path) = shared("gltf/Fox.glb") else { return };
    let mut fox = Animated::load(&path).unwrap();
    assert_eq!(all(&fox.at(9, 0.0).unwrap()), all(&Scene::load(&path).unwrap()));
    let clips: Vec<_> = fox.clips().iter().map(|clip| (clip.name.clone(), clip.seconds as f32)).collect();
    assert_eq!(clips, [("Survey".into(), 3.416_666_7), ("Walk".into(), 0.708_333_3), ("Run".into(), 1.158_333_3)]);
    fox.fit(0.1).unwrap();
    for (clip, (name, seconds)) in clips.iter().enumerate() {
        let moments = (0..=20).map(|i| f64::from(i) / 20.0 * f64::from(*seconds));
        let start = Instant::now();
        let poses: Vec<Scene> = moments.map(|seconds| fox.at(clip, seconds).unwrap()).collect();
        println!("Fox, {name}: {:.2} ms a pose", start.elapsed().as_secs_f64() * 1e3 / poses.len() as f64);
        let lowest: Vec<f32> = poses.iter().map(|pose| pose.bounds().0.y).collect();
        let [ground, highest] =
            [lowest.iter().copied().fold(f32::INFINITY, f32::min), lowest.iter().copied().fold(-1.0, f32::max)];
        for pose in &poses {
            assert_eq!(pose.triangles.len(), 576);
            assert!(pose.radius() < 0.06 && pose.positions.iter().all(|p| p.is_finite()));
        }
        // It stands on its feet, and leaves the ground only where it runs.
        assert!(highest - ground < if name == "Run" { 0.02 } else { 0.004 }, "{name} {lowest:?}");
        // What repeats ends as it begins.
        let apart =
            poses[0].positions.iter().zip(&poses[20].positions).map(|(a, b)| a.distance(*b)).fold(0.0, f32::max);
        assert!(apart < 0.002, "{name}: {apart} m between its ends");
        let moved =
            poses[0].positions.iter().zip(&poses[10].positions).map(|(a, b)| a.distance(*b)).fold(0.0, f32::max);
        assert!(moved > 0.005, "{name} moves by {moved} m");
    }
}
