//! A mesh as the rasteriser takes it.

use super::picture::Pictures;
use super::solids::solids;
use crate::render::mesh::{Mesh, Triangle};
use crate::scene::{Texture, luminance};
use raster::{Figure, Ink, Inks, SMOOTH_MAX, Skin, WHITE, level};
use std::sync::Arc;

/// `mesh` in lanes, with the scene's textures.
pub fn figure(mesh: &Mesh, textures: &[Arc<Texture>]) -> Figure {
    let mut skins = Skins { textures, pictures: Pictures::new(textures.len()), all: Vec::new() };
    let each = mesh.triangles.iter().map(|triangle| ink(triangle, &mut skins)).collect();
    let inks = Inks { each, skins: skins.all, pictures: skins.pictures.all };
    Figure::new(&mesh.positions, mesh.triangles.iter().map(|triangle| triangle.corners), &solids(mesh), inks)
}

/// What is found of textures on the way through a mesh.
struct Skins<'a> {
    textures: &'a [Arc<Texture>],
    pictures: Pictures,
    all: Vec<Skin>,
}

fn ink(triangle: &Triangle, skins: &mut Skins<'_>) -> Ink {
    if let Some(skin) = skins.pictures.skin(triangle, skins.textures) {
        skins.all.push(skin);
        return Ink::Textured(skins.all.len() as u32 - 1);
    }
    let corners = triangle.radiance.map(luminance);
    if triangle.texture.is_some() || corners.iter().any(|value| !(0.0..=1.0).contains(value)) {
        return Ink::Shaded;
    }
    if corners == [corners[0]; 3] {
        return Ink::Flat(level(corners[0]));
    }
    Ink::Smooth(corners.map(|value| (value * WHITE).min(SMOOTH_MAX)))
}
