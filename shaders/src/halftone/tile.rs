//! Masks as `halftone.wgsl` reads them.

use super::Halftone;
use super::mask::{self, bayer_threshold, blue_noise_ranks, blue_noise_volume};
use crate::wgsl::Mask;

const WHITE: u32 = 0;
const TILE: u32 = 1;
const GREY: u32 = 2;

impl Mask {
    /// The mask of `method` in slice `slice` of turn `turn`; `None` for methods that are no masks.
    pub fn new(method: Halftone, slice: u32, turn: u32) -> Option<Self> {
        let mask = mask::Mask::new(method, slice, turn)?;
        let Some(side) = mask.side().map(|side| side as u32) else {
            return Some(Self { kind: WHITE, side: 1, cells: 1, offset: 0, shift: slice });
        };
        let tile = Self { kind: TILE, side, cells: side * side, offset: 0, shift: 0 };
        Some(match mask {
            mask::Mask::Blue { shift } => Self { shift: shift as u32, ..tile },
            mask::Mask::Volume { layer } => {
                Self { cells: blue_noise_volume().len() as u32, offset: layer as u32 * tile.cells, ..tile }
            }
            mask::Mask::Bayer | mask::Mask::White { .. } => tile,
        })
    }

    /// None: grey stays.
    pub const GREY: Self = Self { kind: GREY, side: 1, cells: 1, offset: 0, shift: 0 };

    /// The ranks to which masks of `method` refer; none where there are none.
    pub fn ranks(method: Halftone) -> Vec<u32> {
        let wide = |ranks: &[u16]| ranks.iter().copied().map(u32::from).collect();
        match method {
            Halftone::Bayer => (0..64).map(|cell| (bayer_threshold(cell % 8, cell / 8) * 64.0) as u32).collect(),
            Halftone::BlueNoise3d => wide(blue_noise_volume()),
            Halftone::BlueNoiseFixed
            | Halftone::BlueNoiseHalf
            | Halftone::BlueNoise
            | Halftone::AlternatingBlueNoise => wide(blue_noise_ranks()),
            _ => Vec::new(),
        }
    }
}
