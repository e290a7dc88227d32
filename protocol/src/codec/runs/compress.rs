//! The other direction: on the host, where memory is no matter.

use super::{KIND_ABOVE, KIND_LITERAL, KIND_REPEAT, KIND_ZERO, LENGTH_LONG};

/// Appends the compressed form of `plane` to `out`. `row_bytes`: bytes of a row, [`ImageSize::row_bytes`](super::super::ImageSize::row_bytes).
///
/// Greedy: where a run of at least three bytes begins, the longest one is taken. Never longer than the plane by more than a
/// 64th and 4 bytes.
pub(in super::super) fn compress_runs(plane: &[u8], row_bytes: usize, out: &mut Vec<u8>) {
    let (mut at, mut literal) = (0, 0);
    while at < plane.len() {
        let Some((kind, length)) = run_at(plane, at, row_bytes) else {
            at += 1;
            continue;
        };
        push_literal(&plane[literal..at], out);
        push_head(kind, length, out);
        if kind == KIND_REPEAT {
            out.push(plane[at]);
        }
        at += length;
        literal = at;
    }
    push_literal(&plane[literal..], out);
}

/// The longest run that saves bytes, even where it splits a literal that then needs a second head.
fn run_at(plane: &[u8], at: usize, row_bytes: usize) -> Option<(u8, usize)> {
    let here = &plane[at..];
    let three = here.first_chunk::<3>()?;
    let equal = if three[0] == three[1] && three[1] == three[2] { 1 + common_prefix(here, &here[1..]) } else { 0 };
    let above = at.checked_sub(row_bytes).map_or(0, |from| {
        let above = &plane[from..];
        if above.first_chunk::<3>() == Some(three) { common_prefix(here, above) } else { 0 }
    });
    if above >= equal && above > 0 {
        Some((KIND_ABOVE, above))
    } else if three[0] == 0 && equal > 0 {
        Some((KIND_ZERO, equal))
    } else if equal > 3 {
        Some((KIND_REPEAT, equal))
    } else {
        None
    }
}

/// How many bytes two slices have in common from the start.
fn common_prefix(a: &[u8], b: &[u8]) -> usize {
    let (a_words, b_words) = (a.as_chunks::<8>().0, b.as_chunks::<8>().0);
    let words = a_words.iter().zip(b_words).take_while(|(a, b)| a == b).count();
    let from = words * 8;
    from + a[from..].iter().zip(&b[from..]).take_while(|(a, b)| a == b).count()
}

fn push_literal(bytes: &[u8], out: &mut Vec<u8>) {
    if !bytes.is_empty() {
        push_head(KIND_LITERAL, bytes.len(), out);
        out.extend_from_slice(bytes);
    }
}

fn push_head(kind: u8, length: usize, out: &mut Vec<u8>) {
    if length < LENGTH_LONG {
        out.push(kind << 6 | (length - 1) as u8);
        return;
    }
    let value = (length - LENGTH_LONG) as u32;
    // A plane has at most 2²¹ bytes, so that three always do.
    let bytes = (value.checked_ilog2().unwrap_or(0) / 8 + 1) as usize;
    out.push(kind << 6 | (LENGTH_LONG - 2 + bytes) as u8);
    out.extend_from_slice(&value.to_le_bytes()[..bytes]);
}
