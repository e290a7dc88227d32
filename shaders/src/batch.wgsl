// What the passes over a batch of slices have in common. A slot is a slice's place in the batch; an instance is a face in a slot.

struct Instance {
    mask: Mask,
    slot: u32,
    // Of `slices`: its own, and its slice's first face.
    optics: u32,
    first: u32,
    // Where its slot begins in the target, columns then rows in the upper half.
    cell: u32,
}

struct Batch {
    faces: u32,
    vertices: u32,
    triangles: u32,
    width: u32,
    height: u32,
    // Groups of 32 pixels in a row, and words that hold each, which are the bits of a pixel.
    groups: u32,
    words: u32,
    // Slots side by side and below each other in a layer of the target.
    columns: u32,
    rows: u32,
    // Depth times this is within ±½.
    depth_scale: f32,
}

@group(0) @binding(0) var<uniform> batch: Batch;
@group(0) @binding(2) var<storage, read> instances: array<Instance>;
