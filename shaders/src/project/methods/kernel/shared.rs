//! A slice as its WGSL twin reads it.

use super::bent::Bent;
use super::{Line, Method, SliceProjector};
use crate::wgsl::{BENDS, Slice};

/// Points across and along the slope at which the panel is tried.
const GRID: u8 = 9;
/// How high above the mirror, over the circle's distance, a viewer must be so that none nearby is behind it.
const CLEARLY_LIT: f32 = 0.05;

impl SliceProjector<f32> {
    /// Whether a sight line of the panel or its guard band may lead to a viewer behind the mirror.
    pub fn may_be_unlit(&self) -> bool {
        let [low, high] = self.slope_span;
        let along = |low: f32, high: f32, step: u8| low + (high - low) * f32::from(step) / f32::from(GRID - 1);
        let edge = self.half_width + self.guard;
        let mut mirrors = (0..GRID * GRID)
            .map(|cell| [along(-edge, edge, cell % GRID), along(low - self.guard, high + self.guard, cell / GRID)]);
        mirrors.any(|mirror| {
            let place = self.place_on_panel(mirror);
            let line = self.planar(&place).and_then(|planar| self.follow(&place, planar));
            let [sin, cos] = self.tilt;
            let clearly = |line: Line<f32>| {
                let above = sin * line.viewer[1] + cos * line.height - self.near * self.offset;
                self.is_lit(&line) && above > CLEARLY_LIT * line.from_origin
            };
            !line.is_some_and(clearly)
        })
    }

    /// For `project.wgsl`. Tables are not handed on: the twin takes Newton's steps.
    pub fn shared(&self) -> Slice {
        let lens = self.lens.as_ref();
        let settled = match self.method {
            Method::ConeRoot => self.root_settled(),
            _ => self.settled,
        };
        Slice {
            azimuth: self.azimuth,
            tilt: self.tilt,
            projector: self.projector,
            offset: self.offset,
            image: self.image,
            image_squared: self.image_squared,
            near: self.near,
            circle: self.circle,
            half_width: self.half_width,
            slope_span: self.slope_span,
            guard: self.guard,
            reach_squared: self.reach_squared,
            pixel_u: self.pixels[0],
            grazing: self.bent.as_ref().map_or(self.grazing, |bent| bent.grazing).min(f32::MAX),
            pixel_v: self.pixels[1],
            settled,
            pixel_w: self.pixels[2],
            lit: u32::from(self.exact.projector_is_above),
            mirror_across: self.mirrors[0],
            bends: self.bent.as_ref().map_or(0, Bent::count),
            mirror_slope: self.mirrors[1],
            passing: self.bent.as_ref().map_or(0.0, |bent| bent.passing),
            mirror_w: self.mirrors[2],
            fold_squared: lens.map_or(f32::MAX, |lens| lens.fold_squared.min(f32::MAX)),
            principal: lens.map_or([0.0; 2], |lens| lens.principal),
            focal: lens.map_or([1.0; 2], |lens| lens.focal),
            radial: lens.map_or([0.0; 2], |lens| lens.radial),
            bends_from: self.bent.as_ref().map_or([0.0; 2], |bent| bent.from),
            bend: self.bent.as_ref().map_or([[0.0; 4]; BENDS], Bent::shared),
        }
    }
}
