//! What people want to see: kept across restarts, changed piece by piece.

use crate::pattern::Pattern;
use crate::render::plan::Halftone;
use clap::ValueEnum as _;
use glam::{Affine3A, EulerRot, Quat, Vec3};
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::borrow::Cow;
use std::ops::RangeInclusive;
use thiserror::Error;
use utoipa::ToSchema;

/// Budgets that may be asked for, in projector pixels.
pub const BUDGETS_PX: RangeInclusive<f64> = 0.05..=20.0;
/// The same in words.
pub const BUDGETS_PX_ALLOWED: &str = "0.05 to 20";

/// Why a wish is none.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum WishError {
    /// Unknown keys, or values of the wrong kind: the parser's words.
    #[error("{0}")]
    Malformed(String),
    /// See the message.
    #[error("{key}: {value} is not allowed; allowed is {allowed}")]
    Value {
        /// The key.
        key: &'static str,
        /// What was given.
        value: String,
        /// In words.
        allowed: Cow<'static, str>,
    },
}

/// What is to be seen.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Wish {
    /// What kind of picture stands on the display.
    pub mode: Mode,
    /// Which test pattern.
    #[serde(default = "first_pattern")]
    pub pattern: Pattern,
    /// The scene's name.
    pub scene: String,
    /// How the scene stands.
    pub transform: Transform,
    /// How it moves.
    pub animation: Animation,
    /// How far things may lie from where they belong, in projector pixels: 0.05 to 20. Where rendering is late, more is allowed for a while.
    pub budget_px: f64,
    /// How luminance becomes bits: its name as on the command line.
    #[schema(value_type = String, example = "blue-noise")]
    pub halftone: Halftone,
    /// Whether the mirror is to turn.
    pub motor: bool,
}

fn first_pattern() -> Pattern {
    Pattern::CrossHairs
}

/// What kind of picture stands on the display.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Mode {
    /// The scene.
    Scene,
    /// A test pattern.
    Pattern,
    /// What stood there before.
    Freeze,
    /// Nothing: dark planes.
    Blank,
}

/// How a scene stands: first it is scaled, then turned, then moved.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Transform {
    /// 1 fills the display; 0.01 to 10.
    pub scale: f64,
    /// Counter-clockwise about the vertical axis, seen from above.
    pub yaw_deg: f64,
    /// About the axis to the right: positive shows more of the top.
    pub pitch_deg: f64,
    /// About the axis to the front.
    pub roll_deg: f64,
    /// To the right, up, to the front; each −0.5 to 0.5.
    pub move_m: [f64; 3],
}

/// How a scene moves.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case", tag = "kind", deny_unknown_fields)]
pub enum Animation {
    /// Not at all.
    Still,
    /// About the vertical axis.
    Spin {
        /// In each turn of the mirror: −30 to 30.
        degrees_per_turn: f64,
    },
    /// A clip of the scene's file goes on and on.
    Clip {
        /// Its name; the first one without it.
        name: Option<String>,
        /// 1 is the file's own speed; −10 to 10.
        speed: f64,
    },
}

impl Animation {
    /// A spin that is pleasant to look at: a turn in 9 s of a mirror that turns 20 times a second.
    pub const SPIN: Self = Self::Spin { degrees_per_turn: 2.0 };
}

impl Default for Transform {
    fn default() -> Self {
        Self { scale: 1.0, yaw_deg: 0.0, pitch_deg: 0.0, roll_deg: 0.0, move_m: [0.0; 3] }
    }
}

impl Transform {
    /// As a map of points that fill the display, in metres.
    pub fn affine(&self) -> Affine3A {
        let radians = |degrees: f64| (degrees.to_radians()) as f32;
        let [yaw, pitch, roll] = [self.yaw_deg, self.pitch_deg, self.roll_deg].map(radians);
        let turn = Quat::from_euler(EulerRot::YXZ, yaw, pitch, roll);
        let place = Vec3::from_array(self.move_m.map(|metres| metres as f32));
        Affine3A::from_scale_rotation_translation(Vec3::splat(self.scale as f32), turn, place)
    }

    /// Whether every value is in its range.
    pub fn check(&self) -> Result<(), WishError> {
        let Self { scale, yaw_deg, pitch_deg, roll_deg, move_m } = *self;
        within("transform.scale", scale, 0.01..=10.0, "0.01 to 10")?;
        for (key, value) in
            [("transform.yaw_deg", yaw_deg), ("transform.pitch_deg", pitch_deg), ("transform.roll_deg", roll_deg)]
        {
            within(key, value, -360.0..=360.0, "-360 to 360")?;
        }
        for value in move_m {
            within("transform.move_m", value, -0.5..=0.5, "-0.5 to 0.5, in metres")?;
        }
        Ok(())
    }
}

impl Wish {
    /// This wish with what `patch` says otherwise, by JSON merge patch (RFC 7396).
    ///
    /// # Errors
    /// [`WishError`], and nothing is changed.
    pub fn patched(&self, patch: &Value) -> Result<Self, WishError> {
        let malformed = |error: serde_json::Error| WishError::Malformed(error.to_string());
        if !patch.is_object() {
            return Err(WishError::Malformed(r#"expected an object, such as {"budget_px": 0.5}"#.into()));
        }
        let mut value = serde_json::to_value(self).map_err(malformed)?;
        // Kinds of animation have keys of their own: another kind starts afresh.
        if patch.pointer("/animation/kind").is_some() {
            value["animation"] = Value::Null;
        }
        merge(&mut value, patch);
        if let Some(name) = value["halftone"].as_str()
            && Halftone::from_str(name, false).is_err()
        {
            return Err(no_halftone(name));
        }
        let wish: Self =
            serde_path_to_error::deserialize(value).map_err(|error| WishError::Malformed(error.to_string()))?;
        wish.check()?;
        Ok(wish)
    }

    /// Whether every value is in its range.
    pub fn check(&self) -> Result<(), WishError> {
        check_budget(self.budget_px)?;
        self.transform.check()?;
        match &self.animation {
            Animation::Still => {}
            Animation::Spin { degrees_per_turn } => {
                within("animation.degrees_per_turn", *degrees_per_turn, -30.0..=30.0, "-30 to 30")?;
            }
            Animation::Clip { speed, .. } => within("animation.speed", *speed, -10.0..=10.0, "-10 to 10")?,
        }
        if self.halftone.binary().is_none() {
            return Err(no_halftone(&self.halftone.to_string()));
        }
        Ok(())
    }
}

/// Those that make bits of one slice at a time are allowed.
fn no_halftone(name: &str) -> WishError {
    let allowed = Halftone::ALL.iter().filter(|halftone| halftone.binary().is_some()).map(ToString::to_string);
    WishError::Value { key: "halftone", value: name.into(), allowed: Vec::from_iter(allowed).join(", ").into() }
}

/// Whether a budget in pixels may be asked for.
pub fn check_budget(budget_px: f64) -> Result<(), WishError> {
    within("budget_px", budget_px, BUDGETS_PX, BUDGETS_PX_ALLOWED)
}

fn within(key: &'static str, value: f64, range: RangeInclusive<f64>, allowed: &'static str) -> Result<(), WishError> {
    if range.contains(&value) {
        Ok(())
    } else {
        Err(WishError::Value { key, value: value.to_string(), allowed: allowed.into() })
    }
}

fn merge(value: &mut Value, patch: &Value) {
    let Value::Object(changes) = patch else {
        *value = patch.clone();
        return;
    };
    if !value.is_object() {
        *value = Value::Object(serde_json::Map::new());
    }
    let Value::Object(map) = value else { return };
    for (key, change) in changes {
        if change.is_null() {
            map.remove(key);
        } else {
            merge(map.entry(key.clone()).or_insert(Value::Null), change);
        }
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use serde_json::json;

    pub fn wish() -> Wish {
        Wish {
            mode: Mode::Scene,
            pattern: Pattern::Grid,
            scene: "builtin".into(),
            transform: Transform::default(),
            animation: Animation::Still,
            budget_px: 0.5,
            halftone: Halftone::BlueNoise,
            motor: true,
        }
    }

    #[test]
    fn a_patch_changes_what_it_names() {
        let patched = wish().patched(&json!({"transform": {"yaw_deg": 30}, "halftone": "bayer"})).unwrap();
        let transform = Transform { yaw_deg: 30.0, ..Transform::default() };
        assert_eq!(patched, Wish { transform, halftone: Halftone::Bayer, ..wish() });
        let spinning = patched.patched(&json!({"animation": {"kind": "spin", "degrees_per_turn": 1}})).unwrap();
        let clip = spinning.patched(&json!({"animation": {"kind": "clip", "speed": 1}})).unwrap();
        assert_eq!(clip.animation, Animation::Clip { name: None, speed: 1.0 });
        assert_eq!(clip.patched(&json!({})), Ok(clip.clone()));
    }

    #[test]
    fn what_is_not_allowed_changes_nothing_and_is_named() {
        for (patch, word) in [
            (json!({"budget_px": 0}), "budget_px"),
            (json!({"transform": {"scale": 1e300}}), "transform.scale"),
            (json!({"transform": {"move_m": [0, 0, 9]}}), "transform.move_m"),
            (json!({"animation": {"kind": "spin"}}), "degrees_per_turn"),
            (json!({"animation": {"kind": "spin", "degrees_per_turn": 31}}), "-30 to 30"),
            (json!({"halftone": "grey"}), "halftone: grey is not allowed; allowed is white-noise, bayer"),
            (json!({"halftone": "gray"}), "alternating-diffusion"),
            (json!({"budget_px": "x"}), "budget_px: invalid type"),
            (json!({"scale": 1}), "unknown field"),
            (json!({"scene": null}), "scene"),
            (json!([1, 2]), "expected"),
            (json!(null), "expected"),
        ] {
            let error = wish().patched(&patch).unwrap_err().to_string();
            assert!(error.contains(word), "{patch}: {error}");
        }
    }

    #[test]
    fn a_positive_yaw_turns_the_front_to_the_right() {
        let transform = Transform { yaw_deg: 90.0, scale: 2.0, move_m: [0.0, 0.1, 0.0], ..Transform::default() };
        let moved = transform.affine().transform_point3(Vec3::Z);
        assert!(moved.distance(Vec3::new(2.0, 0.1, 0.0)) < 1e-6, "{moved}");
    }
}
