//! Materials of OBJ files: `Kd`, taken as linear light, times `map_Kd`, a picture in sRGB.

use std::collections::HashMap;
use std::sync::Arc;

use glam::Vec3;

use super::files::Resources;
use super::lines::{logical_lines, numbers};
use super::{Fault, Material, Texture, Wrap};

/// Materials of any number of files, by name; each picture is decoded once.
#[derive(Default)]
pub(super) struct Library {
    materials: HashMap<String, Material>,
    textures: HashMap<(String, bool), Arc<Texture>>,
}

impl Library {
    /// The material called `name`.
    pub fn get(&self, name: &str) -> Option<Material> {
        self.materials.get(name).cloned()
    }

    /// Adds the materials of the file called `file`. A later material replaces one of the same name.
    pub fn add(&mut self, file: &str, bytes: &[u8], resources: &dyn Resources) -> Result<(), Fault> {
        let mut current = None;
        for (number, line) in logical_lines(bytes) {
            let line = line.trim();
            let (keyword, rest) = line.split_once(char::is_whitespace).unwrap_or((line, ""));
            let place = format!("{file} line {number}");
            match keyword {
                "newmtl" => {
                    let name = rest.trim().to_owned();
                    self.materials.insert(name.clone(), Material { name: name.clone(), ..Material::default() });
                    current = Some(name);
                }
                "Kd" => {
                    // One number alone is a grey.
                    let ([r, g, b], count) = numbers(&place, &mut rest.split_whitespace(), 1)?;
                    let colour = if count == 3 { Vec3::new(r, g, b) } else { Vec3::splat(r) };
                    self.change(&current, |material| material.base_colour = colour);
                }
                "map_Kd" => {
                    let texture = self.texture(&place, rest, resources)?;
                    self.change(&current, |material| material.texture = Some(texture));
                }
                _ => {}
            }
        }
        Ok(())
    }

    fn change(&mut self, name: &Option<String>, change: impl FnOnce(&mut Material)) {
        if let Some(material) = name.as_ref().and_then(|name| self.materials.get_mut(name)) {
            change(material);
        }
    }

    /// The picture that a `map_Kd` names after its options.
    fn texture(&mut self, place: &str, rest: &str, resources: &dyn Resources) -> Result<Arc<Texture>, Fault> {
        let place = format!("{place}: map_Kd");
        let (name, clamp) = split_options(rest);
        if name.is_empty() {
            return Err(Fault::malformed(place, "no file name, allowed is the name of a PNG or JPEG file"));
        }
        if let Some(texture) = self.textures.get(&(name.to_owned(), clamp)) {
            return Ok(texture.clone());
        }
        let bytes = resources.read(&place, &name.replace('\\', "/"))?;
        let wrap = if clamp { Wrap::Clamp } else { Wrap::Repeat };
        let texture = Arc::new(Texture::decode(&format!("{place} \"{name}\""), &bytes, [wrap; 2])?);
        self.textures.insert((name.to_owned(), clamp), texture.clone());
        Ok(texture)
    }
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
