use super::mask::{VOLUME_SLICES, bayer_threshold, blue_noise_ranks, blue_noise_volume};
use super::*;

const METHODS: [Halftone; 10] = [
    Halftone::WhiteNoise,
    Halftone::Bayer,
    Halftone::BlueNoiseFixed,
    Halftone::BlueNoiseHalf,
    Halftone::BlueNoise,
    Halftone::AlternatingBlueNoise,
    Halftone::BlueNoise3d,
    Halftone::FloydSteinberg,
    Halftone::OptimisedDiffusion,
    Halftone::AlternatingDiffusion,
];

fn plane(method: Halftone, [slice, turn]: [u32; 2], width: u32, luminance: &[f32]) -> Vec<u8> {
    let mut plane = vec![0xAA; plane_stride(width) * (luminance.len() / width as usize)];
    halftone(method, Slot { slice, turn, blur: Blur::ROUND }, width, luminance, &mut plane);
    plane
}

fn lit(plane: &[u8]) -> u32 {
    plane.iter().map(|byte| byte.count_ones()).sum()
}

/// Scatter of the lit pixels in the 8 × 8 boxes of planes 64 pixels wide, summed plane over plane.
fn box_scatter(planes: &[Vec<u8>]) -> f64 {
    let count = |tile: usize| {
        let of_row = |row: usize| {
            planes.iter().map(|plane| plane[(tile / 8 * 8 + row) * 8 + tile % 8].count_ones()).sum::<u32>()
        };
        f64::from((0..8).map(of_row).sum::<u32>())
    };
    let mean = (0..64).map(count).sum::<f64>() / 64.0;
    ((0..64).map(|tile| (count(tile) - mean).powi(2)).sum::<f64>() / 64.0).sqrt()
}

#[test]
fn black_is_dark_and_white_is_lit() {
    for method in METHODS {
        for slot in [[0, 0], [1, 1], [287, 0], [287, 1]] {
            assert_eq!(lit(&plane(method, slot, 100, &[0.0; 10_000])), 0, "{method:?}");
            assert_eq!(lit(&plane(method, slot, 100, &[1.0; 10_000])), 10_000, "{method:?}");
            assert_eq!(lit(&plane(method, slot, 100, &[7.0; 10_000])), 10_000, "{method:?}");
        }
    }
}

#[test]
fn a_flat_grey_keeps_its_mean() {
    for method in METHODS {
        for level in [0.1f32, 0.37, 0.5, 0.9] {
            for turn in 0..2 {
                let slices = 0..VOLUME_SLICES as u32;
                let lit: u32 = slices.map(|slice| lit(&plane(method, [slice, turn], 128, &[level; 128 * 128]))).sum();
                let mean = lit as f32 / (VOLUME_SLICES * 128 * 128) as f32;
                assert!((mean - level).abs() < 0.01, "{method:?} {level}, turn {turn}: {mean}");
            }
        }
    }
}

#[test]
fn a_slice_at_the_end_of_counting_is_like_another() {
    for method in METHODS {
        let level = lit(&plane(method, [u32::MAX, u32::MAX], 96, &[0.4; 96 * 96]));
        assert!((level as f32 / (96.0 * 96.0) - 0.4).abs() < 0.03, "{method:?}: {level}");
    }
}

#[test]
fn every_rank_stands_once() {
    for ranks in [blue_noise_ranks(), blue_noise_volume()] {
        let mut ranks = ranks.to_vec();
        ranks.sort_unstable();
        assert!(ranks.iter().enumerate().all(|(index, rank)| index == usize::from(*rank)));
    }
    let mut bayer: Vec<_> = (0..64).map(|cell| (bayer_threshold(cell % 8, cell / 8) * 64.0) as u32).collect();
    bayer.sort_unstable();
    assert_eq!(bayer, (0..64).collect::<Vec<_>>());
}

#[test]
fn blue_noise_has_no_low_frequencies_in_space() {
    // Of 8 × 8 boxes, white noise at one half would scatter by √(64 · ¼) = 4 pixels.
    let scatter = |method| box_scatter(&[plane(method, [0, 0], 64, &[0.5; 4096])]);
    assert!(scatter(Halftone::WhiteNoise) > 3.0);
    for method in [Halftone::BlueNoise, Halftone::FloydSteinberg, Halftone::OptimisedDiffusion] {
        assert!(scatter(method) < 1.5, "{method:?}: {}", scatter(method));
    }
    // A slice of the three-dimensional mask gives up some of it to its neighbours.
    assert!(scatter(Halftone::BlueNoise3d) < 2.5, "{}", scatter(Halftone::BlueNoise3d));
}

#[test]
fn the_volume_has_no_low_frequencies_from_slice_to_slice() {
    // Neighbours know of each other, slices four apart do not: the sum of neighbours is bluer.
    let slice = |slice| plane(Halftone::BlueNoise3d, [slice, 0], 64, &[0.5; 4096]);
    let scatter =
        |apart: u32| (0..16).map(|first| box_scatter(&[slice(first), slice(first + apart)])).sum::<f64>() / 16.0;
    assert!(scatter(1) < 0.95 * scatter(4), "{} against {}", scatter(1), scatter(4));
}

#[test]
fn two_alternating_turns_are_nearer_than_two_equal_ones() {
    let luminance: Vec<f32> = (0..4096).map(|cell| 0.2 + 0.6 * (cell % 64) as f32 / 64.0).collect();
    for method in [Halftone::AlternatingBlueNoise, Halftone::AlternatingDiffusion] {
        let error = |turns: [u32; 2]| {
            let planes = turns.map(|turn| plane(method, [3, turn], 64, &luminance));
            let missing = planes.map(|plane| missing(64, &luminance, &plane));
            missing[0].iter().zip(&missing[1]).map(|(a, b)| f64::from(a + b).powi(2)).sum::<f64>()
        };
        assert!(error([0, 1]) < 0.4 * error([0, 0]), "{method:?}: {} against {}", error([0, 1]), error([0, 0]));
        assert_eq!(plane(method, [3, 1], 64, &luminance), plane(method, [3, 7], 64, &luminance));
    }
}

#[test]
fn error_diffusion_stays_inside_the_silhouette() {
    let luminance: Vec<f32> = (0..64 * 64).map(|cell| if cell % 64 < 32 { 0.9 } else { 0.0 }).collect();
    for method in [Halftone::FloydSteinberg, Halftone::OptimisedDiffusion, Halftone::AlternatingDiffusion] {
        let plane = plane(method, [0, 1], 64, &luminance);
        assert!(plane.chunks_exact(8).all(|row| row[4..].iter().all(|byte| *byte == 0)), "{method:?}");
    }
}

#[test]
fn a_diffusion_is_what_its_kernel_says() {
    let luminance: Vec<f32> = (0..50 * 20).map(|cell| (cell % 50) as f32 / 50.0).collect();
    let mut kernels = 0;
    for method in METHODS {
        for turn in 0..2 {
            let Some(kernel) = method.diffusion(turn) else { continue };
            let mut diffused = vec![0; plane_stride(50) * 20];
            diffuse(kernel, 6, 50, &luminance, &mut diffused, |_| 0.0);
            assert_eq!(plane(method, [6, turn], 50, &luminance), diffused, "{method:?} {turn}");
            kernels += 1;
        }
    }
    assert_eq!(kernels, 5);
}
