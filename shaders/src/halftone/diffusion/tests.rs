use super::*;
use proptest::prelude::*;

/// The shares of a kernel with the offsets that they go to, rightward.
fn shares(kernel: &Kernel) -> Vec<([f64; 2], f64)> {
    let ahead = (0..).zip(kernel.ahead).map(|(step, share)| ([f64::from(step) + 1.0, 0.0], f64::from(share)));
    let below = (1..).zip(kernel.below).flat_map(|(row, shares)| {
        (-2..).zip(shares).map(move |(column, share)| ([f64::from(column), f64::from(row)], f64::from(share)))
    });
    ahead.chain(below).collect()
}

#[test]
fn no_error_is_lost() {
    for kernel in [Kernel::FLOYD_STEINBERG, Kernel::OPTIMISED] {
        let sum: f64 = shares(&kernel).iter().map(|(_, share)| share).sum();
        assert!((sum - 1.0).abs() < 1e-6, "{sum}");
    }
}

/// Where shares of a given sum are best, the derivative of |g ∗ (δ − h)|² + 0.02 |h|² is the same for all of them.
#[test]
fn the_optimised_shares_are_the_best() {
    // g ⋆ g of a Gaussian of σ has √2 σ; in units of its peak.
    let blurred = |[ax, ay]: [f64; 2], [bx, by]: [f64; 2]| (-((ax - bx).powi(2) + (ay - by).powi(2)) / 9.0).exp();
    let spread = |kernel: &Kernel| {
        let shares = shares(kernel);
        let slopes = shares.iter().map(|(place, share)| {
            let others: f64 = shares.iter().map(|(other, share)| share * blurred(*place, *other)).sum();
            others - blurred(*place, [0.0, 0.0]) + 0.02 * share
        });
        let (low, high) = slopes.fold((f64::MAX, f64::MIN), |(low, high), slope| (low.min(slope), high.max(slope)));
        high - low
    };
    assert!(spread(&Kernel::OPTIMISED) < 0.003, "{}", spread(&Kernel::OPTIMISED));
    assert!(spread(&Kernel::FLOYD_STEINBERG) > 0.03, "{}", spread(&Kernel::FLOYD_STEINBERG));
}

/// The same written the other way round: each pixel hands out its error.
fn scattered(kernel: &Kernel, seed: u32, width: usize, luminance: &[f32]) -> Vec<u8> {
    let mut plane = vec![0; luminance.len() / width * plane_stride(width as u32)];
    let mut handed = vec![0.0; luminance.len()];
    for (y, row) in luminance.chunks_exact(width).enumerate() {
        let way = if y % 2 == 0 { 1 } else { -1 };
        for step in 0..width {
            let x = if way > 0 { step } else { width - 1 - step };
            if row[x] <= 0.0 {
                continue;
            }
            let wanted = f64::from(row[x]) + handed[y * width + x];
            let lit = wanted > f64::from(kernel.threshold(x as u32, y as u32, seed));
            plane[y * plane_stride(width as u32) + x / 8] |= u8::from(lit) << (x % 8);
            for ([dx, dy], share) in shares(kernel) {
                let (to, below) = (x as i32 + way * dx as i32, y + dy as usize);
                if (0..width as i32).contains(&to) && below < luminance.len() / width {
                    handed[below * width + to as usize] += share * (wanted - f64::from(u8::from(lit)));
                }
            }
        }
    }
    plane
}

#[test]
fn errors_go_where_the_kernel_says() {
    let luminance: Vec<f32> = (0..40 * 20).map(|cell| 0.3 + 0.4 * (hash(cell, 5, 6) % 100) as f32 / 100.0).collect();
    for kernel in [Kernel::FLOYD_STEINBERG, Kernel::OPTIMISED] {
        let mut plane = vec![0; 20 * 5];
        diffuse(&kernel, 7, 40, &luminance, &mut plane, |_| 0.0);
        assert_eq!(plane, scattered(&kernel, 7, 40, &luminance));
    }
}

/// Shades with dark gaps, below 0, above 1, and not a number, from a seed.
fn picture(seed: u32, cells: usize) -> Vec<f32> {
    let shade = |cell: u32| match hash(cell / 37, seed, 3) % 8 {
        0..3 => 0.0,
        3 => 1.0,
        4 => [-0.5, 3.0, f32::NAN, f32::INFINITY][hash(cell, seed, 1) as usize % 4],
        _ => (hash(cell, seed, 2) % 1000) as f32 / 999.0,
    };
    (0..cells as u32).map(shade).collect()
}

/// Asserts that `N` slices in lanes have the bits that they have one by one.
fn check_lanes<const N: usize>(kernel: &Kernel, seed: u32, width: u32, height: usize) -> Result<(), TestCaseError> {
    let bytes = plane_stride(width) * height;
    let seeds = core::array::from_fn(|lane| seed.wrapping_add(lane as u32));
    // Dark outside of a box.
    let lit = [width, height as u32].map(|side| {
        let ends = [4, 5].map(|which| (hash(seed, side, which) % (side + 1)) as usize);
        ends[0].min(ends[1])..ends[0].max(ends[1])
    });
    let pictures = seeds.map(|seed| {
        let mut picture = picture(seed, width as usize * height);
        for (cell, shade) in picture.iter_mut().enumerate() {
            let [x, y] = [cell % width as usize, cell / width as usize];
            *shade = if lit[0].contains(&x) && lit[1].contains(&y) { *shade } else { 0.0 };
        }
        picture
    });
    let mut planes = [(); N].map(|()| vec![0xAA; bytes]);
    let slices = Slices { seeds, width, luminance: pictures.each_ref().map(Vec::as_slice), lit, shade: |value| value };
    diffuse_lanes(kernel, slices, planes.each_mut().map(Vec::as_mut_slice));
    for (lane, plane) in planes.iter().enumerate() {
        let mut expected = vec![0x55; bytes];
        diffuse(kernel, seeds[lane], width, &pictures[lane], &mut expected, |_| 0.0);
        prop_assert_eq!(plane, &expected, "lane {}", lane);
    }
    Ok(())
}

proptest! {
    #[test]
    fn lanes_have_the_bits_of_one_slice(width in 1u32..140, height in 0usize..12, seed: u32, optimised: bool) {
        let kernel = if optimised { Kernel::OPTIMISED } else { Kernel::FLOYD_STEINBERG };
        check_lanes::<1>(&kernel, seed, width, height)?;
        check_lanes::<2>(&kernel, seed, width, height)?;
        check_lanes::<8>(&kernel, seed, width, height)?;
        check_lanes::<16>(&kernel, seed, width, height)?;
    }

    #[test]
    fn a_slice_does_not_mind_how_its_luminance_is_kept(width in 1u32..70, seed: u32) {
        let shades: Vec<i16> = (0..width * 9).map(|cell| (hash(cell, seed, 0) >> 17) as i16).collect();
        let shade = |value: i16| f32::from(value) / 32767.0;
        let luminance: Vec<_> = shades.iter().map(|value| shade(*value)).collect();
        let mut planes = [(); 2].map(|()| vec![0; plane_stride(width) * 9]);
        let slices = Slices { seeds: [seed], width, luminance: [&shades], lit: [0..width as usize, 0..9], shade };
        diffuse_lanes(&Kernel::OPTIMISED, slices, [&mut planes[0]]);
        diffuse(&Kernel::OPTIMISED, seed, width, &luminance, &mut planes[1], |_| 0.0);
        prop_assert_eq!(&planes[0], &planes[1]);
    }

    #[test]
    fn lanes_are_transposed(first in 0u32..1000) {
        let rows: [[f32; GO]; 8] =
            core::array::from_fn(|lane| core::array::from_fn(|x| (first as usize + lane * GO + x) as f32));
        let lanes = to_lanes(rows);
        for (x, lanes) in lanes.iter().enumerate() {
            prop_assert!((0..8).all(|lane| lanes[lane] == rows[lane][x]));
        }
    }
}
