//! Scenes that move: a file's clips, posed at any moment.

use std::panic::RefUnwindSafe;
use std::path::Path;

use glam::DVec3;

use super::files::{self, Folder, Nowhere, Resources};
use super::gltf::File;
use super::gltf_clip::Clip;
use super::gltf_model::Model;
use super::{Fault, Scene, SceneError, guarded};

/// A clip's extent is that of so many of its moments a second, and of so many at most.
const MOMENTS_A_SECOND: f64 = 60.0;
const MOMENTS_MAX: f64 = 600.0;

/// A scene and the clips of its file. Poses share their textures.
pub struct Animated {
    file: String,
    at_rest: Scene,
    model: Option<Model>,
    clips: Vec<Clip>,
    /// Per clip; empty as long as nothing is fitted.
    fits: Vec<Fit>,
}

impl Animated {
    /// Reads what [`Scene::load`] reads, and how it moves. Only glTF has clips.
    ///
    /// # Errors
    /// Those of [`Scene::load`], and [`SceneError`] for clips that are broken: times that do not rise, wrong counts, numbers that are not
    /// finite, targets that are not there or cannot move.
    pub fn load(path: impl AsRef<Path>) -> Result<Self, SceneError> {
        let path = path.as_ref();
        let ending = path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
        let file = path.display().to_string();
        if !["gltf", "glb"].contains(&ending.as_str()) {
            return Ok(Self { file, at_rest: Scene::load(path)?, model: None, clips: Vec::new(), fits: Vec::new() });
        }
        Self::load_gltf(path, &Folder(path.parent().unwrap_or(Path::new(""))))
    }

    /// Reads a glTF file of which nobody knows where it is from: other files that it names are not opened.
    ///
    /// # Errors
    /// Those of [`Animated::load`], and [`SceneError`] where it names a file.
    pub fn load_alone(path: &Path) -> Result<Self, SceneError> {
        Self::load_gltf(path, &Nowhere)
    }

    fn load_gltf(path: &Path, resources: &(dyn Resources + RefUnwindSafe)) -> Result<Self, SceneError> {
        let (mut at_rest, model, clips) = guarded(path, || read(&files::read(path)?, resources))?;
        at_rest.name = super::name_of(path);
        Ok(Self { file: path.display().to_string(), at_rest, model: Some(model), clips, fits: Vec::new() })
    }

    /// The file's clips, in its order.
    pub fn clips(&self) -> &[Clip] {
        &self.clips
    }

    /// What [`Scene::load`] gives, fitted by itself where this is fitted.
    pub fn at_rest(&self) -> &Scene {
        &self.at_rest
    }

    /// The scene at a moment of a clip: `seconds` from its beginning, 0 to [`Clip::seconds`]; before and after it is as at its ends. Where
    /// there is no such clip it is at rest. It may have no triangles: what is shrunk to nothing is not there.
    ///
    /// # Errors
    /// [`SceneError`] where a clip takes a vertex beyond all measure.
    pub fn at(&self, clip: usize, seconds: f64) -> Result<Scene, SceneError> {
        let Some((model, moving)) = self.model.as_ref().zip(self.clips.get(clip)) else {
            return Ok(self.at_rest.clone());
        };
        let mut scene = posed(model, moving, seconds).map_err(|fault| self.error(fault))?;
        scene.name.clone_from(&self.at_rest.name);
        if let Some(fit) = self.fits.get(clip) {
            fit.apply(&mut scene);
        }
        Ok(scene)
    }

    /// Centres each clip's whole extent at the origin and makes it `extent_m` metres, as [`Scene::fit`] does with a scene: a moving object keeps its
    /// size. The extent is that of 60 moments a second, of 600 at most.
    ///
    /// # Errors
    /// Those of [`Animated::at`].
    ///
    /// # Panics
    /// Where [`Scene::fit`] does.
    pub fn fit(&mut self, extent_m: f32) -> Result<(), SceneError> {
        self.at_rest.fit(extent_m);
        let Some(model) = &self.model else { return Ok(()) };
        let fits = self.clips.iter().map(|clip| fit_of(model, clip, extent_m)).collect::<Result<_, _>>();
        self.fits = fits.map_err(|fault| self.error(fault))?;
        Ok(())
    }

    fn error(&self, fault: Fault) -> SceneError {
        SceneError { file: self.file.clone(), fault }
    }
}

/// A document at rest, to be posed, and how it moves.
pub(super) fn read(bytes: &[u8], resources: &dyn files::Resources) -> Result<(Scene, Model, Vec<Clip>), Fault> {
    let file = File::read(bytes, resources)?;
    let model = file.model()?;
    let clips = file.clips(&model)?;
    Ok((model.at_rest()?, model, clips))
}

/// A document at a moment of a clip.
pub(super) fn posed(model: &Model, clip: &Clip, seconds: f64) -> Result<Scene, Fault> {
    let mut pose = model.rest();
    clip.apply(seconds, &mut pose);
    model.posed(&pose)
}

fn fit_of(model: &Model, clip: &Clip, extent_m: f32) -> Result<Fit, Fault> {
    let moments = (clip.seconds * MOMENTS_A_SECOND).ceil().clamp(1.0, MOMENTS_MAX) as u32;
    let mut extent = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    for moment in 0..=moments {
        let (low, high) = posed(model, clip, clip.seconds * f64::from(moment) / f64::from(moments))?.bounds();
        extent = (extent.0.min(low.into()), extent.1.max(high.into()));
    }
    Ok(Fit::new(extent, extent_m))
}

/// Centres a box at the origin and gives it a size.
#[derive(Clone, Copy, Debug)]
pub(super) struct Fit {
    centre: DVec3,
    scale: f64,
}

impl Fit {
    /// The box from one corner to the other, metres; one without an extent stays as it is.
    ///
    /// # Panics
    /// If `extent_m` is not a positive finite number.
    pub fn new((low, high): (DVec3, DVec3), extent_m: f32) -> Self {
        assert!(extent_m.is_finite() && extent_m > 0.0, "extent {extent_m} m, allowed are positive finite numbers");
        let extent = (high - low).max_element();
        if !(extent > 0.0 && extent.is_finite()) {
            return Self { centre: DVec3::ZERO, scale: 1.0 };
        }
        Self { centre: (low + high) / 2.0, scale: f64::from(extent_m) / extent }
    }

    /// In f64: a small object far from the origin keeps its digits.
    pub fn apply(&self, scene: &mut Scene) {
        for position in &mut scene.positions {
            *position = ((DVec3::from(*position) - self.centre) * self.scale).as_vec3();
        }
    }
}
