//! The ways in which a renderer projects: fast, in either precision, each with an error that is known against [`SliceOptics`],
//! which is the reference.

use super::{Model, SliceOptics, Viewer};
use glam::{DVec2, DVec3};
use num_traits::Float;
use protocol::rig::Rig;
use protocol::rig::Viewers;

/// How V' is found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Method {
    /// In the vertical plane through P' and the point: the patent's approximation.
    Planar,
    /// On the diffuser's cone, by finding the root for every vertex.
    ConeRoot,
    /// On the cone, by a table of the root's distance from the planar answer over slice-independent coordinates.
    ConeTable,
    /// On the cone, by Newton's steps from the planar answer.
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
    /// Rounded.
    fn of(value: f64) -> Self;
    /// Exact.
    fn wide(self) -> f64;
}

impl Real for f32 {
    fn of(value: f64) -> Self {
        value as Self
    }
    fn wide(self) -> f64 {
        self.into()
    }
}

impl Real for f64 {
    fn of(value: f64) -> Self {
        value
    }
    fn wide(self) -> f64 {
        self
    }
}

/// A scene point in a slice, as a rasteriser needs it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Vertex<F> {
    /// (u, v) in pixels, also outside the image.
    pub pixel: [F; 2],
    /// |V' − Q| less the distance of the viewing circle from the origin, in metres: small numbers keep their digits. For viewers
    /// at infinity −V'·Q.
    pub depth_m: F,
    /// On which sides of the panel and its guard band it lies outside: see [`SliceOptics::sides`].
    pub sides: u8,
    /// Whether the viewer is on the lit side of the mirror.
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
}

/// What all slices of one face have in common.
#[derive(Clone, Debug)]
pub struct FaceOptics<F> {
    rig: Rig,
    face: usize,
    method: Method,
    marker: core::marker::PhantomData<F>,
}

impl<F: Real> FaceOptics<F> {
    /// Face `face` of `rig`, which must be below `rig.mirror.face.len()`. Tables are made here.
    pub fn new(rig: &Rig, face: usize, method: Method) -> Self {
        Self { rig: rig.clone(), face, method, marker: core::marker::PhantomData }
    }

    /// The face at mirror angle `theta` radians.
    pub fn slice(&self, theta: f64) -> SliceProjector<F> {
        let circle_m = match self.rig.viewers() {
            Viewers::Circle { distance_m, height_m } => distance_m.hypot(height_m),
            Viewers::Infinity { .. } => 0.0,
        };
        SliceProjector {
            optics: SliceOptics::new(&self.rig, self.face, theta, self.method.model()),
            circle_m,
            marker: core::marker::PhantomData,
        }
    }
}

/// One face in one slice.
#[derive(Clone, Debug)]
pub struct SliceProjector<F> {
    optics: SliceOptics,
    circle_m: f64,
    marker: core::marker::PhantomData<F>,
}

impl<F: Real> SliceProjector<F> {
    /// Where world point `point` in metres appears; `None` where it has no pixel: no viewer, no mirror point in front of the viewer,
    /// behind the projector, or so far off the panel that nothing near it is on it.
    pub fn vertex(&self, point: [F; 3]) -> Option<Vertex<F>> {
        let point = DVec3::from_array(point.map(F::wide));
        if !self.optics.is_near(point) {
            return None;
        }
        let projected = self.optics.project(point);
        if projected.visibility == super::Visibility::NoMirror {
            return None;
        }
        Some(Vertex {
            pixel: projected.pixel?.to_array().map(F::of),
            depth_m: F::of(projected.depth_m? - self.circle_m),
            sides: self.optics.sides(projected.mirror?),
            lit: self.optics.is_lit(projected.viewer?),
        })
    }

    /// What `pixel` shows; `None` where its ray misses the panel with its guard band, or where no lit viewer sees it.
    pub fn sight(&self, pixel: [F; 2]) -> Option<SightLine<F>> {
        let mirror = self.optics.mirror_of(DVec2::from_array(pixel.map(F::wide)))?;
        if self.optics.sides(mirror) != 0 {
            return None;
        }
        let viewer = self.optics.sight_of(mirror)?.viewer;
        let toward = match viewer {
            Viewer::At(position) => (position - mirror).normalize(),
            Viewer::Toward(direction) => direction,
        };
        Some(SightLine {
            mirror: mirror.to_array().map(F::of),
            toward_viewer: toward.to_array().map(F::of),
            depth_m: F::of(viewer.depth_of(mirror) - self.circle_m),
        })
    }
}
