//! Masks as `halftone.wgsl` reads them.

use super::Halftone;
use super::mask::{
    BLUE_SIDE, VOLUME_SIDE, VOLUME_SLICES, bayer_threshold, blue_noise_ranks, blue_noise_volume, golden_shift,
};
use crate::wgsl::Mask;

const WHITE: u32 = 0;
const TILE: u32 = 1;
const GREY: u32 = 2;
const BAYER_SIDE: u32 = 8;

impl Mask {
    /// The mask of `method` in slice `slice` of turn `turn`; `None` for methods that are no masks.
    pub fn new(method: Halftone, slice: u32, turn: u32) -> Option<Self> {
        let tile = |side: usize, slices: usize| {
            let (side, cells) = (side as u32, (side * side * slices) as u32);
            Self { kind: TILE, side, cells, offset: 0, shift: 0 }
        };
        let blue_noise = |shift: f64| {
            let blue = tile(BLUE_SIDE, 1);
            Self { shift: (shift.fract() * f64::from(blue.cells)) as u32, ..blue }
        };
        let odd = |number: u32| f64::from(number % 2);
        Some(match method {
            Halftone::WhiteNoise => Self { kind: WHITE, side: 1, cells: 1, offset: 0, shift: slice },
            Halftone::Bayer => tile(BAYER_SIDE as usize, 1),
            Halftone::BlueNoiseFixed => blue_noise(0.0),
            Halftone::BlueNoiseHalf => blue_noise(odd(slice) / 2.0),
            Halftone::BlueNoise => blue_noise(golden_shift(slice)),
            Halftone::AlternatingBlueNoise => blue_noise(golden_shift(slice) + odd(turn) / 2.0),
            Halftone::BlueNoise3d => {
                let offset = slice as usize % VOLUME_SLICES * VOLUME_SIDE * VOLUME_SIDE;
                Self { offset: offset as u32, ..tile(VOLUME_SIDE, VOLUME_SLICES) }
            }
            _ => return None,
        })
    }

    /// None: grey stays.
    pub const GREY: Self = Self { kind: GREY, side: 1, cells: 1, offset: 0, shift: 0 };

    /// The ranks to which masks of `method` refer; none where there are none.
    pub fn ranks(method: Halftone) -> Vec<u32> {
        match method {
            Halftone::Bayer => (0..BAYER_SIDE * BAYER_SIDE)
                .map(|cell| (bayer_threshold(cell % BAYER_SIDE, cell / BAYER_SIDE) * 64.0) as u32)
                .collect(),
            Halftone::BlueNoise3d => blue_noise_volume().iter().copied().map(u32::from).collect(),
            Halftone::BlueNoiseFixed
            | Halftone::BlueNoiseHalf
            | Halftone::BlueNoise
            | Halftone::AlternatingBlueNoise => blue_noise_ranks().iter().copied().map(u32::from).collect(),
            _ => Vec::new(),
        }
    }
}
