// Drawn pixels to the planes of a turn, rows of whole words: pixel x is bit x mod 32 of word x div 32, or byte x mod 4 of word
// x div 4. `source_of` is where a slot was drawn, and `shown` what was drawn at a pixel there.

@group(0) @binding(6) var<storage, read_write> planes: array<u32>;

@compute @workgroup_size(8, 8)
fn pack(@builtin(global_invocation_id) id: vec3u) {
    let slot = id.z;
    let row = id.y;
    let words = batch.groups * batch.words;
    if id.x >= words || row >= batch.height {
        return;
    }
    let bits = batch.words;
    let pixels = 32u / bits;
    let first = id.x * pixels;
    let source = source_of(slot);
    var word = 0u;
    for (var x = 0u; x < pixels; x++) {
        word |= shown(source, vec2u(first + x, row)) << (bits * x);
    }
    planes[(slot * batch.height + row) * words + id.x] = word;
}
