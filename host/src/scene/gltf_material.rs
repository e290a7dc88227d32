//! Materials and textures of a glTF document, made when a primitive first asks for them.

use std::collections::HashMap;
use std::sync::Arc;

use glam::Vec3;
use gltf::texture::WrappingMode;

use super::assembly::Assembly;
use super::files::Resources;
use super::gltf_accessor::Buffers;
use super::{Fault, Material, Texture, Wrap};

/// Indices of the scene's materials and textures, by those of the document.
pub(super) struct Materials<'a> {
    document: &'a gltf::Document,
    buffers: &'a Buffers,
    resources: &'a dyn Resources,
    indices: HashMap<Option<usize>, u32>,
    textures: HashMap<usize, Arc<Texture>>,
    texels: u64,
}

/// Texels of all textures together, 1 GiB: a small file can name one large picture many times.
const TEXELS_MAX: u64 = 1 << 28;

impl<'a> Materials<'a> {
    pub fn new(document: &'a gltf::Document, buffers: &'a Buffers, resources: &'a dyn Resources) -> Self {
        Self { document, buffers, resources, indices: HashMap::new(), textures: HashMap::new(), texels: 0 }
    }

    /// The scene's index of a document's material.
    pub fn index(&mut self, material: &gltf::Material<'_>, assembly: &mut Assembly) -> Result<u32, Fault> {
        if let Some(&index) = self.indices.get(&material.index()) {
            return Ok(index);
        }
        if material.alpha_mode() != gltf::material::AlphaMode::Opaque {
            assembly.note(format!("alpha mode {:?} is drawn opaque", material.alpha_mode()));
        }
        let surface = material.pbr_metallic_roughness();
        let [r, g, b, _] = surface.base_color_factor();
        if ![r, g, b].into_iter().all(f32::is_finite) {
            let place = format!("material {}", material.index().unwrap_or_default());
            return Err(Fault::NotFinite { place, what: "base colour", value: format!("({r}, {g}, {b})") });
        }
        let texture = match surface.base_color_texture() {
            Some(info) => Some(self.texture(&info.texture())?),
            None => None,
        };
        let index = assembly.add_material(Material {
            name: material.name().unwrap_or("default").to_owned(),
            base_colour: Vec3::new(r, g, b),
            texture,
            unlit: material.unlit(),
        });
        self.indices.insert(material.index(), index);
        Ok(index)
    }

    fn texture(&mut self, texture: &gltf::Texture<'_>) -> Result<Arc<Texture>, Fault> {
        if let Some(texture) = self.textures.get(&texture.index()) {
            return Ok(texture.clone());
        }
        let image = texture.source().index();
        let place = format!("image {image}");
        let bytes = self.picture(&place, &self.document.as_json().images[image])?;
        let sampler = texture.sampler();
        let wrap = [sampler.wrap_s(), sampler.wrap_t()].map(|mode| match mode {
            WrappingMode::ClampToEdge => Wrap::Clamp,
            WrappingMode::MirroredRepeat => Wrap::Mirror,
            WrappingMode::Repeat => Wrap::Repeat,
        });
        let decoded = Arc::new(Texture::decode(&place, &bytes, wrap)?);
        self.texels += decoded.texels_srgb8().len() as u64;
        if self.texels > TEXELS_MAX {
            let (what, limit) = ("texels in textures so far", TEXELS_MAX);
            return Err(Fault::TooLarge { place, count: self.texels, what, limit });
        }
        self.textures.insert(texture.index(), decoded.clone());
        Ok(decoded)
    }

    /// The crate's own way to an image (1.4.1) panics where neither view nor URI, or no type, is given.
    fn picture(&self, place: &str, image: &gltf::json::Image) -> Result<Vec<u8>, Fault> {
        match (image.buffer_view, &image.uri) {
            (Some(index), _) => {
                let view = self.document.views().nth(index.value());
                let view = view.ok_or_else(|| Fault::malformed(place, "its buffer view is not there"))?;
                Ok(self.buffers.view(place, &view)?.to_vec())
            }
            (None, Some(uri)) => read_uri(place, uri, self.resources),
            (None, None) => Err(Fault::malformed(place, "neither URI nor buffer view, one is needed")),
        }
    }
}

/// The bytes behind a URI: `data:...;base64,...` or a relative path, with `%` escapes.
pub(super) fn read_uri(place: &str, uri: &str, resources: &dyn Resources) -> Result<Vec<u8>, Fault> {
    if let Some(data) = uri.strip_prefix("data:") {
        let (_, text) = data
            .split_once(";base64,")
            .ok_or_else(|| Fault::malformed(place, "data URI without \";base64,\", allowed is base64"))?;
        return base64(text).ok_or_else(|| Fault::malformed(place, "data URI holds what is not base64"));
    }
    let has_scheme = uri.split(['/', '?']).next().is_some_and(|first| first.contains(':'));
    if has_scheme {
        let reason = "allowed are relative names and data: URIs".into();
        return Err(Fault::Unreadable { place: format!("{place} \"{uri}\": "), reason });
    }
    resources.read(place, &unescape(uri))
}

fn unescape(uri: &str) -> String {
    let mut bytes = Vec::with_capacity(uri.len());
    let mut rest = uri.as_bytes();
    while let Some((&first, after)) = rest.split_first() {
        let code = after.get(..2).and_then(|hex| std::str::from_utf8(hex).ok());
        match code.filter(|_| first == b'%').and_then(|hex| u8::from_str_radix(hex, 16).ok()) {
            Some(byte) => {
                bytes.push(byte);
                rest = &after[2..];
            }
            None => {
                bytes.push(first);
                rest = after;
            }
        }
    }
    String::from_utf8_lossy(&bytes).into_owned()
}

/// RFC 4648, padding optional.
fn base64(text: &str) -> Option<Vec<u8>> {
    let mut bytes = Vec::with_capacity(text.len() / 4 * 3);
    let (mut bits, mut count) = (0_u32, 0);
    for symbol in text.trim_end_matches('=').bytes() {
        let value = match symbol {
            b'A'..=b'Z' => symbol - b'A',
            b'a'..=b'z' => symbol - b'a' + 26,
            b'0'..=b'9' => symbol - b'0' + 52,
            b'+' => 62,
            b'/' => 63,
            _ => return None,
        };
        bits = bits << 6 | u32::from(value);
        count += 6;
        if count >= 8 {
            count -= 8;
            bytes.push((bits >> count) as u8);
        }
    }
    Some(bytes)
}
