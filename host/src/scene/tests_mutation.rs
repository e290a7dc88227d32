//! Broken files give errors and never panic. The parsers are called directly: [`Scene::load`] would hide a panic.

use proptest::prelude::*;
use serde_json::json;

use super::tests_files::{CUBE_OBJ, TRIANGLE_PLY, square_little};
use super::tests_gltf_fixture::{Fixture, Memory, animate, bent, everything, picture};
use super::{Fault, Scene, Shading, animated, gltf, mtl, obj, ply, shade};

const OBJ: &str = "mtllib m.mtl\nv 0 0 0 1 0 0\nv 1 0 0 0 1 0\nv 0 1 0 0 0 1\nv 1 1 0\nvt 0 0.5\nvn 0 0 1
usemtl red\nf 1/1/1 2/1/1 -2/-1/-1\nf 1//1 2//1 4//1 3//1\n";
const MTL: &str = "newmtl red\nKd 0.5\nmap_Kd -clamp on -s 1 2 p.png\n";

type Parser = fn(&[u8]) -> Result<Scene, Fault>;

fn beside() -> Memory {
    Memory(vec![("m.mtl", MTL.into()), ("p.png", picture())])
}

/// Two bones, a target to morph to, and every way to get from one keyframe to the next.
fn moving() -> Fixture {
    let mut f = bent();
    let target = f.floats(&[1.0; 9], "VEC3");
    f.json["meshes"][0]["primitives"][0]["targets"] = json!([{"POSITION": target, "NORMAL": target}]);
    animate(&mut f, [0, 0], "weights", "CUBICSPLINE", &[0.0, 1.0], &[0.0, 0.0, 1.0, 0.5, 1.0, 0.0]);
    animate(&mut f, [1, 1], "scale", "STEP", &[0.0, 0.5], &[1.0, 1.0, 1.0, 2.0, 2.0, 2.0]);
    animate(&mut f, [1, 2], "translation", "LINEAR", &[0.0, 0.5], &[0.0; 6]);
    f
}

/// The last moment that can be had of it.
fn parse_moving(bytes: &[u8]) -> Result<Scene, Fault> {
    let (mut scene, model, clips) = animated::read(bytes, &beside())?;
    for clip in &clips {
        for part in [0.0, 0.3, 0.7, 1.0] {
            scene = animated::posed(&model, clip, part * clip.seconds)?;
        }
    }
    Ok(scene)
}

/// Every kind of file, whole and sound, with its parser.
fn samples() -> Vec<(Vec<u8>, Parser)> {
    let parse_gltf: Parser = |bytes| gltf::parse(bytes, &beside());
    let parse_obj: Parser = |bytes| obj::parse(bytes, &beside());
    vec![
        (everything().glb(), parse_gltf),
        (moving().glb(), parse_moving),
        (OBJ.into(), parse_obj),
        (CUBE_OBJ.into(), parse_obj),
        (TRIANGLE_PLY.into(), ply::parse),
        (square_little(), ply::parse),
    ]
}

/// What a caller may do with whatever was accepted.
fn use_it(result: Result<Scene, Fault>) -> bool {
    let Ok(mut scene) = result else { return false };
    scene.fit(0.1);
    assert!(scene.positions.iter().all(|p| p.is_finite()));
    let shaded = shade(&scene, Shading::Lambert, true);
    assert!(shaded.triangles.iter().flat_map(|t| t.radiance).all(|r| r.is_finite()));
    true
}

#[test]
fn the_samples_are_sound() {
    for (bytes, parse) in samples() {
        assert!(use_it(parse(&bytes)));
    }
}

#[test]
fn every_truncation_is_survived() {
    for (bytes, parse) in samples() {
        for length in 0..bytes.len() {
            use_it(parse(&bytes[..length]));
        }
    }
    let (glb, parse) = samples().swap_remove(0);
    assert!((0..glb.len()).all(|length| !use_it(parse(&glb[..length]))), "no part of a GLB is a GLB");
}

#[test]
fn every_byte_may_be_wrong() {
    for (bytes, parse) in samples() {
        let mut changed = bytes.clone();
        for at in 0..bytes.len() {
            for value in [0, 0xff, b'-', b'9', bytes[at] ^ 1, bytes[at] ^ 0x80] {
                changed[at] = value;
                use_it(parse(&changed));
            }
            changed[at] = bytes[at];
        }
    }
}

#[test]
fn long_files_take_time_in_proportion() {
    let start = std::time::Instant::now();
    let continued = [OBJ.as_bytes(), &b"\\\n".repeat(1 << 20)].concat();
    assert!(use_it(obj::parse(&continued, &beside())));
    let names: String = (0..100_000).map(|i| format!("usemtl {i}\n")).collect();
    let scene = obj::parse(format!("{OBJ}{names}").as_bytes(), &beside()).unwrap();
    assert_eq!(scene.notes.len(), 100);
    assert!(start.elapsed().as_secs() < 20, "{:?}", start.elapsed());
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(2000) })]

    #[test]
    fn several_changes_are_survived(
        sample in 0_usize..6,
        changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>(), 0..4), 1..8),
    ) {
        let (mut bytes, parse) = samples().swap_remove(sample);
        for (at, value, kind) in changes {
            let at = at.index(bytes.len());
            match kind {
                0 => bytes[at] = value,
                1 => bytes.insert(at, value),
                2 => bytes.insert(at, b'0' + value % 10),
                _ => drop(bytes.remove(at)),
            }
        }
        use_it(parse(&bytes));
    }

    #[test]
    fn materials_and_noise_are_survived(noise in prop::collection::vec(any::<u8>(), 0..200), text in "(newmtl a|Kd|map_Kd|-s|-mm|[ \n0-9.-]|p.png){0,20}") {
        for parse in samples().into_iter().map(|(_, parse)| parse) {
            use_it(parse(&noise));
        }
        let _ = mtl::Library::default().add("m", format!("newmtl x\n{text}").as_bytes(), &beside());
    }
}
