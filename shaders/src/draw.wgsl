// Slices by raster hardware, one or more of them in a layer of the target.

// What is the same all over a triangle is handed on, not looked up pixel by pixel; few and full, since each costs a triangle's set-up.
struct Corner {
    @builtin(position) position: vec4f,
    // Weights of the corners, and luminance without a texture.
    @location(0) @interpolate(linear) shade: vec4f,
    // Triangle, instance, cell, and the mask's kind and whether the triangle is safe.
    @location(1) @interpolate(flat) place: vec4u,
    // The rest of the mask.
    @location(2) @interpolate(flat) tile: vec4u,
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
        vec4f(weights, dot(weights, triangle.luminance)),
        vec4u(index / 3u, number, instance.cell, mask.kind << 1u | u32(is_safe(corners))),
        vec4u(mask.side, mask.cells, mask.offset, mask.shift),
    );
}

@fragment
fn draw_fragment(corner: Corner) -> @location(0) f32 {
    let place = corner.place;
    // Left of and above its cell it wraps to large numbers.
    let pixel = vec2u(corner.position.xy) - vec2u(place.z & 0xffffu, place.z >> 16u);
    if pixel.x >= batch.width || pixel.y >= batch.height {
        discard;
    }
    let safe = (place.w & 1u) != 0u;
    if (!safe || FACES) && !is_shown(instances[place.y], safe, pixel) {
        discard;
    }
    var luminance = clamp(corner.shade.w, 0.0, 1.0);
    if TEXTURED {
        luminance = luminance_at(triangles[place.x], corner.shade.xyz);
    }
    let tile = corner.tile;
    let mask = Mask(place.w >> 1u, tile.x, tile.y, tile.z, tile.w);
    return f32(halftoned(mask, pixel, luminance)) * select(1.0, 1.0 / 255.0, mask.kind == GREY);
}
