//! Clips against closed forms, and clips that are wrong.

use glam::{Mat4, Quat, Vec3, vec3};
use proptest::prelude::*;
use serde_json::{Value, json};
use std::f32::consts::{FRAC_1_SQRT_2, FRAC_PI_2};

use super::animated::{posed, read};
use super::gltf_clip::Clip;
use super::gltf_model::Model;
use super::tests_gltf_fixture::{F32, Fixture, I16, Memory, TRIANGLE, U8, animate, bent, everything, triangle};
use super::{Fault, Scene};

fn load(fixture: &Fixture) -> Result<(Scene, Model, Vec<Clip>), Fault> {
    read(&fixture.glb(), &Memory::default())
}

fn at(fixture: &Fixture, seconds: f64) -> Scene {
    let (_, model, clips) = load(fixture).unwrap();
    posed(&model, &clips[0], seconds).unwrap()
}

fn message(fixture: &Fixture) -> String {
    let text = load(fixture).err().expect("a fault").to_string();
    assert!(!text.contains('\n'), "one line: {text}");
    text
}

#[track_caller]
fn close(a: Vec3, b: Vec3) {
    assert!(a.distance(b) < 1e-6, "{a} for {b}");
}

/// A triangle that moves: `values` of `kind` at `times`.
fn moving(path: &str, interpolation: &str, times: &[f32], values: &[f32]) -> Fixture {
    let mut f = triangle(json!({}));
    animate(&mut f, [0, 0], path, interpolation, times, values);
    f
}

#[test]
fn linear_moves_evenly_and_stands_outside_of_its_keyframes() {
    let f = moving("translation", "LINEAR", &[1.0, 3.0, 4.0], &[0., 0., 0., 2., 4., 6., 0., 0., 0.]);
    assert_eq!(load(&f).unwrap().2[0].seconds, 4.0);
    for (seconds, expected) in [
        (0.0, Vec3::ZERO),
        (1.0, Vec3::ZERO),
        (1.5, vec3(0.5, 1.0, 1.5)),
        (3.0, vec3(2.0, 4.0, 6.0)),
        (3.5, vec3(1.0, 2.0, 3.0)),
        (9.0, Vec3::ZERO),
        (f64::NAN, Vec3::ZERO),
    ] {
        close(at(&f, seconds).positions[0], expected);
    }
}

#[test]
fn steps_hold_until_the_next_keyframe() {
    let f = moving("scale", "STEP", &[0.0, 1.0, 2.0], &[1., 1., 1., 2., 2., 2., 3., 3., 3.]);
    for (seconds, scale) in [(0.999, 1.0), (1.0, 2.0), (1.999, 2.0), (2.0, 3.0)] {
        close(at(&f, seconds).positions[1], scale * Vec3::X);
    }
}

#[test]
fn a_quaternion_halfway_takes_the_shorter_arc() {
    let quarter = Quat::from_rotation_z(FRAC_PI_2);
    for to in [quarter, -quarter] {
        let mut values = Quat::IDENTITY.to_array().to_vec();
        values.extend(to.to_array());
        let f = moving("rotation", "LINEAR", &[0.0, 1.0], &values);
        close(at(&f, 0.5).positions[1], vec3(FRAC_1_SQRT_2, FRAC_1_SQRT_2, 0.0));
        close(at(&f, 1.0 / 3.0).positions[1], vec3(3.0_f32.sqrt() / 2.0, 0.5, 0.0));
        close(at(&f, 1.0).positions[1], Vec3::Y);
    }
}

#[test]
fn rotations_may_be_integers() {
    let mut f = triangle(json!({}));
    animate(&mut f, [0, 0], "rotation", "LINEAR", &[0.0, 1.0], &[0., 0., 0., 1., 0., 0., 1., 0.]);
    let bytes: Vec<u8> = [0, 0, 0, i16::MAX, 0, 0, i16::MAX, 0].iter().flat_map(|v: &i16| v.to_le_bytes()).collect();
    let output = f.accessor(&bytes, I16, "VEC4", 2);
    f.json["animations"][0]["samplers"][0]["output"] = json!(output);
    close(at(&f, 0.5).positions[1], Vec3::Y);
}

#[test]
fn a_spline_follows_its_formula() {
    // x: 0 to 4 in 2 s, 1 m/s at the first end and -2 m/s at the other: halfway 2 + 2 (1 / 8) + 2 (2 / 8).
    let values = [9., 9., 9., 0., 1., 0., 1., 0., 0., -2., 0., 0., 4., 1., 0., 9., 9., 9.];
    let f = moving("translation", "CUBICSPLINE", &[1.0, 3.0], &values);
    for (seconds, expected) in [(0.0, 0.0), (1.0, 0.0), (2.0, 2.75), (3.0, 4.0), (5.0, 4.0)] {
        close(at(&f, seconds).positions[0], vec3(expected, 1.0, 0.0));
    }
    let speed = |seconds: f64| (at(&f, seconds + 1e-3).positions[0].x - at(&f, seconds).positions[0].x) / 1e-3;
    assert!((speed(1.0) - 1.0).abs() < 1e-2 && (speed(2.999) + 2.0).abs() < 1e-2, "{} {}", speed(1.0), speed(2.999));
    // Of rotations the result is brought to length 1: halfway between two quarter turns apart without tangents lies 45 degrees.
    let quarter = Quat::from_rotation_z(FRAC_PI_2).to_array();
    let none = [0.0; 4];
    let values = [none, Quat::IDENTITY.to_array(), none, none, quarter, none].concat();
    let f = moving("rotation", "CUBICSPLINE", &[0.0, 1.0], &values);
    close(at(&f, 0.5).positions[1], vec3(FRAC_1_SQRT_2, FRAC_1_SQRT_2, 0.0));
}

#[test]
fn two_bones_bend_their_skin() {
    let f = bent();
    let scene = at(&f, 1.0);
    close(scene.positions[0], vec3(1.0, 0.5, 0.0));
    close(scene.positions[1], vec3(-0.25, 1.25, 0.0));
    close(scene.positions[2], vec3(-1.0, 1.0, 0.0));
    // What a bone turns by a quarter and nothing else has no say in.
    close(scene.normals[2], Vec3::NEG_X);
    close(scene.normals[0], Vec3::Y);
}

#[test]
fn eight_joints_share_a_vertex() {
    let mut f = Fixture::new();
    let positions = f.floats(&TRIANGLE, "VEC3");
    let sets: Vec<usize> =
        [[0, 1, 2, 3], [4, 5, 6, 7]].iter().map(|set| f.accessor(&set.repeat(3), U8, "VEC4", 3)).collect();
    sets.iter().for_each(|&set| f.json["accessors"][set]["normalized"] = json!(false));
    let weights = f.floats(&[0.125; 12], "VEC4");
    let attributes = json!({"POSITION": positions, "JOINTS_0": sets[0], "JOINTS_1": sets[1], "WEIGHTS_0": weights,
        "WEIGHTS_1": weights});
    f.mesh_node(json!({"attributes": attributes}), json!({"skin": 0}));
    let joints: Vec<usize> = (0..8).map(|_| f.push("nodes", json!({}))).collect();
    f.push("skins", json!({"joints": joints}));
    animate(&mut f, [0, joints[6]], "translation", "LINEAR", &[0.0, 1.0], &[0., 0., 0., 8., 0., 0.]);
    close(at(&f, 0.5).positions[0], vec3(0.5, 0.0, 0.0));
}

#[test]
fn morph_targets_add_up_at_rest_and_in_motion() {
    let mut f = Fixture::new();
    let positions = f.floats(&TRIANGLE, "VEC3");
    let normals = f.floats(&[0.0, 0.0, 1.0].repeat(3), "VEC3");
    let up = f.floats(&[0.0, 2.0, 0.0].repeat(3), "VEC3");
    let forth = f.floats(&[0.0, 0.0, 4.0].repeat(3), "VEC3");
    let tilt = f.floats(&[0.0, 1.0, -1.0].repeat(3), "VEC3");
    let primitive = json!({"attributes": {"POSITION": positions, "NORMAL": normals},
        "targets": [{"POSITION": up}, {"POSITION": forth, "NORMAL": tilt}]});
    f.mesh_node(primitive, json!({}));
    animate(&mut f, [0, 0], "weights", "LINEAR", &[0.0, 1.0], &[0.0, 0.0, 1.0, 0.5]);
    let rest = |f: &Fixture| load(f).unwrap().0.positions[0];
    close(rest(&f), Vec3::ZERO);
    f.json["meshes"][0]["weights"] = json!([0.5, 0.25]);
    close(rest(&f), vec3(0.0, 1.0, 1.0));
    f.json["nodes"][0]["weights"] = json!([1.0, 0.0]);
    close(rest(&f), vec3(0.0, 2.0, 0.0));
    close(at(&f, 0.5).positions[0], vec3(0.0, 1.0, 1.0));
    close(at(&f, 1.0).positions[0], vec3(0.0, 2.0, 2.0));
    close(at(&f, 1.0).normals[0], vec3(0.0, FRAC_1_SQRT_2, FRAC_1_SQRT_2));
}

#[test]
fn what_shrinks_to_nothing_is_not_there() {
    let f = moving("scale", "LINEAR", &[0.0, 1.0], &[0., 0., 0., 1., 1., 1.]);
    let scene = at(&f, 0.0);
    assert_eq!((scene.triangles.len(), scene.materials.len()), (0, 1));
    assert_eq!(at(&f, 0.5).triangles.len(), 1);
}

#[test]
fn a_pose_like_rest_is_rest_bit_for_bit() {
    let (mut f, still) = (everything(), everything());
    // What everything's last node has.
    animate(&mut f, [0, 2], "translation", "LINEAR", &[0.0, 1.0], &[0., 0., 1., 0., 0., 1.]);
    let (rest, _, clips) = load(&still).unwrap();
    assert!(clips.is_empty());
    let bits = |scene: &Scene| -> Vec<u32> {
        scene.positions.iter().chain(&scene.normals).flat_map(|v| v.to_array()).map(f32::to_bits).collect()
    };
    for scene in [load(&f).unwrap().0, at(&f, 0.37)] {
        assert_eq!(bits(&scene), bits(&rest));
        assert_eq!((&scene.triangles, &scene.uvs, &scene.colours), (&rest.triangles, &rest.uvs, &rest.colours));
    }
}

#[test]
fn each_fault_of_a_clip_names_its_place() {
    let changed = |change: &dyn Fn(&mut Fixture)| {
        let mut f = moving("translation", "LINEAR", &[0.0, 1.0, 2.0], &[0.0; 9]);
        change(&mut f);
        message(&f)
    };
    let with = |path: &'static str, interpolation: &'static str, times: &'static [f32], numbers: usize| {
        message(&moving(path, interpolation, times, &vec![0.5; numbers]))
    };
    let place = "animation 0 channel 0: ";
    for (message, expected) in [
        (
            with("translation", "LINEAR", &[0.0, 1.0, 1.0], 9),
            "a keyframe at 1 s after one at 1 s, allowed are later ones",
        ),
        (with("translation", "LINEAR", &[1.0, 0.5], 6), "a keyframe at 0.5 s after one at 1 s, allowed are later ones"),
        (with("translation", "LINEAR", &[-1.0, 0.5], 6), "begins at -1 s, allowed are 0 and later"),
        (
            with("translation", "LINEAR", &[0.0, f32::NAN], 6),
            "time NaN is out of range, allowed are finite numbers within +-1e15",
        ),
        (with("translation", "LINEAR", &[], 0), "no keyframe, at least one is needed"),
        (with("translation", "LINEAR", &[0.0, 1.0], 9), "9 numbers for 2 keyframes, allowed are 3 for each"),
        (with("scale", "CUBICSPLINE", &[0.0, 1.0], 6), "6 numbers for 2 keyframes, allowed are 9 for each"),
        (with("weights", "LINEAR", &[0.0, 1.0], 2), "weights of node 0, which has no morph targets"),
        (
            message(&moving("translation", "STEP", &[0.0], &[0.0, f32::INFINITY, 0.0])),
            "value inf is out of range, allowed are finite numbers within +-1e15",
        ),
        (
            changed(&|f| f.json["nodes"][0]["matrix"] = json!(Mat4::IDENTITY.to_cols_array())),
            "node 0 has a matrix, allowed are translation, rotation and scale where it moves",
        ),
        (
            changed(&|f| f.json["animations"][0]["channels"][0]["target"]["path"] = json!("colour")),
            "its target has an unknown path, allowed are translation, rotation, scale and weights",
        ),
        (
            changed(&|f| f.json["animations"][0]["channels"][0]["target"]["node"] = json!(1)),
            "index 1 is out of range, allowed are nodes 0 to 0",
        ),
    ] {
        assert_eq!(message, format!("{place}{expected}"));
    }
    let twice = changed(&|f| animate(f, [0, 0], "translation", "STEP", &[0.0], &[0.0; 3]));
    assert_eq!(twice, "animation 0 channel 1: moves node 0 where another channel of its animation does");
    assert!(changed(&|f| f.json["animations"][0]["channels"][0]["sampler"] = json!(1)).contains("channels[0].sampler"));
    assert!(changed(&|f| f.json["animations"][0]["samplers"][0]["input"] = json!(9)).contains("samplers[0].input"));
    assert!(
        changed(&|f| f.json["animations"][0]["samplers"][0]["interpolation"] = json!("BEST")).contains("interpolation")
    );
    let truncated = changed(&|f| f.json["bufferViews"][1]["byteLength"] = json!(11));
    assert!(truncated.starts_with("animation 0 channel 0 accessor 1: 3 elements of 4 bytes"), "{truncated}");
    let mut far = moving("translation", "LINEAR", &[0.0, 1.0], &[0., 0., 0., 1e15, 0., 0.]);
    far.json["nodes"][0]["scale"] = json!([9e14, 9e14, 1.0]);
    let (rest, model, clips) = load(&far).unwrap();
    assert_eq!(rest.triangles.len(), 1, "at rest nothing is wrong");
    let fault = posed(&model, &clips[0], 1.0).unwrap_err().to_string();
    assert!(fault.starts_with("mesh 0 primitive 0 vertex 1: position [19"), "{fault}");
}

#[test]
fn memory_is_not_reserved_for_keyframes_that_are_named_often() {
    let mut f = triangle(json!({}));
    let zeros = f.view(&[0; 12]);
    for kind in ["SCALAR", "VEC3"] {
        let sparse =
            json!({"count": 1, "indices": {"bufferView": zeros, "componentType": U8}, "values": {"bufferView": zeros}});
        f.push("accessors", json!({"componentType": F32, "type": kind, "count": 1 << 20, "sparse": sparse}));
    }
    let channels: Vec<Value> =
        (0..20).map(|node| json!({"sampler": 0, "target": {"node": node, "path": "scale"}})).collect();
    for _ in 0..20 {
        f.push("nodes", json!({}));
    }
    f.push("animations", json!({"samplers": [{"input": 1, "output": 2}], "channels": channels}));
    // The first is refused for its times; with those in order the seventeenth would be for its size.
    let fault = message(&f);
    assert!(fault.contains("a keyframe at 0 s after one at 0 s"), "{fault}");
    f.json["accessors"][2]["count"] = json!(1_u64 << 40);
    assert!(message(&f).contains("numbers of keyframes so far, allowed are at most 67108864"));
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(200) })]

    #[test]
    fn every_interpolation_meets_its_keyframes_and_linear_stays_between(
        keys in prop::collection::vec((0.01_f32..1.0, prop::array::uniform3(-5.0_f32..5.0), prop::array::uniform3(-5.0_f32..5.0)), 1..6),
        part in 0.0_f64..1.0,
    ) {
        let times: Vec<f32> = keys.iter().scan(0.0, |sum, key| { *sum += key.0; Some(*sum) }).collect();
        let linear: Vec<f32> = keys.iter().flat_map(|key| key.1).collect();
        let spline: Vec<f32> = keys.iter().flat_map(|key| [key.2, key.1, key.2]).flatten().collect();
        for (interpolation, values) in [("STEP", &linear), ("LINEAR", &linear), ("CUBICSPLINE", &spline)] {
            let f = moving("translation", interpolation, &times, values);
            let (_, model, clips) = load(&f).unwrap();
            let place = |seconds: f64| posed(&model, &clips[0], seconds).unwrap().positions[0];
            for (time, key) in times.iter().zip(&keys) {
                prop_assert_eq!(place((*time).into()).to_array(), key.1);
            }
            for (pair, ends) in times.windows(2).zip(keys.windows(2)) {
                let found = place(f64::from(pair[0]) + part * f64::from(pair[1] - pair[0]));
                let [from, to] = [0, 1].map(|i| Vec3::from(ends[i].1));
                let between = from.min(to) - 1e-5;
                prop_assert!(interpolation == "CUBICSPLINE" || (found.cmpge(between) & found.cmple(from.max(to) + 1e-5)).all());
            }
        }
    }

    #[test]
    fn rotations_keep_lengths_and_speed(
        from in prop::array::uniform4(-1.0_f32..1.0),
        to in prop::array::uniform4(-1.0_f32..1.0),
        part in 0.0_f64..0.5,
    ) {
        let [a, b] = [from, to].map(Quat::from_array);
        prop_assume!(a.length() > 0.1 && b.length() > 0.1);
        let f = moving("rotation", "LINEAR", &[0.0, 1.0], &[from, to].concat());
        let (_, model, clips) = load(&f).unwrap();
        let turned = |seconds: f64| {
            let scene = posed(&model, &clips[0], seconds).unwrap();
            let [x, y] = [1, 2].map(|i| scene.positions[i]);
            assert!((x.length() - 1.0).abs() < 1e-5 && (y.length() - 1.0).abs() < 1e-5 && x.dot(y).abs() < 1e-5);
            Quat::from_mat3(&glam::Mat3::from_cols(x, y, x.cross(y)))
        };
        let angle = |p: Quat, q: Quat| 2.0 * p.dot(q).abs().min(1.0).acos();
        // Near no turn at all an angle by its cosine has few digits.
        let [whole, first, second] =
            [angle(turned(0.0), turned(1.0)), angle(turned(0.0), turned(part)), angle(turned(part), turned(2.0 * part))];
        prop_assert!(whole <= std::f32::consts::PI + 1e-3);
        prop_assert!((first - part as f32 * whole).abs() < 5e-3, "{} of {}", first, whole);
        prop_assert!((second - first).abs() < 5e-3, "{} and {}", first, second);
    }
}
