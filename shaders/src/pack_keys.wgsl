// What the rasteriser of compute shaders has drawn; dark again for the next batch.

@group(0) @binding(8) var<storage, read_write> keys: array<vec4u>;

fn shown(slot: u32, row: u32, group: u32) -> array<u32, 32> {
    let first = ((slot * batch.height + row) * batch.groups + group) * 8u;
    let mask = select(1u, 255u, slots[slot].kind == GREY);
    var values = array<u32, 32>();
    for (var quad = 0u; quad < 8u; quad++) {
        let here = keys[first + quad];
        if any(here != vec4u(0u)) {
            keys[first + quad] = vec4u(0u);
            for (var x = 0u; x < 4u; x++) {
                values[4u * quad + x] = here[x] & mask;
            }
        }
    }
    return values;
}
