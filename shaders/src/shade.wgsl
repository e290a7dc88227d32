// What leaves a triangle: the twin of the host's `shade` and `Texture::sample`.

struct Triangle {
    corners: vec3u,
    surface: u32,
    luminance: vec3f,
    unused: u32,
}

// Radiance and u of the corners, then v.
struct Surface {
    a: vec4f,
    b: vec4f,
    c: vec4f,
    v: vec3f,
    picture: u32,
}

struct Picture {
    offset: u32,
    width: u32,
    height: u32,
    wrap: u32,
}

const NONE = 0xffffffffu;
const REPEAT = 0u;
const MIRROR = 1u;
const CLAMP = 2u;

@group(0) @binding(21) var<storage, read> triangles: array<Triangle>;
@group(0) @binding(22) var<storage, read> surfaces: array<Surface>;
@group(0) @binding(23) var<storage, read> pictures: array<Picture>;
@group(0) @binding(24) var<storage, read> texels: array<u32>;
@group(0) @binding(25) var<storage, read> linear_from_srgb: array<f32>;

fn wrapped(index: i32, count: i32, wrap: u32) -> i32 {
    if wrap == CLAMP {
        return clamp(index, 0, count - 1);
    }
    let period = select(count, 2 * count, wrap == MIRROR);
    // Coordinates are within two periods and a texel.
    let inside = (index + period) % period;
    return select(inside, min(inside, 2 * count - 1 - inside), wrap == MIRROR);
}

// The two texels beside a coordinate, and how far it lies from the first toward the second.
struct Neighbours {
    first: i32,
    second: i32,
    part: f32,
}

fn neighbours(coordinate: f32, count: u32, wrap: u32) -> Neighbours {
    let inside = select(coordinate - 2.0 * floor(coordinate * 0.5), clamp(coordinate, 0.0, 1.0), wrap == CLAMP);
    let x = inside * f32(count) - 0.5;
    let first = floor(x);
    let sides = i32(count);
    return Neighbours(wrapped(i32(first), sides, wrap), wrapped(i32(first) + 1, sides, wrap), x - first);
}

fn texel(picture: Picture, x: i32, y: i32) -> vec3f {
    let bits = texels[picture.offset + u32(y) * picture.width + u32(x)];
    return vec3f(
        linear_from_srgb[bits & 0xffu],
        linear_from_srgb[bits >> 8u & 0xffu],
        linear_from_srgb[bits >> 16u & 0xffu],
    );
}

fn sampled(picture: Picture, uv: vec2f) -> vec3f {
    let x = neighbours(uv.x, picture.width, picture.wrap & 3u);
    let y = neighbours(uv.y, picture.height, picture.wrap >> 2u);
    let upper = mix(texel(picture, x.first, y.first), texel(picture, x.second, y.first), x.part);
    let lower = mix(texel(picture, x.first, y.second), texel(picture, x.second, y.second), x.part);
    return mix(upper, lower, y.part);
}

// Luminance, 0 … 1, at given weights of a triangle's corners.
fn shaded(triangle: Triangle, weights: vec3f) -> f32 {
    if triangle.surface == NONE {
        return clamp(dot(weights, triangle.luminance), 0.0, 1.0);
    }
    let surface = surfaces[triangle.surface];
    let mean = weights.x * surface.a + weights.y * surface.b + weights.z * surface.c;
    let colour = mean.rgb * sampled(pictures[surface.picture], vec2f(mean.w, dot(weights, surface.v)));
    return clamp(dot(colour, vec3f(0.2126, 0.7152, 0.0722)), 0.0, 1.0);
}
