//! Bits of a stream, the highest of each byte first: so that a code's length is a count of leading zeros, or a comparison.

/// What one code needs at most, bytes.
pub(super) const CODE_BYTES: usize = 16;
/// Bytes from the next one on that must be there to read a code without looking at the end.
pub(super) const AHEAD_BYTES: usize = CODE_BYTES + 8;

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
        self.at / 8 + AHEAD_BYTES <= self.bytes.len()
    }

    /// The next 57 bits at least, from the highest on; zeros beyond the end.
    #[inline(always)]
    pub(super) fn peek(&self) -> u64 {
        let word = self.bytes.get(self.at / 8..).and_then(|bytes| bytes.first_chunk());
        word.map_or(0, |word| u64::from_be_bytes(*word)) << (self.at % 8)
    }

    /// Passes over `count` bits.
    #[inline(always)]
    pub(super) fn skip(&mut self, count: u32) {
        self.at += count as usize;
    }

    /// The next `count` bits, at most 57.
    #[inline(always)]
    pub(super) fn take(&mut self, count: u32) -> u64 {
        let value = highest(self.peek(), count);
        self.skip(count);
        value
    }

    /// A number by Rice's code: the number without its lowest `low` bits in unary (zeros, then a one), then those bits. After
    /// [`UNARY_MAX`] zeros the number stands in 7 bits.
    #[inline(always)]
    pub(super) fn rice(&mut self, low: u32) -> u32 {
        let next = self.peek();
        let zeros = next.leading_zeros();
        if zeros >= UNARY_MAX {
            self.skip(UNARY_MAX + 7);
            return highest(next << UNARY_MAX, 7) as u32;
        }
        self.skip(zeros + 1 + low);
        zeros << low | highest(next << (zeros + 1), low) as u32
    }

    /// A number by the exponential Golomb code whose first class has `low` bits; below 2¹³.
    #[inline(always)]
    pub(super) fn golomb(&mut self, low: u32) -> u32 {
        let next = self.peek();
        let zeros = next.leading_zeros().min(12);
        let bits = zeros + low;
        self.skip(zeros + 1 + bits);
        (((1 << zeros) - 1) << low) + highest(next << (zeros + 1), bits) as u32
    }
}

/// The highest `count` bits of `word`, at most 63.
#[inline(always)]
fn highest(word: u64, count: u32) -> u64 {
    (word >> 1) >> (63 - count)
}

/// Zeros after which a Rice code is no longer unary.
pub(super) const UNARY_MAX: u32 = 12;

/// Appends bits to memory.
#[cfg(feature = "std")]
pub(super) struct BitWriter<'a> {
    out: &'a mut Vec<u8>,
    /// What is above its filled bits was written.
    word: u64,
    /// Bits in it, the lowest: fewer than 32 between calls.
    filled: u32,
}

#[cfg(feature = "std")]
impl<'a> BitWriter<'a> {
    /// After what is in `out`.
    pub(super) fn new(out: &'a mut Vec<u8>) -> Self {
        Self { out, word: 0, filled: 0 }
    }

    /// `value`, which has at most `count` bits, at most 64.
    #[inline(always)]
    pub(super) fn put(&mut self, value: u64, count: u32) {
        if count > 32 {
            self.put_half(value >> 32, count - 32);
            self.put_half(value & u64::from(u32::MAX), 32);
        } else {
            self.put_half(value, count);
        }
    }

    /// `value`, which has at most `count` bits, at most 32.
    #[inline(always)]
    fn put_half(&mut self, value: u64, count: u32) {
        self.word = self.word << count | value;
        self.filled += count;
        if self.filled >= 32 {
            self.filled -= 32;
            self.out.extend_from_slice(&((self.word >> self.filled) as u32).to_be_bytes());
        }
    }

    /// See [`BitReader::rice`].
    #[inline(always)]
    pub(super) fn put_rice(&mut self, value: u32, low: u32) {
        let unary = value >> low;
        if unary >= UNARY_MAX {
            self.put(value.into(), UNARY_MAX + 7);
        } else {
            self.put(u64::from(1 << low | value & ((1 << low) - 1)), unary + 1 + low);
        }
    }

    /// See [`BitReader::golomb`].
    pub(super) fn put_golomb(&mut self, value: u32, low: u32) {
        let zeros = ((value >> low) + 1).ilog2();
        let rest = value - (((1 << zeros) - 1) << low);
        self.put(u64::from(1 << (zeros + low) | rest), 2 * zeros + 1 + low);
    }

    /// Fills the last byte with zeros.
    pub(super) fn finish(self) {
        let bytes = ((self.word << (32 - self.filled)) as u32).to_be_bytes();
        self.out.extend_from_slice(&bytes[..self.filled.div_ceil(8) as usize]);
    }
}
