//! glTF 2.0, `.gltf` and `.glb`: triangles with node transforms, base colours, textures and vertex colours, morph targets and skins, at
//! rest or in a pose of one of the file's clips.

use gltf::{Document, Gltf};

use super::files::Resources;
use super::gltf_accessor::Buffers;
use super::gltf_clip::{self, Clip};
use super::gltf_material::read_uri;
use super::gltf_model::Model;
use super::{Fault, Scene};

/// Extensions that a file may require: those that change nothing here, or that our reading of accessors covers.
const EXTENSIONS_ALLOWED: [&str; 2] = ["KHR_materials_unlit", "KHR_mesh_quantization"];

/// A document in memory.
pub(super) struct File<'a> {
    document: Document,
    buffers: Buffers,
    resources: &'a dyn Resources,
}

impl<'a> File<'a> {
    pub fn read(bytes: &[u8], resources: &'a dyn Resources) -> Result<Self, Fault> {
        let (document, blob) = read_document(bytes)?;
        Ok(Self { buffers: read_buffers(&document, blob, resources)?, document, resources })
    }

    /// What it shows.
    pub fn model(&self) -> Result<Model, Fault> {
        Model::read(&self.document, &self.buffers, self.resources)
    }

    /// How `model`, which it shows, moves.
    pub fn clips(&self, model: &Model) -> Result<Vec<Clip>, Fault> {
        gltf_clip::read(&self.document, &self.buffers, model)
    }
}

/// What a file shows at rest.
pub(super) fn parse(bytes: &[u8], resources: &dyn Resources) -> Result<Scene, Fault> {
    File::read(bytes, resources)?.model()?.at_rest()
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
