//! PLY, ASCII and binary. Positions `x y z`, normals `nx ny nz`, colours `red green blue` (also with `diffuse_` before):
//! integer channels are sRGB of their type's full range, floating ones are linear light as they stand. Faces are the
//! lists `vertex_indices` or `vertex_index`, triangulated as fans. Other elements and properties are passed over.

use std::io::{BufRead, Cursor};

use glam::Vec3;
use ply_rs_bw::parser::{Parser, Reader};
use ply_rs_bw::ply::{
    ElementDef, Encoding, Header, Property, PropertyAccess, PropertyAccessResult, PropertyType, ScalarType,
};

use super::assembly::{Assembly, Part};
use super::texture::linear_from_srgb;
use super::{Fault, Scene, TRIANGLES_MAX};

pub(super) fn parse(bytes: &[u8]) -> Result<Scene, Fault> {
    let mut reader = Reader::new(Cursor::new(bytes));
    let header =
        Parser::<Other>::new().read_header(&mut reader).map_err(|e| Fault::malformed("header", first_line(&e)))?;
    let mut assembly = Assembly::default();
    let promised = |name: &str| header.elements.get(name).map_or(0, |element| element.count);
    // A face is one triangle or more.
    assembly.room_for("header", promised("vertex"), promised("face"))?;
    let mut part = Part::default();
    let mut faces = Vec::new();
    for (name, element) in &header.elements {
        let left = bytes.len() as u64 - reader.get_ref().position().min(bytes.len() as u64);
        check_count(element, header.encoding, left)?;
        match name.as_str() {
            "vertex" => add_vertices(&mut part, element, read(&mut reader, element, &header)?)?,
            "face" => faces = read::<Face>(&mut reader, element, &header)?,
            _ => drop(read::<Other>(&mut reader, element, &header)?),
        }
    }
    add_faces(&mut part, &faces)?;
    assembly.add("", part)?;
    assembly.finish()
}

fn read<E: PropertyAccess>(
    reader: &mut Reader<Cursor<&[u8]>>,
    element: &ElementDef,
    header: &Header,
) -> Result<Vec<E>, Fault> {
    if header.encoding == Encoding::Ascii {
        return (0..element.count).map(|i| read_ascii(reader.get_mut(), element, i)).collect();
    }
    Parser::<E>::new()
        .read_payload_for_element(reader, element, header)
        .map_err(|e| Fault::malformed(format!("element {}", element.name), first_line(&e)))
}

/// An element on its line. Our own, because `ply-rs-bw` 4.0.1 refuses numbers such as `.5` and `1.`.
fn read_ascii<E: PropertyAccess>(reader: &mut Cursor<&[u8]>, element: &ElementDef, index: usize) -> Result<E, Fault> {
    let place = || format!("{} {index}", element.name);
    let mut line = Vec::new();
    if reader.read_until(b'\n', &mut line).is_ok_and(|length| length == 0) {
        let problem = format!("the file ends, {} were promised (truncated?)", element.count);
        return Err(Fault::malformed(place(), problem));
    }
    let line = String::from_utf8_lossy(&line);
    let mut words = line.split_whitespace();
    let mut value = E::new();
    for (name, property) in &element.properties {
        let read = ascii_property(&property.data_type, &mut words).map_err(|e| Fault::malformed(place(), e))?;
        if value.set_property(name, read) == PropertyAccessResult::UnsupportedType {
            let problem = format!("property {name} has the type {:?}, which it may not have", property.data_type);
            return Err(Fault::malformed(place(), problem));
        }
    }
    Ok(value)
}

fn ascii_property(data_type: &PropertyType, words: &mut dyn Iterator<Item = &str>) -> Result<Property, String> {
    let mut number = |kind: &ScalarType| {
        let word = words.next().ok_or("too few numbers, allowed is one for each property of the header")?;
        let value: f64 = word.parse().map_err(|_| format!("\"{word}\", allowed are numbers"))?;
        let (low, high) = match kind {
            ScalarType::Char => (f64::from(i8::MIN), f64::from(i8::MAX)),
            ScalarType::UChar => (0.0, f64::from(u8::MAX)),
            ScalarType::Short => (f64::from(i16::MIN), f64::from(i16::MAX)),
            ScalarType::UShort => (0.0, f64::from(u16::MAX)),
            ScalarType::Int => (f64::from(i32::MIN), f64::from(i32::MAX)),
            ScalarType::UInt => (0.0, f64::from(u32::MAX)),
            ScalarType::Float | ScalarType::Double => return Ok(value),
        };
        // NaN is no whole number either.
        let whole = value.fract() == 0.0 && (low..=high).contains(&value);
        if whole { Ok(value) } else { Err(format!("{word}, allowed are whole numbers from {low} to {high}")) }
    };
    let (length_kind, kind) = match data_type {
        PropertyType::Scalar(kind) => {
            let value = number(kind)?;
            return Ok(match kind {
                ScalarType::Char => Property::Char(value as i8),
                ScalarType::UChar => Property::UChar(value as u8),
                ScalarType::Short => Property::Short(value as i16),
                ScalarType::UShort => Property::UShort(value as u16),
                ScalarType::Int => Property::Int(value as i32),
                ScalarType::UInt => Property::UInt(value as u32),
                ScalarType::Float | ScalarType::Double => Property::Double(value),
            });
        }
        PropertyType::List(length_kind, kind) => (length_kind, kind),
    };
    // A length beyond the line's words fails at the first that is missing.
    let length = number(length_kind)? as u32;
    let values = (0..length).map(|_| number(kind)).collect::<Result<Vec<f64>, String>>()?;
    Ok(match kind {
        ScalarType::Float | ScalarType::Double => Property::ListDouble(values),
        ScalarType::UInt => Property::ListUInt(values.into_iter().map(|v| v as u32).collect()),
        _ => Property::ListInt(values.into_iter().map(|v| v as i32).collect()),
    })
}

/// Refuses a count of elements that the rest of the file cannot hold, before anybody loops or reserves memory for it.
fn check_count(element: &ElementDef, encoding: Encoding, bytes_left: u64) -> Result<(), Fault> {
    let size = |scalar: &ScalarType| match scalar {
        ScalarType::Char | ScalarType::UChar => 1,
        ScalarType::Short | ScalarType::UShort => 2,
        ScalarType::Int | ScalarType::UInt | ScalarType::Float => 4,
        ScalarType::Double => 8,
    };
    let smallest: u64 = match encoding {
        // A line, if only its end.
        Encoding::Ascii => 1,
        _ => element
            .properties
            .iter()
            .map(|(_, property)| match &property.data_type {
                PropertyType::Scalar(scalar) | PropertyType::List(scalar, _) => size(scalar),
            })
            .sum(),
    };
    let count = element.count as u64;
    // The last line of an ASCII file may lack its end.
    if count > 0 && (smallest == 0 || count.saturating_mul(smallest) > bytes_left + 1) {
        let place = format!("element {}", element.name);
        return Err(Fault::malformed(
            place,
            format!("{count} promised, but only {bytes_left} bytes follow (truncated?)"),
        ));
    }
    Ok(())
}

/// Other libraries' messages quote the file from their second line on.
fn first_line(error: &impl std::fmt::Display) -> String {
    error.to_string().lines().next().unwrap_or_default().to_owned()
}

fn add_vertices(part: &mut Part, element: &ElementDef, vertices: Vec<Vertex>) -> Result<(), Fault> {
    let has = |names: [&str; 3]| names.iter().all(|name| element.properties.contains_key(*name));
    if !has(["x", "y", "z"]) {
        return Err(Fault::malformed("element vertex", "properties x, y and z are needed"));
    }
    part.positions = vertices.iter().map(|v| v.position).collect();
    if has(["nx", "ny", "nz"]) {
        part.normals = vertices.iter().map(|v| v.normal.normalize_or_zero()).collect();
    }
    if has(["red", "green", "blue"]) || has(["diffuse_red", "diffuse_green", "diffuse_blue"]) {
        part.colours = vertices.iter().map(|v| v.colour).collect();
    }
    Ok(())
}

fn add_faces(part: &mut Part, faces: &[Face]) -> Result<(), Fault> {
    let vertex_count = part.positions.len() as i64;
    for (i, face) in faces.iter().enumerate() {
        let place = || format!("face {i}");
        let corners = face
            .corners
            .as_ref()
            .ok_or_else(|| Fault::malformed(place(), "a list vertex_indices of whole numbers is needed"))?;
        if let Some(&index) = corners.iter().find(|&&c| !(0..vertex_count).contains(&c)) {
            let allowed = format!("0 to {}", vertex_count - 1);
            return Err(Fault::IndexOutOfRange { place: place(), index, allowed });
        }
        if corners.len() < 3 {
            return Err(Fault::malformed(place(), format!("{} corners, allowed are at least 3", corners.len())));
        }
        for j in 1..corners.len() - 1 {
            part.triangles.push([corners[0] as u32, corners[j] as u32, corners[j + 1] as u32]);
        }
        if part.triangles.len() > TRIANGLES_MAX {
            Assembly::default().room_for(&place(), 0, part.triangles.len())?;
        }
    }
    Ok(())
}

#[derive(Default)]
struct Vertex {
    position: Vec3,
    normal: Vec3,
    colour: Vec3,
}

impl PropertyAccess for Vertex {
    fn new() -> Self {
        Self::default()
    }

    fn set_property(&mut self, name: &str, property: Property) -> PropertyAccessResult {
        let target = match name {
            "x" => &mut self.position.x,
            "y" => &mut self.position.y,
            "z" => &mut self.position.z,
            "nx" => &mut self.normal.x,
            "ny" => &mut self.normal.y,
            "nz" => &mut self.normal.z,
            _ => return self.set_colour(name, &property),
        };
        set_number(target, property.to_f32_lossy())
    }
}

impl Vertex {
    fn set_colour(&mut self, name: &str, property: &Property) -> PropertyAccessResult {
        let target = match name.strip_prefix("diffuse_").unwrap_or(name) {
            "red" => &mut self.colour.x,
            "green" => &mut self.colour.y,
            "blue" => &mut self.colour.z,
            _ => return PropertyAccessResult::Ignored,
        };
        let full_range = match property {
            Property::Char(_) => f32::from(i8::MAX),
            Property::UChar(_) => f32::from(u8::MAX),
            Property::Short(_) => f32::from(i16::MAX),
            Property::UShort(_) => f32::from(u16::MAX),
            Property::Int(_) => i32::MAX as f32,
            Property::UInt(_) => u32::MAX as f32,
            _ => return set_number(target, property.to_f32_lossy()),
        };
        set_number(target, property.to_f32_lossy().map(|value| linear_from_srgb(value / full_range)))
    }
}

fn set_number(target: &mut f32, value: Option<f32>) -> PropertyAccessResult {
    let Some(value) = value else { return PropertyAccessResult::UnsupportedType };
    *target = value;
    PropertyAccessResult::Set
}

#[derive(Default)]
struct Face {
    corners: Option<Vec<i64>>,
}

impl PropertyAccess for Face {
    fn new() -> Self {
        Self::default()
    }

    fn set_property(&mut self, name: &str, property: Property) -> PropertyAccessResult {
        if !matches!(name, "vertex_indices" | "vertex_index") {
            return PropertyAccessResult::Ignored;
        }
        self.corners = Some(match property {
            Property::ListChar(values) => values.into_iter().map(i64::from).collect(),
            Property::ListUChar(values) => values.into_iter().map(i64::from).collect(),
            Property::ListShort(values) => values.into_iter().map(i64::from).collect(),
            Property::ListUShort(values) => values.into_iter().map(i64::from).collect(),
            Property::ListInt(values) => values.into_iter().map(i64::from).collect(),
            Property::ListUInt(values) => values.into_iter().map(i64::from).collect(),
            _ => return PropertyAccessResult::UnsupportedType,
        });
        PropertyAccessResult::Set
    }
}

/// An element that is passed over. Without fields: a million of them take no memory.
struct Other;

impl PropertyAccess for Other {
    fn new() -> Self {
        Self
    }
}
