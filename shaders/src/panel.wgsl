// What the ways of drawing have in common: projected vertices, whole triangles that are left out, and pixels that are.

// What of this a scene on a rig needs. Without a branch, as software devices work, what is not needed would cost as much.
override TEXTURED = true;
override FACES = true;

@group(0) @binding(1) var<storage, read> slices: array<Slice>;
@group(0) @binding(4) var<storage, read> projected: array<Vertex>;

fn projected_corners(instance: u32, triangle: Triangle) -> array<Vertex, 3> {
    let first = instance * batch.vertices;
    return array(
        projected[first + triangle.corners.x],
        projected[first + triangle.corners.y],
        projected[first + triangle.corners.z],
    );
}

// Whether nothing of a triangle is shown: a corner has no pixel, or all lie beyond one side of the panel.
fn is_out(corners: array<Vertex, 3>) -> bool {
    let beyond = corners[0].state & corners[1].state & corners[2].state & 0xfu;
    return beyond != 0u || ((corners[0].state | corners[1].state | corners[2].state) & NOWHERE) != 0u;
}

// Whether every pixel of a triangle is on the panel and lit, since its corners are.
fn is_safe(corners: array<Vertex, 3>) -> bool {
    return (corners[0].state | corners[1].state | corners[2].state) == 0u;
}

// Whether an instance's face shows a pixel of a triangle that is safe or not, and not another face.
fn is_shown(instance: Instance, safe: bool, pixel: vec2u) -> bool {
    let centre = vec2f(pixel) + 0.5;
    if !safe && !sees(slices[instance.optics], centre) {
        return false;
    }
    if !FACES {
        return true;
    }
    let own = claim(slices[instance.optics], centre);
    for (var other = instance.first; other < instance.first + batch.faces; other++) {
        let rival = claim(slices[other], centre);
        if rival < own || (rival == own && other < instance.optics) {
            return false;
        }
    }
    return own < ELSEWHERE;
}

// Luminance, 0 … 1, at given weights of a triangle's corners.
fn luminance_at(triangle: Triangle, weights: vec3f) -> f32 {
    if TEXTURED {
        return shaded(triangle, weights);
    }
    return clamp(dot(weights, triangle.luminance), 0.0, 1.0);
}
