// What the passes over a batch of slices have in common. A slot is a slice's place in the batch; an instance is a face in a slot.

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
    queue: u32,
}

@group(0) @binding(0) var<uniform> batch: Batch;
