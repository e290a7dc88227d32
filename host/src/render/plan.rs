//! By which methods a turn is rendered: what there is, what each costs and errs, and the choice of the cheapest that is good enough.

pub mod choose;
pub mod cost;
pub mod error;
pub mod speed;

use clap::ValueEnum;
use core::fmt::{self, Display, Formatter};
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
            halftone: Halftone::OptimisedDiffusion,
        }
    }
}

impl Plan {
    /// Whether fixed point draws by it, as [`crate::render::fast`] does: straight pieces, each vertex in single precision.
    pub fn is_for_fixed_point(&self) -> bool {
        self.precision == Precision::Single
            && matches!(self.edges, Edges::Straight | Edges::Uniform | Edges::Adaptive)
            && self.depth == DepthTest::Linear
    }
}

/// The name of a method as files and the command line have it.
fn name(method: impl Serialize) -> String {
    serde_json::to_value(method).ok().and_then(|value| value.as_str().map(str::to_string)).unwrap_or_default()
}

impl Display for Plan {
    /// What bears on geometry: projection, precision, edges, and exact depth.
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        write!(f, "{}, {}, {}", name(self.projection), name(self.precision), name(self.edges))?;
        if matches!(self.edges, Edges::Uniform | Edges::Adaptive) {
            write!(f, " {} px", (self.bow_px * 1e3).round() / 1e3)?;
        }
        match (self.edges, self.depth) {
            (Edges::Discard | Edges::Rays, _) | (_, DepthTest::Linear) => Ok(()),
            (_, DepthTest::Exact) => write!(f, ", exact depth"),
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

impl Projection {
    /// All there are.
    pub const ALL: [Self; 4] = [Self::Planar, Self::ConeNewton, Self::ConeTable, Self::ConeRoot];
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

impl Edges {
    /// All there are.
    pub const ALL: [Self; 5] = [Self::Straight, Self::Uniform, Self::Adaptive, Self::Discard, Self::Rays];
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
    /// A random threshold for every pixel of every slice.
    WhiteNoise,
    /// 8 × 8 ordered dither.
    Bayer,
    /// A void-and-cluster mask, the same in every slice.
    BlueNoiseFixed,
    /// A void-and-cluster mask, moved by half its range in every other slice.
    BlueNoiseHalf,
    /// A void-and-cluster mask that moves from slice to slice.
    BlueNoise,
    /// The same, moved by half its range in every other turn: flickers at half the turn rate.
    AlternatingBlueNoise,
    /// A void-and-cluster mask in space and from slice to slice.
    #[serde(rename = "blue-noise-3d")]
    #[value(name = "blue-noise-3d")]
    BlueNoise3d,
    /// Floyd and Steinberg's error diffusion.
    FloydSteinberg,
    /// Bits searched for the least error after an eye's blur.
    Search,
    /// Error diffusion by the kernel that leaves the least error to a blurred eye.
    OptimisedDiffusion,
    /// The same; every other turn makes good what the turn before it did wrong: flickers at half the turn rate.
    AlternatingDiffusion,
    /// The same; each slice makes good on its sight lines what the slice before it did wrong.
    SightLine,
    /// Bits searched over all slices of a turn together: praxi bake makes them.
    #[value(skip)]
    Joint,
    /// None: slices of 8-bit linear luminance, which no projector shows; they tell optics from halftone.
    Grey,
}

impl Halftone {
    /// The method, if it needs a slice's own luminance only; `None` for those that know other slices, and for grey.
    pub fn binary(self) -> Option<halftone::Halftone> {
        match self {
            Self::WhiteNoise => Some(halftone::Halftone::WhiteNoise),
            Self::Bayer => Some(halftone::Halftone::Bayer),
            Self::BlueNoiseFixed => Some(halftone::Halftone::BlueNoiseFixed),
            Self::BlueNoiseHalf => Some(halftone::Halftone::BlueNoiseHalf),
            Self::BlueNoise => Some(halftone::Halftone::BlueNoise),
            Self::AlternatingBlueNoise => Some(halftone::Halftone::AlternatingBlueNoise),
            Self::BlueNoise3d => Some(halftone::Halftone::BlueNoise3d),
            Self::FloydSteinberg => Some(halftone::Halftone::FloydSteinberg),
            Self::Search => Some(halftone::Halftone::Search),
            Self::OptimisedDiffusion => Some(halftone::Halftone::OptimisedDiffusion),
            Self::AlternatingDiffusion => Some(halftone::Halftone::AlternatingDiffusion),
            Self::SightLine | Self::Joint | Self::Grey => None,
        }
    }

    /// Turns after which its patterns repeat.
    pub fn turns(self) -> u32 {
        match self {
            Self::AlternatingBlueNoise | Self::AlternatingDiffusion => 2,
            _ => 1,
        }
    }

    /// All there are.
    pub const ALL: [Self; 14] = [
        Self::WhiteNoise,
        Self::Bayer,
        Self::BlueNoiseFixed,
        Self::BlueNoiseHalf,
        Self::BlueNoise,
        Self::AlternatingBlueNoise,
        Self::BlueNoise3d,
        Self::FloydSteinberg,
        Self::OptimisedDiffusion,
        Self::AlternatingDiffusion,
        Self::Search,
        Self::SightLine,
        Self::Joint,
        Self::Grey,
    ];

    /// Whether a pixel's bit follows from its own luminance and place alone.
    pub fn is_mask(self) -> bool {
        use Halftone::{
            AlternatingBlueNoise, Bayer, BlueNoise, BlueNoise3d, BlueNoiseFixed, BlueNoiseHalf, WhiteNoise,
        };
        let masks = [WhiteNoise, Bayer, BlueNoiseFixed, BlueNoiseHalf, BlueNoise, AlternatingBlueNoise, BlueNoise3d];
        masks.contains(&self)
    }
}

impl Display for Halftone {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        f.write_str(&name(*self))
    }
}
