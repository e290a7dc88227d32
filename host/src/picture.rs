//! Pictures in linear light, as PNG files: 8-bit sRGB for people, 16-bit linear luminance for measuring.

use crate::input::{self, PICTURE_BYTES_MAX};
use crate::scene::{linear_from_srgb, luminance};
use glam::Vec3;
use image::{DynamicImage, ImageBuffer, ImageFormat, LumaA, Rgba};
use std::io::Cursor;
use std::path::Path;
use thiserror::Error;

/// A picture, row major from the top left.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Linear light, Rec. 709 primaries, 1 is white.
    pub colours: Vec<[f32; 3]>,
    /// False where nothing is known: transparent in the file.
    pub known: Vec<bool>,
}

/// Why a file is no picture.
#[derive(Debug, Error)]
pub enum PictureError {
    /// The file cannot be read.
    #[error("{0}")]
    Read(#[from] std::io::Error),
    /// Not a PNG.
    #[error("not a PNG that can be read: {0}")]
    Format(#[from] image::ImageError),
}

impl Picture {
    /// A grey picture; `luminance` is linear, `width` × `height`.
    pub fn grey(width: u32, height: u32, luminance: Vec<f32>) -> Self {
        let known = vec![true; luminance.len()];
        Self { width, height, colours: luminance.into_iter().map(|value| [value; 3]).collect(), known }
    }

    /// Linear Rec. 709 luminance.
    pub fn luminance(&self) -> Vec<f32> {
        self.colours.iter().map(|colour| luminance(Vec3::from_array(*colour))).collect()
    }

    /// Share of pixels of which a file keeps less light than there is: some channel is brighter than white.
    pub fn clipped_share(&self) -> f64 {
        let clipped = self.colours.iter().filter(|colour| colour.iter().any(|value| *value > 1.001)).count();
        clipped as f64 / self.colours.len() as f64
    }

    /// The same with all light times `gain`.
    pub fn exposed(mut self, gain: f32) -> Self {
        self.colours.iter_mut().flatten().for_each(|value| *value *= gain);
        self
    }

    /// As PNG: 8-bit sRGB with alpha.
    pub fn srgb_png(&self) -> Vec<u8> {
        let grey = self.colours.iter().all(|[r, g, b]| r == g && g == b);
        let pixels = self.colours.iter().zip(&self.known);
        let picture: DynamicImage = if grey {
            let bytes = pixels.flat_map(|([value, ..], known)| [srgb_byte(*value), alpha(*known)]).collect();
            buffer::<LumaA<u8>>(self.width, self.height, bytes).into()
        } else {
            let bytes = pixels.flat_map(|(colour, known)| {
                let [r, g, b] = colour.map(srgb_byte);
                [r, g, b, alpha(*known)]
            });
            buffer::<Rgba<u8>>(self.width, self.height, bytes.collect()).into()
        };
        png(&picture)
    }

    /// As PNG: 16-bit linear luminance with alpha.
    pub fn linear_png(&self) -> Vec<u8> {
        let words = self.luminance().into_iter().zip(&self.known).flat_map(|(value, known)| {
            [(value.clamp(0.0, 1.0) * 65535.0 + 0.5) as u16, if *known { u16::MAX } else { 0 }]
        });
        png(&buffer::<LumaA<u16>>(self.width, self.height, words.collect()).into())
    }

    /// Reads a PNG of either kind: 16 bits a channel are linear, 8 bits sRGB; transparent pixels are unknown.
    pub fn load(path: &Path) -> Result<Self, PictureError> {
        let picture = image::load_from_memory_with_format(&input::read(path, PICTURE_BYTES_MAX)?, ImageFormat::Png)?;
        let linear = picture.color().bytes_per_pixel() / picture.color().channel_count() == 2;
        let (width, height) = (picture.width(), picture.height());
        let pixels = picture.into_rgba16();
        let light = |value: u16| {
            let value = f32::from(value) / 65535.0;
            if linear { value } else { linear_from_srgb(value) }
        };
        let colours = pixels.pixels().map(|Rgba([r, g, b, _])| [*r, *g, *b].map(light)).collect();
        let known = pixels.pixels().map(|pixel| pixel[3] > u16::MAX / 2).collect();
        Ok(Self { width, height, colours, known })
    }
}

fn buffer<P: image::Pixel>(width: u32, height: u32, data: Vec<P::Subpixel>) -> ImageBuffer<P, Vec<P::Subpixel>> {
    ImageBuffer::from_raw(width, height, data).expect("as many values as the picture has")
}

fn alpha(known: bool) -> u8 {
    if known { u8::MAX } else { 0 }
}

/// A PNG in memory.
pub fn png(picture: &DynamicImage) -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    picture.write_to(&mut bytes, ImageFormat::Png).expect("writing into memory");
    bytes.into_inner()
}

/// Linear light, 0 … 1, to 8-bit sRGB (IEC 61966-2-1).
pub fn srgb_byte(light: f32) -> u8 {
    let light = light.clamp(0.0, 1.0);
    let value = if light <= 0.003_130_8 { light * 12.92 } else { 1.055 * light.powf(1.0 / 2.4) - 0.055 };
    (value * 255.0 + 0.5) as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_written_can_be_read() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.png");
        let mut picture = Picture::grey(3, 1, vec![0.0, 0.2, 1.0]);
        picture.known[2] = false;
        for (bytes, step) in [(picture.srgb_png(), 4e-3), (picture.linear_png(), 1e-5)] {
            std::fs::write(&path, bytes).unwrap();
            let read = Picture::load(&path).unwrap();
            assert_eq!(read.known, picture.known);
            assert!(read.colours.iter().zip(&picture.colours).all(|(a, b)| (a[0] - b[0]).abs() < step), "{read:?}");
        }
        picture.colours[1] = [0.3, 0.2, 0.1];
        std::fs::write(&path, picture.srgb_png()).unwrap();
        assert!((Picture::load(&path).unwrap().colours[1][2] - 0.1).abs() < 4e-3);
    }

    #[test]
    fn a_file_that_is_no_picture_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.png");
        assert!(Picture::load(&path).is_err());
        let whole = Picture::grey(8, 8, vec![0.5; 64]).srgb_png();
        for length in [0, 7, 20, whole.len() / 2] {
            std::fs::write(&path, &whole[..length]).unwrap();
            assert!(Picture::load(&path).is_err(), "{length}");
        }
    }
}
