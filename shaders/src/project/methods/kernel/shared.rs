//! A slice as its WGSL twin reads it.

use super::{Method, SliceProjector};
use crate::wgsl::Slice;

impl SliceProjector<f32> {
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
            grazing: self.grazing.min(f32::MAX),
            pixel_v: self.pixels[1],
            settled,
            pixel_w: self.pixels[2],
            lit: u32::from(self.exact.projector_is_above),
            mirror_across: self.mirrors[0],
            cone: u32::from(self.method != Method::Planar),
            mirror_slope: self.mirrors[1],
            lens: u32::from(lens.is_some()),
            mirror_w: self.mirrors[2],
            fold_squared: lens.map_or(f32::MAX, |lens| lens.fold_squared.min(f32::MAX)),
            principal: lens.map_or([0.0; 2], |lens| lens.principal),
            focal: lens.map_or([1.0; 2], |lens| lens.focal),
            radial: lens.map_or([0.0; 2], |lens| lens.radial),
            unused: [0.0; 2],
        }
    }
}
