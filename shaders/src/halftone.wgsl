// The twin of halftone/mask.rs: thresholds of the masks. `ranks` holds the tiles.

struct Mask {
    kind: u32,
    side: u32,
    cells: u32,
    offset: u32,
    shift: u32,
}

const WHITE = 0u;
const TILE = 1u;
// None: luminance itself is wanted.
const GREY = 2u;

@group(0) @binding(20) var<storage, read> ranks: array<u32>;

fn rotated(value: u32, by: u32) -> u32 {
    return value << by | value >> (32u - by);
}

// The twin of `halftone::hash`.
fn mixed(a: u32, b: u32, c: u32) -> u32 {
    var bits = (a * 0x9E3779B1u) ^ rotated(b * 0x85EBCA77u, 11u) ^ (c * 0xC2B2AE3Du);
    bits = (bits ^ bits >> 16u) * 0x85EBCA6Bu;
    bits = (bits ^ bits >> 13u) * 0xC2B2AE35u;
    return bits ^ bits >> 16u;
}

fn threshold(mask: Mask, pixel: vec2u) -> f32 {
    if mask.kind == WHITE {
        return (f32(mixed(pixel.x, pixel.y, mask.shift) >> 8u) + 0.5) / 16777216.0;
    }
    // Powers of two: divisions took a third of a slice's time.
    let place = pixel & vec2u(mask.side - 1u);
    let rank = ranks[mask.offset + place.y * mask.side + place.x];
    return (f32((rank + mask.shift) & (mask.cells - 1u)) + 0.5) / f32(mask.cells);
}

// What a pixel of this luminance, 0 … 1, holds: 1 or 0, or 0 … 255 of grey.
fn halftoned(mask: Mask, pixel: vec2u, luminance: f32) -> u32 {
    if mask.kind == GREY {
        return u32(luminance * 255.0 + 0.5);
    }
    return u32(luminance > threshold(mask, pixel));
}
