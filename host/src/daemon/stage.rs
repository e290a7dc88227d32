//! A scene that is ready to be rendered: read, brought to the display's size, with its plans.

use super::library::{Library, LibraryError};
use super::wish::{Animation, Transform, Wish, WishError, check_budget};
use crate::render::plan::choose::{Candidate, PlanError, ladder};
use crate::scene::{Animated, Scene, SceneError, ShadedScene, Shading, shade};
use protocol::rig::Rig;
use serde::{Deserialize, Serialize};
use std::path::Path;
use std::sync::Arc;
use thiserror::Error;

/// Plans from what is asked for to what is allowed where rendering is late: 1, 2, 4 and 8 times the error.
const RUNGS: u32 = 4;
/// How much of the display a scene fills, so that the eyes' window holds it.
const FILLING: f32 = 0.92;

/// Why a scene is not ready.
#[derive(Debug, Error)]
pub enum StageError {
    /// See the message.
    #[error(transparent)]
    Library(#[from] LibraryError),
    /// See the message.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// See the message.
    #[error(transparent)]
    Plan(#[from] PlanError),
    /// See the message.
    #[error("{scene}: {triangles} triangles: at most {allowed} are allowed")]
    TooManyTriangles {
        /// The scene.
        scene: String,
        /// What it has.
        triangles: usize,
        /// The most.
        allowed: usize,
    },
    /// See the message.
    #[error("{scene}: no clip {name}; {}", if found.is_empty() { "it has none".into() } else { format!("it has {}", found.join(", ")) })]
    NoClip {
        /// The scene.
        scene: String,
        /// What was asked for.
        name: String,
        /// What there is.
        found: Vec<String>,
    },
}

/// What a stage is made of: another cast needs another stage.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Cast {
    scene: String,
    transform: Transform,
    budget_px: f64,
}

impl Cast {
    /// What `wish` needs.
    pub fn of(wish: &Wish) -> Self {
        Self { scene: wish.scene.clone(), transform: wish.transform, budget_px: wish.budget_px }
    }

    /// Whether every value is in its range.
    pub fn check(&self) -> Result<(), WishError> {
        check_budget(self.budget_px)?;
        self.transform.check()
    }

    /// The scene's name.
    pub fn scene(&self) -> &str {
        &self.scene
    }
}

/// The scene.
#[derive(Clone)]
pub struct Stage {
    /// What it was made of.
    pub cast: Cast,
    /// The scene, filling the display.
    pub scene: Arc<Animated>,
    /// By which it is rendered: the first as asked for, each further one with more error and less work.
    pub plans: Vec<Candidate>,
}

impl Stage {
    /// Reads and plans what `cast` says. What stands on the stage `before` is not read again.
    pub fn prepare(
        cast: &Cast,
        before: Option<&Stage>,
        library: &Library,
        rig: &Rig,
        display_radius_m: f64,
        triangles_max: usize,
    ) -> Result<Self, StageError> {
        let same = before.filter(|before| before.cast.scene == cast.scene);
        let scene = match same {
            Some(before) => Arc::clone(&before.scene),
            None => Arc::new(filling(library, &cast.scene, display_radius_m as f32, triangles_max)?),
        };
        let lit = lit(&scene, scene.at_rest().clone(), &cast.transform);
        Ok(Self { cast: cast.clone(), plans: ladder(&lit, rig, cast.budget_px, RUNGS)?, scene })
    }

    /// The clip that `animation` asks for.
    pub fn clip(&self, animation: &Animation) -> Result<Option<usize>, StageError> {
        let Animation::Clip { name, .. } = animation else { return Ok(None) };
        let clips = self.scene.clips();
        let found = match name {
            Some(name) => clips.iter().position(|clip| clip.name == *name),
            None => (!clips.is_empty()).then_some(0),
        };
        found.map(Some).ok_or_else(|| StageError::NoClip {
            scene: self.cast.scene.clone(),
            name: name.clone().unwrap_or_default(),
            found: clips.iter().map(|clip| clip.name.clone()).collect(),
        })
    }

    /// The scene in turn `number` of a mirror that turns so often a second, lit.
    pub fn at(
        &self,
        wish: &Wish,
        clip: Option<usize>,
        number: u64,
        turns_per_second: f64,
    ) -> Result<ShadedScene, StageError> {
        let scene = match (clip, &wish.animation) {
            (Some(clip), Animation::Clip { speed, .. }) => {
                let length = self.scene.clips()[clip].seconds;
                let seconds = number as f64 / turns_per_second * speed;
                self.scene.at(clip, if length > 0.0 { seconds.rem_euclid(length) } else { 0.0 })?
            }
            _ => self.scene.at_rest().clone(),
        };
        let yaw_deg = wish.transform.yaw_deg + turned_deg(&wish.animation, number);
        Ok(lit(&self.scene, scene, &Transform { yaw_deg, ..wish.transform }))
    }

    /// The scene as `transform` has it, before it moves, lit.
    pub fn at_rest(&self, transform: &Transform) -> ShadedScene {
        lit(&self.scene, self.scene.at_rest().clone(), transform)
    }
}

/// How far `animation` has turned a scene in turn `number`, in degrees about the axis.
pub fn turned_deg(animation: &Animation, number: u64) -> f64 {
    match animation {
        Animation::Spin { degrees_per_turn } => (number as f64 * degrees_per_turn) % 360.0,
        Animation::Still | Animation::Clip { .. } => 0.0,
    }
}

/// Whether what `animation` shows changes by itself.
pub fn moves(animation: &Animation) -> bool {
    match animation {
        Animation::Still => false,
        Animation::Spin { degrees_per_turn } => *degrees_per_turn != 0.0,
        Animation::Clip { speed, .. } => *speed != 0.0,
    }
}

fn lit(animated: &Animated, mut scene: Scene, transform: &Transform) -> ShadedScene {
    if *transform != Transform::default() {
        let map = transform.affine();
        scene.positions.iter_mut().for_each(|position| *position = map.transform_point3(*position));
        scene.normals.iter_mut().for_each(|normal| *normal = map.transform_vector3(*normal).normalize_or_zero());
    }
    debug_assert_eq!(scene.name, animated.at_rest().name);
    shade(&scene, Shading::Lambert, false)
}

/// Reads a scene and brings it to the display's size: files, and built-in scenes that are larger than it.
fn filling(library: &Library, name: &str, radius_m: f32, triangles_max: usize) -> Result<Animated, StageError> {
    let mut scene = library.load(name)?;
    let triangles = scene.at_rest().triangles.len();
    if triangles > triangles_max {
        return Err(StageError::TooManyTriangles { scene: name.into(), triangles, allowed: triangles_max });
    }
    let is_built_in = crate::scene::BUILT_IN.contains(&name) && Path::new(name).extension().is_none();
    if !is_built_in || scene.at_rest().radius() > radius_m {
        let mut unit = scene.at_rest().clone();
        unit.fit(1.0);
        scene.fit(FILLING * radius_m / unit.radius())?;
    }
    Ok(scene)
}
