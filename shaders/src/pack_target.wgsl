// What raster hardware has drawn.

@group(0) @binding(7) var drawn: texture_2d_array<f32>;

// Column, row and layer.
fn source_of(slot: u32) -> vec3u {
    let cells = batch.columns * batch.rows;
    let cell = slot % cells;
    return vec3u(cell % batch.columns * batch.width, cell / batch.columns * batch.height, slot / cells);
}

fn shown(source: vec3u, pixel: vec2u) -> u32 {
    if pixel.x >= batch.width {
        return 0u;
    }
    return u32(textureLoad(drawn, source.xy + pixel, source.z, 0).r * f32((1u << batch.words) - 1u) + 0.5);
}
