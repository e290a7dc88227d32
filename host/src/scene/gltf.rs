//! glTF 2.0, `.gltf` and `.glb`: triangles with node transforms, base colours, textures and vertex colours, skinned
//! meshes in the pose of their nodes at rest.

use glam::{Mat3, Mat4, Vec2, Vec3};
use gltf::mesh::Mode;
use gltf::{Document, Gltf, Primitive, Semantic};

use super::assembly::{Assembly, Part, check_numbers};
use super::files::Resources;
use super::gltf_accessor::Buffers;
use super::gltf_material::{Materials, read_uri};
use super::{Fault, Scene, gltf_nodes};

/// Extensions that a file may require: those that change nothing here, or that our reading of accessors covers.
const EXTENSIONS_ALLOWED: [&str; 2] = ["KHR_materials_unlit", "KHR_mesh_quantization"];

pub(super) fn parse(bytes: &[u8], resources: &dyn Resources) -> Result<Scene, Fault> {
    let (document, blob) = read_document(bytes)?;
    let loader = Loader {
        buffers: read_buffers(&document, blob, resources)?,
        world_from_nodes: gltf_nodes::world_from_nodes(&document)?,
        document: &document,
    };
    let mut assembly = Assembly::default();
    let mut materials = Materials::new(&document, &loader.buffers, resources);
    if document.extensions_used().any(|e| e == "KHR_texture_transform") {
        assembly.note("KHR_texture_transform is not applied");
    }
    for index in gltf_nodes::shown_nodes(&document) {
        loader.node(index, &mut materials, &mut assembly)?;
    }
    assembly.finish()
}

fn read_document(bytes: &[u8]) -> Result<(Document, Option<Vec<u8>>), Fault> {
    // The crate subtracts the header's 12 bytes from this length unchecked.
    let stated = bytes.get(8..12).map_or(0, |b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]) as usize);
    if bytes.starts_with(b"glTF") && (stated < 12 || stated > bytes.len()) {
        let problem = format!("length {stated} bytes, but the file holds {} (truncated?)", bytes.len());
        return Err(Fault::malformed("GLB header", problem));
    }
    let gltf = Gltf::from_slice_without_validation(bytes).map_err(|e| Fault::malformed("glTF", e))?;
    let mut json = gltf.document.into_json();
    if let Some(extension) = json.extensions_required.iter().find(|e| !EXTENSIONS_ALLOWED.contains(&e.as_str())) {
        let feature = format!("required extension {extension}");
        return Err(Fault::Unsupported { place: "glTF".into(), feature, allowed: EXTENSIONS_ALLOWED.join(", ") });
    }
    // Checked above; the crate's validation knows fewer.
    json.extensions_required.clear();
    check_positions(&mut json)?;
    let document = Document::from_json(json).map_err(|e| Fault::malformed("glTF", e))?;
    Ok((document, gltf.blob))
}

/// The crate's validation (1.4.1) takes the accessors of positions without checking their index, and refuses files that
/// lack their bounds, which we do not use.
fn check_positions(json: &mut gltf::json::Root) -> Result<(), Fault> {
    let count = json.accessors.len();
    for (m, mesh) in json.meshes.iter().enumerate() {
        for (p, primitive) in mesh.primitives.iter().enumerate() {
            if let Some(index) = primitive.attributes.values().map(|i| i.value()).find(|&i| i >= count) {
                let (place, allowed) = (format!("mesh {m} primitive {p} accessor"), format!("below {count}"));
                return Err(Fault::IndexOutOfRange { place, index: index as i64, allowed });
            }
        }
    }
    for accessor in &mut json.accessors {
        accessor.min = Some(vec![0.0; 3].into());
        accessor.max = Some(vec![0.0; 3].into());
    }
    Ok(())
}

fn read_buffers(document: &Document, mut blob: Option<Vec<u8>>, resources: &dyn Resources) -> Result<Buffers, Fault> {
    let read = |buffer: gltf::Buffer<'_>| {
        let place = format!("buffer {}", buffer.index());
        let bytes = match buffer.source() {
            gltf::buffer::Source::Bin => {
                blob.take().ok_or_else(|| Fault::malformed(&place, "has no URI and the file no binary chunk"))?
            }
            gltf::buffer::Source::Uri(uri) => read_uri(&place, uri, resources)?,
        };
        if bytes.len() < buffer.length() {
            let problem = format!("{} bytes promised, but {} are there (truncated?)", buffer.length(), bytes.len());
            return Err(Fault::malformed(place, problem));
        }
        Ok(bytes)
    };
    document.buffers().map(read).collect::<Result<_, _>>().map(Buffers)
}

struct Loader<'a> {
    document: &'a Document,
    buffers: Buffers,
    world_from_nodes: Vec<Mat4>,
}

impl Loader<'_> {
    fn node(&self, index: usize, materials: &mut Materials<'_>, assembly: &mut Assembly) -> Result<(), Fault> {
        let node = self.document.nodes().nth(index).expect("an index of a node");
        let Some(mesh) = node.mesh() else { return Ok(()) };
        let joints = node.skin().map(|skin| self.world_from_joints(&skin)).transpose()?;
        for primitive in mesh.primitives() {
            let place = format!("mesh {} primitive {}", mesh.index(), primitive.index());
            if matches!(primitive.mode(), Mode::Points | Mode::Lines | Mode::LineLoop | Mode::LineStrip) {
                assembly.note("points and lines are not drawn");
                continue;
            }
            if primitive.morph_targets().len() > 0 {
                assembly.note("morph targets are not applied");
            }
            let mut part = self.primitive(&place, &primitive, assembly)?;
            let world_from_vertices = match &joints {
                Some(joints) => self.skin(&place, &primitive, joints, part.positions.len())?,
                None => vec![self.world_from_nodes[index]],
            };
            transform(&mut part, &world_from_vertices);
            part.materials = vec![materials.index(&primitive.material(), assembly)?];
            assembly.add(&place, part)?;
        }
        Ok(())
    }

    /// A primitive in its own space.
    fn primitive(&self, place: &str, primitive: &Primitive<'_>, assembly: &Assembly) -> Result<Part, Fault> {
        let positions = primitive
            .get(&Semantic::Positions)
            .ok_or_else(|| Fault::malformed(place, "no attribute POSITION, one is needed"))?;
        let index_count = primitive.indices().map_or(positions.count(), |indices| indices.count());
        assembly.room_for(place, positions.count(), index_count / 3)?;
        let mut part = Part { positions: vectors(self.buffers.floats(place, &positions)?), ..Part::default() };
        let count = part.positions.len();
        if let Some(normals) = primitive.get(&Semantic::Normals) {
            part.normals = vectors(self.buffers.floats(place, &normals)?);
        }
        if let Some(colours) = primitive.get(&Semantic::Colors(0)) {
            part.colours = match colours.dimensions().multiplicity() {
                4 => self.buffers.floats::<4>(place, &colours)?.iter().map(|c| Vec3::new(c[0], c[1], c[2])).collect(),
                _ => vectors(self.buffers.floats(place, &colours)?),
            };
        }
        let info = primitive.material().pbr_metallic_roughness().base_color_texture();
        let set = info.map_or(0, |info| info.tex_coord());
        if let Some(uvs) = primitive.get(&Semantic::TexCoords(set)) {
            part.uvs = self.buffers.floats::<2>(place, &uvs)?.into_iter().map(Vec2::from).collect();
        }
        for (name, length) in
            [("NORMAL", part.normals.len()), ("COLOR_0", part.colours.len()), ("TEXCOORD", part.uvs.len())]
        {
            same_count(place, name, length, count)?;
        }
        let indices: Vec<u32> = match primitive.indices() {
            Some(accessor) => self.buffers.integers::<1>(place, &accessor)?.into_iter().map(|[i]| i).collect(),
            None => (0..count as u32).collect(),
        };
        part.triangles = triangles(place, primitive.mode(), &indices, count)?;
        // As in the file: a transform would spread what is not finite over all three coordinates.
        check_numbers(place, &part)?;
        Ok(part)
    }

    /// What takes a vertex bound to a joint to the world, per joint. The node that holds the mesh has no say in it.
    fn world_from_joints(&self, skin: &gltf::Skin<'_>) -> Result<Vec<Mat4>, Fault> {
        let place = format!("skin {}", skin.index());
        let joints: Vec<Mat4> = skin.joints().map(|joint| self.world_from_nodes[joint.index()]).collect();
        let Some(accessor) = skin.inverse_bind_matrices() else { return Ok(joints) };
        let inverse_binds = self.buffers.floats::<16>(&place, &accessor)?;
        if inverse_binds.len() < joints.len() {
            let problem = format!("{} inverse bind matrices for {} joints", inverse_binds.len(), joints.len());
            return Err(Fault::malformed(place, problem));
        }
        Ok(joints.iter().zip(&inverse_binds).map(|(joint, bind)| *joint * Mat4::from_cols_array(bind)).collect())
    }

    /// Blended matrices, one per vertex.
    fn skin(&self, place: &str, primitive: &Primitive<'_>, joints: &[Mat4], count: usize) -> Result<Vec<Mat4>, Fault> {
        let mut blended = vec![Mat4::ZERO; count];
        let mut total = vec![0.0; count];
        for set in 0.. {
            let (Some(indices), Some(weights)) =
                (primitive.get(&Semantic::Joints(set)), primitive.get(&Semantic::Weights(set)))
            else {
                break;
            };
            let indices = self.buffers.integers::<4>(place, &indices)?;
            let weights = self.buffers.floats::<4>(place, &weights)?;
            same_count(place, "JOINTS", indices.len(), count)?;
            same_count(place, "WEIGHTS", weights.len(), count)?;
            for (vertex, (indices, weights)) in indices.iter().zip(&weights).enumerate() {
                for (&index, &weight) in indices.iter().zip(weights).filter(|(_, weight)| **weight != 0.0) {
                    let joint = joints.get(index as usize).ok_or_else(|| Fault::IndexOutOfRange {
                        place: format!("{place} vertex {vertex}"),
                        index: index.into(),
                        allowed: format!("joints 0 to {}", joints.len() as i64 - 1),
                    })?;
                    blended[vertex] += *joint * weight;
                    total[vertex] += weight;
                }
            }
        }
        match total.iter().position(|&total| total <= 0.0) {
            Some(vertex) => Err(Fault::malformed(format!("{place} vertex {vertex}"), "has no joint, one is needed")),
            None => Ok(blended.iter().zip(&total).map(|(&matrix, &total)| matrix * total.recip()).collect()),
        }
    }
}

fn vectors(elements: Vec<[f32; 3]>) -> Vec<Vec3> {
    elements.into_iter().map(Vec3::from).collect()
}

/// An attribute is absent or has an element for each vertex.
fn same_count(place: &str, name: &str, length: usize, count: usize) -> Result<(), Fault> {
    if length == 0 || length == count {
        return Ok(());
    }
    Err(Fault::malformed(place, format!("{length} elements of {name} for {count} vertices")))
}

/// Triangles of a list, strip or fan of indices.
fn triangles(place: &str, mode: Mode, indices: &[u32], vertex_count: usize) -> Result<Vec<[u32; 3]>, Fault> {
    if let Some(i) = indices.iter().position(|&index| index as usize >= vertex_count) {
        let allowed = format!("0 to {}", vertex_count as i64 - 1);
        let place = format!("{place} index {i}");
        return Err(Fault::IndexOutOfRange { place, index: indices[i].into(), allowed });
    }
    Ok(match mode {
        Mode::TriangleStrip => {
            let turned = |(i, w): (usize, &[u32])| if i % 2 == 0 { [w[0], w[1], w[2]] } else { [w[0], w[2], w[1]] };
            indices.windows(3).enumerate().map(turned).collect()
        }
        Mode::TriangleFan => indices.windows(2).skip(1).map(|w| [indices[0], w[0], w[1]]).collect(),
        _ => {
            let (triangles, rest) = indices.as_chunks();
            if !rest.is_empty() {
                let problem = format!("{} corners of triangles, allowed are multiples of 3", indices.len());
                return Err(Fault::malformed(place, problem));
            }
            triangles.to_vec()
        }
    })
}

/// Takes a part to the world with one matrix for all of its vertices or one for each. Where a matrix mirrors, the
/// triangles' corners change their order, so that outside stays outside.
fn transform(part: &mut Part, world_from_vertices: &[Mat4]) {
    let matrix = |i: usize| &world_from_vertices[if world_from_vertices.len() == 1 { 0 } else { i }];
    let mirrors = |i: usize| matrix(i).determinant() < 0.0;
    for (i, position) in part.positions.iter_mut().enumerate() {
        *position = matrix(i).transform_point3(*position);
    }
    for (i, normal) in part.normals.iter_mut().enumerate() {
        let side = if mirrors(i) { -1.0 } else { 1.0 };
        *normal = (side * cofactors(&Mat3::from_mat4(*matrix(i))) * *normal).normalize_or_zero();
    }
    for corners in &mut part.triangles {
        if mirrors(corners[0] as usize) {
            corners.swap(1, 2);
        }
    }
}

/// Takes normals along: the inverse transpose times the determinant, which exists for flattening matrices, too.
fn cofactors(m: &Mat3) -> Mat3 {
    Mat3::from_cols(m.y_axis.cross(m.z_axis), m.z_axis.cross(m.x_axis), m.x_axis.cross(m.y_axis))
}
