//! Prefix codes for the bytes of a halftone, one for each neighbourhood that a byte may have.

use thiserror::Error;

/// Neighbourhoods: 17 densities, 3 phases.
pub const CONTEXTS: usize = 17 * 3;
/// The longest code, bits.
const LENGTH_MAX: usize = 15;
/// A length in 4 bits, two in a byte, the first in the lower half: of bytes 0 … 255 in context 0, then of context 1 …
pub const LENGTHS_BYTES: usize = CONTEXTS * 128;

/// Lengths that make no codes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum ByteCodesError {
    /// See the message.
    #[error("code lengths of {given} bytes: {LENGTHS_BYTES} are needed")]
    Size {
        /// What was given.
        given: usize,
    },
    /// See the message.
    #[error("the code lengths of context {context} are none of a complete prefix code")]
    Lengths {
        /// The context.
        context: usize,
    },
}

/// The codes of one neighbourhood, in canonical order: shorter ones first, then by their bytes.
#[derive(Clone, Copy, Debug)]
struct Context {
    /// By the next 8 bits: a byte and, above it, the length of its code; 0 where that is longer.
    short: [u16; 256],
    /// Beyond the last code of each length, its bits at the top of 16: up to 2¹⁶. The first is of length 1.
    limits: [u32; LENGTH_MAX],
    /// What a code of each length has less than its place in `bytes`.
    offsets: [u16; LENGTH_MAX + 1],
    bytes: [u8; 256],
}

/// Codes for all neighbourhoods, in memory of their own: 44 KiB.
#[derive(Clone, Debug)]
pub struct ByteCodes {
    is_set: bool,
    contexts: [Context; CONTEXTS],
}

impl ByteCodes {
    /// No codes yet.
    pub const NONE: Self = {
        let none = Context { short: [0; 256], limits: [0; LENGTH_MAX], offsets: [0; LENGTH_MAX + 1], bytes: [0; 256] };
        Self { is_set: false, contexts: [none; CONTEXTS] }
    };

    /// No codes any more.
    pub fn forget(&mut self) {
        self.is_set = false;
    }

    /// Whether there are any.
    pub const fn is_set(&self) -> bool {
        self.is_set
    }

    /// Takes codes by their `lengths`: see [`LENGTHS_BYTES`]. After an error there are none.
    pub fn set(&mut self, lengths: &[u8]) -> Result<(), ByteCodesError> {
        self.is_set = false;
        if lengths.len() != LENGTHS_BYTES {
            return Err(ByteCodesError::Size { given: lengths.len() });
        }
        for (number, (context, lengths)) in self.contexts.iter_mut().zip(lengths.as_chunks().0).enumerate() {
            *context = Context::new(lengths).ok_or(ByteCodesError::Lengths { context: number })?;
        }
        self.is_set = true;
        Ok(())
    }

    /// The byte whose code `next` begins with, in `context`, and its length.
    #[inline(always)]
    pub(super) fn read(&self, context: usize, next: u64) -> (u8, u32) {
        let context = &self.contexts[context.min(CONTEXTS - 1)];
        let short = context.short[(next >> 56) as usize];
        if short != 0 {
            return (short as u8, (short >> 8).into());
        }
        let code = (next >> 48) as u32;
        let mut length = 1;
        for limit in &context.limits {
            length += u32::from(code >= *limit);
        }
        let length = length.min(LENGTH_MAX as u32);
        let place = ((code >> (16 - length)) as u16).wrapping_add(context.offsets[length as usize]);
        (context.bytes[usize::from(place & 255)], length)
    }
}

impl Context {
    fn new(lengths: &[u8; 128]) -> Option<Self> {
        let mut context =
            Self { short: [0; 256], limits: [0; LENGTH_MAX], offsets: [0; LENGTH_MAX + 1], bytes: [0; 256] };
        let length_of = |byte: usize| usize::from(lengths[byte / 2] >> (byte % 2 * 4) & 15);
        let (mut code, mut place) = (0u32, 0u16);
        let Self { short, limits, offsets, bytes } = &mut context;
        for (length, (limit, offset)) in (1..).zip(limits.iter_mut().zip(offsets.iter_mut().skip(1))) {
            code <<= 1;
            *offset = place.wrapping_sub(code as u16);
            for byte in (0..256).filter(|byte| length_of(*byte) == length) {
                if let Some(slot) = bytes.get_mut(usize::from(place)) {
                    *slot = byte as u8;
                }
                if length <= 8 {
                    let span = 1 << (8 - length);
                    let entries = short.iter_mut().skip((code as usize).wrapping_mul(span)).take(span);
                    entries.for_each(|entry| *entry = (length << 8 | byte) as u16);
                }
                (code, place) = (code + 1, place + 1);
            }
            if code > 1 << length {
                return None;
            }
            *limit = code << (16 - length);
        }
        (code == 1 << LENGTH_MAX && place == 256).then_some(context)
    }
}
