//! A turn of grey slices becomes binary: each slice by itself, with what the slice before it shows on the same sight lines, or all of
//! them together.

use super::blur::eye_blur;
use super::clear::owner;
use super::joint::{Joint, SWEEPS};
use super::plan::Halftone;
use super::turn::{Depth, Turn};
use glam::DVec2;
use protocol::rig::Rig;
use rayon::prelude::*;
use shaders::halftone::diffusion::{Kernel, diffuse};
use shaders::halftone::{Slot, halftone, missing, plane_stride};
use shaders::project::{Model, SliceOptics};

/// Slices that are carried through in one go. Goes do not wait for each other.
const GO: u32 = 24;
/// Slices before a go that are halftoned for what they leave to it: of [`CARRIED`] to this power, 3 %, nothing can be
/// seen.
const WARM_UP: u32 = 5;
/// The share of what a slice's bits leave unsaid that the next slice makes good on the same sight lines.
const CARRIED: f32 = 0.5;

/// All slices of `grey`, a turn of [`Depth::Grey`], as turn number `turn` by `method`; a copy for [`Halftone::Grey`].
/// `done` is called from any thread after each slice.
pub fn binary_turn(grey: &Turn, rig: &Rig, method: Halftone, turn: u32, done: &(dyn Fn() + Sync)) -> Turn {
    halftone_slices(grey, rig, method, turn, &(0..grey.slices()).collect::<Vec<_>>(), done)
}

/// The same of those slices that `slices` names; the others stay dark. [`slices_read`] are those that `grey` must hold.
pub fn halftone_slices(
    grey: &Turn,
    rig: &Rig,
    method: Halftone,
    turn: u32,
    slices: &[u32],
    done: &(dyn Fn() + Sync),
) -> Turn {
    match method {
        Halftone::Grey => return grey.clone(),
        // Slices that are not wanted are dark in what was rendered, and found at once.
        Halftone::Joint => {
            return Joint::new(rig, grey).search_all(SWEEPS, done).expect("no larger than the grey turn");
        }
        _ => {}
    }
    let mut binary =
        Turn::dark(grey.slices(), grey.width(), grey.height(), Depth::Binary).expect("no larger than the grey turn");
    let slice_bytes = binary.slice_bytes();
    if let Some(method) = method.binary() {
        let wanted = binary.bytes_mut().par_chunks_mut(slice_bytes).enumerate();
        wanted.filter(|(slice, _)| slices.contains(&(*slice as u32))).for_each(|(slice, plane)| {
            let slot = Slot { slice: slice as u32, turn, blur: eye_blur(rig, slice as u32) };
            halftone(method, slot, grey.width(), &luminance(grey, slot.slice), plane);
            done();
        });
        return binary;
    }
    let goes = binary.bytes_mut().par_chunks_mut(slice_bytes * GO as usize).enumerate();
    goes.for_each(|(go, planes)| {
        let first = go as u32 * GO;
        let of_go = |slice: &&u32| (first..first + GO).contains(*slice);
        let Some(last) = slices.iter().filter(of_go).max() else { return };
        let mut carrier = Carrier::new(grey, rig);
        for step in 0..WARM_UP + last - first + 1 {
            let slice = (first + step + grey.slices() - WARM_UP % grey.slices()) % grey.slices();
            let plane = carrier.next(slice);
            if step >= WARM_UP && slices.contains(&slice) {
                planes[(slice - first) as usize * slice_bytes..][..slice_bytes].copy_from_slice(plane);
                done();
            }
        }
    });
    binary
}

/// The slices whose luminance [`halftone_slices`] by [`Halftone::SightLine`] reads for `slices`, each once.
pub fn slices_read(rig: &Rig, slices: &[u32]) -> Vec<u32> {
    let turn = rig.rotation.slices;
    let read_for = |slice: u32| (0..=slice % GO + WARM_UP).map(move |back| (slice + turn - back % turn) % turn);
    let mut read: Vec<_> = slices.iter().flat_map(|slice| read_for(*slice)).collect();
    read.sort_unstable();
    read.dedup();
    read
}

fn luminance(grey: &Turn, slice: u32) -> Vec<f32> {
    grey.slice(slice).iter().map(|byte| f32::from(*byte) / 255.0).collect()
}

/// Halftones slice after slice, and keeps what the last one left unsaid.
struct Carrier<'a> {
    grey: &'a Turn,
    rig: &'a Rig,
    plane: Vec<u8>,
    /// The slice that was last halftoned and, pixel by pixel, how much less it shows than it should.
    left: Option<(u32, Vec<f32>)>,
}

impl<'a> Carrier<'a> {
    fn new(grey: &'a Turn, rig: &'a Rig) -> Self {
        Self {
            grey,
            rig,
            plane: vec![0; grey.slice_bytes() / grey.width() as usize * plane_stride(grey.width())],
            left: None,
        }
    }

    /// The bits of `slice`.
    fn next(&mut self, slice: u32) -> &[u8] {
        let width = self.grey.width();
        let luminance = luminance(self.grey, slice);
        if luminance.iter().all(|value| *value == 0.0) {
            self.plane.fill(0);
            self.left = None;
            return &self.plane;
        }
        let correction = match &self.left {
            Some((before, left)) => {
                let lines = SightLines::new(self.rig, slice, *before);
                let at = |pixel: DVec2| lines.at(pixel).map_or(0.0, |place| sample(width, left, place));
                let centre = |cell: usize| {
                    DVec2::new((cell % width as usize) as f64 + 0.5, (cell / width as usize) as f64 + 0.5)
                };
                let lit = luminance.iter().enumerate();
                lit.map(|(cell, value)| if *value > 0.0 { CARRIED * at(centre(cell)) } else { 0.0 }).collect()
            }
            None => vec![0.0; luminance.len()],
        };
        diffuse(&Kernel::OPTIMISED, slice, width, &luminance, &mut self.plane, |cell| correction[cell]);
        self.left = Some((slice, missing(width, &luminance, &self.plane)));
        &self.plane
    }
}

/// `values` at `place`, between pixel centres bilinearly; 0 outside.
fn sample(width: u32, values: &[f32], place: DVec2) -> f32 {
    let corner = (place - 0.5).floor();
    let part = (place - 0.5 - corner).as_vec2();
    let at = |x: i32, y: i32| {
        let (x, y) = (corner.x as i32 + x, corner.y as i32 + y);
        let inside = (0..width as i32).contains(&x) && y >= 0;
        if inside { values.get(y as usize * width as usize + x as usize).copied().unwrap_or(0.0) } else { 0.0 }
    };
    let row = |y: i32| at(0, y) + part.x * (at(1, y) - at(0, y));
    row(0) + part.y * (row(1) - row(0))
}

/// Pixels between the places whose sight lines are followed.
const GRID: u32 = 32;

/// Where the sight lines of one slice's pixels meet the mirror in another slice, on the projector's image.
struct SightLines {
    /// The faces in the first slice.
    faces: Vec<SliceOptics>,
    columns: usize,
    /// Of each face, the places of the grid's corners in the other slice.
    corners: Vec<Vec<Option<DVec2>>>,
}

impl SightLines {
    /// From slice `here` to slice `there`. Eyes see by the cone, however the slices were rendered.
    fn new(rig: &Rig, here: u32, there: u32) -> Self {
        let (columns, rows) = (rig.projector.width_px.div_ceil(GRID) + 1, rig.projector.height_px.div_ceil(GRID) + 1);
        let corner = |cell: u32| DVec2::new((cell % columns).into(), (cell / columns).into()) * f64::from(GRID);
        let faces = |slice| {
            (0..rig.mirror.face.len()).map(move |face| SliceOptics::new(rig, face, rig.slice_angle(slice), Model::Cone))
        };
        let corners = faces(here).zip(faces(there)).map(|(here, there)| {
            let place = |pixel| there.pixel_of(here.sight_of(here.mirror_of(pixel)?)?);
            (0..columns * rows).map(|cell| place(corner(cell))).collect()
        });
        Self { faces: faces(here).collect(), columns: columns as usize, corners: corners.collect() }
    }

    /// Where the sight line of `pixel`, which lies in the image, is found in the other slice.
    fn at(&self, pixel: DVec2) -> Option<DVec2> {
        let face = if self.faces.len() == 1 { 0 } else { owner(&self.faces, pixel)? };
        let place = pixel / f64::from(GRID);
        let square = place.floor();
        let part = place - square;
        let cell = square.y as usize * self.columns + square.x as usize;
        let corners = &self.corners[face];
        let row = |cell: usize| Some(corners[cell]?.lerp(corners[cell + 1]?, part.x));
        Some(row(cell)?.lerp(row(cell + self.columns)?, part.y))
    }
}

#[cfg(test)]
mod tests;
