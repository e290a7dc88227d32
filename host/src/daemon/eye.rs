//! What an eye sees of the display, and what its slices are, as pictures for the page.

use crate::picture::Picture;
use crate::render::turn::Turn;
use crate::seen::{Brightness, View, see};
use core::f64::consts::TAU;
use glam::DVec3;
use image::{DynamicImage, GrayImage, Luma};
use protocol::rig::Rig;
use serde::Deserialize;
use shaders::halftone::plane_stride;
use utoipa::{IntoParams, ToSchema};

/// Where an eye is, and how large its picture is to be.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, IntoParams, ToSchema)]
#[serde(default, deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct Place {
    /// Seen from above, counter-clockwise from the front: 90 is the display's right side.
    pub azimuth_deg: f64,
    /// From the axis, level: 0.2 to 20.
    pub distance_m: f64,
    /// Above the middle of the mirror: −5 to 5.
    pub height_m: f64,
    /// The picture's side: 16 to 512.
    pub pixels: u32,
}

impl Default for Place {
    fn default() -> Self {
        Self { azimuth_deg: 0.0, distance_m: 0.9, height_m: 0.35, pixels: 256 }
    }
}

impl Place {
    /// Why it is none, if it is none.
    pub fn check(&self) -> Result<(), String> {
        let within = |name: &str, value: f64, [least, most]: [f64; 2]| {
            let text = format!("{name} = {value}: allowed is {least} to {most}");
            if (least..=most).contains(&value) { Ok(()) } else { Err(text) }
        };
        within("azimuth_deg", self.azimuth_deg, [-360.0, 360.0])?;
        within("distance_m", self.distance_m, [0.2, 20.0])?;
        within("height_m", self.height_m, [-5.0, 5.0])?;
        within("pixels", self.pixels.into(), [16.0, 512.0])
    }

    fn view(&self, radius_m: f64) -> View {
        let (sin, cos) = self.azimuth_deg.to_radians().sin_cos();
        View {
            from: DVec3::new(self.distance_m * sin, self.height_m, self.distance_m * cos),
            look_at: DVec3::ZERO,
            window_m: 2.0 * radius_m,
            pixels: self.pixels,
            rays: 2,
        }
    }
}

/// What an eye at `place` sees of `turn` on `rig`, whose display has this radius, as PNG: transparent where no slice reaches it.
pub fn eye_png(rig: &Rig, turn: Option<&Turn>, place: &Place, radius_m: f64) -> Vec<u8> {
    match turn {
        Some(turn) => see(rig, turn, &place.view(radius_m), 1, Brightness::Divided, &|| ()).srgb_png(),
        None => {
            let pixels = (place.pixels * place.pixels) as usize;
            Picture::grey(place.pixels, place.pixels, vec![0.0; pixels]).srgb_png()
        }
    }
}

/// How many slices the ring shows.
const RING_SLICES: u32 = 24;

/// Slices of `turn` as they leave the projector, on a ring by their mirror angle, the first at the top, counter-clockwise, `side`
/// pixels wide; as PNG.
pub fn ring_png(turn: Option<&Turn>, side: u32) -> Vec<u8> {
    let mut ring = GrayImage::new(side, side);
    let Some(turn) = turn else { return crate::picture::png(&DynamicImage::ImageLuma8(ring)) };
    let tile = side * 9 / 100;
    let radius = f64::from(side - tile) / 2.0 - 1.0;
    for place in 0..RING_SLICES.min(turn.slices()) {
        let slice = place * turn.slices() / RING_SLICES.min(turn.slices());
        let (sin, cos) = (TAU * f64::from(slice) / f64::from(turn.slices())).sin_cos();
        let corner = [-sin, -cos].map(|along| (f64::from(side - tile) / 2.0 + radius * along) as u32);
        for (x, y) in (0..tile * tile).map(|cell| (cell % tile, cell / tile)) {
            ring.put_pixel(corner[0] + x, corner[1] + y, Luma([shrunk(turn, slice, [x, y], tile)]));
        }
    }
    crate::picture::png(&DynamicImage::ImageLuma8(ring))
}

/// The brightness, sRGB, of cell (x, y) of `tile` × `tile` over slice `slice`.
fn shrunk(turn: &Turn, slice: u32, [x, y]: [u32; 2], tile: u32) -> u8 {
    let (bytes, stride) = (turn.slice(slice), plane_stride(turn.width()));
    let range = |cell: u32, pixels: u32| cell * pixels / tile..(cell + 1) * pixels / tile;
    let (mut lit, mut all) = (0, 0);
    for row in range(y, turn.height()) {
        for column in range(x, turn.width()) {
            let byte = bytes[row as usize * stride + column as usize / 8];
            lit += u32::from(byte >> (column % 8) & 1);
            all += 1;
        }
    }
    // A dark slice still is to be seen as one.
    crate::picture::srgb_byte(lit as f32 / all.max(1) as f32).max(24)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::turn::Depth;

    #[test]
    fn places_out_of_range_are_named() {
        assert_eq!(Place::default().check(), Ok(()));
        for (place, name) in [
            (Place { distance_m: 0.0, ..Place::default() }, "distance_m"),
            (Place { height_m: f64::NAN, ..Place::default() }, "height_m"),
            (Place { azimuth_deg: 361.0, ..Place::default() }, "azimuth_deg"),
            (Place { pixels: 1 << 20, ..Place::default() }, "pixels"),
        ] {
            assert!(place.check().unwrap_err().contains(name));
        }
    }

    #[test]
    fn the_ring_shows_which_slices_are_lit() {
        let mut turn = Turn::dark(288, 64, 48, Depth::Binary).unwrap();
        turn.slice_mut(72).fill(0xff);
        let ring = image::load_from_memory(&ring_png(Some(&turn), 400)).unwrap().into_luma8();
        // A quarter of a turn, counter-clockwise from the top: on the left.
        assert_eq!(
            [ring.get_pixel(18, 200)[0], ring.get_pixel(382, 200)[0], ring.get_pixel(200, 18)[0]],
            [255, 24, 24]
        );
        assert_eq!(ring.get_pixel(200, 200)[0], 0);
        let small = Turn::dark(3, 8, 8, Depth::Binary).unwrap();
        assert!(!ring_png(Some(&small), 16).is_empty() && !ring_png(None, 16).is_empty());
    }
}
