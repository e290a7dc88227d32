//! Turns with what is known of their halftone, as a stream compresses them best.

use crate::render::plan::Halftone;
use crate::render::turn::Turn;
use crate::stream::TurnPlanes;
use protocol::codec::Hint;
use shaders::halftone::mask::Mask;
use std::ops::Deref;

/// A binary turn and how it was halftoned. `T` holds the turn, or leads to it.
#[derive(Clone, Copy, Debug)]
pub struct Halftoned<T> {
    /// The turn.
    pub turn: T,
    /// Its halftone.
    pub halftone: Halftone,
    /// The number that it was rendered with: halftones that alternate do so by its parity.
    pub number: u32,
}

impl<T> Halftoned<T> {
    fn mask(&self, slice: u32) -> Option<Mask> {
        Mask::new(self.halftone.binary()?, slice, self.number)
    }
}

impl<T: Deref<Target = Turn> + Sync> TurnPlanes for Halftoned<T> {
    fn slices(&self) -> u32 {
        self.turn.slices()
    }

    fn plane_bytes(&self, slice: u32) -> &[u8] {
        self.turn.slice(slice)
    }

    fn hint(&self, slice: u32) -> Hint {
        match self.mask(slice).and_then(Mask::ranks) {
            Some((_, shift)) => Hint::Mask { shift },
            None => Hint::Diffusion,
        }
    }

    fn mask_ranks(&self) -> &[u16] {
        self.mask(0).and_then(Mask::ranks).map_or(&[], |(ranks, _)| ranks)
    }
}
