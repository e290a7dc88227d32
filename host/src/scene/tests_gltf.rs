//! glTF against worked examples, and glTF that is wrong.

use glam::{Quat, Vec2, Vec3, vec2, vec3};
use serde_json::json;

use super::tests_gltf_fixture::{F32, Fixture, Memory, TRIANGLE, U8, U16, everything, picture, triangle};
use super::{Fault, Scene, Wrap, gltf};

fn load(fixture: &Fixture) -> Result<Scene, Fault> {
    gltf::parse(&fixture.glb(), &Memory::default())
}

fn message(fixture: &Fixture) -> String {
    let text = load(fixture).expect_err("a fault").to_string();
    assert!(!text.contains('\n'), "one line: {text}");
    text
}

fn corners(scene: &Scene, triangle: usize) -> [Vec3; 3] {
    scene.triangles[triangle].map(|i| scene.positions[i as usize])
}

fn normal(scene: &Scene, triangle: usize) -> Vec3 {
    let [a, b, c] = corners(scene, triangle);
    (b - a).cross(c - a).normalize()
}

fn close(a: Vec3, b: Vec3) -> bool {
    a.distance(b) < 1e-5
}

#[test]
fn nested_transforms_apply_from_the_leaf_to_the_root() {
    let turn = Quat::from_rotation_y(std::f32::consts::FRAC_PI_2);
    let mut f = triangle(json!({"translation": [1.0, 2.0, 3.0]}));
    f.push("nodes", json!({"children": [0], "scale": [2.0, 2.0, 2.0], "rotation": turn.to_array()}));
    let scene = load(&f).unwrap();
    // (1, 2, 3) scaled to (2, 4, 6), then turned: x becomes z, z becomes -x... seen from above counter-clockwise.
    assert!(close(scene.positions[0], vec3(6.0, 4.0, -2.0)), "{}", scene.positions[0]);
    assert!(close(scene.positions[1], vec3(6.0, 4.0, -4.0)), "{}", scene.positions[1]);
    assert!(close(normal(&scene, 0), Vec3::X));
}

#[test]
fn a_matrix_is_read_by_columns() {
    let matrix = [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 5.0, 6.0, 7.0, 1.0];
    let scene = load(&triangle(json!({"matrix": matrix}))).unwrap();
    assert_eq!(scene.positions[0], vec3(5.0, 6.0, 7.0));
}

#[test]
fn mirrored_nodes_keep_their_outside_and_their_normals() {
    let mut f = Fixture::new();
    let positions = f.floats(&TRIANGLE, "VEC3");
    let normals = f.floats(&[0.0, 0.6, 0.8].repeat(3), "VEC3");
    let primitive = json!({"attributes": {"POSITION": positions, "NORMAL": normals}});
    f.mesh_node(primitive, json!({"scale": [-2.0, 1.0, 1.0]}));
    let scene = load(&f).unwrap();
    assert!(close(normal(&scene, 0), Vec3::Z), "the mirror in x leaves +z outside");
    assert!(close(scene.normals[0], vec3(0.0, 0.6, 0.8)));
    assert!(corners(&scene, 0).iter().any(|&c| close(c, vec3(-2.0, 0.0, 0.0))));
    f.json["nodes"][0]["scale"] = json!([1.0, 1.0, -4.0]);
    let scene = load(&f).unwrap();
    assert!(close(normal(&scene, 0), Vec3::NEG_Z), "the mirror in z turns the outside");
    assert!(close(scene.normals[0], vec3(0.0, 0.6, -0.2).normalize()), "{}", scene.normals[0]);
}

#[test]
fn instances_and_scenes_show_what_they_name() {
    let mut f = triangle(json!({}));
    f.push("nodes", json!({"mesh": 0, "translation": [0.0, 0.0, 1.0]}));
    f.push("nodes", json!({"mesh": 0, "translation": [0.0, 0.0, 2.0]}));
    assert_eq!(load(&f).unwrap().triangles.len(), 3, "without scenes: all nodes");
    f.push("scenes", json!({"nodes": [0]}));
    f.push("scenes", json!({"nodes": [0, 2]}));
    assert_eq!(load(&f).unwrap().triangles.len(), 2, "without a default: each node of all scenes once");
    f.json["scene"] = json!(1);
    let scene = load(&f).unwrap();
    assert_eq!(scene.positions.iter().map(|p| p.z).collect::<Vec<_>>(), [0.0, 0.0, 0.0, 2.0, 2.0, 2.0]);
}

#[test]
fn strips_and_fans_become_triangles_of_one_sense() {
    let mut f = Fixture::new();
    let strip = f.floats(&[0., 0., 0., 1., 0., 0., 0., 1., 0., 1., 1., 0., 0., 2., 0.], "VEC3");
    f.mesh_node(json!({"attributes": {"POSITION": strip}, "mode": 5}), json!({}));
    let scene = load(&f).unwrap();
    assert_eq!(scene.triangles, [[0, 1, 2], [1, 3, 2], [2, 3, 4]]);
    assert!((0..3).all(|i| close(normal(&scene, i), Vec3::Z)));

    let mut f = Fixture::new();
    let fan = f.floats(&[0., 0., 0., 1., 0., 0., 1., 1., 0., 0., 1., 0., -1., 1., 0.], "VEC3");
    let indices = f.indices(&[0, 1, 2, 3, 4]);
    f.mesh_node(json!({"attributes": {"POSITION": fan}, "mode": 6, "indices": indices}), json!({}));
    let scene = load(&f).unwrap();
    assert_eq!(scene.triangles, [[0, 1, 2], [0, 2, 3], [0, 3, 4]]);
    assert!((0..3).all(|i| close(normal(&scene, i), Vec3::Z)));
}

#[test]
fn vertex_colours_are_read_in_every_type() {
    let half = u16::MAX / 2;
    let u16s: Vec<u8> = [half, 0, u16::MAX].repeat(3).iter().flat_map(|v| v.to_le_bytes()).collect();
    let f32s: Vec<u8> = [0.5_f32, 0.0, 1.0, 0.3].repeat(3).iter().flat_map(|v| v.to_le_bytes()).collect();
    let padded: Vec<u8> = [128, 0, 255, 0].repeat(3);
    for (bytes, component, kind, tolerance) in
        [(padded, U8, "VEC4", 3e-3), (u16s, U16, "VEC3", 1e-4), (f32s, F32, "VEC4", 1e-7)]
    {
        let mut f = triangle(json!({}));
        let colours = f.accessor(&bytes, component, kind, 3);
        f.json["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"] = json!(colours);
        if component == U16 {
            f.json["bufferViews"][1]["byteStride"] = json!(null);
        }
        let scene = load(&f).unwrap();
        assert_eq!(scene.colours.len(), 3);
        assert!(scene.colours[2].distance(vec3(0.5, 0.0, 1.0)) < tolerance, "{component} {}", scene.colours[2]);
    }
}

#[test]
fn a_part_without_an_attribute_is_filled_up() {
    let mut f = triangle(json!({}));
    let positions = f.floats(&TRIANGLE, "VEC3");
    let colours = f.floats(&[0.5; 9], "VEC3");
    f.mesh_node(json!({"attributes": {"POSITION": positions, "COLOR_0": colours}}), json!({}));
    let scene = load(&f).unwrap();
    assert_eq!(scene.colours, [vec![Vec3::ONE; 3], vec![Vec3::splat(0.5); 3]].concat());
    assert!(scene.normals.is_empty() && scene.uvs.is_empty());
}

#[test]
fn a_skinned_mesh_follows_its_joints_and_not_its_node() {
    let mut f = Fixture::new();
    let positions = f.floats(&TRIANGLE, "VEC3");
    let joints = f.accessor(&[0, 1, 0, 0].repeat(3), U8, "VEC4", 3);
    f.json["accessors"][joints]["normalized"] = json!(false);
    // Weights that sum to 2: they are brought to 1. The first vertex hangs on joint 1 alone.
    let weights = f.floats(&[0., 2., 0., 0., 1., 1., 0., 0., 2., 0., 0., 0.], "VEC4");
    let unmove = glam::Mat4::from_translation(vec3(0.0, -0.5, 0.0)).to_cols_array();
    let binds = f.floats(&[unmove, glam::Mat4::IDENTITY.to_cols_array()].concat(), "MAT4");
    f.push("skins", json!({"joints": [1, 2], "inverseBindMatrices": binds}));
    let primitive = json!({"attributes": {"POSITION": positions, "JOINTS_0": joints, "WEIGHTS_0": weights}});
    f.mesh_node(primitive, json!({"skin": 0, "translation": [100.0, 0.0, 0.0]}));
    f.push("nodes", json!({"translation": [0.0, 2.0, 0.0], "children": [2]}));
    f.push("nodes", json!({"translation": [0.0, 0.0, 3.0]}));
    let scene = load(&f).unwrap();
    assert!(close(scene.positions[0], vec3(0.0, 2.0, 3.0)), "{}", scene.positions[0]);
    assert!(close(scene.positions[1], vec3(1.0, 1.75, 1.5)), "{}", scene.positions[1]);
    assert!(close(scene.positions[2], vec3(0.0, 2.5, 0.0)), "{}", scene.positions[2]);
    f.json["skins"][0]["joints"] = json!([1]);
    assert!(message(&f).contains("mesh 0 primitive 0 vertex 0: index 1 is out of range, allowed are joints 0 to 0"));
}

#[test]
fn materials_bring_colour_texture_wrap_and_unlit() {
    let scene = load(&everything()).unwrap();
    assert_eq!(scene.triangles.len(), 6, "a strip of two, three times");
    assert_eq!(scene.materials.len(), 1, "one material, however often it is used");
    let paint = &scene.materials[0];
    assert_eq!((paint.name.as_str(), paint.base_colour, paint.unlit), ("paint", vec3(0.5, 0.25, 1.0), true));
    let texture = paint.texture.as_ref().unwrap();
    assert_eq!((texture.size(), texture.wrap()), ((2, 1), [Wrap::Clamp, Wrap::Mirror]));
    assert!((texture.texel(1, 0).x - 0.5029).abs() < 1e-3, "sRGB 188 is half of the light");
    assert_eq!(scene.uvs[3], Vec2::ONE);
    assert!((0..6).all(|i| close(normal(&scene, i), Vec3::Z)), "also where node 0 mirrors");
}

#[test]
fn a_texture_names_its_set_of_coordinates_and_comes_from_a_file_or_uri() {
    let mut f = triangle(json!({}));
    let first = f.floats(&[0.0; 6], "VEC2");
    let second = f.floats(&[0.25; 6], "VEC2");
    f.json["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_0"] = json!(first);
    f.json["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_1"] = json!(second);
    f.json["meshes"][0]["primitives"][0]["material"] = json!(0);
    f.push("materials", json!({"pbrMetallicRoughness": {"baseColorTexture": {"index": 0, "texCoord": 1}}}));
    f.push("textures", json!({"source": 0}));
    f.push("images", json!({"uri": "a%20picture.png"}));
    let beside = Memory(vec![("a picture.png", picture())]);
    let scene = gltf::parse(&f.glb(), &beside).unwrap();
    assert_eq!(scene.uvs, [vec2(0.25, 0.25); 3]);
    assert_eq!(scene.materials[0].texture.as_ref().unwrap().wrap(), [Wrap::Repeat; 2]);
    assert_eq!(message(&f), "image 0 \"a picture.png\": cannot be read: not there");
    f.json["images"][0]["uri"] = json!("data:image/png;base64,AAAA");
    assert!(message(&f).starts_with("image 0: unknown kind of picture, allowed are PNG and JPEG"));
    f.json["images"][0]["uri"] = json!(null);
    assert_eq!(message(&f), "image 0: neither URI nor buffer view, one is needed");
    f.json["images"][0]["uri"] = json!("https://example.org/a.png");
    assert!(message(&f).contains("allowed are relative names and data: URIs"));
}

#[test]
fn buffers_come_from_files_and_data_uris() {
    let mut f = triangle(json!({}));
    f.json["buffers"] = json!([{"byteLength": 36, "uri": "t.bin"}]);
    let text = f.json.to_string().into_bytes();
    let scene = gltf::parse(&text, &Memory(vec![("t.bin", f.bin.clone())])).unwrap();
    assert_eq!(scene.positions[1], Vec3::X);
    let fault = gltf::parse(&text, &Memory::default()).unwrap_err().to_string();
    assert_eq!(fault, "buffer 0 \"t.bin\": cannot be read: not there");
    let fault = gltf::parse(&text, &Memory(vec![("t.bin", vec![0; 35])])).unwrap_err().to_string();
    assert!(fault.starts_with("buffer 0: 36 bytes promised, but 35 are there"), "{fault}");
    // 36 bytes: nine little-endian floats, by an encoder that is not ours.
    let uri = "data:application/octet-stream;base64,AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAA";
    f.json["buffers"] = json!([{"byteLength": 36, "uri": uri}]);
    let scene = gltf::parse(f.json.to_string().as_bytes(), &Memory::default()).unwrap();
    assert_eq!(scene.positions, [Vec3::ZERO, Vec3::X, Vec3::Y]);
}

#[test]
fn sparse_accessors_replace_elements() {
    let mut f = triangle(json!({}));
    let index = f.view(&[2]);
    let value = f.view(&[0.0_f32, 7.0, 0.0].iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<_>>());
    let indices = json!({"bufferView": index, "componentType": U8});
    f.json["accessors"][0]["sparse"] = json!({"count": 1, "indices": indices, "values": {"bufferView": value}});
    assert_eq!(load(&f).unwrap().positions, [Vec3::ZERO, Vec3::X, 7.0 * Vec3::Y]);
    f.bin[36] = 3;
    assert!(message(&f).contains("index 3 is out of range, allowed are sparse indices below 3"));
}

#[test]
fn each_fault_names_its_place() {
    let changed = |change: &dyn Fn(&mut Fixture)| {
        let mut f = triangle(json!({}));
        change(&mut f);
        message(&f)
    };
    let number =
        |at: usize, value: f32| move |f: &mut Fixture| f.bin[4 * at..4 * at + 4].copy_from_slice(&value.to_le_bytes());
    let nan = changed(&number(4, f32::NAN));
    assert!(nan.starts_with("mesh 0 primitive 0 vertex 1: position [1, NaN, 0] is out of range"), "{nan}");
    assert!(changed(&number(8, f32::INFINITY)).contains("vertex 2: position"));
    assert!(changed(&|f| f.json["nodes"][0]["scale"] = json!([1e30, 1e30, 1e30])).contains("vertex 1: position"));
    assert!(changed(&|f| f.json["accessors"][0]["count"] = json!(4)).contains("accessor 0: 4 elements of 12 bytes"));
    assert!(
        changed(&|f| f.json["accessors"][0]["count"] = json!(u64::MAX))
            .contains("mesh 0 primitive 0: 6148914691236517205 triangles, allowed are at most 50000000")
    );
    assert!(changed(&|f| f.json["accessors"][0]["type"] = json!("VEC2")).contains("2 components, allowed are 3"));
    assert!(changed(&|f| f.json["bufferViews"][0]["byteStride"] = json!(4)).contains("stride 4 bytes"));
    assert!(changed(&|f| f.json["bufferViews"][0]["byteLength"] = json!(99)).contains("buffer view 0: 99 bytes at 0"));
    assert!(changed(&|f| f.json["nodes"] = json!([])).contains("no triangles"));
    assert!(changed(&|f| f.json["meshes"][0]["primitives"][0]["mode"] = json!(1)).contains("no triangles"));
    let attribute = changed(&|f| f.json["meshes"][0]["primitives"][0]["attributes"]["POSITION"] = json!(1));
    assert_eq!(attribute, "mesh 0 primitive 0 accessor: index 1 is out of range, allowed are below 1");
    assert!(changed(&|f| f.json["nodes"][0]["mesh"] = json!(5)).contains("nodes[0].mesh"));
    let required = changed(&|f| f.json["extensionsRequired"] = json!(["KHR_draco_mesh_compression"]));
    assert!(required.contains("required extension KHR_draco_mesh_compression is not supported, allowed is"));
    let indexed = changed(&|f| {
        let indices = f.indices(&[0, 1, 3]);
        f.json["meshes"][0]["primitives"][0]["indices"] = json!(indices);
    });
    assert_eq!(indexed, "mesh 0 primitive 0 index 2: index 3 is out of range, allowed are 0 to 2");
}

#[test]
fn nodes_form_trees() {
    let mut f = triangle(json!({"children": [1]}));
    f.push("nodes", json!({"children": [0]}));
    assert!(message(&f).contains("its own ancestor"));
    f.json["nodes"][1] = json!({});
    f.push("nodes", json!({"children": [1]}));
    assert!(message(&f).contains("node 1: has more than one parent"));
}

#[test]
fn memory_is_not_reserved_for_what_is_only_promised() {
    let mut f = triangle(json!({}));
    f.json["accessors"][0] = json!({"componentType": F32, "type": "VEC3", "count": 100_000_000,
        "min": [0.0, 0.0, 0.0], "max": [0.0, 0.0, 0.0]});
    let sparse_view = json!({"bufferView": 0, "componentType": U8});
    f.json["accessors"][0]["sparse"] = json!({"count": 1, "indices": sparse_view, "values": {"bufferView": 0}});
    assert!(message(&f).contains("100000000 elements without a buffer view, allowed are at most 1048576"));
    f.json["accessors"][0]["count"] = json!(u32::MAX);
    assert!(message(&f).contains("allowed are at most"));
}
