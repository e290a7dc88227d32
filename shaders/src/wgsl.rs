//! The WGSL twins, and the structs that both sides share: laid out as WGSL does, which a test compares field by field.

use bytemuck::{Pod, Zeroable};

/// Projection and its inverse: no bindings.
pub const PROJECT: &str = include_str!("project.wgsl");
/// Masks: binding 20.
pub const HALFTONE: &str = include_str!("halftone.wgsl");
/// Radiance and textures: bindings 21 to 25.
pub const SHADE: &str = include_str!("shade.wgsl");
/// What all passes share: binding 0.
pub const BATCH: &str = include_str!("batch.wgsl");
/// The pass that projects vertices: entry `vertices`.
pub const VERTICES: &str = include_str!("vertices.wgsl");
/// What both ways of drawing use of projected vertices.
pub const PANEL: &str = include_str!("panel.wgsl");
/// Drawing by raster hardware: entries `draw_vertex` and `draw_fragment`.
pub const DRAW: &str = include_str!("draw.wgsl");
/// Drawing by compute shaders: entries `fill_small` and `fill_large`.
pub const RASTER: &str = include_str!("raster.wgsl");
/// What was drawn to planes: entry `pack`, with [`PACK_TARGET`] or [`PACK_KEYS`].
pub const PACK: &str = include_str!("pack.wgsl");
/// Reads what [`DRAW`] has drawn.
pub const PACK_TARGET: &str = include_str!("pack_target.wgsl");
/// Reads what [`RASTER`] has drawn.
pub const PACK_KEYS: &str = include_str!("pack_keys.wgsl");

/// [`Triangle::surface`] of a triangle without a texture.
pub const NONE: u32 = u32::MAX;
/// [`Vertex::state`]: single precision is not enough there.
pub const UNSURE: u32 = 0x40;

/// The most bends of the viewing curve in a slice: more are left to the reference. Viewers 8° apart have four of them in a fan of 32°.
pub const BENDS: usize = 6;

/// One face in one slice: [`crate::project::methods::SliceProjector`] in single precision.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct Slice {
    /// Sine and cosine of the face's azimuth.
    pub azimuth: [f32; 2],
    /// Sine and cosine of its tilt.
    pub tilt: [f32; 2],
    /// P in panel coordinates, metres.
    pub projector: [f32; 3],
    /// The plane's distance from the origin, metres.
    pub offset: f32,
    /// P' from above, in the mirror's frame, metres.
    pub image: [f32; 2],
    /// The square of its length.
    pub image_squared: f32,
    /// 1, or 0 for viewers at infinity.
    pub near: f32,
    /// Radius, height, and distance from the origin of the viewing circle, metres.
    pub circle: [f32; 3],
    /// Of the panel, metres.
    pub half_width: f32,
    /// Of the panel, metres.
    pub slope_span: [f32; 2],
    /// The guard band, metres.
    pub guard: f32,
    /// The square of the panel's reach, square metres.
    pub reach_squared: f32,
    /// Homogeneous pixels from (across, slope, 1).
    pub pixel_u: [f32; 3],
    /// Lines with less steepness are not answered.
    pub grazing: f32,
    /// See [`Slice::pixel_u`].
    pub pixel_v: [f32; 3],
    /// The step after which Newton's steps end, radians.
    pub settled: f32,
    /// See [`Slice::pixel_u`].
    pub pixel_w: [f32; 3],
    /// Whether the projector is on the lit side: 1 or 0.
    pub lit: u32,
    /// Homogeneous (across, slope) from pixels.
    pub mirror_across: [f32; 3],
    /// How many of [`Slice::bend`] there are; with none, viewers are on the circle.
    pub bends: u32,
    /// See [`Slice::mirror_across`].
    pub mirror_slope: [f32; 3],
    /// Square metres: lines that pass the axis at less than its root cross the curve once.
    pub passing: f32,
    /// See [`Slice::mirror_across`].
    pub mirror_w: [f32; 3],
    /// The squared radius at which distortion folds the image.
    pub fold_squared: f32,
    /// The centre of the distortion, pixels.
    pub principal: [f32; 2],
    /// Pixels in a unit of the radius.
    pub focal: [f32; 2],
    /// k1, k2.
    pub radial: [f32; 2],
    /// Distance and height where the first bend begins, metres.
    pub bends_from: [f32; 2],
    /// Bends of the viewing curve: start in radians of the mirror's frame, 1 / width, and metres added to distance and height.
    pub bend: [[f32; 4]; BENDS],
}

/// A vertex in an instance.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct Vertex {
    /// (u, v) in pixels.
    pub pixel: [f32; 2],
    /// As [`crate::project::methods::Vertex::depth_m`].
    pub depth: f32,
    /// As [`crate::project::methods::lanes::Lanes::state`], and [`UNSURE`].
    pub state: u32,
}

/// How a slice is halftoned.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
pub struct Mask {
    /// 0 white noise, 1 a tile of ranks, 2 grey.
    pub kind: u32,
    /// Columns and rows of the tile.
    pub side: u32,
    /// Ranks.
    pub cells: u32,
    /// The tile's first rank.
    pub offset: u32,
    /// Added to each rank; of white noise the slice.
    pub shift: u32,
}

/// A face in a slot of a batch.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
pub struct Instance {
    /// Of its slice.
    pub mask: Mask,
    /// The slice's place in the batch.
    pub slot: u32,
    /// Index of its [`Slice`].
    pub optics: u32,
    /// Index of the [`Slice`] of its slice's first face.
    pub first: u32,
    /// Where the slot begins in the target: columns, and rows times 65,536.
    pub cell: u32,
}

/// A triangle.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct Triangle {
    /// Indices of vertices.
    pub corners: [u32; 3],
    /// Index of its [`Surface`], or [`NONE`].
    pub surface: u32,
    /// At the corners, where there is no surface.
    pub luminance: [f32; 3],
    /// To a multiple of 16 bytes.
    pub unused: u32,
}

/// What a textured triangle looks like.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct Surface {
    /// Linear RGB, and u.
    pub a: [f32; 4],
    /// The same of the second corner.
    pub b: [f32; 4],
    /// The same of the third.
    pub c: [f32; 4],
    /// v of the corners.
    pub v: [f32; 3],
    /// Index of its [`Picture`].
    pub picture: u32,
}

/// A texture.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
pub struct Picture {
    /// Of the first texel.
    pub offset: u32,
    /// In texels.
    pub width: u32,
    /// In texels.
    pub height: u32,
    /// Along u, plus 4 times that along v: 0 repeats, 1 mirrors, 2 clamps.
    pub wrap: u32,
}

/// What the passes over a batch of slices share. A slot is a slice's place in the batch; an instance is a face in a slot.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct Batch {
    /// Faces a slot.
    pub faces: u32,
    /// Vertices an instance.
    pub vertices: u32,
    /// Triangles an instance.
    pub triangles: u32,
    /// Pixels.
    pub width: u32,
    /// Pixels.
    pub height: u32,
    /// Groups of 32 pixels in a row.
    pub groups: u32,
    /// Words that hold a group: the bits of a pixel.
    pub words: u32,
    /// Slots side by side in a layer of the target.
    pub columns: u32,
    /// Slots below each other in a layer of the target.
    pub rows: u32,
    /// Depth times this is within ±½.
    pub depth_scale: f32,
}

#[cfg(test)]
mod tests;
