//! Which planes light a photodiode: a sequence of bits, a turn long, in which every few bits in a row stand at one place only.
//!
//! A maximal sequence of a linear-feedback shift register, cut down to the turn's length: of its states a whole run can be left out
//! where the state before the run and its last one differ in the oldest bit alone, for then both have the same successors. Golomb, Shift
//! Register Sequences, chapter V; there is one such place for every length.

/// Feedback taps of a maximal register of w bits, as the bits of the state that are added: w from 2 to 16. Xilinx XAPP052, table 3.
const TAPS: [u32; 15] = [
    0b11,
    0b110,
    0b1100,
    0b1_0100,
    0b11_0000,
    0b110_0000,
    0b1011_1000,
    0b1_0001_0000,
    0b10_0100_0000,
    0b101_0000_0000,
    0b1000_0010_1001,
    0b1_0000_0000_1101,
    0b10_0000_0001_0101,
    0b110_0000_0000_0000,
    0b1101_0000_0000_1000,
];

/// The sequence.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Sequence {
    bits: Vec<bool>,
    window: u32,
}

impl Sequence {
    /// For turns of `slices` planes, of which at most 65 534 have places of their own.
    pub fn new(slices: u32) -> Self {
        let window = (2..16).find(|window| 1 << window > slices).unwrap_or(16);
        let (taps, mask) = (TAPS[window as usize - 2], (1_u32 << window) - 1);
        let next = |state: u32| (state << 1 | (state & taps).count_ones() & 1) & mask;
        let mut states = vec![1];
        states.extend(std::iter::successors(Some(next(1)), |state| Some(next(*state)).filter(|state| *state != 1)));
        states.truncate(mask as usize);
        let all = states.len();
        let length = (slices as usize).min(all);
        // After the run's last state comes what came after the state before it.
        let oldest = 1 << (window - 1);
        let begins =
            |at: &usize| length == all || states[(at + all - 1) % all] ^ oldest == states[(at + length - 1) % all];
        let at = (0..all).find(begins).unwrap_or(0);
        Self { bits: (0..length).map(|place| states[(at + place) % all] & 1 == 1).collect(), window }
    }

    /// So many bits in a row stand at one place only.
    pub fn window(&self) -> usize {
        self.window as usize
    }

    /// Whether the plane of `slice` is lit.
    pub fn is_lit(&self, slice: u32) -> bool {
        self.bits[slice as usize % self.bits.len()]
    }

    /// The slice of the last of [`Sequence::window`] planes that were lit so; nothing where they stand nowhere.
    pub fn slice_of(&self, planes: &[bool]) -> Option<u32> {
        let length = self.bits.len();
        let is_here = |end: &usize| {
            (0..self.window()).all(|back| {
                planes[self.window() - 1 - back] == self.bits[(end + length * self.window() - back) % length]
            })
        };
        (planes.len() == self.window()).then(|| (0..length).find(is_here)).flatten().map(|end| end as u32)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::collections::HashSet;

    fn places(sequence: &Sequence, slices: u32) -> usize {
        let word =
            |start: u32| (0..sequence.window() as u32).map(move |place| sequence.is_lit((start + place) % slices));
        (0..slices).map(|start| word(start).collect::<Vec<_>>()).collect::<HashSet<_>>().len()
    }

    #[test]
    fn the_registers_are_maximal() {
        for window in 2..=16 {
            let slices = (1 << window) - 1;
            assert_eq!(places(&Sequence::new(slices), slices), slices as usize, "{window}");
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]
        #[test]
        fn every_window_stands_once(slices in 2_u32..3_000) {
            prop_assert_eq!(places(&Sequence::new(slices), slices), slices as usize);
        }

        #[test]
        fn a_window_tells_its_slice(slices in 4_u32..1_000, slice in any::<u32>()) {
            let sequence = Sequence::new(slices);
            let slice = slice % slices;
            let width = sequence.window() as u32;
            let planes: Vec<_> =
                (0..width).map(|place| sequence.is_lit((slice + width * slices + 1 + place - width) % slices)).collect();
            prop_assert_eq!(sequence.slice_of(&planes), Some(slice));
        }
    }

    #[test]
    fn about_half_of_the_planes_are_lit() {
        let sequence = Sequence::new(288);
        let lit = (0..288).filter(|slice| sequence.is_lit(*slice)).count();
        assert!((110..180).contains(&lit) && sequence.window() == 9, "{lit}");
    }
}
