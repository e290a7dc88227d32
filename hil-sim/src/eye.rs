//! Lit pixels to what an eye sees: the forward model, by the cone, written apart from the renderer.
//!
//! It takes from the rig only the figures in its file: frames, projection and lobe are derived here anew, so that one sign error
//! cannot hide in both directions.

mod apparatus;

use apparatus::Apparatus;
use glam::{DVec2, DVec3};
use protocol::rig::Rig;
use rayon::prelude::*;

/// What the projector shows during one plane: rows from the top, pixels from the left.
#[derive(Clone, Copy, Debug)]
pub enum Picture<'a> {
    /// Nothing.
    Dark,
    /// Pixel x is bit x mod 8 of byte x div 8; rows of ⌈width / 8⌉ bytes.
    Binary(&'a [u8]),
    /// Linear luminance, 255 is white; rows of width bytes.
    Grey(&'a [u8]),
}

/// One plane as it was shown. A blanked plane is there too, as [`Picture::Dark`]: it counts as dark.
#[derive(Clone, Copy, Debug)]
pub struct Flash<'a> {
    /// The mirror angle at its first moment, radians.
    pub start: f64,
    /// The mirror angle at its last moment, radians; less than a turn from `start`.
    pub end: f64,
    /// The pixels.
    pub picture: Picture<'a>,
}

/// An eye, and the square window that it looks at: at `look_at`, at right angles to the line of sight.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    /// The eye in world metres.
    pub from: DVec3,
    /// The middle of the window; must differ from `from`.
    pub look_at: DVec3,
    /// The window's side in metres.
    pub window_m: f64,
    /// The picture's side in pixels.
    pub pixels: u32,
    /// Each pixel is the mean of `rays` × `rays` rays.
    pub rays: u32,
}

impl View {
    /// Parts of the work that [`expose`] does one by one.
    pub fn parts(&self) -> u32 {
        self.pixels.div_ceil(TILE).pow(2)
    }

    /// The direction of ray (`column`, `row`) of pixel (`x`, `y`), not of unit length. World +y is up in the picture; where the
    /// eye looks straight down or up, world −z is.
    fn ray(&self, x: u32, y: u32, column: u32, row: u32) -> DVec3 {
        let at = |pixel: u32, ray: u32| {
            let place = f64::from(pixel) + (f64::from(ray) + 0.5) / f64::from(self.rays);
            (place / f64::from(self.pixels) - 0.5) * self.window_m
        };
        let [right, up] = self.axes();
        self.look_at + right * at(x, column) - up * at(y, row) - self.from
    }

    fn axes(&self) -> [DVec3; 2] {
        let forward = (self.look_at - self.from).normalize();
        let right = forward.cross(DVec3::Y);
        let right = if right.length() < 1e-9 { DVec3::X } else { right.normalize() };
        [right, right.cross(forward)]
    }
}

/// What is done with the sum of the light.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Brightness {
    /// Divided by the sum of the weights: a white scene is flat.
    Divided,
    /// As it falls into the eye, for one turn.
    Physical,
}

/// A picture as seen: linear RGB, row major.
#[derive(Clone, Debug)]
pub struct Seen {
    /// Side in pixels.
    pub pixels: u32,
    /// Linear light, Rec. 709 primaries; 1 is white.
    pub colours: Vec<[f32; 3]>,
    /// Whether any slice reached the pixel.
    pub reached: Vec<bool>,
}

impl Seen {
    /// Linear Rec. 709 luminance.
    pub fn luminance(&self) -> Vec<f32> {
        self.colours.iter().map(|[r, g, b]| 0.2126 * r + 0.7152 * g + 0.0722 * b).collect()
    }
}

/// Side of the squares of pixels that share a list of the moments that reach them.
const TILE: u32 = 16;

/// What `view` sees of `flashes`, which cover `turns` turns of `rig`'s mirror.
///
/// Each flash is taken at `exposures` mirror angles between its start and its end, which gives the motion blur. `pixels`,
/// `rays` and `exposures` must not be 0. `done` is called, from any thread, after each of [`View::parts`] parts of the work.
pub fn expose(
    rig: &Rig,
    flashes: &[Flash<'_>],
    turns: f64,
    exposures: u32,
    view: &View,
    brightness: Brightness,
    done: &(dyn Fn() + Sync),
) -> Seen {
    let apparatus = Apparatus::new(rig);
    let moments = moments(flashes, exposures);
    let tiles = view.pixels.div_ceil(TILE);
    let scale = match brightness {
        Brightness::Divided => None,
        Brightness::Physical => Some(1.0 / (f64::from(exposures) * turns)),
    };
    let squares: Vec<_> = (0..tiles * tiles)
        .into_par_iter()
        .map(|tile| {
            let corner = [tile % tiles * TILE, tile / tiles * TILE];
            let square = expose_tile(&apparatus, flashes, &moments, view, corner, scale);
            done();
            square
        })
        .collect();
    let mut seen = Seen {
        pixels: view.pixels,
        colours: vec![[0.0; 3]; (view.pixels * view.pixels) as usize],
        reached: vec![false; (view.pixels * view.pixels) as usize],
    };
    for (tile, square) in (0..).zip(squares) {
        for (cell, colour) in (0..).zip(square) {
            let (x, y) = (tile % tiles * TILE + cell % TILE, tile / tiles * TILE + cell / TILE);
            if let Some(colour) = colour
                && x < view.pixels
                && y < view.pixels
            {
                let place = (y * view.pixels + x) as usize;
                seen.colours[place] = colour.map(|value| value as f32);
                seen.reached[place] = true;
            }
        }
    }
    seen
}

/// A mirror angle at which light is sampled, and the flash that it belongs to.
#[derive(Clone, Copy)]
struct Moment {
    flash: usize,
    angle: f64,
}

fn moments(flashes: &[Flash<'_>], exposures: u32) -> Vec<Moment> {
    let of_flash = |(index, flash): (usize, &Flash<'_>)| {
        let (start, way) = (flash.start, flash.end - flash.start);
        (0..exposures).map(move |exposure| Moment {
            flash: index,
            angle: start + way * (f64::from(exposure) + 0.5) / f64::from(exposures),
        })
    };
    flashes.iter().enumerate().flat_map(of_flash).collect()
}

/// The colours of one square of pixels, row major; `None` where nothing reaches.
fn expose_tile(
    apparatus: &Apparatus,
    flashes: &[Flash<'_>],
    moments: &[Moment],
    view: &View,
    [left, top]: [u32; 2],
    scale: Option<f64>,
) -> Vec<Option<[f64; 3]>> {
    let middle = view.rays / 2;
    let probes: Vec<DVec3> = [0, TILE / 2, TILE]
        .into_iter()
        .flat_map(|y| [0, TILE / 2, TILE].map(|x| view.ray(left + x, top + y, middle, middle)))
        .collect();
    let reaching: Vec<Vec<_>> = (0..apparatus.faces())
        .map(|face| {
            let may_reach = |moment: &&Moment| apparatus.may_reach(face, moment.angle, view.from, &probes);
            let faces =
                moments.iter().filter(may_reach).map(|moment| (moment.flash, apparatus.face_at(face, moment.angle)));
            faces.collect()
        })
        .collect();
    (0..TILE * TILE)
        .map(|cell| {
            let (x, y) = (left + cell % TILE, top + cell / TILE);
            let rays = (0..view.rays * view.rays)
                .filter_map(|ray| {
                    let direction = view.ray(x, y, ray % view.rays, ray / view.rays);
                    ray_colour(apparatus, flashes, &reaching, view.from, direction, scale)
                })
                .fold(([0.0; 3], 0.0), |(sum, count), colour| {
                    (core::array::from_fn(|channel| sum[channel] + colour[channel]), count + 1.0)
                });
            (rays.1 > 0.0).then(|| rays.0.map(|sum: f64| sum / rays.1))
        })
        .collect()
}

/// The light on one ray: per face the weighted mean (or sum) of the pixels that reach the eye, faces added in their filters' colours.
fn ray_colour(
    apparatus: &Apparatus,
    flashes: &[Flash<'_>],
    reaching: &[Vec<(usize, apparatus::FaceAt)>],
    eye: DVec3,
    direction: DVec3,
    scale: Option<f64>,
) -> Option<[f64; 3]> {
    let mut colour = [0.0; 3];
    let mut reached = false;
    for (face, moments) in reaching.iter().enumerate() {
        let (mut light, mut weights) = (0.0, 0.0);
        for (flash, face_at) in moments {
            if let Some((weight, pixel)) = apparatus.arrival(face, face_at, eye, direction) {
                light += weight * apparatus.luminance(flashes[*flash].picture, pixel);
                weights += weight;
            }
        }
        if weights > 0.0 {
            reached = true;
            let intensity = light * scale.unwrap_or(1.0 / weights);
            colour = core::array::from_fn(|channel| colour[channel] + intensity * apparatus.colour(face)[channel]);
        }
    }
    reached.then_some(colour)
}

/// A pixel's column and row.
type Pixel = DVec2;

#[cfg(test)]
mod tests;
