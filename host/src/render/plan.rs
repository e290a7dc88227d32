//! By which methods a turn is rendered.

use clap::ValueEnum;
use serde::{Deserialize, Serialize};
use shaders::halftone;
use shaders::project::methods::Method;

/// The methods of one turn.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Plan {
    /// How V' is found.
    pub projection: Projection,
    /// In which precision vertices are projected.
    pub precision: Precision,
    /// How straight edges are brought to the curves that the optics make of them.
    pub edges: Edges,
    /// How far a straight piece may lie from its curve, in projector pixels. [`Edges::Discard`] allows that much before the test
    /// by pixel, which leaves no bow; [`Edges::Straight`] and [`Edges::Rays`] do not use it.
    pub bow_px: f64,
    /// How depth is compared.
    pub depth: DepthTest,
    /// How luminance becomes bits.
    pub halftone: Halftone,
}

impl Default for Plan {
    fn default() -> Self {
        Self {
            projection: Projection::ConeNewton,
            precision: Precision::Single,
            edges: Edges::Adaptive,
            bow_px: 0.5,
            depth: DepthTest::Linear,
            halftone: Halftone::BlueNoise,
        }
    }
}

/// How V' is found.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum Projection {
    /// Light leaves in vertical planes: the patent's approximation.
    Planar,
    /// Light leaves in cones, as a horizontal diffuser has it; the root found for every vertex.
    ConeRoot,
    /// The cone by a look-up table.
    ConeTable,
    /// The cone by Newton's steps from the planar answer.
    ConeNewton,
}

impl From<Projection> for Method {
    fn from(projection: Projection) -> Self {
        match projection {
            Projection::Planar => Self::Planar,
            Projection::ConeRoot => Self::ConeRoot,
            Projection::ConeTable => Self::ConeTable,
            Projection::ConeNewton => Self::ConeNewton,
        }
    }
}

/// In which precision vertices are projected.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum Precision {
    /// 32 bits.
    Single,
    /// 64 bits.
    Double,
}

/// How straight edges are brought to the curves that the optics make of them.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum Edges {
    /// Not at all: triangles as they come.
    Straight,
    /// Every edge is cut to one length.
    Uniform,
    /// Edges are cut where they bow.
    Adaptive,
    /// Coarse triangles, and a test by pixel of what lies on them: the patent's alternative.
    Discard,
    /// No triangles on the projector: a ray for every pixel.
    Rays,
}

/// How depth is compared.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum DepthTest {
    /// Interpolated linearly between vertices: the patent's way.
    Linear,
    /// By the pixel's own sight line where two surfaces come close.
    Exact,
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
    /// Bits searched for the least error after an eye's blur.
    Search,
    /// Bits searched over all slices of a turn together: praxi bake makes them.
    #[value(skip)]
    Joint,
    /// None: slices of 8-bit linear luminance, which no projector shows; they tell optics from halftone.
    Grey,
}

impl Halftone {
    /// The method of a slice by itself, `None` for grey.
    pub fn binary(self) -> Option<halftone::Halftone> {
        match self {
            Self::Bayer => Some(halftone::Halftone::Bayer),
            Self::BlueNoise => Some(halftone::Halftone::BlueNoise),
            Self::FloydSteinberg => Some(halftone::Halftone::FloydSteinberg),
            Self::Search | Self::Joint => Some(halftone::Halftone::Search),
            Self::Grey => None,
        }
    }
}
