// Slices by raster hardware, one or more of them in a layer of the target.

// What is the same all over a triangle is handed on, not looked up pixel by pixel.
struct Corner {
    @builtin(position) position: vec4f,
    @location(0) @interpolate(linear) luminance: f32,
    @location(1) @interpolate(linear) weights: vec3f,
    @location(2) @interpolate(flat) triangle: u32,
    @location(3) @interpolate(flat) instance: u32,
    @location(4) @interpolate(flat) safe: u32,
    @location(5) @interpolate(flat) cell: vec2u,
    @location(6) @interpolate(flat) tile: vec4u,
    @location(7) @interpolate(flat) noise: vec2u,
}

@vertex
fn draw_vertex(@builtin(vertex_index) index: u32, @builtin(instance_index) number: u32) -> Corner {
    let triangle = triangles[index / 3u];
    let instance = instances[number];
    let corners = projected_corners(number, triangle);
    let low = min(corners[0].pixel, min(corners[1].pixel, corners[2].pixel));
    let high = max(corners[0].pixel, max(corners[1].pixel, corners[2].pixel));
    let size = vec2f(f32(batch.width), f32(batch.height));
    let is_own = vec3u(0u, 1u, 2u) == vec3u(index % 3u);
    let weights = select(vec3f(0.0), vec3f(1.0), is_own);
    var own = corners[0];
    if is_own.y {
        own = corners[1];
    }
    if is_own.z {
        own = corners[2];
    }
    let cell = vec2u(instance.cell & 0xffffu, instance.cell >> 16u);
    let target_size = vec2f(f32(batch.columns), f32(batch.rows)) * size;
    let place = (vec2f(cell) + own.pixel) / target_size;
    var position = vec4f(2.0 * place.x - 1.0, 1.0 - 2.0 * place.y, 0.5 + own.depth * batch.depth_scale, 1.0);
    if is_out(corners) || any(high < vec2f(0.0)) || any(low > size) {
        position = vec4f(2.0, 2.0, 2.0, 1.0);
    }
    let mask = instance.mask;
    return Corner(
        position,
        dot(weights, triangle.luminance),
        weights,
        index / 3u,
        number,
        u32(is_safe(corners)),
        cell,
        vec4u(mask.side, mask.cells, mask.offset, mask.shift),
        vec2u(mask.kind, mask.slice),
    );
}

@fragment
fn draw_fragment(corner: Corner) -> @location(0) f32 {
    // Left of and above its cell it wraps to large numbers.
    let pixel = vec2u(corner.position.xy) - corner.cell;
    if pixel.x >= batch.width || pixel.y >= batch.height {
        discard;
    }
    let safe = corner.safe != 0u;
    if (!safe || FACES) && !is_shown(instances[corner.instance], safe, pixel) {
        discard;
    }
    var luminance = clamp(corner.luminance, 0.0, 1.0);
    if TEXTURED {
        luminance = luminance_at(triangles[corner.triangle], corner.weights);
    }
    let tile = corner.tile;
    let mask = Mask(corner.noise.y, corner.noise.x, tile.x, tile.y, tile.z, tile.w);
    return f32(halftoned(mask, pixel, luminance)) * select(1.0, 1.0 / 255.0, mask.kind == GREY);
}
