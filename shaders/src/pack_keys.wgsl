// What the rasteriser of compute shaders has drawn; dark again for the next batch.

@group(0) @binding(8) var<storage, read_write> keys: array<u32>;

fn shown(slot: u32, pixel: vec2u) -> u32 {
    let place = (slot * batch.height + pixel.y) * batch.groups * 32u + pixel.x;
    let key = keys[place];
    if key != 0u {
        keys[place] = 0u;
    }
    return key & ((1u << batch.words) - 1u);
}
