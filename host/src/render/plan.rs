//! By which methods a turn is rendered.

use clap::ValueEnum;
use serde::{Deserialize, Serialize};
use shaders::{halftone, project};

/// The methods of one turn.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Plan {
    /// How the diffuser is modelled.
    pub model: Model,
    /// How luminance becomes bits.
    pub halftone: Halftone,
    /// How far a straight edge may lie from where the optics bend it, in projector pixels.
    pub bow_px: f64,
}

impl Default for Plan {
    fn default() -> Self {
        Self { model: Model::Cone, halftone: Halftone::BlueNoise, bow_px: 0.5 }
    }
}

/// How the diffuser is modelled.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum Model {
    /// Light leaves in vertical planes: the patent's approximation.
    Planar,
    /// Light leaves in cones, as a horizontal diffuser has it.
    Cone,
}

impl From<Model> for project::Model {
    fn from(model: Model) -> Self {
        match model {
            Model::Planar => Self::Planar,
            Model::Cone => Self::Cone,
        }
    }
}

/// How luminance becomes bits, if at all.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum Halftone {
    /// 8 × 8 ordered dither.
    Bayer,
    /// A void-and-cluster mask that moves from slice to slice.
    BlueNoise,
    /// Error diffusion.
    FloydSteinberg,
    /// None: slices of 8-bit linear luminance, which no projector shows; they tell optics from halftone.
    Grey,
}

impl Halftone {
    /// The method, `None` for grey.
    pub fn binary(self) -> Option<halftone::Halftone> {
        match self {
            Self::Bayer => Some(halftone::Halftone::Bayer),
            Self::BlueNoise => Some(halftone::Halftone::BlueNoise),
            Self::FloydSteinberg => Some(halftone::Halftone::FloydSteinberg),
            Self::Grey => None,
        }
    }
}
