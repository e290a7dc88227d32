//! The ways in which a renderer projects: fast, in either precision, each with an error that is known against [`SliceOptics`],
//! which is the reference.

mod kernel;
pub mod lanes;
mod table;

pub use kernel::SliceProjector;

use super::{Model, SliceOptics};
use num_traits::Float;
use protocol::rig::Rig;
use table::Table;

/// How V' is found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Method {
    /// In the vertical plane through P' and the point: the patent's approximation.
    Planar,
    /// On the diffuser's cone, by finding the root for every vertex.
    ConeRoot,
    /// On the cone, by a table of the root's distance from the planar answer over slice-independent coordinates, made and measured
    /// in [`FaceOptics::new`]; by Newton's steps outside it, and where the projector is so far aside that there is none.
    ConeTable,
    /// On the cone, by Newton's steps from the planar answer, to 0.05 px.
    ConeNewton,
}

impl Method {
    /// What the method approximates.
    pub const fn model(self) -> Model {
        match self {
            Self::Planar => Model::Planar,
            Self::ConeRoot | Self::ConeTable | Self::ConeNewton => Model::Cone,
        }
    }
}

/// Single or double precision.
pub trait Real: Float + Send + Sync + core::fmt::Debug + 'static {
    /// How far, in pixels, its rounding may take an answer from the exact one: what may be farther is answered by [`SliceOptics`].
    const TOLERANCE_PX: f64;
    /// Rounded.
    fn of(value: f64) -> Self;
    /// Exact.
    fn wide(self) -> f64;
    /// Twice the arctangent, in radians, of −1 … 1.
    fn twice_arctangent(self) -> Self;
}

impl Real for f32 {
    const TOLERANCE_PX: f64 = 5e-3;

    #[inline(always)]
    fn of(value: f64) -> Self {
        value as Self
    }
    #[inline(always)]
    fn wide(self) -> f64 {
        self.into()
    }
    /// Within 3e-8 rad but for rounding (Abramowitz and Stegun 4.4.49): a polynomial runs in lanes.
    #[inline(always)]
    fn twice_arctangent(self) -> Self {
        const SERIES: [f32; 8] = [
            0.002_866_225_7,
            -0.016_165_737,
            0.042_909_615,
            -0.075_289_64,
            0.106_562_64,
            -0.142_089,
            0.199_935_51,
            -0.333_331_47,
        ];
        let square = self * self;
        let series = SERIES.iter().fold(0.0, |sum, coefficient| (sum + coefficient) * square);
        (self + self) * (1.0 + series)
    }
}

impl Real for f64 {
    const TOLERANCE_PX: f64 = 1e-7;

    #[inline(always)]
    fn of(value: f64) -> Self {
        value
    }
    #[inline(always)]
    fn wide(self) -> f64 {
        self
    }
    #[inline(always)]
    fn twice_arctangent(self) -> Self {
        2.0 * self.atan()
    }
}

/// A scene point in a slice, as a rasteriser needs it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Vertex<F> {
    /// (u, v) in pixels, also outside the image.
    pub pixel: [F; 2],
    /// |V' − Q| less the distance of V' from the origin, in metres: small numbers keep their digits. For viewers at infinity −V'·Q.
    pub depth_m: F,
    /// On which sides of the panel and its guard band it lies outside: see [`SliceOptics::sides`].
    pub sides: u8,
    /// Whether viewer and projector are on the lit side of the mirror.
    pub lit: bool,
}

/// What a pixel shows: everything on the line through `mirror` along `toward_viewer`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SightLine<F> {
    /// M, world metres.
    pub mirror: [F; 3],
    /// The unit direction from M to V'.
    pub toward_viewer: [F; 3],
    /// As [`Vertex::depth_m`], of M. A point `s` metres behind M on the line has this plus `s`.
    pub depth_m: F,
    /// The distance of V' from the origin, metres: with the depth it is that from M. Infinite for viewers at infinity.
    pub from_origin_m: f64,
}

/// What all slices of one face have in common.
#[derive(Clone, Debug)]
pub struct FaceOptics<F> {
    rig: Rig,
    face: usize,
    method: Method,
    table: Option<Table<F>>,
}

impl<F: Real> FaceOptics<F> {
    /// Face `face` of `rig`, which must be below `rig.mirror.face.len()`. Tables are made here.
    pub fn new(rig: &Rig, face: usize, method: Method) -> Self {
        let table = if method == Method::ConeTable { Table::new(&rig.at_rest(), face) } else { None };
        Self { rig: rig.clone(), face, method, table }
    }

    /// The face at mirror angle `theta` radians.
    pub fn slice(&self, theta: f64) -> SliceProjector<F> {
        let table = self.table.as_ref().map(|table| table.at(theta));
        SliceProjector::new(SliceOptics::new(&self.rig, self.face, theta, self.method.model()), self.method, table)
    }
}

/// Whether single precision answers within 0.01 px of double by itself, for all that lies in a ball as large as the panel, and viewers on
/// the circle or on one through a tracked viewer.
///
/// Where it does not, because the image is very fine or the sight lines graze the mirror, [`SliceProjector`] turns to double
/// precision vertex by vertex: just as right, but slower than double precision throughout.
pub fn single_is_enough(rig: &Rig) -> bool {
    const SLICES: u32 = 12;
    let is_enough = |rig: &Rig| {
        (0..rig.mirror.face.len()).all(|face| {
            let optics = FaceOptics::<f32>::new(rig, face, Method::Planar);
            (0..SLICES).all(|part| optics.slice(rig.slice_angle(part * rig.rotation.slices / SLICES)).is_sound())
        })
    };
    let rest = rig.at_rest();
    is_enough(&rest)
        && rig.viewing.tracked.iter().all(|viewer| {
            let mut circle = rest.clone();
            circle.viewing.distance_m = Some(viewer.distance_m);
            circle.viewing.height_m = Some(viewer.height_m);
            is_enough(&circle)
        })
}

#[cfg(test)]
mod tests;
