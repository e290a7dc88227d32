//! How far straight pieces lie from the curves that the optics make of them.

use core::f64::consts::TAU;
use glam::{DVec2, DVec3};
use protocol::rig::{Rig, Viewers};
use shaders::project::methods::{FaceOptics, Method, SliceProjector, Vertex};
use shaders::project::{Model, SliceOptics, Viewer};

/// Slices of a turn in which bows are measured.
const SAMPLES: u32 = 24;

/// Bows are measured too in as many slices a turn, of those whose viewers are on a bent piece of a curve: a bend is 10° wide.
const BENT_SAMPLES: u32 = 144;

/// One turn of a rig by some of its slices, all faces.
pub struct Samples {
    /// Face by face, each [`Samples::per_face`] slices around the turn.
    projectors: Vec<SliceProjector<f64>>,
    per_face: usize,
}

/// Where a point appears in each of [`Samples`].
pub type Track = Vec<Option<Vertex<f64>>>;

impl Samples {
    /// Evenly spread over the turn, and more where viewers are on a bent piece of a curve.
    pub fn new(rig: &Rig, model: Model) -> Self {
        let method = match model {
            Model::Planar => Method::Planar,
            Model::Cone => Method::ConeNewton,
        };
        let slices = rig.rotation.slices;
        let count = slices.min(SAMPLES);
        let faces: Vec<_> = (0..rig.mirror.face.len()).map(|face| FaceOptics::new(rig, face, method)).collect();
        let mut samples: Vec<_> = (0..count).map(|sample| sample * slices / count).collect();
        if !rig.viewing.tracked.is_empty() {
            let is_bent = |slice: &u32| faces.iter().any(|optics| optics.slice(rig.slice_angle(*slice)).is_bent());
            samples.extend((0..slices).step_by((slices / BENT_SAMPLES).max(1) as usize).filter(is_bent));
            samples.sort_unstable();
            samples.dedup();
        }
        let projectors =
            faces.iter().flat_map(|optics| samples.iter().map(|slice| optics.slice(rig.slice_angle(*slice))));
        Self { projectors: projectors.collect(), per_face: samples.len() }
    }

    /// Where `point` appears.
    pub fn track(&self, point: DVec3) -> Track {
        self.projectors.iter().map(|projector| projector.vertex(point.to_array())).collect()
    }

    /// How far, in pixels, `inner` lies at most from the mean of `corners` with `weights`, in the slices in which some of them may be
    /// visible: in a sample or in one beside it, since a slice between two samples is like either. Without bound where one of them
    /// has no pixel there: the piece cannot be drawn, and shorter ones may.
    pub fn bow_px<const N: usize>(&self, inner: &Track, corners: [&Track; N], weights: [f64; N]) -> f64 {
        let seen = |sample: usize| {
            let vertices = || corners.iter().copied().chain([inner]).map(|track| &track[sample]);
            if vertices().any(Option::is_none) {
                return vertices().flatten().any(|vertex| vertex.lit && vertex.sides == 0);
            }
            let common = vertices().flatten().fold(u8::MAX, |common, vertex| common & vertex.sides);
            common == 0 && vertices().flatten().any(|vertex| vertex.lit)
        };
        let bow = |sample: usize| {
            let pixel = |track: &Track| track[sample].map(|vertex| DVec2::from_array(vertex.pixel));
            let mut straight = DVec2::ZERO;
            for (track, weight) in corners.iter().zip(weights) {
                straight += weight * pixel(track)?;
            }
            Some(pixel(inner)?.distance(straight))
        };
        let around = self.per_face;
        let bows = (0..self.projectors.len()).filter(|sample| {
            let first = sample - sample % around;
            [0, 1, around - 1].into_iter().any(|step| seen(first + (sample + step) % around))
        });
        bows.map(|sample| bow(sample).unwrap_or(f64::INFINITY)).fold(0.0, f64::max)
    }
}

/// Beyond this distance from the origin no point has a sight line: it lies past the viewing circle; for viewers at infinity,
/// twenty times the panel's size away.
pub fn reach_m(rig: &Rig) -> f64 {
    match rig.viewers() {
        Viewers::Circle { distance_m, height_m } => distance_m.hypot(height_m),
        Viewers::Curve(curve) => {
            // A distance and a height that are not one viewer's may meet.
            let [_, distance_m] = curve.distances();
            distance_m.hypot(curve.spots().map(|spot| spot.height_m.abs()).fold(0.0, f64::max))
        }
        Viewers::Infinity { .. } => 20.0 * panel_m(rig),
    }
}

/// The largest extent of a panel from its middle, metres.
pub fn panel_m(rig: &Rig) -> f64 {
    let extents = rig.mirror.face.iter().flat_map(|face| {
        [face.width_m / 2.0, face.slope_span_m[0].abs(), face.slope_span_m[1].abs(), face.offset_m.abs()]
    });
    extents.fold(0.0, f64::max)
}

/// The finest that edges are cut to, as a share of the smallest panel (4 mm on the reference rig, which bows by 0.03 px): near the
/// viewers, and where sight lines graze the mirror, bows grow without bound.
const FINEST: f64 = 1.0 / 32.0;

/// No shorter edge is cut.
pub fn finest_edge_m(rig: &Rig) -> f64 {
    FINEST * smallest_panel_m(rig)
}

/// The longest edge that may have an end without a pixel. The renderer takes it that a piece with a corner a panel's size off the panel
/// does not meet it, so that this is half the smallest panel, and the less the flatter sight lines are to the mirror: it is seen as
/// much longer there. Where they graze it, even the finest edges are too long.
pub fn whole_edge_m(rig: &Rig) -> f64 {
    (0.5 * smallest_panel_m(rig) * flattest_sine(rig)).max(finest_edge_m(rig))
}

fn smallest_panel_m(rig: &Rig) -> f64 {
    let sizes = rig.mirror.face.iter().map(|face| face.width_m.min(face.slope_span_m[1] - face.slope_span_m[0]));
    sizes.fold(f64::INFINITY, f64::min)
}

/// The sine of the smallest angle between the mirror and a sight line of its panels; 0 where some leave it from behind.
fn flattest_sine(rig: &Rig) -> f64 {
    let faces = rig.mirror.face.iter().enumerate();
    let slices = faces.flat_map(|pair| (0..SAMPLES).map(move |sample| (pair, sample)));
    slices.fold(1.0, |flattest, ((index, face), sample)| {
        let theta = TAU * f64::from(sample) / f64::from(SAMPLES);
        let (frame, optics) = (face.frame(theta), SliceOptics::new(rig, index, theta, Model::Planar));
        let sine = |across: f64, up: f64| {
            let slope = face.slope_span_m[0] + up * (face.slope_span_m[1] - face.slope_span_m[0]);
            let mirror = face.offset_m * frame.normal + across * face.width_m * frame.across + slope * frame.slope;
            optics.sight_of(mirror).map_or(0.0, |sight| match sight.viewer {
                Viewer::At(viewer) => frame.normal.dot((viewer - mirror).normalize()),
                Viewer::Toward(direction) => frame.normal.dot(direction),
            })
        };
        let places = [-0.5, 0.0, 0.5].into_iter().flat_map(|across| [0.0, 0.5, 1.0].map(|up| sine(across, up)));
        places.fold(flattest, f64::min)
    })
}

/// The longest edge whose middle stays within `bow_px` of the middle of its ends' pixels, anywhere within `radius_m` of the
/// origin or of the panel, whichever is smaller.
///
/// The bow grows with the square of the length (18.8 px for 100 mm, 0.29 px for 12.5 mm on the reference rig), so the largest
/// of a scatter of short segments gives it, with a quarter in reserve.
pub fn edge_limit_m(rig: &Rig, model: Model, radius_m: f64, bow_px: f64) -> f64 {
    const SEGMENTS: u32 = 600;
    // Bends are in some slices only.
    let segments = if rig.viewing.tracked.is_empty() { SEGMENTS } else { 8 * SEGMENTS };
    let radius = radius_m.min(1.5 * panel_m(rig)).max(1e-6);
    let length = radius / 8.0;
    let worst = (0..segments).filter_map(|index| bow_of_segment(rig, model, index, radius, length)).fold(0.0, f64::max);
    (length * (bow_px / (1.25 * worst).max(1e-12)).sqrt()).min(whole_edge_m(rig))
}

fn bow_of_segment(rig: &Rig, model: Model, index: u32, radius: f64, length: f64) -> Option<f64> {
    let scatter = |step: f64| (f64::from(index) * step).fract();
    let middle = on_sphere(scatter(0.618_034), scatter(0.754_878)) * radius * scatter(0.569_840).cbrt();
    let half = on_sphere(scatter(0.819_173), scatter(0.671_044)) * length / 2.0;
    let slice = index.wrapping_mul(97) % rig.rotation.slices;
    let face = index as usize % rig.mirror.face.len();
    let optics = SliceOptics::new(rig, face, rig.slice_angle(slice), model);
    let [start, between, end] = [middle - half, middle, middle + half].map(|point| optics.project(point).pixel);
    Some((between? - (start? + end?) / 2.0).length())
}

/// A point of the unit sphere from two fractions, spread evenly where they are.
fn on_sphere(around: f64, along: f64) -> DVec3 {
    let height = 2.0 * along - 1.0;
    let level = (1.0 - height * height).max(0.0).sqrt();
    DVec3::new(level * (TAU * around).sin(), height, level * (TAU * around).cos())
}
