//! Bits of a stream, the lowest of each byte first.

/// What one code needs at most, bytes: see [`super::blocks`].
pub(super) const CODE_BYTES: usize = 16;

/// Reads bits that lie in memory.
#[derive(Clone, Copy)]
pub(super) struct BitReader<'a> {
    bytes: &'a [u8],
    /// In bits.
    at: usize,
}

impl<'a> BitReader<'a> {
    /// From bit `at` of `bytes` on.
    #[inline(always)]
    pub(super) fn new(bytes: &'a [u8], at: usize) -> Self {
        Self { bytes, at }
    }

    /// Where the next bit is.
    #[inline(always)]
    pub(super) fn at(&self) -> usize {
        self.at
    }

    /// Whether a whole code is there, whatever it is.
    #[inline(always)]
    pub(super) fn has_code(&self) -> bool {
        self.at / 8 + CODE_BYTES + 8 <= self.bytes.len()
    }

    /// The next 57 bits at least; zeros beyond the end.
    #[inline(always)]
    pub(super) fn peek(&self) -> u64 {
        let word = self.bytes.get(self.at / 8..).and_then(|bytes| bytes.first_chunk());
        word.map_or(0, |word| u64::from_le_bytes(*word)) >> (self.at % 8)
    }

    /// Passes over `count` bits.
    #[inline(always)]
    pub(super) fn skip(&mut self, count: u32) {
        self.at += count as usize;
    }

    /// The next `count` bits, at most 57.
    #[inline(always)]
    pub(super) fn take(&mut self, count: u32) -> u64 {
        let value = self.peek() & ((1 << count) - 1);
        self.skip(count);
        value
    }

    /// A number by Rice's code: the number without its lowest `low` bits in unary (zeros, then a one), then those bits. After
    /// [`UNARY_MAX`] zeros the number stands in 7 bits.
    #[inline(always)]
    pub(super) fn rice(&mut self, low: u32) -> u32 {
        let next = self.peek();
        let zeros = next.trailing_zeros();
        if zeros >= UNARY_MAX {
            self.skip(UNARY_MAX + 7);
            return (next >> UNARY_MAX) as u32 & 127;
        }
        self.skip(zeros + 1 + low);
        zeros << low | (next >> (zeros + 1)) as u32 & ((1 << low) - 1)
    }

    /// A number by the exponential Golomb code whose first class has `low` bits; at most 2¹² - 1.
    #[inline(always)]
    pub(super) fn golomb(&mut self, low: u32) -> u32 {
        let next = self.peek();
        let zeros = next.trailing_zeros().min(12);
        let bits = zeros + low;
        self.skip(zeros + 1 + bits);
        (((1 << zeros) - 1) << low) + ((next >> (zeros + 1)) as u32 & ((1 << bits) - 1))
    }
}

/// Zeros after which a Rice code is no longer unary.
pub(super) const UNARY_MAX: u32 = 12;

/// Appends bits to memory.
#[cfg(feature = "std")]
pub(super) struct BitWriter<'a> {
    out: &'a mut Vec<u8>,
    word: u64,
    /// Bits in it: fewer than 8 between calls.
    filled: u32,
}

#[cfg(feature = "std")]
impl<'a> BitWriter<'a> {
    /// After what is in `out`.
    pub(super) fn new(out: &'a mut Vec<u8>) -> Self {
        Self { out, word: 0, filled: 0 }
    }

    /// The lowest `count` bits of `value`, at most 64; the others are zeros.
    #[inline(always)]
    pub(super) fn put(&mut self, value: u64, count: u32) {
        if count > 48 {
            self.put(value & ((1 << 32) - 1), 32);
            self.put(value >> 32, count - 32);
            return;
        }
        self.word |= value << self.filled;
        self.filled += count;
        let whole = self.filled as usize / 8;
        self.out.extend_from_slice(&self.word.to_le_bytes()[..whole]);
        self.word >>= 8 * whole;
        self.filled %= 8;
    }

    /// See [`BitReader::rice`].
    #[inline(always)]
    pub(super) fn put_rice(&mut self, value: u32, low: u32) {
        let unary = value >> low;
        if unary >= UNARY_MAX {
            self.put(u64::from(value) << UNARY_MAX, UNARY_MAX + 7);
        } else {
            let rest = u64::from(value & ((1 << low) - 1));
            self.put((rest << 1 | 1) << unary, unary + 1 + low);
        }
    }

    /// See [`BitReader::golomb`].
    pub(super) fn put_golomb(&mut self, value: u32, low: u32) {
        let zeros = ((value >> low) + 1).ilog2();
        let rest = u64::from(value - (((1 << zeros) - 1) << low));
        self.put((rest << 1 | 1) << zeros, 2 * zeros + 1 + low);
    }

    /// Fills the last byte with zeros.
    pub(super) fn finish(self) {
        if self.filled > 0 {
            self.out.push(self.word as u8);
        }
    }
}
