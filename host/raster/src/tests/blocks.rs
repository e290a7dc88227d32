//! Blocks against plain arithmetic.

use super::*;
use crate::block::{COLUMNS, PIXELS};
use proptest::prelude::*;
use std::panic::{AssertUnwindSafe, catch_unwind};

/// What is to be known of a level's blocks, number by number.
#[derive(Debug, Default, PartialEq)]
struct Known {
    pairs: Vec<[i16; PIXELS]>,
    bits: Vec<u32>,
    lanes: u32,
    gathered: Vec<u64>,
}

/// Numbers to compute with.
struct Numbers<'a> {
    one: [i16; PIXELS],
    other: [i16; PIXELS],
    bits: u32,
    lanes: [i32; 16],
    table: &'a [u64],
    indices: [u32; 16],
}

/// All operations of blocks.
struct Operations<'a>(&'a Numbers<'a>, &'a mut Known);

impl Work for Operations<'_> {
    #[inline(always)]
    #[allow(unsafe_code)]
    fn run<B: Block, const N: usize>(self) {
        let Self(numbers, known) = self;
        let (a, b) = (B::from_array(&numbers.one), B::from_array(&numbers.other));
        let mask = B::from_bits(numbers.bits);
        let pairs = [
            a.add(b),
            a.add_saturating(b),
            a.mul(b),
            a.and(b),
            a.or(b),
            a.and_not(b),
            a.min(b),
            a.max(b),
            a.above(b),
            mask.select(a, b),
            B::splat(numbers.one[0]),
            B::columns(),
            B::rows(),
        ];
        known.pairs = pairs.map(B::to_array).to_vec();
        known.bits = vec![a.negative(), mask.negative()];
        for (lanes, indices) in numbers.lanes.as_chunks::<N>().0.iter().zip(numbers.indices.as_chunks::<N>().0) {
            known.lanes = known.lanes << N | B::negative_lanes(lanes);
            // SAFETY: the indices are made for the table.
            known.gathered.extend(unsafe { B::gather(numbers.table, indices) });
        }
    }
}

/// The same without blocks, for groups of `n` lanes.
fn plain(numbers: &Numbers<'_>, n: usize) -> Known {
    let Numbers { one, other, bits, lanes, table, indices } = numbers;
    let is_set = |pixel: usize| bits >> pixel & 1 != 0;
    let each = |number: &dyn Fn(usize) -> i16| core::array::from_fn(number);
    let pair = |number: fn(i16, i16) -> i16| each(&|pixel| number(one[pixel], other[pixel]));
    let negative = |is_negative: &[bool]| (0..).zip(is_negative).map(|(at, is)| u32::from(*is) << at).sum::<u32>();
    let signs: Vec<_> = lanes.iter().map(|lane| *lane < 0).collect();
    Known {
        pairs: vec![
            pair(i16::wrapping_add),
            pair(i16::saturating_add),
            pair(i16::wrapping_mul),
            pair(|a, b| a & b),
            pair(|a, b| a | b),
            pair(|a, b| a & !b),
            pair(i16::min),
            pair(i16::max),
            pair(|a, b| -i16::from(a > b)),
            each(&|pixel| if is_set(pixel) { one[pixel] } else { other[pixel] }),
            [one[0]; PIXELS],
            each(&|pixel| pixel as i16 % 8 - 4),
            each(&|pixel| pixel as i16 / 8 - 2),
        ],
        bits: vec![negative(&one.map(|number| number < 0)), *bits],
        lanes: signs.chunks(n).fold(0, |before, signs| before << n | negative(signs)),
        gathered: indices.iter().map(|index| table[*index as usize]).collect(),
    }
}

fn number() -> impl Strategy<Value = i16> {
    prop_oneof![any::<i16>(), prop::sample::select(&[i16::MIN, -1, 0, 1, i16::MAX][..])]
}

fn numbers() -> impl Strategy<Value = [i16; PIXELS]> {
    prop::collection::vec(number(), PIXELS).prop_map(|numbers| numbers.try_into().expect("as many"))
}

/// A block within cells and beyond.
struct Moved<'a> {
    cells: &'a mut [i16],
    at: usize,
    stride: u32,
    /// What is read, and then what is written.
    values: &'a mut [i16; PIXELS],
    write: bool,
}

impl Work for Moved<'_> {
    #[inline(always)]
    fn run<B: Block, const N: usize>(self) {
        match self.write {
            true => B::from_array(self.values).store(self.cells, self.at, self.stride),
            false => *self.values = B::load(self.cells, self.at, self.stride).to_array(),
        }
    }
}

proptest! {
    #![proptest_config(config())]

    #[test]
    fn operations_are_plain_arithmetic(
        (one, other) in (numbers(), numbers()),
        bits: u32,
        lanes: [i32; 16],
        (table, indices) in prop::collection::vec(any::<u64>(), 1..40).prop_flat_map(|table| {
            let index = 0..table.len() as u32;
            (Just(table), prop::array::uniform16(index))
        }),
    ) {
        let numbers = Numbers { one, other, bits, lanes, table: &table, indices };
        for level in levels() {
            let mut known = Known::default();
            level.run(Operations(&numbers, &mut known));
            prop_assert_eq!(known, plain(&numbers, if level == Level::Portable { 4 } else { 16 }), "{}", level);
        }
    }

    /// The last row may end where the cells do; one cell less is refused, and nothing is written beside the rows.
    #[test]
    fn blocks_move_from_and_to_their_cells_alone(at in 0usize..9, stride in 8u32..20, spare in 0usize..3, values in numbers()) {
        let end = at + 3 * stride as usize + COLUMNS;
        let cells: Vec<_> = (0..(end + spare) as i16).collect();
        let place = |pixel: usize| at + pixel / COLUMNS * stride as usize + pixel % COLUMNS;
        for level in levels() {
            let (mut written, mut read) = (cells.clone(), [0; PIXELS]);
            level.run(Moved { cells: &mut written, at, stride, values: &mut read, write: false });
            prop_assert_eq!(read, core::array::from_fn(|pixel| place(pixel) as i16), "{}", level);
            level.run(Moved { cells: &mut written, at, stride, values: &mut values.clone(), write: true });
            let mut right = cells.clone();
            (0..PIXELS).for_each(|pixel| right[place(pixel)] = values[pixel]);
            prop_assert_eq!(written, right, "{}", level);
        }
    }
}

#[test]
fn blocks_beyond_their_cells_are_refused() {
    let mut cells = [0; 3 * 9 + 8];
    let last = cells.len();
    for level in levels() {
        for (at, end) in [(1, last), (0, last - 1), (last + 1, last), (usize::MAX, last)] {
            for write in [false, true] {
                let moved = Moved { cells: &mut cells[..end], at, stride: 9, values: &mut [0; PIXELS], write };
                let result = catch_unwind(AssertUnwindSafe(|| level.run(moved)));
                assert!(result.is_err(), "{level}: a block at {at} of {end}");
            }
        }
    }
}
