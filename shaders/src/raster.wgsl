// A rasteriser of compute shaders. A pixel's key is nearness, then what is shown there: one atomic maximum is depth test and write.
// Positions are fixed point, 1/256 pixel; edge functions are exact integers with the CPU's top-left rule.

@group(0) @binding(8) var<storage, read_write> keys: array<atomic<u32>>;
@group(0) @binding(9) var<storage, read_write> queued: atomic<u32>;
// Instance, triangle, and column and row of a tile, for what is too large for one invocation.
@group(0) @binding(10) var<storage, read_write> queue: array<vec4u>;

const FIXED = 256.0;
// Pixels of the largest box that one invocation fills by itself, and its longest side.
const SMALL_PX = 256;
const SMALL_SIDE = 64;
// Columns and rows of a tile.
const TILE_SIDE = 64;
// Where an edge function is held; a tile's steps stay below half of it.
const BEYOND = 0x40000000;

// A 64-bit integer: low word, high word.
fn product(a: i32, b: i32) -> vec2u {
    let x = u32(abs(a));
    let y = u32(abs(b));
    let low = (x & 0xffffu) * (y & 0xffffu);
    let across = (x & 0xffffu) * (y >> 16u);
    let along = (x >> 16u) * (y & 0xffffu);
    let middle = (low >> 16u) + (across & 0xffffu) + (along & 0xffffu);
    let high = (x >> 16u) * (y >> 16u) + (across >> 16u) + (along >> 16u) + (middle >> 16u);
    let size = vec2u((low & 0xffffu) | middle << 16u, high);
    return select(size, minus(vec2u(0u), size), (a < 0) != (b < 0));
}

fn minus(a: vec2u, b: vec2u) -> vec2u {
    return vec2u(a.x - b.x, a.y - b.y - u32(a.x < b.x));
}

// a × b, exactly.
fn crossed(a: vec2i, b: vec2i) -> vec2u {
    return minus(product(a.x, b.y), product(a.y, b.x));
}

// An edge function over 256, rounded down and held within what a tile's steps cannot leave.
fn held(value: vec2u) -> i32 {
    let high = bitcast<i32>(value.y);
    if high >= 64 {
        return BEYOND;
    }
    if high < -64 {
        return -BEYOND;
    }
    return bitcast<i32>(value.y << 24u | value.x >> 8u);
}

struct Corner {
    at: vec2i,
    depth: f32,
}

struct Drawn {
    instance: u32,
    triangle: u32,
    // The order in which the corners go around clockwise, as the image is seen.
    swapped: bool,
    safe: bool,
    a: Corner,
    b: Corner,
    c: Corner,
    inverse_area: f32,
    // Columns and rows, the last not included; empty where nothing is shown.
    low: vec2i,
    high: vec2i,
}

fn corner_of(vertex: Vertex) -> Corner {
    return Corner(vec2i(round(vertex.pixel * FIXED)), vertex.depth);
}

fn set_up(instance: u32, triangle: u32) -> Drawn {
    let corners = projected_corners(instance, triangles[triangle]);
    var drawn = Drawn();
    if is_out(corners) {
        return drawn;
    }
    let a = corner_of(corners[0]);
    var b = corner_of(corners[1]);
    var c = corner_of(corners[2]);
    let least = min(a.at, min(b.at, c.at));
    let most = max(a.at, max(b.at, c.at));
    let low = max((least + 127) >> vec2u(8u), vec2i(0));
    let high = min(((most + 128) >> vec2u(8u)), vec2i(i32(batch.width), i32(batch.height)));
    if any(low >= high) {
        return drawn;
    }
    let area = crossed(b.at - a.at, c.at - a.at);
    if all(area == vec2u(0u)) {
        return drawn;
    }
    drawn.swapped = bitcast<i32>(area.y) < 0;
    let size = select(area, minus(vec2u(0u), area), drawn.swapped);
    drawn.instance = instance;
    drawn.triangle = triangle;
    drawn.safe = is_safe(corners);
    drawn.a = a;
    if drawn.swapped {
        drawn.b = c;
        drawn.c = b;
    } else {
        drawn.b = b;
        drawn.c = c;
    }
    drawn.inverse_area = FIXED * FIXED / (f32(size.y) * 4294967296.0 + f32(size.x));
    drawn.low = low;
    drawn.high = high;
    return drawn;
}

// The edge function at a pixel's centre over 256, rounded down: not below 0 for what is inside.
fn edge_at(start: vec2i, end: vec2i, pixel: vec2i) -> i32 {
    let along = end - start;
    let owned = along.y < 0 || (along.y == 0 && along.x > 0);
    return held(minus(crossed(along, pixel * 256 + 128 - start), vec2u(u32(!owned), 0u)));
}

fn edges_at(drawn: Drawn, pixel: vec2i) -> vec3i {
    return vec3i(
        edge_at(drawn.b.at, drawn.c.at, pixel),
        edge_at(drawn.c.at, drawn.a.at, pixel),
        edge_at(drawn.a.at, drawn.b.at, pixel),
    );
}

// What a step to the right, and one down, adds to the edge functions.
fn step_across(drawn: Drawn) -> vec3i {
    return vec3i(drawn.b.at.y - drawn.c.at.y, drawn.c.at.y - drawn.a.at.y, drawn.a.at.y - drawn.b.at.y);
}

fn step_down(drawn: Drawn) -> vec3i {
    return vec3i(drawn.c.at.x - drawn.b.at.x, drawn.a.at.x - drawn.c.at.x, drawn.b.at.x - drawn.a.at.x);
}

fn put(drawn: Drawn, pixel: vec2i) {
    let arm = vec2f(pixel * 256 + 128 - drawn.a.at) / FIXED;
    let ab = vec2f(drawn.b.at - drawn.a.at) / FIXED;
    let ac = vec2f(drawn.c.at - drawn.a.at) / FIXED;
    let b = clamp((arm.x * ac.y - arm.y * ac.x) * drawn.inverse_area, 0.0, 1.0);
    let c = clamp((ab.x * arm.y - ab.y * arm.x) * drawn.inverse_area, 0.0, 1.0 - b);
    let depth = drawn.a.depth + b * (drawn.b.depth - drawn.a.depth) + c * (drawn.c.depth - drawn.a.depth);
    let slot = drawn.instance / batch.faces;
    let mask = slots[slot];
    let bits = select(1u, 8u, mask.kind == GREY);
    let nearness = u32((0.5 - depth * batch.depth_scale) * f32(0xffffff00u >> bits)) << bits;
    let place = (slot * batch.height + u32(pixel.y)) * batch.groups * 32u + u32(pixel.x);
    if atomicLoad(&keys[place]) >= (nearness | ((1u << bits) - 1u)) {
        return;
    }
    let centre = vec2u(pixel);
    if (!drawn.safe || batch.faces > 1u) && !is_shown(drawn.instance, drawn.safe, centre) {
        return;
    }
    let weights = select(vec3f(1.0 - b - c, b, c), vec3f(1.0 - b - c, c, b), drawn.swapped);
    atomicMax(&keys[place], nearness | halftoned(mask, centre, shaded(triangles[drawn.triangle], weights)));
}

fn fill_column(drawn: Drawn, column: i32, rows: vec2i) {
    var edges = edges_at(drawn, vec2i(column, rows.x));
    let down = step_down(drawn);
    for (var y = rows.x; y < rows.y; y++) {
        if all(edges >= vec3i(0)) {
            put(drawn, vec2i(column, y));
        }
        edges += down;
    }
}

fn fill_box(drawn: Drawn) {
    var starts = edges_at(drawn, drawn.low);
    let across = step_across(drawn);
    let down = step_down(drawn);
    for (var y = drawn.low.y; y < drawn.high.y; y++) {
        var edges = starts;
        for (var x = drawn.low.x; x < drawn.high.x; x++) {
            if all(edges >= vec3i(0)) {
                put(drawn, vec2i(x, y));
            }
            edges += across;
        }
        starts += down;
    }
}

fn tile_rows(drawn: Drawn, tile: vec2i) -> vec2i {
    return vec2i(max(drawn.low.y, tile.y * TILE_SIDE), min(drawn.high.y, (tile.y + 1) * TILE_SIDE));
}

// Whether a tile lies wholly outside an edge.
fn misses(drawn: Drawn, tile: vec2i) -> bool {
    let edges = edges_at(drawn, tile * TILE_SIDE);
    let across = max(step_across(drawn), vec3i(0)) * (TILE_SIDE - 1);
    let down = max(step_down(drawn), vec3i(0)) * (TILE_SIDE - 1);
    return any(edges + across + down < vec3i(0));
}

fn enqueue(drawn: Drawn) {
    let first = drawn.low / TILE_SIDE;
    let last = (drawn.high - 1) / TILE_SIDE;
    for (var row = first.y; row <= last.y; row++) {
        for (var column = first.x; column <= last.x; column++) {
            let tile = vec2i(column, row);
            if misses(drawn, tile) {
                continue;
            }
            let place = atomicAdd(&queued, 1u);
            if place < batch.queue {
                queue[place] = vec4u(drawn.instance, drawn.triangle, vec2u(tile));
                continue;
            }
            let rows = tile_rows(drawn, tile);
            for (var x = max(drawn.low.x, column * TILE_SIDE); x < min(drawn.high.x, (column + 1) * TILE_SIDE); x++) {
                fill_column(drawn, x, rows);
            }
        }
    }
}

@compute @workgroup_size(64)
fn fill_small(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let triangle = id.x + id.y * groups.x * 64u;
    if triangle >= batch.triangles {
        return;
    }
    let drawn = set_up(id.z, triangle);
    let size = drawn.high - drawn.low;
    if all(size <= vec2i(SMALL_SIDE)) && size.x * size.y <= SMALL_PX {
        fill_box(drawn);
    } else {
        enqueue(drawn);
    }
}

@compute @workgroup_size(64)
fn fill_large(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    let count = min(atomicLoad(&queued), batch.queue);
    for (var item = group.x; item < count; item += groups.x) {
        let entry = queue[item];
        let drawn = set_up(entry.x, entry.y);
        let tile = vec2i(entry.zw);
        let column = tile.x * TILE_SIDE + i32(lane);
        if drawn.low.x <= column && column < drawn.high.x {
            fill_column(drawn, column, tile_rows(drawn, tile));
        }
    }
}
