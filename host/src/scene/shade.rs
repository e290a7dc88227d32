//! Light on the scene: what leaves each triangle, in linear RGB.

use std::sync::Arc;

use glam::{DVec3, Vec2, Vec3};

use super::{Material, Scene, Texture};

/// Light that reaches a surface from everywhere.
const AMBIENT: f32 = 0.1;
/// Light of the lamp on a surface that faces it.
const LAMP: f32 = 0.85;

/// How the scene is lit.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Shading {
    /// The measure's light: colour times `0.1 + 0.85 max(0, n.l)`, l = [`light`]. Unlit materials keep their colour.
    #[default]
    Lambert,
    /// Every surface keeps its colour.
    Unlit,
}

/// A triangle with what leaves it. Its radiance at a point is the interpolated `radiance` times, where there is a
/// texture, the texture's sample at the interpolated `uv`. It is seen from both sides.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ShadedTriangle {
    /// Metres, world space.
    pub positions: [Vec3; 3],
    /// Linear RGB at each corner.
    pub radiance: [Vec3; 3],
    /// Texture coordinates at each corner; zero without a texture.
    pub uv: [Vec2; 3],
    /// Index into [`ShadedScene::textures`].
    pub texture: Option<u32>,
}

/// What the renderer consumes.
#[derive(Clone, Debug, Default)]
pub struct ShadedScene {
    /// In the order of the scene's triangles.
    pub triangles: Vec<ShadedTriangle>,
    /// Each texture once.
    pub textures: Vec<Arc<Texture>>,
}

/// Direction toward the lamp, unit length, world space: the measure's (0.4, 0.8, 0.45).
pub fn light() -> Vec3 {
    Vec3::new(0.4, 0.8, 0.45).normalize()
}

/// The measure's light on a surface with unit normal `normal`: 0.1 to 0.95.
pub fn lambert(normal: Vec3) -> f32 {
    AMBIENT + LAMP * normal.dot(light()).max(0.0)
}

/// Luminance of linear RGB: Rec. 709.
pub fn luminance(rgb: Vec3) -> f32 {
    rgb.dot(Vec3::new(0.2126, 0.7152, 0.0722))
}

/// Lights a scene. Normals are those of the triangles, outward where corners go counter-clockwise; with `smooth`, the
/// file's normals at the vertices that have one.
pub fn shade(scene: &Scene, shading: Shading, smooth: bool) -> ShadedScene {
    let mut textures: Vec<Arc<Texture>> = Vec::new();
    let texture_of_material: Vec<Option<u32>> =
        scene.materials.iter().map(|material| texture_index(&mut textures, material)).collect();
    let triangles = scene
        .triangles
        .iter()
        .zip(&scene.triangle_materials)
        .map(|(corners, &material)| {
            let positions = corners.map(|i| scene.positions[i as usize]);
            let texture = texture_of_material[material as usize].filter(|_| !scene.uvs.is_empty());
            ShadedTriangle {
                positions,
                radiance: radiance(scene, *corners, &scene.materials[material as usize], shading, smooth),
                uv: texture.map_or([Vec2::ZERO; 3], |_| corners.map(|i| scene.uvs[i as usize])),
                texture,
            }
        })
        .collect();
    ShadedScene { triangles, textures }
}

fn texture_index(textures: &mut Vec<Arc<Texture>>, material: &Material) -> Option<u32> {
    let texture = material.texture.as_ref()?;
    let index = textures.iter().position(|t| Arc::ptr_eq(t, texture)).unwrap_or_else(|| {
        textures.push(texture.clone());
        textures.len() - 1
    });
    Some(index as u32)
}

fn radiance(scene: &Scene, corners: [u32; 3], material: &Material, shading: Shading, smooth: bool) -> [Vec3; 3] {
    let lit = shading == Shading::Lambert && !material.unlit;
    let flat = if lit { flat_normal(corners.map(|i| scene.positions[i as usize])) } else { Vec3::ZERO };
    corners.map(|i| {
        let own = if smooth { scene.normals.get(i as usize).copied().unwrap_or_default() } else { Vec3::ZERO };
        let normal = if own == Vec3::ZERO { flat } else { own };
        let factor = if lit { lambert(normal) } else { 1.0 };
        factor * material.base_colour * scene.colours.get(i as usize).copied().unwrap_or(Vec3::ONE)
    })
}

/// Unit normal of a triangle, toward those who see its corners counter-clockwise; zero without an area.
fn flat_normal(corners: [Vec3; 3]) -> Vec3 {
    // In f64: edges of a micrometre and of a light year have squares that f32 does not.
    let [a, b, c] = corners.map(DVec3::from);
    (b - a).cross(c - a).normalize_or_zero().as_vec3()
}
