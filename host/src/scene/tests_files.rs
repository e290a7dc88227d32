//! OBJ and PLY against worked examples, wrong files, and what all scenes share.

use glam::{Vec2, Vec3, vec2, vec3};

use super::tests_gltf_fixture::{Memory, picture};
use super::{Fault, Material, Scene, Shading, Texture, Wrap, lambert, light, luminance, obj, ply, shade};

/// A cube of side 2 about (5, 0, 0) in quads, and a vertex far off that no face uses.
pub const CUBE_OBJ: &str = "# a cube
v 4 -1 -1\nv 6 -1 -1\nv 6 1 -1\nv 4 1 -1\nv 4 -1 1\nv 6 -1 1\nv 6 1 1\nv 4 1 1\nv 99 99 99
f 1 4 3 2\nf 5 6 7 8\nf 1 2 6 5\nf 3 4 8 7\nf 1 5 8 4\nf 2 3 7 6\n";

pub const TRIANGLE_PLY: &str = "ply\nformat ascii 1.0\ncomment by hand
element vertex 3\nproperty float x\nproperty float y\nproperty float z\nproperty uchar red\nproperty uchar green
property uchar blue\nelement face 1\nproperty list uchar int vertex_indices\nend_header
0 0 0 255 0 188\n1 0 0 0 0 0\n0 1 0 255 255 255\n3 0 1 2\n";

fn obj(text: &str) -> Result<Scene, Fault> {
    obj::parse(text.as_bytes(), &Memory::default())
}

fn obj_message(text: &str) -> String {
    let message = obj(text).expect_err("a fault").to_string();
    assert!(!message.contains('\n'), "one line: {message}");
    message
}

fn ply_message(text: &str) -> String {
    let message = ply::parse(text.as_bytes()).expect_err("a fault").to_string();
    assert!(!message.contains('\n'), "one line: {message}");
    message
}

#[test]
fn a_cube_has_its_faces_area_and_light() {
    let scene = obj(CUBE_OBJ).unwrap();
    assert_eq!(scene.triangles.len(), 12);
    let shaded = shade(&scene, Shading::Lambert, false);
    // 0.1 + 0.85 max(0, n.l), l = (0.4, 0.8, 0.45) / sqrt(1.0025), worked by hand.
    let expected = [(Vec3::X, 0.439576), (Vec3::Y, 0.779152), (Vec3::Z, 0.482023)];
    let mut area = 0.0;
    for triangle in &shaded.triangles {
        let [a, b, c] = triangle.positions;
        let cross = (b - a).cross(c - a);
        area += cross.length() / 2.0;
        let outward = (a + b + c) / 3.0 - vec3(5.0, 0.0, 0.0);
        assert!(cross.dot(outward) > 0.0, "corners go counter-clockwise seen from outside");
        let factor = expected.iter().find(|(n, _)| cross.normalize().dot(*n) > 0.99).map_or(0.1, |(_, factor)| *factor);
        assert!(triangle.radiance.iter().all(|r| r.distance(Vec3::splat(factor)) < 1e-5), "{:?}", triangle.radiance);
        assert!((luminance(triangle.radiance[0]) - factor).abs() < 1e-5);
    }
    assert!((area - 24.0).abs() < 1e-4);
    assert!(shade(&scene, Shading::Unlit, false).triangles.iter().all(|t| t.radiance == [Vec3::ONE; 3]));
}

#[test]
fn the_light_is_the_measures() {
    assert!((lambert(light()) - 0.95).abs() < 1e-6 && lambert(-light()) == 0.1);
    assert!((luminance(Vec3::X) - 0.2126).abs() < 1e-7 && (luminance(Vec3::Y) - 0.7152).abs() < 1e-7);
}

#[test]
fn fit_uses_only_what_is_drawn() {
    let mut scene = obj(CUBE_OBJ).unwrap();
    assert_eq!(scene.bounds(), (vec3(4.0, -1.0, -1.0), vec3(6.0, 1.0, 1.0)));
    scene.fit(0.1);
    let (low, high) = scene.bounds();
    assert!(low.distance(Vec3::splat(-0.05)) < 1e-7 && high.distance(Vec3::splat(0.05)) < 1e-7);
    assert!((scene.radius() - 0.05 * 3.0_f32.sqrt()).abs() < 1e-7);
    scene.positions.push(Vec3::splat(7.0));
    assert!(scene.radius() < 0.1, "a vertex that no triangle uses does not count");
}

#[test]
fn smooth_shading_uses_the_files_normals() {
    let text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 5 0\nf 1//1 2//1 3\n";
    let scene = obj(text).unwrap();
    let radiance = |smooth| shade(&scene, Shading::Lambert, smooth).triangles[0].radiance.map(|r| r.x);
    assert_eq!(radiance(false), [lambert(Vec3::Z); 3]);
    assert_eq!(radiance(true), [lambert(Vec3::Y), lambert(Vec3::Y), lambert(Vec3::Z)]);
}

#[test]
fn unlit_materials_and_colours_multiply() {
    let mut scene = obj("v 0 0 0 1 0.5 0\nv 1 0 0 0 0 0\nv 0 1 0\nf 1 2 3\n").unwrap();
    scene.materials[0] = Material { base_colour: vec3(0.5, 0.5, 0.5), unlit: true, ..Material::default() };
    let radiance = shade(&scene, Shading::Lambert, false).triangles[0].radiance;
    assert_eq!(radiance, [vec3(0.5, 0.25, 0.0), Vec3::ZERO, Vec3::splat(0.5)]);
}

#[test]
fn obj_corners_count_backward_and_pair_their_own_coordinates() {
    let scene = obj("v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0.25 0.25\nvt 1 1\nf -4 -3/2 \\\n-2/-2 -1\n").unwrap();
    assert_eq!(scene.triangles, [[0, 1, 2], [0, 2, 3]]);
    assert_eq!(scene.uvs, [Vec2::ZERO, vec2(1.0, 0.0), vec2(0.25, 0.75), Vec2::ZERO], "v turned to grow downward");
}

#[test]
fn obj_materials() {
    let text = "mtllib a b.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nusemtl red\nf 1/1 2/1 3/1\nusemtl none\nf 1 2 3\n";
    let mtl = "Kd 9\nnewmtl red\nKd 0.5\nnewmtl red\nKd 1 0.5 0.25\nmap_Kd -s 1 1 -clamp on my picture.png\n";
    let files = Memory(vec![("a b.mtl", mtl.into()), ("my picture.png", picture())]);
    let scene = obj::parse(text.as_bytes(), &files).unwrap();
    let [red, white] = [0, 1].map(|i| scene.material_of(i));
    assert_eq!((red.name.as_str(), red.base_colour), ("red", vec3(1.0, 0.5, 0.25)));
    assert_eq!(red.texture.as_ref().unwrap().wrap(), [Wrap::Clamp; 2]);
    assert_eq!((white.base_colour, white.texture.is_none()), (Vec3::ONE, true));
    assert_eq!(scene.notes, ["material \"none\" is not defined, white is used"]);
    let shaded = shade(&scene, Shading::Unlit, false);
    assert_eq!((shaded.textures.len(), shaded.triangles[0].texture, shaded.triangles[1].texture), (1, Some(0), None));

    let scene = obj(text).unwrap();
    assert!(scene.notes.iter().any(|note| note == "material file \"b.mtl\" cannot be read, white is used"));
    let missing = obj::parse(text.as_bytes(), &Memory(vec![("a b.mtl", mtl.into())])).unwrap_err().to_string();
    assert_eq!(missing, "a b.mtl line 6: map_Kd \"my picture.png\": cannot be read: not there");
    let wrong = Memory(vec![("a b.mtl", "newmtl red\nKd x".into())]);
    let fault = obj::parse(text.as_bytes(), &wrong).unwrap_err().to_string();
    assert!(fault.starts_with("a b.mtl line 2: \"x\""), "{fault}");
}

#[test]
fn obj_faults_name_their_line() {
    let vertices = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";
    let with = |face: &str| obj_message(&format!("{vertices}{face}\n"));
    assert_eq!(with("f 1 2 4"), "line 4: index 4 is out of range, allowed are 1 to 3 and -3 to -1");
    assert_eq!(with("f 1 2 -4"), "line 4: index -4 is out of range, allowed are 1 to 3 and -3 to -1");
    assert!(with("f 0 1 2").contains("index 0 is out of range"));
    assert!(with("f 1/1 2/1 3/1").contains("allowed are none"));
    assert!(with("f 1 2").contains("line 4: a face of 2 corners, allowed are at least 3"));
    assert!(with("f 1 2 x").contains("line 4: index \"x\""));
    assert!(with("f 1 2 9223372036854775807").contains("out of range"));
    assert!(with("f 1 2 -9223372036854775808").contains("out of range"));
    assert!(with("v 1 nan 3").contains("line 4: number nan is out of range"));
    assert!(with("v 1 inf 3").contains("out of range") && with("v 1 1e30 3").contains("out of range"));
    assert!(with("v 1 2").contains("line 4: 2 numbers, allowed are at least 3"));
    assert!(with("").starts_with("no triangles;"));
    assert!(with("f 1 1 2").starts_with("no triangles but 1 degenerate"));
}

#[test]
fn degenerate_triangles_are_dropped_and_told() {
    let scene = obj("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 2 0 0\nf 1 2 3\nf 1 2 4\nf 2 2 3\n").unwrap();
    assert_eq!((scene.triangles.len(), scene.triangle_materials.len()), (1, 1));
    assert_eq!(scene.notes, ["2 degenerate triangles dropped"]);
}

#[test]
fn ply_ascii_with_srgb_colours() {
    let scene = ply::parse(TRIANGLE_PLY.as_bytes()).unwrap();
    assert_eq!(scene.positions, [Vec3::ZERO, Vec3::X, Vec3::Y]);
    assert!(scene.colours[0].distance(vec3(1.0, 0.0, 0.502886)) < 1e-5, "{}", scene.colours[0]);
    assert_eq!((scene.triangles, scene.normals.len()), (vec![[0, 1, 2]], 0));
    let other = TRIANGLE_PLY.replace("1 0 0 0 0 0", "1. .5 -1E-1 0 0 0 ").replace('\n', "\r\n");
    assert_eq!(ply::parse(other.as_bytes()).unwrap().positions[1], vec3(1.0, 0.5, -0.1));
}

/// A square as PLY with doubles, normals, float colours and an element that nobody knows.
fn square_ply(
    format: &str,
    list: &str,
    numbers: impl Fn(f64) -> Vec<u8>,
    floats: impl Fn(f32) -> Vec<u8>,
    face: &[u8],
) -> Vec<u8> {
    let mut bytes =
        format!("ply\nformat {format} 1.0\nelement odd 2\nproperty uchar a\nelement vertex 4\n").into_bytes();
    for name in ["x", "y", "z"] {
        bytes.extend(format!("property double {name}\n").into_bytes());
    }
    for name in ["nx", "ny", "nz", "red", "green", "blue"] {
        bytes.extend(format!("property float {name}\n").into_bytes());
    }
    bytes.extend(format!("element face 1\nproperty list uchar {list} vertex_index\nend_header\n").into_bytes());
    bytes.extend([1, 2]);
    for (x, y) in [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)] {
        [x, y, 0.0].into_iter().for_each(|v| bytes.extend(numbers(v)));
        [0.0, 0.0, 2.0, 0.5, 0.25, x as f32].into_iter().for_each(|v| bytes.extend(floats(v)));
    }
    bytes.extend_from_slice(face);
    bytes
}

pub fn square_little() -> Vec<u8> {
    let face = [4, 0, 0, 1, 0, 2, 0, 3, 0];
    square_ply("binary_little_endian", "ushort", |v| v.to_le_bytes().into(), |v| v.to_le_bytes().into(), &face)
}

#[test]
fn ply_binary_in_both_orders() {
    let face = [4, 0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 2, 0, 0, 0, 3];
    let big = square_ply("binary_big_endian", "int", |v| v.to_be_bytes().into(), |v| v.to_be_bytes().into(), &face);
    for bytes in [square_little(), big] {
        let scene = ply::parse(&bytes).unwrap();
        assert_eq!(scene.triangles, [[0, 1, 2], [0, 2, 3]]);
        assert_eq!(scene.positions[2], vec3(1.0, 1.0, 0.0));
        assert_eq!((scene.normals[0], scene.colours[1]), (Vec3::Z, vec3(0.5, 0.25, 1.0)));
    }
}

#[test]
fn ply_numbers_that_are_not_finite() {
    let mut bytes = square_little();
    let first = bytes.windows(11).position(|w| w == b"end_header\n").unwrap() + 11 + 2;
    // Vertex 2, y.
    let at = first + 2 * (3 * 8 + 6 * 4) + 8;
    bytes[at..at + 8].copy_from_slice(&f64::NAN.to_le_bytes());
    let fault = ply::parse(&bytes).unwrap_err().to_string();
    assert!(fault.starts_with("vertex 2: position [1, NaN, 0] is out of range"), "{fault}");
}

#[test]
fn ply_faults_name_their_place() {
    let changed = |from: &str, to: &str| {
        assert!(TRIANGLE_PLY.contains(from));
        ply_message(&TRIANGLE_PLY.replace(from, to))
    };
    assert_eq!(changed("3 0 1 2", "3 0 1 3"), "face 0: index 3 is out of range, allowed are 0 to 2");
    assert_eq!(changed("3 0 1 2", "3 0 1 -1"), "face 0: index -1 is out of range, allowed are 0 to 2");
    assert_eq!(changed("3 0 1 2", "2 0 1"), "face 0: 2 corners, allowed are at least 3");
    assert!(changed("1 0 0 0 0 0", "1 nan 0 0 0 0").starts_with("vertex 1: position [1, NaN, 0] is out of range"));
    assert!(changed("1 0 0 0 0 0", "1 0 0").starts_with("vertex 1: too few numbers"));
    assert!(changed("1 0 0 0 0 0", "1 0 x 0 0 0").starts_with("vertex 1: \"x\", allowed are numbers"));
    assert!(
        changed("1 0 0 0 0 0", "1 0 0 256 0 0").starts_with("vertex 1: 256, allowed are whole numbers from 0 to 255")
    );
    assert!(changed("3 0 1 2", "3 0 1").starts_with("face 0: too few numbers"));
    assert!(changed("3 0 1 2", "-1 0").starts_with("face 0: -1, allowed are whole numbers from 0"));
    assert!(changed("1 0 0 0 0 0", "1 1e300 0 0 0 0").starts_with("vertex 1: position [1, inf, 0] is out of range"));
    assert!(changed("property float z\n", "property float w\n").contains("x, y and z are needed"));
    assert!(changed("vertex_indices", "corners").contains("a list vertex_indices"));
    assert!(changed("list uchar int", "list uchar float").starts_with("face 0: property vertex_indices has"));
    assert!(changed("3 0 1 2\n", "").starts_with("face 0: the file ends"));
    assert!(changed("element vertex 3", "element vertex 99").starts_with("element vertex: 99 promised"));
    assert!(changed("ply\nformat", "plx\nformat").starts_with("header:"));
    let too_many = changed("vertex 3", "vertex 150000001");
    assert!(too_many.starts_with("header: 150000001 vertices, allowed are at most 150000000"), "{too_many}");
    let too_many = changed("face 1", "face 50000001");
    assert!(too_many.starts_with("header: 50000001 triangles, allowed are at most 50000000"), "{too_many}");
    assert!(changed("element face 1", "element face 0").starts_with("no triangles;"));
    assert!(ply_message("").starts_with("header:"));
}

#[test]
fn ply_memory_is_not_reserved_for_what_is_only_promised() {
    let empty = "ply\nformat binary_little_endian 1.0\nelement nothing 4000000000\nend_header\n";
    assert!(ply_message(empty).contains("element nothing: 4000000000 promised"));
    let list = "ply\nformat binary_little_endian 1.0\nelement vertex 1\nproperty list uint double x\nend_header\n";
    let fault = ply::parse(&[list.as_bytes(), &[255; 12]].concat()).unwrap_err().to_string();
    assert!(fault.starts_with("element vertex:"), "{fault}");
}

fn grey(values: &[u8], wrap: Wrap) -> Texture {
    Texture::new(values.len() as u32, 1, values.iter().map(|&v| [v, v, v, 255]).collect(), [wrap; 2])
}

#[test]
fn textures_are_bilinear_in_linear_light() {
    let texture = grey(&[0, 255], Wrap::Clamp);
    for (u, light) in
        [(0.0, 0.0), (0.25, 0.0), (0.375, 0.25), (0.5, 0.5), (0.75, 1.0), (1.0, 1.0), (9.0, 1.0), (-9.0, 0.0)]
    {
        assert!((texture.sample(vec2(u, 0.5)).x - light).abs() < 1e-6, "{u}");
    }
    assert!((grey(&[128], Wrap::Repeat).sample(Vec2::ZERO).x - 0.215_860_5).abs() < 1e-6, "sRGB 128");
    let rows = Texture::new(1, 2, vec![[255, 0, 0, 0], [0, 0, 255, 0]], [Wrap::Clamp; 2]);
    assert_eq!((rows.sample(vec2(0.5, 0.1)), rows.sample(vec2(0.5, 0.9))), (Vec3::X, Vec3::Z), "v grows downward");
}

#[test]
fn textures_wrap() {
    let at = |wrap, u| grey(&[0, 0, 255, 255], wrap).sample(vec2(u, 0.0)).x;
    for (wrap, lights) in
        [(Wrap::Repeat, [1.0, 0.0, 1.0]), (Wrap::Mirror, [0.0, 1.0, 0.0]), (Wrap::Clamp, [0.0, 1.0, 1.0])]
    {
        assert_eq!([at(wrap, -0.25), at(wrap, 1.25), at(wrap, 1.75)], lights, "{wrap:?}");
    }
    assert!((at(Wrap::Repeat, 1.0) - 0.5).abs() < 1e-6, "between the last texel and the first");
    assert!((at(Wrap::Repeat, -3.0) - 0.5).abs() < 1e-6);
    for u in [f32::MAX, -1e30, f32::MIN_POSITIVE, -f32::MIN_POSITIVE] {
        assert!([Wrap::Repeat, Wrap::Mirror, Wrap::Clamp].iter().all(|&wrap| at(wrap, u).is_finite()), "{u}");
    }
}

#[test]
fn load_names_the_file_and_what_is_allowed() {
    let message = |path: &str| Scene::load(path).unwrap_err().to_string();
    assert_eq!(
        message("a.stl"),
        "a.stl: unknown kind of file \"stl\", allowed are .gltf, .glb, .obj, .ply and the names builtin, boxes, knot-5k, knot-20k, knot-70k"
    );
    assert!(message("nowhere/a.OBJ").starts_with("nowhere/a.OBJ: cannot be read: "));
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("Cube.Obj");
    std::fs::write(&path, CUBE_OBJ).unwrap();
    assert_eq!(Scene::load(&path).unwrap().name, "Cube");
    std::fs::create_dir(folder.path().join("b.ply")).unwrap();
    assert!(Scene::load(folder.path().join("b.ply")).unwrap_err().to_string().contains("not a regular file"));
    for name in super::BUILT_IN {
        assert_eq!(Scene::load(name).unwrap().name, name);
    }
}
