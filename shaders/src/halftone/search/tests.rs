use super::*;

const WIDTH: u32 = 100;

/// A ramp in a disc, with a white and a black square in it.
fn picture() -> Vec<f32> {
    let pixel = |x: i32, y: i32| match (x, y) {
        _ if (x - 50).pow(2) + (y - 40).pow(2) > 35 * 35 => 0.0,
        (40..50, 40..50) => 1.0,
        (60..70, 40..50) => 0.0,
        _ => 0.05 + x as f32 / 110.0,
    };
    (0..80).flat_map(|y| (0..WIDTH as i32).map(move |x| pixel(x, y))).collect()
}

fn start(luminance: &[f32]) -> Vec<u8> {
    let mut plane = vec![0; plane_stride(WIDTH) * 80];
    let slot = crate::halftone::Slot { slice: 3, turn: 0, blur: Blur::ROUND };
    crate::halftone::halftone(crate::halftone::Halftone::BlueNoise, slot, WIDTH, luminance, &mut plane);
    plane
}

fn bit(plane: &[u8], cell: usize) -> f32 {
    let (x, y) = (cell % WIDTH as usize, cell / WIDTH as usize);
    f32::from(plane[y * plane_stride(WIDTH) + x / 8] >> (x % 8) & 1)
}

/// |G ∗ (b − l)|² by its definition.
fn blurred_energy(blur: Blur, luminance: &[f32], plane: &[u8]) -> f64 {
    let [uu, uv, vv] = blur.0;
    let determinant = uu * vv - uv * uv;
    let error = |x: i32, y: i32| {
        let cell = (y * WIDTH as i32 + x) as usize;
        bit(plane, cell) - luminance[cell]
    };
    let (columns, rows) = (0..WIDTH as i32, 0..80);
    let blurred = |x: i32, y: i32| {
        let near =
            |centre: i32, range: &core::ops::Range<i32>| (centre - 7).max(range.start)..(centre + 8).min(range.end);
        let terms = near(y, &rows).flat_map(|v| near(x, &columns).map(move |u| (u, v)));
        let gauss = |u: f32, v: f32| (-(vv * u * u - 2.0 * uv * u * v + uu * v * v) / (2.0 * determinant)).exp();
        terms.map(|(u, v)| gauss((u - x) as f32, (v - y) as f32) * error(u, v)).sum::<f32>()
    };
    rows.clone().flat_map(|y| columns.clone().map(move |x| (x, y))).map(|(x, y)| f64::from(blurred(x, y)).powi(2)).sum()
}

#[test]
fn the_search_lowers_the_blurred_error() {
    let luminance = picture();
    for blur in [Blur::ROUND, Blur([3.0, 0.9, 2.2])] {
        let before = start(&luminance);
        let mut after = before.clone();
        improve(blur, WIDTH, &luminance, &mut after);
        let [before, after] = [before, after].map(|plane| blurred_energy(blur, &luminance, &plane));
        assert!(after < 0.6 * before, "{before} {after}");
    }
}

#[test]
fn black_and_white_stay_and_so_does_the_mean() {
    let luminance = picture();
    let mut plane = start(&luminance);
    improve(Blur::ROUND, WIDTH, &luminance, &mut plane);
    let cells = luminance.iter().enumerate();
    assert!(cells.clone().filter(|(_, l)| **l == 0.0 || **l == 1.0).all(|(cell, l)| bit(&plane, cell) == *l));
    let difference = cells.map(|(cell, l)| bit(&plane, cell) - l).sum::<f32>();
    assert!(difference.abs() < 0.002 * luminance.iter().sum::<f32>(), "{difference}");
}

#[test]
fn the_order_within_a_phase_does_not_matter() {
    let luminance = picture();
    let kernel = Kernel::new(Blur([2.5, -0.7, 2.0]));
    let search = Search::new(&kernel, WIDTH, &luminance, &start(&luminance));
    let [width, height] = search.size;
    for moves in [Moves::Flips, Moves::Swaps] {
        let (mut forward, mut backward) = (search.clone(), search.clone());
        let moved = forward.sweep(&kernel, moves);
        for phase in 0..TILE * TILE {
            let rows = (TILE + phase / TILE..height - TILE).step_by(TILE);
            let cells =
                rows.flat_map(|y| (y * width + TILE + phase % TILE..(y + 1) * width - TILE).step_by(TILE)).rev();
            for cell in cells {
                match moves {
                    Moves::Flips => backward.flip(&kernel, cell),
                    Moves::Swaps => backward.swap(&kernel, cell),
                };
            }
        }
        assert!(moved > 50, "{moved}");
        assert!(forward.state == backward.state && forward.error == backward.error, "{moves:?}");
    }
}

#[test]
fn points_meet_pixels_as_counted() {
    let [a, b] = axes([3.0, 0.9, 2.2]);
    let back = [a[0] * a[0] + b[0] * b[0], a[0] * a[1] + b[0] * b[1], a[1] * a[1] + b[1] * b[1]];
    assert!(back.iter().zip([3.0, 0.9, 2.2]).all(|(value, given)| (value - given).abs() < 1e-9), "{back:?}");
    // Points 0.65 px apart across and 0.5 px down: a pixel holds 1.54 across on average, its square 2.62 (counted by hand).
    let sampled = Kernel::sampled(Blur([(0.65 / SPACING as f32).powi(2), 0.0, (0.5 / SPACING as f32).powi(2)]));
    let plain = Kernel::new(Blur([(0.65 / SPACING as f32).powi(2), 0.0, (0.5 / SPACING as f32).powi(2)]));
    let share = |dx: usize, dy: usize| {
        let at = |kernel: &Kernel| f64::from(kernel.taps[REACH + dy][REACH + dx]);
        at(&sampled) / at(&plain)
    };
    assert!((share(0, 0) / share(1, 0) - 1.105 / 0.909).abs() < 0.03, "{}", share(0, 0) / share(1, 0));
    assert!((share(0, 0) / share(0, 1) - 1.0).abs() < 0.02, "{}", share(0, 0) / share(0, 1));
}

#[test]
fn a_field_is_what_it_says() {
    let luminance = picture();
    let kernel = Kernel::new(Blur::ROUND);
    let mut search = Search::new(&kernel, WIDTH, &luminance, &start(&luminance));
    let field = search.field(&kernel, 0.0);
    let (x, y) = (45, 30);
    let cell = (y - search.top + TILE) * search.size[0] + x - search.left + TILE;
    let (here, beside) = (f32::from(search.error[cell]), f32::from(search.error[cell + 1]));
    assert_eq!(field.at(45.5, 30.5), here);
    assert!((field.at(46.0, 30.5) - (here + beside) / 2.0).abs() < 0.01);
    assert_eq!(
        [field.at(-500.0, 30.0), field.at(500.0, 30.0), field.at(30.0, -500.0), field.at(30.0, 500.0)],
        [0.0; 4]
    );
    let lit = f32::from(u8::from(search.state[cell] > 0)) - luminance[y * WIDTH as usize + x];
    let sharp = search.field(&kernel, 0.5).at(45.5, 30.5) - here;
    assert!((sharp - 0.5 * f32::from(kernel.peak()) * lit).abs() < 0.01);
    // A slice that others make brighter than wanted darkens.
    let before = search.state.iter().filter(|state| **state > 0).count();
    search.add_field(|_, _| 2000.0);
    search.sweep(&kernel, Moves::Swaps);
    assert!(search.state.iter().filter(|state| **state > 0).count() < before - 50);
}

#[test]
fn the_error_is_kept_up_to_date() {
    let luminance = picture();
    for blur in [Blur::ROUND, Blur([3.0, 0.9, 2.2]), Blur([0.0; 3]), Blur([400.0, 30.0, 90.0])] {
        let kernel = Kernel::new(blur);
        let mut search = Search::new(&kernel, WIDTH, &luminance, &start(&luminance));
        assert!(search.sweep(&kernel, Moves::Flips) + search.sweep(&kernel, Moves::Swaps) > 0);
        let kept = search.error.clone();
        search.convolve(&kernel);
        // Where nothing is searched, nobody reads it.
        let cells = kept.iter().zip(&search.error).zip(&search.state).filter(|(_, state)| **state != 0);
        let worst = cells.map(|((kept, anew), _)| (kept - anew).abs()).max().unwrap();
        assert!(worst < kernel.peak() / 20, "{worst} of {}", kernel.peak());
    }
}

#[test]
fn nothing_to_search_is_no_error() {
    for (width, luminance) in [(1, vec![0.5]), (3, vec![0.0; 9]), (3, vec![1.0; 9]), (5, vec![0.3; 5])] {
        let mut plane = vec![0; plane_stride(width) * luminance.len() / width as usize];
        improve(Blur::ROUND, width, &luminance, &mut plane);
    }
}
