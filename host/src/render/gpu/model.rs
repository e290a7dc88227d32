//! What all slices of a scene on a rig have in common, on the device.

use super::GpuError;
use super::device::Gpu;
use super::needs::Needs;
use crate::render::mesh::{Mesh, Triangle};
use crate::scene::{Texture, Wrap, linear_from_srgb, luminance};
use glam::Vec3;
use protocol::rig::Rig;
use shaders::project::methods::{FaceOptics, Method, SliceProjector};
use shaders::wgsl::{self, NONE};
use std::sync::Arc;
use wgpu::{BindingResource, Buffer, BufferUsages};

/// Bindings: slices, slots, triangles, surfaces, pictures, texels, tones, ranks.
pub(super) struct Model {
    /// Vertices.
    pub vertices: u32,
    /// Triangles.
    pub triangles: u32,
    /// Faces of the mirror.
    pub faces: u32,
    /// What of the shaders it uses.
    pub needs: Needs,
    /// No depth is larger than this, in metres.
    pub radius_m: f32,
    positions: Buffer,
    slices: Buffer,
    shading: [Buffer; 5],
    ranks: Buffer,
}

impl Model {
    /// `mesh` with `textures` on `rig`, projected by `method`, halftoned with `ranks`.
    pub fn new(
        gpu: &Gpu,
        mesh: &Mesh,
        textures: &[Arc<Texture>],
        rig: &Rig,
        method: Method,
        ranks: &[u32],
    ) -> Result<Self, GpuError> {
        let allowed = gpu.largest_binding();
        // Before anything is made: what is refused is refused at once.
        gpu.within("bytes of triangles", size_of::<wgsl::Triangle>() as u64 * mesh.triangles.len() as u64, allowed)?;
        gpu.within("bytes of vertices", 16 * mesh.positions.len() as u64, allowed)?;
        gpu.within("bytes of textures", textures.iter().map(|texture| texture_bytes(texture)).sum(), allowed)?;
        let storage = |what, words: &[u32]| gpu.filled(what, words, BufferUsages::STORAGE);
        let positions: Vec<[f32; 4]> =
            mesh.positions.iter().map(|position| position.as_vec3().extend(0.0).to_array()).collect();
        let projectors = projectors(rig, method);
        let slices: Vec<_> = projectors.iter().map(SliceProjector::shared).collect();
        let needs = Needs {
            lens: rig.camera().lens().is_some(),
            cone: method != Method::Planar,
            curve: slices.iter().any(|slice| slice.bends > 0),
            dim: projectors.iter().any(SliceProjector::may_be_unlit),
            textured: mesh.triangles.iter().any(|triangle| triangle.texture.is_some()),
            faces: rig.mirror.face.len() > 1,
        };
        let (triangles, surfaces) = triangles(&mesh.triangles);
        let (pictures, texels) = pictures(textures);
        let tones: Vec<_> = (0..256).map(|value| linear_from_srgb(value as f32 / 255.0)).collect();
        Ok(Self {
            vertices: mesh.positions.len() as u32,
            triangles: mesh.triangles.len() as u32,
            faces: rig.mirror.face.len() as u32,
            needs,
            radius_m: mesh.positions.iter().map(|position| position.length() as f32).fold(1e-9, f32::max),
            positions: storage("vertices", bytemuck::cast_slice(&positions))?,
            slices: storage("slices", bytemuck::cast_slice(&slices))?,
            shading: [
                storage("triangles", bytemuck::cast_slice(&triangles))?,
                storage("textured triangles", bytemuck::cast_slice(&surfaces))?,
                storage("pictures", bytemuck::cast_slice(&pictures))?,
                storage("textures", &texels)?,
                storage("tones", bytemuck::cast_slice(&tones))?,
            ],
            ranks: storage("a mask", ranks)?,
        })
    }

    /// What projects vertices.
    pub fn for_vertices(&self) -> Vec<(u32, BindingResource<'_>)> {
        vec![(1, self.slices.as_entire_binding()), (3, self.positions.as_entire_binding())]
    }

    /// What draws.
    pub fn for_drawing(&self) -> Vec<(u32, BindingResource<'_>)> {
        let mut bindings = self.for_lookup();
        bindings.push((1, self.slices.as_entire_binding()));
        bindings
    }

    /// Masks and shading alone.
    fn for_lookup(&self) -> Vec<(u32, BindingResource<'_>)> {
        let shading = (21..).zip(self.shading.iter().map(Buffer::as_entire_binding));
        [(20, self.ranks.as_entire_binding())].into_iter().chain(shading).collect()
    }
}

/// Slice by slice, every face.
fn projectors(rig: &Rig, method: Method) -> Vec<SliceProjector<f32>> {
    // A table would be made and not be used.
    let method = if method == Method::ConeTable { Method::ConeNewton } else { method };
    let faces: Vec<_> = (0..rig.mirror.face.len()).map(|face| FaceOptics::<f32>::new(rig, face, method)).collect();
    (0..rig.rotation.slices)
        .flat_map(|slice| faces.iter().map(move |face| face.slice(rig.slice_angle(slice))))
        .collect()
}

fn triangles(triangles: &[Triangle]) -> (Vec<wgsl::Triangle>, Vec<wgsl::Surface>) {
    let mut surfaces = Vec::new();
    let shared = triangles.iter().map(|triangle| {
        let surface = triangle.texture.map_or(NONE, |picture| {
            let corner = |index: usize| triangle.radiance[index].extend(triangle.uv[index].x).to_array();
            let v = triangle.uv.map(|uv| uv.y);
            surfaces.push(wgsl::Surface { a: corner(0), b: corner(1), c: corner(2), v, picture });
            surfaces.len() as u32 - 1
        });
        wgsl::Triangle {
            corners: triangle.corners,
            surface,
            luminance: triangle.radiance.map(|radiance: Vec3| luminance(radiance)),
            unused: 0,
        }
    });
    (shared.collect(), surfaces)
}

fn texture_bytes(texture: &Texture) -> u64 {
    4 * texture.texels_srgb8().len() as u64
}

fn pictures(textures: &[Arc<Texture>]) -> (Vec<wgsl::Picture>, Vec<u32>) {
    let mut texels = Vec::new();
    let pictures = textures.iter().map(|texture| {
        let ((width, height), [u, v]) = (texture.size(), texture.wrap().map(wrap));
        let offset = texels.len() as u32;
        texels.extend(texture.texels_srgb8().iter().map(|texel| u32::from_le_bytes(*texel)));
        wgsl::Picture { offset, width, height, wrap: u | v << 2 }
    });
    (pictures.collect(), texels)
}

fn wrap(wrap: Wrap) -> u32 {
    match wrap {
        Wrap::Repeat => 0,
        Wrap::Mirror => 1,
        Wrap::Clamp => 2,
    }
}
