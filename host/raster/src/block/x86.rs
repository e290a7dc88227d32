//! Blocks in the registers of x86-64: AVX2 and AVX-512.
//!
//! Their methods are `inline(always)` and end in functions that enable the instructions: see [`crate::level`], which alone names these
//! types, and gives them only to work on machines that have the instructions.
#![allow(unsafe_code)]

use super::{Block, COLUMNS, PIXELS, Portable};
use core::arch::x86_64::*;

/// One register. SAFETY of its methods: they are called, by way of `level`, where AVX-512 F and BW were found.
#[derive(Clone, Copy)]
pub struct Avx512(__m512i);

/// Two registers, two rows each. SAFETY of its methods: they are called, by way of `level`, where AVX2 was found.
#[derive(Clone, Copy)]
pub struct Avx2([__m256i; 2]);

/// Makes sure that [`Block::load`] and [`Block::store`] stay in `cells`.
#[inline(always)]
fn check(cells: &[i16], at: usize, stride: u32) {
    assert!(cells[at..].len() >= 3 * stride as usize + COLUMNS, "a block lies in its cells");
}

/// SAFETY: the caller has checked that four rows lie in what `from` points to.
#[inline(always)]
unsafe fn load_pair(from: *const i16, stride: usize) -> __m256i {
    unsafe {
        let [upper, lower] = [from, from.add(stride)].map(|row| _mm_loadu_si128(row.cast()));
        _mm256_inserti128_si256::<1>(_mm256_castsi128_si256(upper), lower)
    }
}

/// SAFETY: as of [`load_pair`].
#[inline(always)]
unsafe fn store_pair(pair: __m256i, to: *mut i16, stride: usize) {
    unsafe {
        _mm_storeu_si128(to.cast(), _mm256_castsi256_si128(pair));
        _mm_storeu_si128(to.add(stride).cast(), _mm256_extracti128_si256::<1>(pair));
    }
}

/// Methods that are one instruction a register.
macro_rules! instructions {
    ($($method:ident: $instruction:ident,)*) => {$(
        #[inline(always)]
        fn $method(self, other: Self) -> Self {
            self.zip(other, |a, b| unsafe { $instruction(a, b) })
        }
    )*};
}

impl Avx512 {
    #[inline(always)]
    fn zip(self, other: Self, operation: impl Fn(__m512i, __m512i) -> __m512i) -> Self {
        Self(operation(self.0, other.0))
    }
}

impl Block for Avx512 {
    #[inline(always)]
    fn splat(value: i16) -> Self {
        Self(unsafe { _mm512_set1_epi16(value) })
    }

    #[inline(always)]
    fn from_array(values: &[i16; PIXELS]) -> Self {
        // An array is as large as the register.
        Self(unsafe { _mm512_loadu_si512(values.as_ptr().cast()) })
    }

    #[inline(always)]
    fn to_array(self) -> [i16; PIXELS] {
        let mut values = [0; PIXELS];
        // An array is as large as the register.
        unsafe { _mm512_storeu_si512(values.as_mut_ptr().cast(), self.0) };
        values
    }

    #[inline(always)]
    fn load(cells: &[i16], at: usize, stride: u32) -> Self {
        check(cells, at, stride);
        let stride = stride as usize;
        // All four rows were checked.
        Self(unsafe {
            let first = cells.as_ptr().add(at);
            let [upper, lower] = [load_pair(first, stride), load_pair(first.add(2 * stride), stride)];
            _mm512_inserti64x4::<1>(_mm512_castsi256_si512(upper), lower)
        })
    }

    #[inline(always)]
    fn store(self, cells: &mut [i16], at: usize, stride: u32) {
        check(cells, at, stride);
        let stride = stride as usize;
        // All four rows were checked.
        unsafe {
            let first = cells.as_mut_ptr().add(at);
            store_pair(_mm512_castsi512_si256(self.0), first, stride);
            store_pair(_mm512_extracti64x4_epi64::<1>(self.0), first.add(2 * stride), stride);
        }
    }

    #[inline(always)]
    fn from_bits(bits: u32) -> Self {
        Self(unsafe { _mm512_movm_epi16(bits) })
    }

    #[inline(always)]
    fn negative(self) -> u32 {
        unsafe { _mm512_movepi16_mask(self.0) }
    }

    #[inline(always)]
    fn negative_lanes<const N: usize>(lanes: &[i32; N]) -> u32 {
        const { assert!(N == 16) };
        // An array is as large as the register.
        unsafe { _mm512_movepi32_mask(_mm512_loadu_si512(lanes.as_ptr().cast())).into() }
    }

    #[inline(always)]
    unsafe fn gather<const N: usize>(table: &[u64], indices: &[u32; N]) -> [u64; N] {
        const { assert!(N == 16) };
        if cfg!(miri) {
            // Miri does not know the instruction; the caller's promise is the same.
            return unsafe { Portable::gather(table, indices) };
        }
        let mut values = [0; N];
        for half in 0..2 {
            // Half an array of indices, and of values, is as large as a register; indices are in the table, as the caller has made sure,
            // and do not reach half of what 32 bits hold.
            unsafe {
                let indices = _mm256_loadu_si256(indices.as_ptr().add(8 * half).cast());
                let gathered = _mm512_i32gather_epi64::<8>(indices, table.as_ptr().cast());
                _mm512_storeu_si512(values.as_mut_ptr().add(8 * half).cast(), gathered);
            }
        }
        values
    }

    instructions! {
        add: _mm512_add_epi16,
        add_saturating: _mm512_adds_epi16,
        mul: _mm512_mullo_epi16,
        and: _mm512_and_si512,
        or: _mm512_or_si512,
        min: _mm512_min_epi16,
        max: _mm512_max_epi16,
    }

    #[inline(always)]
    fn and_not(self, mask: Self) -> Self {
        Self(unsafe { _mm512_andnot_si512(mask.0, self.0) })
    }

    #[inline(always)]
    fn above(self, other: Self) -> Self {
        Self(unsafe { _mm512_movm_epi16(_mm512_cmpgt_epi16_mask(self.0, other.0)) })
    }
}

impl Avx2 {
    #[inline(always)]
    fn zip(self, other: Self, operation: impl Fn(__m256i, __m256i) -> __m256i) -> Self {
        Self([operation(self.0[0], other.0[0]), operation(self.0[1], other.0[1])])
    }
}

impl Block for Avx2 {
    #[inline(always)]
    fn splat(value: i16) -> Self {
        Self([unsafe { _mm256_set1_epi16(value) }; 2])
    }

    #[inline(always)]
    fn from_array(values: &[i16; PIXELS]) -> Self {
        Self::load(values, 0, COLUMNS as u32)
    }

    #[inline(always)]
    fn to_array(self) -> [i16; PIXELS] {
        let mut values = [0; PIXELS];
        self.store(&mut values, 0, COLUMNS as u32);
        values
    }

    #[inline(always)]
    fn load(cells: &[i16], at: usize, stride: u32) -> Self {
        check(cells, at, stride);
        let stride = stride as usize;
        // All four rows were checked.
        Self(unsafe {
            let first = cells.as_ptr().add(at);
            [load_pair(first, stride), load_pair(first.add(2 * stride), stride)]
        })
    }

    #[inline(always)]
    fn store(self, cells: &mut [i16], at: usize, stride: u32) {
        check(cells, at, stride);
        let stride = stride as usize;
        // All four rows were checked.
        unsafe {
            let first = cells.as_mut_ptr().add(at);
            store_pair(self.0[0], first, stride);
            store_pair(self.0[1], first.add(2 * stride), stride);
        }
    }

    #[inline(always)]
    fn from_bits(bits: u32) -> Self {
        let half = |bits: u32| unsafe {
            let places =
                _mm256_setr_epi16(1, 2, 4, 8, 16, 32, 64, 128, 256, 512, 1024, 2048, 4096, 8192, 16384, i16::MIN);
            _mm256_cmpeq_epi16(_mm256_and_si256(_mm256_set1_epi16(bits as i16), places), places)
        };
        Self([half(bits), half(bits >> 16)])
    }

    #[inline(always)]
    fn negative(self) -> u32 {
        unsafe {
            // Saturating to bytes keeps signs, and interleaves the halves of both registers.
            let bytes = _mm256_permute4x64_epi64::<0b11_01_10_00>(_mm256_packs_epi16(self.0[0], self.0[1]));
            _mm256_movemask_epi8(bytes) as u32
        }
    }

    #[inline(always)]
    fn negative_lanes<const N: usize>(lanes: &[i32; N]) -> u32 {
        const { assert!(N == 16) };
        // An array is as large as two registers.
        let half = |half: usize| unsafe {
            let lanes = _mm256_loadu_si256(lanes.as_ptr().add(8 * half).cast());
            _mm256_movemask_ps(_mm256_castsi256_ps(lanes)) as u32
        };
        half(0) | half(1) << 8
    }

    #[inline(always)]
    unsafe fn gather<const N: usize>(table: &[u64], indices: &[u32; N]) -> [u64; N] {
        // Its gathers are no faster than one load after the other.
        unsafe { Portable::gather(table, indices) }
    }

    instructions! {
        add: _mm256_add_epi16,
        add_saturating: _mm256_adds_epi16,
        mul: _mm256_mullo_epi16,
        and: _mm256_and_si256,
        or: _mm256_or_si256,
        min: _mm256_min_epi16,
        max: _mm256_max_epi16,
    }

    #[inline(always)]
    fn and_not(self, mask: Self) -> Self {
        self.zip(mask, |a, b| unsafe { _mm256_andnot_si256(b, a) })
    }

    #[inline(always)]
    fn above(self, other: Self) -> Self {
        self.zip(other, |a, b| unsafe { _mm256_cmpgt_epi16(a, b) })
    }
}
