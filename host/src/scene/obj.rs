//! Wavefront OBJ: polygons (triangulated as fans), normals, texture coordinates, vertex colours (`v x y z r g b`),
//! negative indices, materials by name. Vertex colours are taken as linear light, as they stand.
//!
//! Our own reader, because `tobj` 4.0.5 panics on `Kd 0.5` (which the format allows) and on indices far out of range,
//! pairs texture coordinates with the wrong vertices where only some corners have them, and cannot name a line.

use std::collections::HashMap;

use glam::{Vec2, Vec3};

use super::assembly::{Assembly, Part};
use super::files::Resources;
use super::lines::{logical_lines, numbers};
use super::{Fault, Material, Scene, TRIANGLES_MAX, mtl};

pub(super) fn parse(bytes: &[u8], resources: &dyn Resources) -> Result<Scene, Fault> {
    let mut reader = Reader::new(resources);
    for (number, line) in logical_lines(bytes) {
        reader.line(&format_args!("line {number}"), &line)?;
    }
    reader.finish()
}

/// Indices of a corner's position, texture coordinate and normal.
type Corner = (u32, Option<u32>, Option<u32>);

struct Reader<'a> {
    resources: &'a dyn Resources,
    assembly: Assembly,
    positions: Vec<Vec3>,
    colours: Vec<Vec3>,
    uvs: Vec<Vec2>,
    normals: Vec<Vec3>,
    part: Part,
    vertex_of_corner: HashMap<Corner, u32>,
    materials: mtl::Library,
    material_indices: HashMap<String, u32>,
    material: u32,
}

impl<'a> Reader<'a> {
    fn new(resources: &'a dyn Resources) -> Self {
        let mut assembly = Assembly::default();
        let material = assembly.add_material(Material::default());
        Self {
            resources,
            assembly,
            positions: Vec::new(),
            colours: Vec::new(),
            uvs: Vec::new(),
            normals: Vec::new(),
            part: Part::default(),
            vertex_of_corner: HashMap::new(),
            materials: mtl::Library::default(),
            material_indices: HashMap::new(),
            material,
        }
    }

    fn line(&mut self, place: &dyn std::fmt::Display, line: &str) -> Result<(), Fault> {
        let line = line.trim();
        let (keyword, rest) = line.split_once(char::is_whitespace).unwrap_or((line, ""));
        let words = &mut rest.split_whitespace();
        match keyword {
            "v" => self.vertex(place, words)?,
            "vt" => {
                let ([u, v], _) = numbers(place, words, 1)?;
                // OBJ's v grows upward from the bottom of the picture.
                self.uvs.push(Vec2::new(u, 1.0 - v));
            }
            "vn" => self.normals.push(Vec3::from_array(numbers(place, words, 3)?.0).normalize_or_zero()),
            "f" => self.face(place, words)?,
            "usemtl" => self.use_material(rest.trim()),
            "mtllib" => self.load_materials(place, rest.trim())?,
            _ => {}
        }
        Ok(())
    }

    fn vertex(&mut self, place: &dyn std::fmt::Display, words: &mut dyn Iterator<Item = &str>) -> Result<(), Fault> {
        let ([x, y, z, r, g, b], count) = numbers(place, words, 3)?;
        if count == 6 {
            self.colours.resize(self.positions.len(), Vec3::ONE);
            self.colours.push(Vec3::new(r, g, b));
        } else if !self.colours.is_empty() {
            self.colours.push(Vec3::ONE);
        }
        self.positions.push(Vec3::new(x, y, z));
        Ok(())
    }

    fn face(&mut self, place: &dyn std::fmt::Display, words: &mut dyn Iterator<Item = &str>) -> Result<(), Fault> {
        let corners: Vec<u32> = words.map(|word| self.corner(place, word)).collect::<Result<_, _>>()?;
        if corners.len() < 3 {
            let problem = format!("a face of {} corners, allowed are at least 3", corners.len());
            return Err(Fault::malformed(place.to_string(), problem));
        }
        for i in 1..corners.len() - 1 {
            self.part.triangles.push([corners[0], corners[i], corners[i + 1]]);
            self.part.materials.push(self.material);
        }
        if self.part.triangles.len() > TRIANGLES_MAX {
            self.assembly.room_for(&place.to_string(), 0, self.part.triangles.len())?;
        }
        Ok(())
    }

    /// The vertex for a corner such as `3`, `3/1`, `3//2` or `-1/-1/-1`.
    fn corner(&mut self, place: &dyn std::fmt::Display, word: &str) -> Result<u32, Fault> {
        let mut parts = word.split('/');
        let mut index = |count: usize| match parts.next() {
            None | Some("") => Ok(None),
            Some(text) => resolve(place, text, count).map(Some),
        };
        let position = index(self.positions.len())?;
        let corner = (position, index(self.uvs.len())?, index(self.normals.len())?);
        let (Some(position), uv, normal) = corner else {
            let problem = format!("corner \"{word}\", allowed are v, v/vt, v//vn and v/vt/vn");
            return Err(Fault::malformed(place.to_string(), problem));
        };
        Ok(*self.vertex_of_corner.entry((position, uv, normal)).or_insert_with(|| {
            let part = &mut self.part;
            let (vertex, at) = (part.positions.len(), position as usize);
            part.positions.push(self.positions[at]);
            let colour = (!self.colours.is_empty()).then(|| self.colours[at]);
            set(&mut part.colours, vertex, colour, Vec3::ONE);
            set(&mut part.uvs, vertex, uv.map(|i| self.uvs[i as usize]), Vec2::ZERO);
            set(&mut part.normals, vertex, normal.map(|i| self.normals[i as usize]), Vec3::ZERO);
            vertex as u32
        }))
    }

    fn use_material(&mut self, name: &str) {
        if let Some(&index) = self.material_indices.get(name) {
            self.material = index;
            return;
        }
        let material = self.materials.get(name).unwrap_or_else(|| {
            self.assembly.note(format!("material \"{name}\" is not defined, white is used"));
            Material { name: name.into(), ..Material::default() }
        });
        self.material = self.assembly.add_material(material);
        self.material_indices.insert(name.into(), self.material);
    }

    fn load_materials(&mut self, place: &dyn std::fmt::Display, names: &str) -> Result<(), Fault> {
        let place = format!("{place}: mtllib");
        // Names are separated by spaces, and many programs write one name with spaces in it.
        let files = match self.resources.read(&place, names) {
            Ok(bytes) => vec![(names, Ok(bytes))],
            Err(_) => names.split_whitespace().map(|name| (name, self.resources.read(&place, name))).collect(),
        };
        for (name, bytes) in files {
            match bytes {
                Ok(bytes) => self.materials.add(name, &bytes, self.resources)?,
                Err(_) => self.assembly.note(format!("material file \"{name}\" cannot be read, white is used")),
            }
        }
        Ok(())
    }

    fn finish(mut self) -> Result<Scene, Fault> {
        self.assembly.add("", self.part)?;
        self.assembly.finish()
    }
}

/// Index from 0 for OBJ's index from 1, or from -1 backward.
fn resolve(place: &dyn std::fmt::Display, text: &str, count: usize) -> Result<u32, Fault> {
    let index: i64 = text
        .parse()
        .map_err(|_| Fault::malformed(place.to_string(), format!("index \"{text}\", allowed are whole numbers")))?;
    let from_zero = if index < 0 { index.saturating_add(count as i64) } else { index - 1 };
    if (0..count as i64).contains(&from_zero) {
        return Ok(from_zero as u32);
    }
    let allowed = match count {
        0 => "none: nothing was defined before".into(),
        n => format!("1 to {n} and -{n} to -1"),
    };
    Err(Fault::IndexOutOfRange { place: place.to_string(), index, allowed })
}

/// Sets the attribute of the vertex just added; the attribute stays empty until a vertex has it.
fn set<T: Copy>(values: &mut Vec<T>, vertex: usize, value: Option<T>, missing: T) {
    if value.is_some() || !values.is_empty() {
        values.resize(vertex, missing);
        values.push(value.unwrap_or(missing));
    }
}
