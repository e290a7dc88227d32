//! Small pictures, pixel by pixel.

use super::*;
use crate::figure::VERTEX_LANES;
use crate::grid::FINE;
use glam::DVec3;
use proptest::prelude::*;
use shaders::halftone::mask::Mask;

/// Whole bytes in no row, whole blocks in none either; small for an interpreter.
const SIZE: [i32; 2] = if cfg!(miri) { [13, 9] } else { [45, 37] };
/// Triangles, for more than one group at once.
const MANY: usize = if cfg!(miri) { 20 } else { 40 };
const WIDTH: usize = SIZE[0] as usize;
/// A plane's row.
const STRIDE: usize = WIDTH.div_ceil(8);
const PIXELS: usize = WIDTH * SIZE[1] as usize;

/// A triangle on the image.
#[derive(Clone, Debug)]
struct Triangle {
    /// In steps from the middle of the image.
    corners: [[i64; 2]; 3],
    depth: i64,
    ink: Ink,
    solid: bool,
    /// Whether a corner lies beyond the panel.
    rim: bool,
}

/// What is drawn besides: see [`View`].
struct Rules<'a> {
    shows: &'a dyn Fn([i32; 2]) -> bool,
    is_shared: bool,
    front: i32,
    shade: &'a dyn Fn(usize, [f32; 3]) -> f32,
    skins: Vec<Skin>,
    pictures: Vec<Picture>,
}

/// A figure whose vertices are where `triangles` have them already.
fn placed(triangles: &[Triangle], skins: Vec<Skin>, pictures: Vec<Picture>) -> (Figure, Vertices) {
    let solid: Vec<_> = triangles.iter().map(|triangle| triangle.solid).collect();
    let each = triangles.iter().map(|triangle| triangle.ink).collect();
    let indices = (0..triangles.len() as u32).map(|index| [3 * index, 3 * index + 1, 3 * index + 2]);
    let positions = vec![DVec3::ZERO; 3 * triangles.len()];
    let figure = Figure::new(&positions, indices, &solid, Inks { each, skins, pictures });
    let pack = |(index, [x, y]): (usize, [i64; 2]), triangle: &Triangle| {
        let is_wide = [x, y].iter().any(|place| *place != i64::from(*place as i16));
        let state = u64::from(is_wide) << 7 | u64::from(triangle.rim && index == 0);
        (x & 0xFFFF | (y & 0xFFFF) << 16 | (triangle.depth & 0xFFFF) << 32) as u64 | state << 48
    };
    let packed = triangles
        .iter()
        .flat_map(|triangle| triangle.corners.into_iter().enumerate().map(move |corner| pack(corner, triangle)));
    let mut packed: Vec<_> = packed.collect();
    packed.resize(packed.len().next_multiple_of(VERTEX_LANES), 0);
    (figure, Vertices(packed.as_chunks().0.to_vec()))
}

/// A slice in grey and by Bayer's mask.
#[derive(Clone, Debug, PartialEq)]
struct Slice {
    grey: Vec<i16>,
    plane: Vec<u8>,
}

struct Drawing<'a>(&'a Scene<'a>, &'a View<'a>, &'a Vertices, &'a mut Slice);

impl Work for Drawing<'_> {
    #[inline(always)]
    fn run<B: Block, const N: usize>(self) {
        let Self(scene, view, vertices, slice) = self;
        let mut panel = Panel::default();
        panel.forget(SIZE);
        let (mut greys, mut touched) = (Greys::new(SIZE), Touched::NONE);
        draw::<B, N, _>(scene, view, vertices, &mut panel, &mut greys, &mut touched);
        let rows = [touched.first[1], touched.end[1]];
        greys.take(rows, SIZE, |y, row| slice.grey[y * WIDTH..][..WIDTH].copy_from_slice(row));
        let mut bits = Bits::new(SIZE);
        bits.tile.set(Mask::Bayer, SIZE);
        draw::<B, N, _>(scene, view, vertices, &mut panel, &mut bits, &mut touched);
        bits.take::<B>([touched.first[0], touched.end[0]], rows, SIZE, &mut slice.plane);
    }
}

fn drawn(level: Level, triangles: &[Triangle], rules: Rules<'_>) -> Slice {
    let Rules { shows, is_shared, front, shade, skins, pictures } = rules;
    let (figure, vertices) = placed(triangles, skins, pictures);
    let corner = |index: u32| {
        let triangle = &triangles[index as usize / 3];
        let [x, y] = triangle.corners[index as usize % 3];
        [x << FINE, y << FINE, triangle.depth].map(|value| value as i32)
    };
    let scene = Scene { figure: &figure, shade, grid: grid() };
    let mut slice = Slice { grey: vec![0; PIXELS], plane: vec![0; STRIDE * SIZE[1] as usize] };
    level.run(Drawing(&scene, &View { shows, is_shared, front, corner: &corner }, &vertices, &mut slice));
    slice
}

fn grid() -> Grid {
    Grid::new(SIZE.map(|side| side as u32), 1.0)
}

/// `grey` by Bayer's mask.
fn halftoned(grey: &[i16]) -> Vec<u8> {
    let mut plane = vec![0; STRIDE * SIZE[1] as usize];
    for (cell, value) in grey.iter().enumerate() {
        let (x, y) = (cell % WIDTH, cell / WIDTH);
        let lit = f32::from(*value) > Mask::Bayer.threshold(x as u32, y as u32) * WHITE;
        plane[y * STRIDE + x / 8] |= u8::from(lit) << (x % 8);
    }
    plane
}

/// Whether a triangle covers a pixel's centre, by the top-left rule.
fn covers(corners: [[i64; 2]; 3], pixel: [i32; 2]) -> bool {
    let at = [0, 1].map(|axis| i64::from(pixel[axis] - SIZE[axis] / 2) * 32 + 16);
    let edge = |[ax, ay]: [i64; 2], [bx, by]: [i64; 2], [x, y]: [i64; 2]| (bx - ax) * (y - ay) - (by - ay) * (x - ax);
    let area = edge(corners[0], corners[1], corners[2]);
    let [a, b, c] = if area < 0 { [corners[0], corners[2], corners[1]] } else { corners };
    area != 0
        && [(a, b), (b, c), (c, a)].into_iter().all(|(from, to)| {
            let is_top_or_left = to[1] < from[1] || (to[1] == from[1] && to[0] > from[0]);
            edge(from, to, at) >= i64::from(!is_top_or_left)
        })
}

fn triangle() -> impl Strategy<Value = Triangle> {
    let place = [-800i64..800, -800i64..800];
    let arm = || [-1.0f32..1.0, -1.0f32..1.0];
    // In one block, in a few, too large for the narrow arithmetic, too large for 16 bits. Even multiples of half a pixel meet centres.
    let size = prop::sample::select(&[90.0, 1000.0, 6000.0, 300_000.0f32][..]);
    let snap = prop::sample::select(&[1, 16][..]);
    let looks = (-16_000i64..16_000, 0i16..32_767, any::<bool>(), any::<bool>());
    (place, [arm(), arm(), arm()], size, snap, looks).prop_map(
        |(place, arms, size, snap, (depth, light, solid, rim))| {
            let along = |axis: usize, arm: f32| (place[axis] + (arm * size) as i64) / snap * snap;
            let corners = arms.map(|arm| [along(0, arm[0]), along(1, arm[1])]);
            // The lowest bit is the pixel's.
            Triangle { corners, depth: 2 * depth, ink: Ink::Flat(light), solid, rim }
        },
    )
}

proptest! {
    #![proptest_config(config())]

    /// Exactly: which pixels, and whose.
    #[test]
    fn the_nearest_triangle_that_covers_a_pixel_shows(
        mut triangles in prop::collection::vec(triangle(), 1..MANY),
        front in -1i32..2,
        is_shared: bool,
        border in -5i32..50,
    ) {
        triangles.sort_by_key(|triangle| triangle.depth);
        triangles.dedup_by_key(|triangle| triangle.depth);
        let shows = |[x, _]: [i32; 2]| x < border;
        let is_drawn = |triangle: &Triangle, pixel: [i32; 2]| {
            let [a, b, c] = triangle.corners;
            let area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
            let is_back = triangle.solid && area.signum() * i64::from(front) < 0;
            let is_cut = is_shared || triangle.rim;
            !is_back && (!is_cut || shows(pixel)) && covers(triangle.corners, pixel)
        };
        let luminance = |pixel: [i32; 2]| {
            let nearest = triangles.iter().find(|triangle| is_drawn(triangle, pixel));
            nearest.map_or(0, |triangle| if let Ink::Flat(light) = triangle.ink { light } else { 0 })
        };
        let grey: Vec<_> = (0..PIXELS as i32).map(|cell| luminance([cell % SIZE[0], cell / SIZE[0]])).collect();
        let right = Slice { plane: halftoned(&grey), grey };
        // The order in which they come makes no difference.
        triangles.sort_by_key(|triangle| triangle.corners);
        for level in levels() {
            let (skins, pictures) = Default::default();
            let rules = Rules { shows: &shows, is_shared, front, shade: &|_, _| 0.0, skins, pictures };
            let slice = drawn(level, &triangles, rules);
            prop_assert!(slice == right, "{level}: {slice:?} is not {right:?}");
        }
    }
}

/// A gradient over a rectangle is the same by its corners, by a picture, and asked for pixel by pixel.
#[test]
fn inks_agree() {
    const BRIGHT: f32 = 30_000.0;
    // Of three corners, of which the second is at the right, or the first at the left.
    let values = [[0.0, BRIGHT, BRIGHT], [0.0, BRIGHT, 0.0]];
    let picture = || Picture::new(2, [Wrap::Clamp; 2], &[0, 65_535]);
    let place = |value: f32| 0.5 + value / BRIGHT;
    let skin = |values: [f32; 3]| Skin { picture: 0, places: [values.map(place), [0.5; 3]], gains: [BRIGHT / FULL; 3] };
    let shade = |index: usize, weights: [f32; 3]| {
        (0..3).map(|corner| weights[corner] * values[index][corner]).sum::<f32>() / WHITE
    };
    // The second time too large for the narrow arithmetic.
    for scale in [1, 30].into_iter().take(if cfg!(miri) { 1 } else { 2 }) {
        let [right, bottom] = SIZE.map(|side| i64::from(side / 2 - 2) * 32);
        let [left, right, top, bottom] = [-right, right, -bottom * scale, bottom * scale];
        let corners = [[[left, top], [right, top], [right, bottom]], [[left, top], [right, bottom], [left, bottom]]];
        let inks = [values.map(Ink::Smooth), [0, 1].map(Ink::Textured), [Ink::Shaded; 2]];
        for (level, inks) in levels().flat_map(|level| inks.map(|inks| (level, inks))) {
            let triangle = |index: usize| Triangle {
                corners: corners[index],
                depth: 0,
                ink: inks[index],
                solid: false,
                rim: false,
            };
            let (skins, pictures) = (values.map(skin).to_vec(), vec![picture()]);
            let rules = Rules { shows: &|_| true, is_shared: false, front: 0, shade: &shade, skins, pictures };
            let slice = drawn(level, &[triangle(0), triangle(1)], rules);
            for (cell, value) in slice.grey.iter().enumerate() {
                let [x, y] = [cell % WIDTH, cell / WIDTH].map(|place| place as i64 * 32 + 16);
                let [x, y] = [x - i64::from(SIZE[0] / 2) * 32, y - i64::from(SIZE[1] / 2) * 32];
                let is_inside = (left..right).contains(&x) && (top..bottom).contains(&y);
                let share = (x - left) as f32 / (right - left) as f32;
                let right = if is_inside { share * BRIGHT } else { 0.0 };
                // A step of a gradient is a whole number: a block's farthest pixel is six steps from its centre.
                assert!((f32::from(*value) - right).abs() < 4.0, "{level}, {inks:?}: {value}, not {right} at {x} {y}");
            }
            assert_eq!(slice.plane, halftoned(&slice.grey), "{level}, {inks:?}");
        }
    }
}
