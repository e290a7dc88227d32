// What the ways of drawing have in common: projected vertices, whole triangles that are left out, and pixels that are.

@group(0) @binding(1) var<storage, read> slices: array<Slice>;
@group(0) @binding(2) var<storage, read> slots: array<Mask>;
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
fn is_shown(instance: u32, safe: bool, pixel: vec2u) -> bool {
    let centre = vec2f(pixel) + 0.5;
    let first = slots[instance / batch.faces].slice * batch.faces;
    let face = instance % batch.faces;
    if !safe && !sees(slices[first + face], centre) {
        return false;
    }
    if batch.faces == 1u {
        return true;
    }
    let own = claim(slices[first + face], centre);
    for (var other = 0u; other < batch.faces; other++) {
        let rival = claim(slices[first + other], centre);
        if rival < own || (rival == own && other < face) {
            return false;
        }
    }
    return own < ELSEWHERE;
}
