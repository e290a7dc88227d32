// The twin of `SliceProjector<f32>`: scene point to pixel, and a pixel to what the mirror shows there.
// One face in one slice; lengths in metres, the mirror's frame, as in methods/kernel.rs.

const BENDS = 6;

struct Slice {
    azimuth: vec2f,
    tilt: vec2f,
    projector: vec3f,
    offset: f32,
    image: vec2f,
    image_squared: f32,
    near: f32,
    circle: vec3f,
    half_width: f32,
    slope_span: vec2f,
    guard: f32,
    reach_squared: f32,
    pixel_u: vec3f,
    grazing: f32,
    pixel_v: vec3f,
    settled: f32,
    pixel_w: vec3f,
    lit: u32,
    mirror_across: vec3f,
    // How many bends there are; without any, viewers are on the circle.
    bends: u32,
    mirror_slope: vec3f,
    // Lines that pass the axis at less than the root of this cross the curve once.
    passing: f32,
    mirror_w: vec3f,
    fold_squared: f32,
    principal: vec2f,
    focal: vec2f,
    radial: vec2f,
    // Distance and height where the first bend begins.
    bends_from: vec2f,
    // Start, 1 / width, and what is added to distance and height.
    bend: array<vec4f, BENDS>,
}

struct Vertex {
    pixel: vec2f,
    depth: f32,
    state: u32,
}

// Whether there is distortion, whether the cone is followed, whether a viewer may be behind the mirror, and whether viewers are on a
// curve in place of a circle.
override LENS = true;
override CONE = true;
override DIM = true;
override CURVE = true;

const UNLIT = 0x10u;
const NOWHERE = 0x20u;
// The twin turns to double precision.
const UNSURE = 0x40u;
const CANCELLATION = 4.0;
const STEPS = 6;
const PLANAR_STEPS = 3;
const PLANAR_LAST = 7e-5;
const CONE_STEPS = 8;

struct Place {
    at: vec3f,
    slope: f32,
    above: f32,
    level_squared: f32,
}

struct Line {
    viewer: vec2f,
    height: f32,
    from_origin: f32,
    // The tangent of half the azimuth of V', where the curve is bent.
    half: f32,
    toward: vec3f,
    square: f32,
    toward_slope: f32,
    toward_above: f32,
    range: f32,
    mirror: vec2f,
    sound: bool,
}

fn place_of(slice: Slice, point: vec3f) -> Place {
    let sin_cos = slice.azimuth;
    return place_in_frame(slice, vec3f(
        sin_cos.y * point.x - sin_cos.x * point.z,
        point.y,
        sin_cos.x * point.x + sin_cos.y * point.z,
    ));
}

fn place_in_frame(slice: Slice, at: vec3f) -> Place {
    let sin_cos = slice.tilt;
    return Place(
        at,
        sin_cos.x * at.y - sin_cos.y * at.z,
        sin_cos.y * at.y + sin_cos.x * at.z - slice.offset,
        at.x * at.x + at.z * at.z,
    );
}

fn place_on_panel(slice: Slice, mirror: vec2f) -> Place {
    let sin_cos = slice.tilt;
    let y = sin_cos.y * slice.offset + sin_cos.x * mirror.y;
    let z = sin_cos.x * slice.offset - sin_cos.y * mirror.y;
    return Place(vec3f(mirror.x, y, z), mirror.y, 0.0, mirror.x * mirror.x + z * z);
}

fn line_away(slice: Slice, place: Place, away: vec2f) -> Line {
    return line_toward(slice, place, away, slice.circle.yz);
}

// Toward somebody at a height and a distance from the origin.
fn line_toward(slice: Slice, place: Place, away: vec2f, height_distance: vec2f) -> Line {
    let y = height_distance.x - slice.near * place.at.y;
    let sin_cos = slice.tilt;
    let toward_slope = sin_cos.x * y - sin_cos.y * away.y;
    let toward_above = sin_cos.y * y + sin_cos.x * away.y;
    let range = place.above / toward_above;
    return Line(
        slice.near * place.at.xz + away,
        height_distance.x,
        height_distance.y,
        0.0,
        vec3f(away.x, y, away.y),
        away.x * away.x + y * y + away.y * away.y,
        toward_slope,
        toward_above,
        range,
        vec2f(place.at.x - range * away.x, place.slope - range * toward_slope),
        true,
    );
}

fn is_steep(slice: Slice, place: Place, line: Line) -> bool {
    let squared = slice.reach_squared + place.level_squared + place.at.y * place.at.y;
    let least = slice.grazing * line.square * squared;
    return line.toward_above * line.toward_above >= least;
}

fn planar(slice: Slice, place: Place) -> Line {
    let away = place.at.xz - slice.image;
    let square = dot(away, away);
    let unit = away / sqrt(square);
    let radius = slice.circle.x;
    let along = slice.near * dot(place.at.xz, unit);
    let within = radius * radius - slice.near * place.level_squared;
    let range = sqrt(along * along + within) - along;
    var line = line_away(slice, place, range * unit);
    line.sound = CANCELLATION * CANCELLATION * square >= slice.image_squared + place.level_squared
        && CANCELLATION * range >= radius
        && is_steep(slice, place, line);
    return line;
}

fn line_across(slice: Slice, place: Place, line: Line, x: f32) -> Line {
    let radius = slice.circle.x;
    let size = sqrt((radius - x) * (radius + x));
    let z = select(size, -size, line.viewer.y < 0.0);
    return line_away(slice, place, vec2f(x, z) - slice.near * place.at.xz);
}

fn newton(slice: Slice, place: Place, start: Line) -> Line {
    let sin_cos = slice.tilt;
    var line = start;
    var rise = 0.0;
    var last = abs(start.viewer.y) * 0.5;
    for (var step = 0; step < STEPS; step++) {
        let across = line.mirror.x - slice.projector.x;
        let up = line.mirror.y - slice.projector.y;
        let inward = 1.0 / sqrt(across * across + up * up + slice.projector.z * slice.projector.z);
        let outward = 1.0 / sqrt(line.square);
        let value = line.toward.x * outward - across * inward;
        if abs(value) < slice.settled * rise {
            line.sound = is_steep(slice, place, line);
            return line;
        }
        let viewer_z = -line.viewer.x / line.viewer.y;
        let range = -line.range * sin_cos.x * viewer_z / line.toward_above;
        let mirror_across = -(range * line.toward.x + line.range);
        let mirror_up = -(range * line.toward_slope - line.range * sin_cos.y * viewer_z);
        let incident = inward * (mirror_across - across * inward * inward * (across * mirror_across + up * mirror_up));
        let leaving = line.toward.x + line.toward.z * viewer_z;
        let slope = outward * (1.0 - line.toward.x * outward * outward * leaving) - incident;
        rise = slope / outward;
        let move_x = value / slope;
        if !(rise > 1.0 / CANCELLATION && abs(move_x) < last * 0.25) {
            break;
        }
        last = abs(move_x);
        line = line_across(slice, place, line, line.viewer.x - move_x);
    }
    line.sound = false;
    return line;
}

// A place of the curve.
struct Stand {
    // V', and how it moves with its azimuth.
    at: vec3f,
    moves: vec3f,
    // Radians for a step of the tangent of half the azimuth.
    turn: f32,
}

fn twice_arctangent(tangent: f32) -> f32 {
    let square = tangent * tangent;
    var series = 0.0028662257 * square;
    series = (series - 0.0161657367) * square;
    series = (series + 0.0429096138) * square;
    series = (series - 0.07528964) * square;
    series = (series + 0.1065626393) * square;
    series = (series - 0.1420889944) * square;
    series = (series + 0.1999355085) * square;
    series = (series - 0.3333314528) * square;
    return 2.0 * tangent * (1.0 + series);
}

fn stand_at(slice: Slice, half: f32) -> Stand {
    let square = half * half;
    let scale = 1.0 / (1.0 + square);
    let sin_cos = vec2f(2.0 * half, 1.0 - square) * scale;
    let azimuth = twice_arctangent(half);
    var place = slice.bends_from;
    var rise = vec2f(0.0);
    for (var index = 0u; index < slice.bends; index++) {
        let bend = slice.bend[index];
        let way = clamp((azimuth - bend.x) * bend.y, 0.0, 1.0);
        let left = 1.0 - way;
        place += way * way * (2.0 * left + 1.0) * bend.zw;
        rise += 6.0 * way * left * bend.y * bend.zw;
    }
    return Stand(
        vec3f(place.x * sin_cos.x, place.y, place.x * sin_cos.y),
        vec3f(rise.x * sin_cos.x + place.x * sin_cos.y, rise.y, rise.x * sin_cos.y - place.x * sin_cos.x),
        1.0 + sin_cos.y,
    );
}

fn line_to_stand(slice: Slice, place: Place, half: f32, at: vec3f) -> Line {
    var line = line_toward(slice, place, at.xz - place.at.xz, vec2f(at.y, length(at)));
    line.half = half;
    return line;
}

// The twin of `Bent::planar_line`.
fn bent_planar(slice: Slice, place: Place) -> Line {
    let away = place.at.xz - slice.image;
    let square = dot(away, away);
    let unit = away / sqrt(square);
    let radius = slice.bends_from.x;
    let along = dot(place.at.xz, unit);
    let passing = place.at.x * unit.y - place.at.z * unit.x;
    let first = place.at.xz + (sqrt(along * along + (radius * radius - place.level_squared)) - along) * unit;
    var half = first.x / (radius + first.y);
    var last = 0.0;
    for (var step = 0; step < PLANAR_STEPS; step++) {
        let stand = stand_at(slice, half);
        let gap = stand.at.xz - place.at.xz;
        last = (gap.x * unit.y - gap.y * unit.x) / (stand.moves.x * unit.y - stand.moves.z * unit.x);
        half -= last / stand.turn;
    }
    var line = line_to_stand(slice, place, half, stand_at(slice, half).at);
    line.sound = CANCELLATION * CANCELLATION * square >= slice.image_squared + place.level_squared
        && CANCELLATION * dot(line.toward.xz, unit) >= radius
        && abs(last) < PLANAR_LAST
        && abs(half) < 1.0
        && passing * passing <= slice.passing
        && is_steep(slice, place, line);
    return line;
}

// The twin of `Bent::newton`.
fn bent_newton(slice: Slice, place: Place, start: Line) -> Line {
    let sin_cos = slice.tilt;
    var half = start.half;
    var line = start;
    var rise = 0.0;
    var last = 0.5;
    for (var step = 0; step < CONE_STEPS; step++) {
        let stand = stand_at(slice, half);
        line = line_to_stand(slice, place, half, stand.at);
        let across = line.mirror.x - slice.projector.x;
        let up = line.mirror.y - slice.projector.y;
        let inward = 1.0 / sqrt(across * across + up * up + slice.projector.z * slice.projector.z);
        let outward = 1.0 / sqrt(line.square);
        let value = line.toward.x * outward - across * inward;
        if abs(value) < slice.settled * rise {
            line.sound = is_steep(slice, place, line);
            return line;
        }
        let moves = stand.moves;
        let range = -line.range * (sin_cos.y * moves.y + sin_cos.x * moves.z) / line.toward_above;
        let mirror_across = -(range * line.toward.x + line.range * moves.x);
        let mirror_up = -(range * line.toward_slope + line.range * (sin_cos.x * moves.y - sin_cos.y * moves.z));
        let incident = inward * (mirror_across - across * inward * inward * (across * mirror_across + up * mirror_up));
        let leaving = dot(line.toward, moves);
        let slope = outward * (moves.x - line.toward.x * outward * outward * leaving) - incident;
        rise = slope / (outward * line.viewer.y);
        let turn = value / slope;
        if !(rise > 1.0 / CANCELLATION && abs(turn) < last * 0.25) {
            break;
        }
        last = abs(turn);
        half -= turn / stand.turn;
    }
    line.sound = false;
    return line;
}

// The planar fan's line.
fn fan(slice: Slice, place: Place) -> Line {
    if CURVE && slice.bends != 0u {
        return bent_planar(slice, place);
    }
    return planar(slice, place);
}

fn follow(slice: Slice, place: Place, start: Line) -> Line {
    if !CONE || !start.sound {
        return start;
    }
    if CURVE && slice.bends != 0u {
        return bent_newton(slice, place, start);
    }
    return newton(slice, place, start);
}

fn depth_of(slice: Slice, place: Place, line: Line) -> f32 {
    let squared = slice.near * (place.level_squared + place.at.y * place.at.y);
    let along = place.at.x * line.viewer.x + place.at.y * line.height + place.at.z * line.viewer.y;
    return (squared - along - along) / (sqrt(line.square) + line.from_origin);
}

fn is_near(slice: Slice, mirror: vec2f) -> bool {
    let size = slice.slope_span.y - slice.slope_span.x;
    return abs(mirror.x) <= slice.half_width * 3.0
        && slice.slope_span.x - size <= mirror.y
        && mirror.y <= slice.slope_span.y + size;
}

fn sides_of(slice: Slice, mirror: vec2f, guard: f32) -> u32 {
    return u32(mirror.x < -slice.half_width - guard)
        | u32(mirror.x > slice.half_width + guard) << 1u
        | u32(mirror.y < slice.slope_span.x - guard) << 2u
        | u32(mirror.y > slice.slope_span.y + guard) << 3u;
}

fn is_lit(slice: Slice, line: Line) -> bool {
    let above = slice.tilt.x * line.viewer.y + slice.tilt.y * line.height;
    return slice.lit != 0u && above > slice.near * slice.offset;
}

// A mirror point's pixel, and whether there is one: 1 or 0.
fn pixel_of(slice: Slice, mirror: vec2f) -> vec3f {
    let panel = vec3f(mirror, 1.0);
    let w = dot(slice.pixel_w, panel);
    if !(w > 0.0) {
        return vec3f(0.0);
    }
    let pixel = vec2f(dot(slice.pixel_u, panel), dot(slice.pixel_v, panel)) / w;
    if !LENS {
        return vec3f(pixel, 1.0);
    }
    let ideal = (pixel - slice.principal) / slice.focal;
    let squared = dot(ideal, ideal);
    if !(squared < slice.fold_squared) {
        return vec3f(0.0);
    }
    return vec3f(slice.principal + slice.focal * ideal * lens_gain(slice, squared), 1.0);
}

fn lens_gain(slice: Slice, squared: f32) -> f32 {
    return 1.0 + squared * (slice.radial.x + squared * slice.radial.y);
}

// Newton on the radius, as Camera::undistort; single precision is at its last digit after a few steps.
fn undistort(slice: Slice, pixel: vec2f) -> vec2f {
    let seen = (pixel - slice.principal) / slice.focal;
    let goal = length(seen);
    if !LENS || goal == 0.0 {
        return pixel;
    }
    var radius = goal;
    for (var step = 0; step < 12; step++) {
        let squared = radius * radius;
        let growth = 1.0 + squared * (3.0 * slice.radial.x + 5.0 * squared * slice.radial.y);
        radius = clamp(radius - (radius * lens_gain(slice, squared) - goal) / growth, 0.0, 4.0 * goal);
    }
    return slice.principal + slice.focal * seen * (radius / goal);
}

// M of a pixel, and whether the projector's ray meets the plane: 1 or 0.
fn mirror_of(slice: Slice, pixel: vec2f) -> vec3f {
    let ideal = vec3f(undistort(slice, pixel), 1.0);
    let w = dot(slice.mirror_w, ideal);
    if !(w > 0.0) {
        return vec3f(0.0);
    }
    return vec3f(dot(slice.mirror_across, ideal) / w, dot(slice.mirror_slope, ideal) / w, 1.0);
}

// Where a world point appears.
fn vertex_of(slice: Slice, point: vec3f) -> Vertex {
    let nowhere = Vertex(vec2f(0.0), 0.0, NOWHERE);
    let place = place_of(slice, point);
    let start = fan(slice, place);
    if start.sound && !is_near(slice, start.mirror) {
        return nowhere;
    }
    let line = follow(slice, place, start);
    if !line.sound {
        return Vertex(vec2f(0.0), 0.0, NOWHERE | UNSURE);
    }
    let pixel = pixel_of(slice, line.mirror);
    if line.range * slice.near <= -1.0 || pixel.z == 0.0 {
        return nowhere;
    }
    let unlit = select(UNLIT, 0u, is_lit(slice, line));
    return Vertex(pixel.xy, depth_of(slice, place, line), sides_of(slice, line.mirror, slice.guard) | unlit);
}

// Whether the panel with its guard band shows something at a pixel: the twin of `SliceProjector::sight`.
fn sees(slice: Slice, pixel: vec2f) -> bool {
    let mirror = mirror_of(slice, pixel);
    if mirror.z == 0.0 || sides_of(slice, mirror.xy, slice.guard) != 0u {
        return false;
    }
    if !DIM {
        return true;
    }
    let place = place_on_panel(slice, mirror.xy);
    return is_lit(slice, follow(slice, place, fan(slice, place)));
}

// Where the projector's ray through a pixel meets a face, as a rank: squared throws within the panel, beyond all of these within
// its guard band, and beyond all elsewhere. Of several faces the least owns the pixel.
const ELSEWHERE = 3e38;
const IN_GUARD = 1e30;

fn claim(slice: Slice, pixel: vec2f) -> f32 {
    let mirror = mirror_of(slice, pixel);
    if mirror.z == 0.0 || sides_of(slice, mirror.xy, slice.guard) != 0u {
        return ELSEWHERE;
    }
    let arm = vec3f(mirror.xy, 0.0) - slice.projector;
    return dot(arm, arm) * select(IN_GUARD, 1.0, sides_of(slice, mirror.xy, 0.0) == 0u);
}
