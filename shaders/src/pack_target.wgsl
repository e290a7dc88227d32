// What raster hardware has drawn.

@group(0) @binding(7) var drawn: texture_2d_array<f32>;

fn shown(slot: u32, row: u32, group: u32) -> array<u32, 32> {
    let cells = batch.columns * batch.rows;
    let cell = vec2u(slot % cells % batch.columns * batch.width, slot % cells / batch.columns * batch.height);
    let scale = select(1.0, 255.0, slots[slot].kind == GREY);
    let count = min(32u, batch.width - 32u * group);
    var values = array<u32, 32>();
    for (var x = 0u; x < count; x++) {
        let place = cell + vec2u(32u * group + x, row);
        values[x] = u32(textureLoad(drawn, place, slot / cells, 0).r * scale + 0.5);
    }
    return values;
}
