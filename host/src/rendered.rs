//! A rendered turn as a folder: `frame_00.png` … and `rotation.json`; or `slice_000.png` … for grey slices.

use crate::input::{self, PICTURE_BYTES_MAX};
use crate::picture::png;
use crate::render::plan::{Halftone, Plan};
use crate::render::turn::{Depth, Turn};
use image::{ColorType, DynamicImage, GrayImage, ImageFormat, RgbImage};
use protocol::rig::{Rig, RigError};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use shaders::pack::{pack, unpack};
use std::path::{Path, PathBuf};
use thiserror::Error;

/// `rotation.json`: what the pictures beside it are.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Rotation {
    /// `praxi`.
    pub program: String,
    /// The version of the program that wrote the folder.
    pub version: String,
    /// Slices a turn.
    pub slices: u32,
    /// Frames a turn.
    pub frames: u32,
    /// What was rendered.
    pub scene: SceneNote,
    /// How it was rendered.
    pub method: Method,
    /// For which rig, whole.
    pub rig: Rig,
}

/// What was rendered.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SceneNote {
    /// As given.
    pub source: String,
    /// How many triangles.
    pub triangles: usize,
    /// The largest extent in metres that it was fitted to.
    pub fit_m: Option<f64>,
}

/// How it was rendered.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Method {
    /// Model, halftone, budget.
    #[serde(flatten)]
    pub plan: Plan,
    /// `lambert` or `unlit`.
    pub shading: String,
    /// Whether the file's normals were used.
    pub smooth: bool,
}

impl Rotation {
    /// The note beside a turn for `rig`.
    pub fn new(rig: &Rig, scene: SceneNote, method: Method) -> Self {
        let rotation = rig.rotation();
        Self {
            program: "praxi".into(),
            version: env!("CARGO_PKG_VERSION").into(),
            slices: rotation.slices(),
            frames: rotation.frames(),
            scene,
            method,
            rig: rig.clone(),
        }
    }
}

/// Why a folder holds no turn.
#[derive(Debug, Error)]
pub enum RenderedError {
    /// A file cannot be read or written.
    #[error("{0}: {1}")]
    File(PathBuf, std::io::Error),
    /// There is no `rotation.json`.
    #[error("{0}: {1}; a folder that praxi render wrote is needed")]
    NotATurn(PathBuf, std::io::Error),
    /// `rotation.json` says nothing that can be used.
    #[error("{0}: {1}")]
    Rotation(PathBuf, String),
    /// The rig in it is impossible.
    #[error("{0}: rig: {1}")]
    Rig(PathBuf, RigError),
    /// A picture is broken.
    #[error("{0}: {1}")]
    Picture(PathBuf, image::ImageError),
    /// A picture is another than the rig needs.
    #[error("{0}: {1}, must be {2}")]
    Shape(PathBuf, String, String),
}

fn names(rotation: &Rotation) -> Vec<String> {
    match rotation.method.plan.halftone {
        Halftone::Grey => (0..rotation.slices).map(|slice| format!("slice_{slice:03}.png")).collect(),
        _ => (0..rotation.frames).map(|frame| format!("frame_{frame:02}.png")).collect(),
    }
}

/// Writes `turn` and its note into `folder`, which must exist. `done` is called after each picture.
pub fn write(folder: &Path, turn: &Turn, rotation: &Rotation, done: &(dyn Fn() + Sync)) -> Result<(), RenderedError> {
    let save = |name: &str, bytes: &[u8]| {
        let path = folder.join(name);
        std::fs::write(&path, bytes).map_err(|error| RenderedError::File(path, error))
    };
    names(rotation).par_iter().enumerate().try_for_each(|(index, name)| {
        save(name, &png(&picture(turn, rotation, index as u32)))?;
        done();
        Ok(())
    })?;
    let note = serde_json::to_string_pretty(rotation).expect("a note of strings and numbers");
    save("rotation.json", (note + "\n").as_bytes())
}

/// Frame, or grey slice, number `index`.
fn picture(turn: &Turn, rotation: &Rotation, index: u32) -> DynamicImage {
    let (width, height) = (turn.width(), turn.height());
    match turn.depth() {
        Depth::Grey => GrayImage::from_raw(width, height, turn.slice(index).to_vec()).expect("a slice's bytes").into(),
        Depth::Binary => {
            RgbImage::from_raw(width, height, frame(turn, &rotation.rig, index)).expect("a frame's bytes").into()
        }
    }
}

/// Frame `index` of a binary turn, packed as the projector of `rig` takes it: RGB8, row major.
pub fn frame(turn: &Turn, rig: &Rig, index: u32) -> Vec<u8> {
    let mut frame = vec![0; turn.width() as usize * turn.height() as usize * 3];
    let planes = rig.rotation.planes_per_frame as usize * turn.slice_bytes();
    let planes = &turn.bytes()[index as usize * planes..][..planes];
    pack(turn.width(), turn.height(), rig.projector.plane_order, planes, &mut frame);
    frame
}

/// Reads the turn in `folder`. Every picture must be there, whole, and of the rig's size.
pub fn load(folder: &Path) -> Result<(Rotation, Turn), RenderedError> {
    let rotation = load_rotation(&folder.join("rotation.json"))?;
    let depth = if rotation.method.plan.halftone == Halftone::Grey { Depth::Grey } else { Depth::Binary };
    let projector = &rotation.rig.projector;
    let mut turn = Turn::dark(rotation.slices, projector.width_px, projector.height_px, depth)
        .map_err(|error| RenderedError::Rotation(folder.join("rotation.json"), error.to_string()))?;
    let names = names(&rotation);
    let part = turn.bytes().len() / names.len();
    turn.bytes_mut().par_chunks_mut(part).zip(names).try_for_each(|(planes, name)| {
        let picture = load_picture(&folder.join(name), &rotation.rig, depth)?;
        match depth {
            Depth::Grey => planes.copy_from_slice(picture.as_bytes()),
            Depth::Binary => {
                unpack(projector.width_px, projector.height_px, projector.plane_order, picture.as_bytes(), planes);
            }
        }
        Ok(())
    })?;
    Ok((rotation, turn))
}

fn load_rotation(path: &Path) -> Result<Rotation, RenderedError> {
    let broken = |message: String| RenderedError::Rotation(path.into(), message);
    let text = input::read_text(path).map_err(|error| RenderedError::NotATurn(path.into(), error))?;
    let rotation: Rotation = serde_json::from_str(&text).map_err(|error| broken(error.to_string()))?;
    let rig = rotation.rig.checked().map_err(|error| RenderedError::Rig(path.into(), error))?;
    let turn = rig.rotation();
    if (rotation.slices, rotation.frames) != (turn.slices(), turn.frames()) {
        return Err(broken(format!(
            "{} slices in {} frames, but its rig has {} in {}",
            rotation.slices,
            rotation.frames,
            turn.slices(),
            turn.frames()
        )));
    }
    Ok(Rotation { rig, ..rotation })
}

fn load_picture(path: &Path, rig: &Rig, depth: Depth) -> Result<DynamicImage, RenderedError> {
    let bytes = input::read(path, PICTURE_BYTES_MAX).map_err(|error| RenderedError::File(path.into(), error))?;
    let picture = image::load_from_memory_with_format(&bytes, ImageFormat::Png)
        .map_err(|error| RenderedError::Picture(path.into(), error))?;
    let (colour, words) = match depth {
        Depth::Grey => (ColorType::L8, "8-bit grey"),
        Depth::Binary => (ColorType::Rgb8, "8-bit RGB"),
    };
    let (width, height) = (rig.projector.width_px, rig.projector.height_px);
    if (picture.width(), picture.height(), picture.color()) != (width, height, colour) {
        let found = format!("{} × {} pixels of {:?}", picture.width(), picture.height(), picture.color());
        return Err(RenderedError::Shape(path.into(), found, format!("{width} × {height} pixels of {words}")));
    }
    Ok(picture)
}
