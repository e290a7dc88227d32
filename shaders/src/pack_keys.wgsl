// What the rasteriser of compute shaders has drawn; dark again for the next batch.

@group(0) @binding(8) var<storage, read_write> keys: array<u32>;

// The row.
fn source_of(slot: u32) -> vec3u {
    return vec3u(0u, slot * batch.height, 0u);
}

fn shown(source: vec3u, pixel: vec2u) -> u32 {
    let place = (source.y + pixel.y) * batch.groups * 32u + pixel.x;
    let key = keys[place];
    if key != 0u {
        keys[place] = 0u;
    }
    return key & ((1u << batch.words) - 1u);
}
