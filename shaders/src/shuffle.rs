//! Transposition by perfect shuffles, which are vector instructions where moving each number by itself is not.

/// One from each half of `from` in turn. As places in binary, the first digit becomes the last: of 2ⁿ rows, n shuffles make columns.
#[inline(always)]
pub fn shuffle<T: Copy>(from: &[T], to: &mut [T]) {
    let (low, high) = from.split_at(from.len() / 2);
    for (pair, (low, high)) in to.chunks_exact_mut(2).zip(low.iter().zip(high)) {
        pair[0] = *low;
        pair[1] = *high;
    }
}
