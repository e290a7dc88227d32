//! Small glTF files made in memory, and files beside them.

use glam::{Mat4, Quat, vec3};
use serde_json::{Value, json};

use super::Fault;
use super::files::Resources;

/// Component types by their numbers in the format.
pub const U8: u32 = 5121;
pub const I16: u32 = 5122;
pub const U16: u32 = 5123;
pub const U32: u32 = 5125;
pub const F32: u32 = 5126;

/// Files by name, in place of a folder.
#[derive(Default)]
pub struct Memory(pub Vec<(&'static str, Vec<u8>)>);

impl Resources for Memory {
    fn read(&self, place: &str, name: &str) -> Result<Vec<u8>, Fault> {
        let found = self.0.iter().find(|(file, _)| *file == name).map(|(_, bytes)| bytes.clone());
        found.ok_or_else(|| Fault::Unreadable { place: format!("{place} \"{name}\": "), reason: "not there".into() })
    }
}

/// A document that grows; `json` can be changed freely before it is written.
pub struct Fixture {
    pub json: Value,
    pub bin: Vec<u8>,
}

impl Fixture {
    pub fn new() -> Self {
        let json = json!({"asset": {"version": "2.0"}, "accessors": [], "bufferViews": [], "meshes": [], "nodes": []});
        Self { json, bin: Vec::new() }
    }

    /// Appends to a list of the document; its index.
    pub fn push(&mut self, list: &str, value: Value) -> usize {
        if self.json[list].is_null() {
            self.json[list] = json!([]);
        }
        let list = self.json[list].as_array_mut().unwrap();
        list.push(value);
        list.len() - 1
    }

    pub fn view(&mut self, bytes: &[u8]) -> usize {
        let offset = self.bin.len();
        self.bin.extend_from_slice(bytes);
        self.bin.resize(self.bin.len().next_multiple_of(4), 0);
        self.push("bufferViews", json!({"buffer": 0, "byteOffset": offset, "byteLength": bytes.len()}))
    }

    pub fn accessor(&mut self, bytes: &[u8], component: u32, kind: &str, count: usize) -> usize {
        let view = self.view(bytes);
        let normalized = component != F32 && kind != "SCALAR";
        let accessor = json!({"bufferView": view, "componentType": component, "type": kind, "count": count,
            "normalized": normalized, "min": [0.0, 0.0, 0.0], "max": [1.0, 1.0, 1.0]});
        self.push("accessors", accessor)
    }

    pub fn floats(&mut self, values: &[f32], kind: &str) -> usize {
        let width = match kind {
            "SCALAR" => 1,
            "VEC2" => 2,
            "VEC3" => 3,
            "VEC4" => 4,
            _ => 16,
        };
        self.accessor(&values.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<_>>(), F32, kind, values.len() / width)
    }

    pub fn indices(&mut self, values: &[u32]) -> usize {
        let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        self.accessor(&bytes, U32, "SCALAR", values.len())
    }

    /// A node with a mesh of one primitive.
    pub fn mesh_node(&mut self, primitive: Value, mut node: Value) -> usize {
        node["mesh"] = json!(self.push("meshes", json!({"primitives": [primitive]})));
        self.push("nodes", node)
    }

    pub fn glb(&self) -> Vec<u8> {
        let mut json = self.json.clone();
        if !self.bin.is_empty() {
            json["buffers"] = json!([{"byteLength": self.bin.len()}]);
        }
        let mut text = json.to_string().into_bytes();
        text.resize(text.len().next_multiple_of(4), b' ');
        let length = 12 + 8 + text.len() + 8 + self.bin.len();
        let mut glb = b"glTF".to_vec();
        glb.extend([2, length as u32, text.len() as u32].iter().flat_map(|v: &u32| v.to_le_bytes()));
        glb.extend_from_slice(b"JSON");
        glb.extend(text);
        glb.extend((self.bin.len() as u32).to_le_bytes());
        glb.extend_from_slice(b"BIN\0");
        glb.extend_from_slice(&self.bin);
        glb
    }
}

/// A right-angled triangle in the xy plane that faces +z.
pub const TRIANGLE: [f32; 9] = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0];

/// A document with the triangle alone, under a node.
pub fn triangle(node: Value) -> Fixture {
    let mut fixture = Fixture::new();
    let positions = fixture.floats(&TRIANGLE, "VEC3");
    fixture.mesh_node(json!({"attributes": {"POSITION": positions}}), node);
    fixture
}

/// A PNG of 2 x 1 texels: black, then sRGB 188 in all channels.
pub fn picture() -> Vec<u8> {
    let mut bytes = std::io::Cursor::new(Vec::new());
    let image = image::RgbImage::from_fn(2, 1, |x, _| image::Rgb([188 * x as u8; 3]));
    image.write_to(&mut bytes, image::ImageFormat::Png).unwrap();
    bytes.into_inner()
}

/// A document with everything that we read: texture, colours, normals, strip, instances, skin.
pub fn everything() -> Fixture {
    let mut f = Fixture::new();
    let positions = f.floats(&[TRIANGLE.as_slice(), &[1.0, 1.0, 0.0]].concat(), "VEC3");
    let normals = f.floats(&[0.0, 0.0, 1.0].repeat(4), "VEC3");
    let uvs = f.floats(&[0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 1.0, 1.0], "VEC2");
    let colours = f.accessor(&[255, 128, 0, 255].repeat(4), U8, "VEC4", 4);
    let indices = f.indices(&[0, 1, 2, 3]);
    let joints = f.accessor(&[0; 16], U8, "VEC4", 4);
    f.json["accessors"][joints]["normalized"] = json!(false);
    let weights = f.floats(&[1.0, 0.0, 0.0, 0.0].repeat(4), "VEC4");
    let binds = f.floats(&glam::Mat4::IDENTITY.to_cols_array(), "MAT4");
    let image = f.view(&picture());
    f.push("images", json!({"bufferView": image, "mimeType": "image/png"}));
    f.push("samplers", json!({"wrapS": 33071, "wrapT": 33648}));
    f.push("textures", json!({"source": 0, "sampler": 0}));
    let base = json!({"baseColorFactor": [0.5, 0.25, 1.0, 1.0], "baseColorTexture": {"index": 0}});
    f.push(
        "materials",
        json!({"name": "paint", "pbrMetallicRoughness": base, "extensions": {"KHR_materials_unlit": {}}}),
    );
    f.json["extensionsUsed"] = json!(["KHR_materials_unlit"]);
    let mut attributes = json!({"POSITION": positions, "NORMAL": normals, "TEXCOORD_0": uvs, "COLOR_0": colours});
    let plain = json!({"attributes": attributes, "indices": indices, "mode": 5, "material": 0});
    attributes["JOINTS_0"] = json!(joints);
    attributes["WEIGHTS_0"] = json!(weights);
    let skinned = json!({"attributes": attributes, "indices": indices, "mode": 5, "material": 0});
    f.mesh_node(plain, json!({"scale": [-1.0, 1.0, 1.0]}));
    f.push("skins", json!({"joints": [0], "inverseBindMatrices": binds}));
    f.mesh_node(skinned, json!({"skin": 0}));
    f.push("nodes", json!({"mesh": 0, "children": [0], "translation": [0.0, 0.0, 1.0]}));
    f.push("scenes", json!({"nodes": [1, 2]}));
    f.json["scene"] = json!(0);
    f
}

/// Lets `animation` move `path` of `node`: `values` at `times`.
pub fn animate(
    f: &mut Fixture,
    [animation, node]: [usize; 2],
    path: &str,
    interpolation: &str,
    times: &[f32],
    values: &[f32],
) {
    let kind = match path {
        "rotation" => "VEC4",
        "weights" => "SCALAR",
        _ => "VEC3",
    };
    let (input, output) = (f.floats(times, "SCALAR"), f.floats(values, kind));
    if f.json["animations"][animation].is_null() {
        f.push("animations", json!({"channels": [], "samplers": []}));
    }
    let animation = &mut f.json["animations"][animation];
    let samplers = animation["samplers"].as_array_mut().unwrap();
    samplers.push(json!({"input": input, "output": output, "interpolation": interpolation}));
    let sampler = samplers.len() - 1;
    let channel = json!({"sampler": sampler, "target": {"node": node, "path": path}});
    animation["channels"].as_array_mut().unwrap().push(channel);
}

/// Two bones, one above the other, in a skin of one triangle, which hangs on the lower, on both, and on the upper bone; in a second the upper
/// bone turns by a quarter to the left.
pub fn bent() -> Fixture {
    let mut f = Fixture::new();
    let positions = f.floats(&[1., 0.5, 0., 0., 1.5, 0., 0., 2., 0.], "VEC3");
    let normals = f.floats(&[0., 1., 0.].repeat(3), "VEC3");
    let joints = f.accessor(&[0, 0, 0, 0, 0, 1, 0, 0, 1, 0, 0, 0], U8, "VEC4", 3);
    f.json["accessors"][joints]["normalized"] = json!(false);
    let weights = f.floats(&[1., 0., 0., 0., 0.5, 0.5, 0., 0., 1., 0., 0., 0.], "VEC4");
    let down = Mat4::from_translation(vec3(0.0, -1.0, 0.0)).to_cols_array();
    let binds = f.floats(&[Mat4::IDENTITY.to_cols_array(), down].concat(), "MAT4");
    let attributes = json!({"POSITION": positions, "NORMAL": normals, "JOINTS_0": joints, "WEIGHTS_0": weights});
    let node = f.mesh_node(json!({"attributes": attributes}), json!({"skin": 0}));
    let lower = f.push("nodes", json!({"children": [2]}));
    let upper = f.push("nodes", json!({"translation": [0.0, 1.0, 0.0]}));
    f.push("skins", json!({"joints": [lower, upper], "inverseBindMatrices": binds}));
    f.push("scenes", json!({"nodes": [node, lower]}));
    let quarter = Quat::from_rotation_z(std::f32::consts::FRAC_PI_2);
    let values = [Quat::IDENTITY.to_array(), quarter.to_array()].concat();
    animate(&mut f, [0, upper], "rotation", "LINEAR", &[0.0, 1.0], &values);
    f
}
