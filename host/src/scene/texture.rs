//! Pictures on surfaces.

use std::io::Cursor;
use std::sync::LazyLock;

use glam::{Vec2, Vec3};
use raster::Wrap;

use super::Fault;

/// Larger pictures are refused.
const SIDE_MAX_PX: u32 = 16_384;

/// A picture with bilinear sampling in linear light. Texels are kept as they are stored, sRGB in 8 bits, so that they
/// can be handed to a GPU as they are; [`Texture::texel`] and [`Texture::sample`] give linear RGB.
#[derive(Clone, Debug, PartialEq)]
pub struct Texture {
    width: u32,
    height: u32,
    texels: Vec<[u8; 4]>,
    wrap: [Wrap; 2],
}

static LINEAR_FROM_SRGB8: LazyLock<[f32; 256]> =
    LazyLock::new(|| std::array::from_fn(|i| linear_from_srgb(i as f32 / 255.0)));

/// The sRGB curve (IEC 61966-2-1), 0 to 1, to linear light.
pub fn linear_from_srgb(value: f32) -> f32 {
    if value <= 0.04045 { value / 12.92 } else { ((value + 0.055) / 1.055).powf(2.4) }
}

/// Linear light of an 8-bit sRGB channel.
pub(super) fn linear_from_srgb8(value: u8) -> f32 {
    LINEAR_FROM_SRGB8[value as usize]
}

impl Texture {
    /// A picture of `width` x `height` sRGB texels with alpha, row by row from the top; `wrap` along u and v.
    ///
    /// # Panics
    /// If a side is zero or the number of texels differs from `width * height`.
    pub fn new(width: u32, height: u32, texels: Vec<[u8; 4]>, wrap: [Wrap; 2]) -> Self {
        assert!(width > 0 && height > 0 && texels.len() == width as usize * height as usize);
        Self { width, height, texels, wrap }
    }

    /// Decodes a PNG or JPEG. `place` is how errors call it.
    pub(super) fn decode(place: &str, bytes: &[u8], wrap: [Wrap; 2]) -> Result<Self, Fault> {
        let mut reader = image::ImageReader::new(Cursor::new(bytes)).with_guessed_format().expect("memory can be read");
        if reader.format().is_none() {
            return Err(Fault::malformed(place, "unknown kind of picture, allowed are PNG and JPEG"));
        }
        let mut limits = image::Limits::default();
        limits.max_image_width = Some(SIDE_MAX_PX);
        limits.max_image_height = Some(SIDE_MAX_PX);
        reader.limits(limits);
        let picture = reader
            .decode()
            .map_err(|e| Fault::malformed(place, format!("{e}; allowed are PNG and JPEG of 1 to {SIDE_MAX_PX} px")))?
            .into_rgba8();
        let (width, height) = picture.dimensions();
        if width == 0 || height == 0 {
            return Err(Fault::malformed(place, format!("{width} x {height} px, allowed are 1 to {SIDE_MAX_PX}")));
        }
        let texels = picture.into_raw().as_chunks().0.to_vec();
        Ok(Self::new(width, height, texels, wrap))
    }

    /// Width and height in texels.
    pub fn size(&self) -> (u32, u32) {
        (self.width, self.height)
    }

    /// Texels row by row from the top: sRGB in 8 bits, and the alpha of the file, which nothing here uses.
    pub fn texels_srgb8(&self) -> &[[u8; 4]] {
        &self.texels
    }

    /// What is shown outside of the unit square along u and along v.
    pub fn wrap(&self) -> [Wrap; 2] {
        self.wrap
    }

    /// Linear RGB of the texel at column `x` and row `y`, row 0 at the top.
    pub fn texel(&self, x: u32, y: u32) -> Vec3 {
        let [r, g, b, _] = self.texels[y as usize * self.width as usize + x as usize];
        Vec3::new(linear_from_srgb8(r), linear_from_srgb8(g), linear_from_srgb8(b))
    }

    /// Linear RGB at `uv`, bilinear between texel centres; (0, 0) is the top left corner of the picture, (1, 1) its
    /// bottom right one.
    pub fn sample(&self, uv: Vec2) -> Vec3 {
        let (x0, x1, fx) = neighbours(uv.x, self.width, self.wrap[0]);
        let (y0, y1, fy) = neighbours(uv.y, self.height, self.wrap[1]);
        let upper = self.texel(x0, y0).lerp(self.texel(x1, y0), fx);
        let lower = self.texel(x0, y1).lerp(self.texel(x1, y1), fx);
        upper.lerp(lower, fy)
    }
}

/// The two texels beside a coordinate along an axis, and how far it lies from the first toward the second.
fn neighbours(coordinate: f32, count: u32, wrap: Wrap) -> (u32, u32, f32) {
    // Large coordinates lose their digits but stay in range.
    let inside = match wrap {
        Wrap::Clamp => coordinate,
        Wrap::Repeat => coordinate - coordinate.floor(),
        Wrap::Mirror => {
            let inside = coordinate - 2.0 * (coordinate / 2.0).floor();
            inside.min(2.0 - inside)
        }
    };
    // Of no number at all, a cast makes 0.
    let x = inside.clamp(0.0, 1.0) * count as f32 + 0.5;
    let after = (x as u32).min(count);
    let fraction = x - after as f32;
    // Beyond a border lies the other one, or, where it is mirrored, itself.
    let [beyond_first, beyond_last] = if wrap == Wrap::Repeat { [count - 1, 0] } else { [0, count - 1] };
    let first = if after == 0 { beyond_first } else { after - 1 };
    let second = if after == count { beyond_last } else { after };
    (first, second, fraction)
}
