// What raster hardware has drawn.

@group(0) @binding(7) var drawn: texture_2d_array<f32>;

fn shown(slot: u32, pixel: vec2u) -> u32 {
    if pixel.x >= batch.width {
        return 0u;
    }
    let cells = batch.columns * batch.rows;
    let cell = vec2u(slot % cells % batch.columns * batch.width, slot % cells / batch.columns * batch.height);
    return u32(textureLoad(drawn, cell + pixel, slot / cells, 0).r * f32((1u << batch.words) - 1u) + 0.5);
}
