//! Parts of a file, checked and joined to one scene.

use glam::{DVec3, Vec2, Vec3};

use super::{Fault, Material, Scene, TRIANGLES_MAX};

/// Three vertices for each allowed triangle.
const VERTICES_MAX: usize = 3 * TRIANGLES_MAX;
/// Beyond this, squares of lengths leave f32.
const COORDINATE_MAX: f32 = 1e15;
const NOTES_MAX: usize = 100;
/// A triangle is degenerate where twice its area is below this part of its longest edge's square.
const THINNEST: f64 = 1e-10;

/// Vertices and triangles that share a material. An attribute is empty or as long as `positions`.
#[derive(Clone, Default)]
pub(super) struct Part {
    pub positions: Vec<Vec3>,
    pub normals: Vec<Vec3>,
    pub colours: Vec<Vec3>,
    pub uvs: Vec<Vec2>,
    pub triangles: Vec<[u32; 3]>,
    /// Index into the scene's materials, per triangle, or one for all.
    pub materials: Vec<u32>,
}

/// A scene that grows part by part.
#[derive(Clone, Default)]
pub(super) struct Assembly {
    scene: Scene,
    degenerate: usize,
}

impl Assembly {
    /// Index of a new material.
    pub fn add_material(&mut self, material: Material) -> u32 {
        self.scene.materials.push(material);
        self.scene.materials.len() as u32 - 1
    }

    /// Adds a remark, once; beyond a hundred nobody reads them.
    pub fn note(&mut self, note: impl Into<String>) {
        let note = note.into();
        if self.scene.notes.len() < NOTES_MAX && !self.scene.notes.contains(&note) {
            self.scene.notes.push(note);
        }
    }

    /// Refuses a further part before memory is spent on it.
    pub fn room_for(&self, place: &str, vertices: usize, triangles: usize) -> Result<(), Fault> {
        room_beside([self.scene.positions.len(), self.scene.triangles.len()], place, vertices, triangles)
    }

    /// Checks a part's numbers and indices, drops its degenerate triangles and adds the rest.
    /// `place` is how errors call the part, e.g. `mesh 2 primitive 0`; may be empty.
    pub fn add(&mut self, place: &str, part: Part) -> Result<(), Fault> {
        self.room_for(place, part.positions.len(), part.triangles.len())?;
        check_numbers(place, &part)?;
        check_indices(place, &part)?;
        let scene = &mut self.scene;
        let first = scene.positions.len() as u32;
        for (i, corners) in part.triangles.iter().enumerate() {
            if is_degenerate(corners.map(|c| part.positions[c as usize])) {
                self.degenerate += 1;
                continue;
            }
            scene.triangles.push(corners.map(|c| first + c));
            scene.triangle_materials.push(*part.materials.get(i).or(part.materials.first()).unwrap_or(&0));
        }
        let (before, added) = (scene.positions.len(), part.positions.len());
        scene.positions.extend(part.positions);
        append(&mut scene.normals, before, part.normals, added, Vec3::ZERO);
        append(&mut scene.colours, before, part.colours, added, Vec3::ONE);
        append(&mut scene.uvs, before, part.uvs, added, Vec2::ZERO);
        Ok(())
    }

    /// The scene, if there is anything to draw.
    pub fn finish(self) -> Result<Scene, Fault> {
        let degenerate = self.degenerate;
        let scene = self.finish_even_empty();
        if scene.triangles.is_empty() {
            let detail = match degenerate {
                0 => String::new(),
                n => format!(" but {n} degenerate (zero area)"),
            };
            return Err(Fault::Empty { detail });
        }
        Ok(scene)
    }

    /// The scene, also where there is nothing to draw at the moment.
    pub fn finish_even_empty(mut self) -> Scene {
        match self.degenerate {
            0 => {}
            1 => self.note("1 degenerate triangle dropped"),
            n => self.note(format!("{n} degenerate triangles dropped")),
        }
        if self.scene.materials.is_empty() {
            self.scene.materials.push(Material::default());
        }
        self.scene
    }
}

/// Refuses so many vertices and triangles beside those there are.
pub(super) fn room_beside(
    [have_vertices, have_triangles]: [usize; 2],
    place: &str,
    vertices: usize,
    triangles: usize,
) -> Result<(), Fault> {
    let check = |have: usize, more: usize, what: &'static str, limit: usize| {
        let count = have.saturating_add(more);
        let too_large = Fault::TooLarge { place: place.into(), count: count as u64, what, limit: limit as u64 };
        if count > limit { Err(too_large) } else { Ok(()) }
    };
    check(have_triangles, triangles, "triangles", TRIANGLES_MAX)?;
    check(have_vertices, vertices, "vertices", VERTICES_MAX)
}

/// Grows an attribute that may be absent before or in the new part, so that it is absent or complete.
fn append<T: Copy>(all: &mut Vec<T>, before: usize, new: Vec<T>, added: usize, missing: T) {
    if all.is_empty() && new.is_empty() {
        return;
    }
    all.resize(before, missing);
    all.extend(new);
    all.resize(before + added, missing);
}

/// Whether lengths may be that.
pub(super) fn in_range(value: f32) -> bool {
    value.abs() <= COORDINATE_MAX
}

/// Refuses positions, colours and texture coordinates that are not finite or beyond all measure.
pub(super) fn check_numbers(place: &str, part: &Part) -> Result<(), Fault> {
    let not_finite = |what, vertex: usize, value: String| {
        let place = format!("{place} vertex {vertex}").trim_start().to_owned();
        Err(Fault::NotFinite { place, what, value })
    };
    for (what, values) in [("position", &part.positions), ("colour", &part.colours)] {
        if let Some(i) = values.iter().position(|v| !v.to_array().into_iter().all(in_range)) {
            return not_finite(what, i, values[i].to_string());
        }
    }
    match part.uvs.iter().position(|v| !v.to_array().into_iter().all(in_range)) {
        Some(i) => not_finite("texture coordinate", i, part.uvs[i].to_string()),
        None => Ok(()),
    }
}

fn check_indices(place: &str, part: &Part) -> Result<(), Fault> {
    let count = part.positions.len();
    for (i, corners) in part.triangles.iter().enumerate() {
        if let Some(&index) = corners.iter().find(|&&c| c as usize >= count) {
            let place = format!("{place} triangle {i}").trim_start().to_owned();
            let allowed = format!("0 to {}", count as i64 - 1);
            return Err(Fault::IndexOutOfRange { place, index: index.into(), allowed });
        }
    }
    Ok(())
}

fn is_degenerate(corners: [Vec3; 3]) -> bool {
    let [a, b, c] = corners.map(DVec3::from);
    let longest_squared = (b - a).length_squared().max((c - b).length_squared()).max((a - c).length_squared());
    (b - a).cross(c - a).length() <= THINNEST * longest_squared
}
