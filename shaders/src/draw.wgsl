// Slices by raster hardware, one or more of them in a layer of the target.

struct Corner {
    @builtin(position) position: vec4f,
    @location(0) @interpolate(linear) weights: vec3f,
    @location(1) @interpolate(flat) triangle: u32,
    @location(2) @interpolate(flat) instance: u32,
    @location(3) @interpolate(flat) safe: u32,
}

fn cell_of(slot: u32) -> vec2u {
    let cell = slot % (batch.columns * batch.rows);
    return vec2u(cell % batch.columns * batch.width, cell / batch.columns * batch.height);
}

@vertex
fn draw_vertex(@builtin(vertex_index) index: u32, @builtin(instance_index) instance: u32) -> Corner {
    let triangle = index / 3u;
    let corners = projected_corners(instance, triangles[triangle]);
    let low = min(corners[0].pixel, min(corners[1].pixel, corners[2].pixel));
    let high = max(corners[0].pixel, max(corners[1].pixel, corners[2].pixel));
    let size = vec2f(f32(batch.width), f32(batch.height));
    if is_out(corners) || any(high < vec2f(0.0)) || any(low > size) {
        return Corner(vec4f(2.0, 2.0, 2.0, 1.0), vec3f(0.0), triangle, instance, 0u);
    }
    let own = projected[instance * batch.vertices + triangles[triangle].corners[index % 3u]];
    let target_size = vec2f(f32(batch.columns * batch.width), f32(batch.rows * batch.height));
    let place = (vec2f(cell_of(instance / batch.faces)) + own.pixel) / target_size;
    return Corner(
        vec4f(2.0 * place.x - 1.0, 1.0 - 2.0 * place.y, 0.5 + own.depth * batch.depth_scale, 1.0),
        select(vec3f(0.0), vec3f(1.0), vec3u(0u, 1u, 2u) == vec3u(index % 3u)),
        triangle,
        instance,
        u32(is_safe(corners)),
    );
}

@fragment
fn draw_fragment(corner: Corner) -> @location(0) f32 {
    let slot = corner.instance / batch.faces;
    // Left of and above its cell it wraps to large numbers.
    let pixel = vec2u(corner.position.xy) - cell_of(slot);
    if pixel.x >= batch.width || pixel.y >= batch.height {
        discard;
    }
    if (corner.safe == 0u || batch.faces > 1u) && !is_shown(corner.instance, corner.safe != 0u, pixel) {
        discard;
    }
    let mask = slots[slot];
    let value = halftoned(mask, pixel, shaded(triangles[corner.triangle], corner.weights));
    return f32(value) * select(1.0, 1.0 / 255.0, mask.kind == GREY);
}
