// A rasteriser of compute shaders. A pixel's key is nearness, then what is shown there: one atomic maximum is depth test and write.
// Positions are fixed point, 1/256 pixel; edge functions are exact integers with the CPU's top-left rule.

@group(0) @binding(8) var<storage, read_write> keys: array<atomic<u32>>;
@group(0) @binding(9) var<storage, read_write> queued: atomic<u32>;
// Instance and triangle of what is too large for one invocation.
@group(0) @binding(10) var<storage, read_write> queue: array<vec2u>;

const FIXED = 256.0;
// Pixels of the largest box that one invocation fills by itself, and its longest side.
const SMALL_PX = 4096;
const SMALL_SIDE = 64;
// Columns and rows of a tile, and how many workgroups share a large triangle's tiles.
const TILE_SIDE = 64;
const SHARES = 16;
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
    number: u32,
    triangle: u32,
    safe: bool,
    a: Corner,
    b: Corner,
    c: Corner,
    // Of the pixels' box: columns and rows, the last not included; empty where nothing is shown.
    low: vec2i,
    high: vec2i,
}

fn corner_of(vertex: Vertex) -> Corner {
    return Corner(vec2i(round(vertex.pixel * FIXED)), vertex.depth);
}

fn set_up(number: u32, triangle: u32) -> Drawn {
    let corners = projected_corners(number, triangles[triangle]);
    let a = corner_of(corners[0]);
    let b = corner_of(corners[1]);
    let c = corner_of(corners[2]);
    let least = min(a.at, min(b.at, c.at));
    let most = max(a.at, max(b.at, c.at));
    let low = max((least + 127) >> vec2u(8u), vec2i(0));
    var high = min((most + 128) >> vec2u(8u), vec2i(i32(batch.width), i32(batch.height)));
    if is_out(corners) {
        high = low;
    }
    return Drawn(number, triangle, is_safe(corners), a, b, c, low, high);
}

// 1 where an edge's border belongs to its neighbour: the CPU's top-left rule.
fn bias(along: vec2i) -> i32 {
    return i32(!(along.y < 0 || (along.y == 0 && along.x > 0)));
}

// 1 for corners clockwise as the image is seen, -1 for the other way, 0 for what has no area.
fn sense(drawn: Drawn) -> i32 {
    let area = crossed(drawn.b.at - drawn.a.at, drawn.c.at - drawn.a.at);
    return select(select(1, 0, all(area == vec2u(0u))), -1, bitcast<i32>(area.y) < 0);
}

// The edge function at a pixel's centre over 256, rounded down: not below 0 for what is inside.
fn edge_at(start: vec2i, end: vec2i, pixel: vec2i) -> i32 {
    let along = end - start;
    return held(minus(crossed(along, pixel * 256 + 128 - start), vec2u(u32(bias(along)), 0u)));
}

fn put(drawn: Drawn, instance: Instance, pixel: vec2i) {
    let arm = vec2f(pixel * 256 + 128 - drawn.a.at) / FIXED;
    let ab = vec2f(drawn.b.at - drawn.a.at) / FIXED;
    let ac = vec2f(drawn.c.at - drawn.a.at) / FIXED;
    let area = ab.x * ac.y - ab.y * ac.x;
    let b = clamp((arm.x * ac.y - arm.y * ac.x) / area, 0.0, 1.0);
    let c = clamp((ab.x * arm.y - ab.y * arm.x) / area, 0.0, 1.0 - b);
    let depth = drawn.a.depth + b * (drawn.b.depth - drawn.a.depth) + c * (drawn.c.depth - drawn.a.depth);
    let bits = batch.words;
    let nearness = u32((0.5 - depth * batch.depth_scale) * f32(0xffffff00u >> bits)) << bits;
    let place = (instance.slot * batch.height + u32(pixel.y)) * batch.groups * 32u + u32(pixel.x);
    if atomicLoad(&keys[place]) >= (nearness | ((1u << bits) - 1u)) {
        return;
    }
    let centre = vec2u(pixel);
    if (!drawn.safe || FACES) && !is_shown(instance, drawn.safe, centre) {
        return;
    }
    let luminance = luminance_at(triangles[drawn.triangle], vec3f(1.0 - b - c, b, c));
    atomicMax(&keys[place], nearness | halftoned(instance.mask, centre, luminance));
}

@compute @workgroup_size(64)
fn fill_small(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let triangle = id.x + id.y * groups.x * 64u;
    if triangle >= batch.triangles {
        return;
    }
    let drawn = set_up(id.z, triangle);
    let size = drawn.high - drawn.low;
    if any(size <= vec2i(0)) {
        return;
    }
    let extent = max(max(drawn.a.at, drawn.b.at), drawn.c.at) - min(min(drawn.a.at, drawn.b.at), drawn.c.at);
    if any(extent > vec2i(SMALL_SIDE * 256)) || size.x * size.y > SMALL_PX {
        queue[atomicAdd(&queued, 1u)] = vec2u(id.z, triangle);
        return;
    }
    // All products stay below 2^29: 32 bits are exact.
    let ab = drawn.b.at - drawn.a.at;
    let ac = drawn.c.at - drawn.a.at;
    let sign = sign(ab.x * ac.y - ab.y * ac.x);
    if sign == 0 {
        return;
    }
    let across = sign * vec3i(ac.y - ab.y, -ac.y, ab.y);
    let down = sign * vec3i(ac.x - ab.x, -ac.x, ab.x);
    let corner = drawn.low * 256 + 128;
    let at_a = corner - drawn.a.at;
    let at_b = corner - drawn.b.at;
    let biases = vec3i(bias(vec2i(down.x, across.x)), bias(vec2i(down.y, across.y)), bias(vec2i(down.z, across.z)));
    var starts = (down * vec3i(at_b.y, at_a.y, at_a.y) - across * vec3i(at_b.x, at_a.x, at_a.x) - biases) >> vec3u(8u);
    let instance = instances[id.z];
    // First on to the next pixel inside, then that: so the invocations of a group, whose boxes differ, are at it together.
    var pixel = vec2i(drawn.low.x - 1, drawn.low.y);
    var edges = starts + across;
    loop {
        loop {
            pixel.x += 1;
            edges -= across;
            if pixel.x >= drawn.high.x {
                pixel = vec2i(drawn.low.x, pixel.y + 1);
                starts += down;
                edges = starts;
            }
            if pixel.y >= drawn.high.y || all(edges >= vec3i(0)) {
                break;
            }
        }
        if pixel.y >= drawn.high.y {
            break;
        }
        put(drawn, instance, pixel);
    }
}

// The column of a tile of a triangle whose corners go around clockwise.
fn fill_column(drawn: Drawn, instance: Instance, sense: i32, column: i32, rows: vec2i) {
    let pixel = vec2i(column, rows.x);
    let b = select(drawn.c.at, drawn.b.at, sense > 0);
    let c = select(drawn.b.at, drawn.c.at, sense > 0);
    let a = drawn.a.at;
    var edges = vec3i(edge_at(b, c, pixel), edge_at(c, a, pixel), edge_at(a, b, pixel));
    let down = vec3i(c.x - b.x, a.x - c.x, b.x - a.x);
    for (var y = rows.x; y < rows.y; y++) {
        if all(edges >= vec3i(0)) {
            put(drawn, instance, vec2i(column, y));
        }
        edges += down;
    }
}

@compute @workgroup_size(64)
fn fill_large(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    let count = atomicLoad(&queued);
    for (var item = group.x; item < count; item += groups.x) {
        let drawn = set_up(queue[item].x, queue[item].y);
        let sense = sense(drawn);
        if sense == 0 {
            continue;
        }
        let instance = instances[drawn.number];
        let tiles = (drawn.high - drawn.low + TILE_SIDE - 1) / TILE_SIDE;
        for (var tile = i32(group.y); tile < tiles.x * tiles.y; tile += SHARES) {
            let corner = drawn.low + TILE_SIDE * vec2i(tile % tiles.x, tile / tiles.x);
            let column = corner.x + i32(lane);
            if column < drawn.high.x {
                let rows = vec2i(corner.y, min(corner.y + TILE_SIDE, drawn.high.y));
                fill_column(drawn, instance, sense, column, rows);
            }
        }
    }
}
