// Drawn pixels to the planes of a turn, rows of whole words: pixel x is bit x mod 32 of word x div 32, or byte x mod 4 of word
// x div 4. `shown` is what was drawn at 32 pixels of a row.

@group(0) @binding(2) var<storage, read> slots: array<Mask>;
@group(0) @binding(6) var<storage, read_write> planes: array<u32>;

fn packed_bits(values: array<u32, 32>) -> u32 {
    var values_here = values;
    var word = 0u;
    for (var bit = 0u; bit < 32u; bit++) {
        word |= values_here[bit] << bit;
    }
    return word;
}

fn packed_bytes(values: array<u32, 32>, word: u32) -> u32 {
    var values_here = values;
    let first = 4u * word;
    return values_here[first] | values_here[first + 1u] << 8u
        | values_here[first + 2u] << 16u | values_here[first + 3u] << 24u;
}

@compute @workgroup_size(8, 8)
fn pack(@builtin(global_invocation_id) id: vec3u) {
    let slot = id.z;
    let row = id.y;
    let group = id.x;
    if group >= batch.groups || row >= batch.height {
        return;
    }
    let values = shown(slot, row, group);
    let first = ((slot * batch.height + row) * batch.groups + group) * batch.words;
    if slots[slot].kind != GREY {
        planes[first] = packed_bits(values);
        return;
    }
    for (var word = 0u; word < 8u; word++) {
        planes[first + word] = packed_bytes(values, word);
    }
}
