//! Materials of OBJ files: `Kd`, taken as linear light, times `map_Kd`, a picture in sRGB.

use std::collections::HashMap;
use std::sync::Arc;

use glam::Vec3;

use super::files::Resources;
use super::obj::{logical_lines, numbers};
use super::{Fault, Material, Texture, Wrap};

/// Materials of the file called `file`, by name.
pub(super) fn parse(file: &str, bytes: &[u8], resources: &dyn Resources) -> Result<HashMap<String, Material>, Fault> {
    let mut materials: HashMap<String, Material> = HashMap::new();
    let mut current: Option<String> = None;
    for (number, line) in logical_lines(bytes) {
        let line = line.trim();
        let (keyword, rest) = line.split_once(char::is_whitespace).unwrap_or((line, ""));
        let place = format!("{file} line {number}");
        if keyword == "newmtl" {
            let name = rest.trim().to_owned();
            materials.insert(name.clone(), Material { name: name.clone(), ..Material::default() });
            current = Some(name);
        }
        let Some(material) = current.as_ref().and_then(|name| materials.get_mut(name)) else { continue };
        match keyword {
            "Kd" => {
                // One number alone is a grey.
                let ([r, g, b], count) = numbers(&place, &mut rest.split_whitespace(), 1)?;
                material.base_colour = if count == 3 { Vec3::new(r, g, b) } else { Vec3::splat(r) };
            }
            "map_Kd" => material.texture = Some(texture(&place, rest, resources)?),
            _ => {}
        }
    }
    Ok(materials)
}

/// The picture that a `map_Kd` names after its options.
fn texture(place: &str, rest: &str, resources: &dyn Resources) -> Result<Arc<Texture>, Fault> {
    let place = format!("{place}: map_Kd");
    let (name, clamp) = split_options(rest);
    if name.is_empty() {
        return Err(Fault::malformed(place, "no file name, allowed is the name of a PNG or JPEG file"));
    }
    let bytes = resources.read(&place, &name.replace('\\', "/"))?;
    let wrap = if clamp { Wrap::Clamp } else { Wrap::Repeat };
    Texture::decode(&format!("{place} \"{name}\""), &bytes, [wrap; 2]).map(Arc::new)
}

/// The file name after options such as `-s 1 1 1` or `-clamp on`, and whether the texture is clamped.
fn split_options(rest: &str) -> (&str, bool) {
    let mut rest = rest.trim();
    let mut clamp = false;
    while rest.starts_with('-') {
        let (option, after) = rest.split_once(char::is_whitespace).unwrap_or((rest, ""));
        rest = after.trim_start();
        let values_max = if matches!(option, "-o" | "-s" | "-t") { 3 } else { 1 + usize::from(option == "-mm") };
        for i in 0..values_max {
            let (value, after) = rest.split_once(char::is_whitespace).unwrap_or((rest, ""));
            // The second and third number may be left out.
            if i > 0 && value.parse::<f32>().is_err() {
                break;
            }
            clamp |= option == "-clamp" && value == "on";
            rest = after.trim_start();
        }
    }
    (rest, clamp)
}
