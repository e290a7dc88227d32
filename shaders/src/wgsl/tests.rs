//! The modules are valid, and structs are laid out alike on both sides.

use super::*;
use core::mem::offset_of;
use naga::valid::{Capabilities, ValidationFlags, Validator};
use naga::{Module, TypeInner};

fn module(parts: &[&str]) -> Module {
    let text = parts.join("\n");
    let module = naga::front::wgsl::parse_str(&text).unwrap_or_else(|error| panic!("{}", error.emit_to_string(&text)));
    if let Err(error) = Validator::new(ValidationFlags::all(), Capabilities::default()).validate(&module) {
        panic!("{}", error.emit_to_string(&text));
    }
    module
}

#[test]
fn every_module_is_valid() {
    module(&[HALFTONE, BATCH, PROJECT, VERTICES]);
    module(&[HALFTONE, BATCH, PROJECT, SHADE, PANEL, DRAW]);
    module(&[HALFTONE, BATCH, PROJECT, SHADE, PANEL, RASTER]);
    module(&[HALFTONE, BATCH, PACK, PACK_TARGET]);
    module(&[HALFTONE, BATCH, PACK, PACK_KEYS]);
}

/// Name and offset of a struct's fields in WGSL, and its size.
fn layout(module: &Module, name: &str) -> (Vec<(String, usize)>, usize) {
    let found = module.types.iter().find(|(_, ty)| ty.name.as_deref() == Some(name)).expect(name).1;
    let TypeInner::Struct { members, span } = &found.inner else { panic!("{name} is no struct") };
    let fields = members.iter().map(|member| (member.name.clone().unwrap_or_default(), member.offset as usize));
    (fields.collect(), *span as usize)
}

macro_rules! same {
    ($module:expr, $type:ident { $($field:ident),* $(,)? }) => {
        let fields = vec![$((stringify!($field).to_string(), offset_of!($type, $field))),*];
        // Names every field, or does not compile.
        let $type { $($field: _),* } = <$type as bytemuck::Zeroable>::zeroed();
        assert_eq!(layout($module, stringify!($type)), (fields, size_of::<$type>()));
    };
}

#[test]
fn structs_are_laid_out_alike() {
    let all = module(&[HALFTONE, BATCH, PROJECT, SHADE]);
    same!(
        &all,
        Slice {
            azimuth,
            tilt,
            projector,
            offset,
            image,
            image_squared,
            near,
            circle,
            half_width,
            slope_span,
            guard,
            reach_squared,
            pixel_u,
            grazing,
            pixel_v,
            settled,
            pixel_w,
            lit,
            mirror_across,
            bends,
            mirror_slope,
            passing,
            mirror_w,
            fold_squared,
            principal,
            focal,
            radial,
            bends_from,
            bend,
        }
    );
    same!(&all, Vertex { pixel, depth, state });
    same!(&all, Mask { kind, side, cells, offset, shift });
    same!(&all, Instance { mask, slot, optics, first, cell });
    same!(&all, Triangle { corners, surface, luminance, unused });
    same!(&all, Surface { a, b, c, v, picture });
    same!(&all, Picture { offset, width, height, wrap });
    same!(&all, Batch { faces, vertices, triangles, width, height, groups, words, columns, rows, depth_scale });
}
