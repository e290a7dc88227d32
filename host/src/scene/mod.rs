//! What is shown: triangles in metres with colours, from glTF, OBJ or PLY files or from the built-in scene.
//!
//! A [`Scene`] is geometry as the file has it, in world space (right-handed, +y up, +z to the front of the display, the
//! origin at the mirror's centre). [`shade`] lights it and gives the renderer what it consumes: a [`ShadedScene`].
//! [`Animated`] has the scenes that a file's clips go through. Nothing a file holds makes the loader panic, and what a file promises is compared with what it holds before memory is
//! reserved for it. (A picture may unpack to 512 MiB; instances in glTF multiply, up to [`TRIANGLES_MAX`].)

mod animated;
mod assembly;
mod builtin;
mod error;
mod files;
mod gltf;
mod gltf_accessor;
mod gltf_clip;
mod gltf_material;
mod gltf_model;
mod gltf_nodes;
mod gltf_shape;
mod lines;
mod mtl;
mod obj;
mod ply;
mod shade;
mod solids;
mod texture;

#[cfg(test)]
mod tests_animated;
#[cfg(test)]
mod tests_builtin;
#[cfg(test)]
mod tests_clips;
#[cfg(test)]
mod tests_files;
#[cfg(test)]
mod tests_gltf;
#[cfg(test)]
mod tests_gltf_fixture;
#[cfg(test)]
mod tests_mutation;

use std::path::Path;
use std::sync::Arc;

use animated::Fit;
use glam::{Quat, Vec2, Vec3};

pub use animated::Animated;
pub use error::{Fault, SceneError};
pub use gltf_clip::Clip;
pub use raster::Wrap;
pub use shade::{ShadedScene, ShadedTriangle, Shading, lambert, light, luminance, shade};
pub use texture::{Texture, linear_from_srgb};

/// The name that means [`Scene::builtin`] where a path to a file is asked for.
pub const BUILTIN: &str = "builtin";

/// The names that mean scenes without a file where a path to one is asked for: see [`Scene::load`].
pub const BUILT_IN: [&str; 5] = [BUILTIN, "boxes", "knot-5k", "knot-20k", "knot-70k"];

/// File endings that [`Scene::load`] reads, in lower case.
pub const EXTENSIONS: [&str; 4] = ["gltf", "glb", "obj", "ply"];

/// More triangles than this are refused: a turn of them could not be rendered in reasonable time or memory.
pub const TRIANGLES_MAX: usize = 50_000_000;

/// Triangles in metres, world space, with what colours them.
///
/// Every index in `triangles` is below `positions.len()`, every coordinate finite, every triangle has an area; scenes
/// from [`Scene::load`] and [`Scene::builtin`] hold this.
#[derive(Clone, Debug, Default)]
pub struct Scene {
    /// What to call it: the file's name without its folder, or `builtin`.
    pub name: String,
    /// Metres, world space.
    pub positions: Vec<Vec3>,
    /// Per vertex, unit length; empty where the file has none, zero for a vertex that has none.
    pub normals: Vec<Vec3>,
    /// Per vertex, linear RGB, multiplies the material's colour; empty where the file has none.
    pub colours: Vec<Vec3>,
    /// Per vertex, (0, 0) is the top left corner of the texture and v grows downward (glTF's sense); empty where the
    /// file has none.
    pub uvs: Vec<Vec2>,
    /// Indices of vertices, counter-clockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
    /// Per triangle, an index into `materials`.
    pub triangle_materials: Vec<u32>,
    /// At least one.
    pub materials: Vec<Material>,
    /// One-line remarks for the person who loaded the file, such as what was left out.
    pub notes: Vec<String>,
}

/// How a surface is coloured.
#[derive(Clone, Debug)]
pub struct Material {
    /// As in the file, or `default`.
    pub name: String,
    /// Linear RGB.
    pub base_colour: Vec3,
    /// Multiplies the base colour.
    pub texture: Option<Arc<Texture>>,
    /// True for a surface that ignores the light (`KHR_materials_unlit`).
    pub unlit: bool,
}

impl Default for Material {
    /// White, lit, without a texture.
    fn default() -> Self {
        Self { name: "default".into(), base_colour: Vec3::ONE, texture: None, unlit: false }
    }
}

impl Scene {
    /// Reads a `.gltf`, `.glb`, `.obj` or `.ply` file (the ending in any case), or makes a scene for one of the names [`BUILT_IN`]: the
    /// built-in one, boxes with long edges, trefoil knots of about so many triangles. The file's units are taken as metres and its axes as ours; see [`Scene::fit`].
    ///
    /// # Errors
    /// [`SceneError`] in one line for a file that is missing, unreadable, of another kind, broken, truncated, empty,
    /// too large or that refers to what is not there.
    pub fn load(path: impl AsRef<Path>) -> Result<Self, SceneError> {
        let path = path.as_ref();
        match path.to_str() {
            Some(BUILTIN) => return Ok(Self::builtin()),
            Some("boxes") => return Ok(builtin::boxes()),
            Some("knot-5k") => return Ok(builtin::knot("knot-5k", [128, 20])),
            Some("knot-20k") => return Ok(builtin::knot("knot-20k", [256, 40])),
            Some("knot-70k") => return Ok(builtin::knot("knot-70k", [480, 74])),
            _ => {}
        }
        guarded(path, || Self::load_file(path))
    }

    fn load_file(path: &Path) -> Result<Self, Fault> {
        let extension = path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
        if !EXTENSIONS.contains(&extension.as_str()) {
            return Err(Fault::UnknownKind { extension });
        }
        let bytes = files::read(path)?;
        let folder = path.parent().unwrap_or(Path::new(""));
        let mut scene = match extension.as_str() {
            "obj" => obj::parse(&bytes, &files::Folder(folder)),
            "ply" => ply::parse(&bytes),
            _ => gltf::parse(&bytes, &files::Folder(folder)),
        }?;
        scene.name = name_of(path);
        Ok(scene)
    }

    /// The scene that needs no file, in metres, within a ball of radius 60 mm about the origin.
    pub fn builtin() -> Self {
        builtin::praxinoscope()
    }

    /// Smallest and largest coordinates of the vertices that triangles use, metres. A scene without triangles gives
    /// (infinity, -infinity).
    pub fn bounds(&self) -> (Vec3, Vec3) {
        self.used_positions().fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), p| (low.min(p), high.max(p)))
    }

    /// Largest distance from the origin of a vertex that a triangle uses, metres; 0 without triangles.
    pub fn radius(&self) -> f32 {
        self.used_positions().map(Vec3::length).fold(0.0, f32::max)
    }

    /// Centres the bounding box of [`Scene::bounds`] at the origin and makes its largest extent `extent_m` metres.
    ///
    /// # Panics
    /// If `extent_m` is not a positive finite number: the edge has to check what people enter.
    pub fn fit(&mut self, extent_m: f32) {
        let (low, high) = self.bounds();
        Fit::new((low.into(), high.into()), extent_m).apply(self);
    }

    /// The same, turned counter-clockwise by `degrees` about the vertical axis.
    pub fn turned(&self, degrees: f32) -> Self {
        let turn = Quat::from_axis_angle(Vec3::Y, degrees.to_radians());
        let mut turned = self.clone();
        turned.positions.iter_mut().chain(&mut turned.normals).for_each(|vector| *vector = turn * *vector);
        turned
    }

    fn used_positions(&self) -> impl Iterator<Item = Vec3> + '_ {
        self.triangles.iter().flatten().map(|&i| self.positions[i as usize])
    }

    /// The material of triangle `index`.
    pub fn material_of(&self, index: usize) -> &Material {
        &self.materials[self.triangle_materials[index] as usize]
    }
}

/// What `read` makes of the file at `path`. The parsers of glTF, PLY, PNG and JPEG are not ours. We check what they rely on and know of no input
/// that makes them panic; this turns the one we have not met into an error.
fn guarded<T>(path: &Path, read: impl FnOnce() -> Result<T, Fault> + std::panic::UnwindSafe) -> Result<T, SceneError> {
    std::panic::catch_unwind(read)
        .unwrap_or_else(|_| Err(Fault::malformed("file", "its parser failed")))
        .map_err(|fault| SceneError::new(path, fault))
}

/// The file's name without its folder and ending.
fn name_of(path: &Path) -> String {
    path.file_stem().map(|stem| stem.to_string_lossy().into_owned()).unwrap_or_default()
}
