//! Lines and numbers of OBJ and MTL files.

use std::borrow::Cow;

use super::Fault;

/// Lines with their numbers from 1, comments removed, joined where one ends in a backslash.
pub(super) fn logical_lines(bytes: &[u8]) -> impl Iterator<Item = (usize, Cow<'_, str>)> {
    // Some editors put a byte order mark in front.
    let bytes = bytes.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(bytes);
    let mut lines = bytes.split(|&b| b == b'\n').enumerate();
    std::iter::from_fn(move || {
        let (index, line) = lines.next()?;
        let mut text = String::from_utf8_lossy(line);
        while let Some(length) = text.trim_end().strip_suffix('\\').map(str::len) {
            let Some((_, next)) = lines.next() else { break };
            let joined = text.to_mut();
            joined.replace_range(length.., " ");
            joined.push_str(&String::from_utf8_lossy(next));
        }
        if let Some(comment) = text.find('#') {
            text = Cow::Owned(text[..comment].to_owned());
        }
        Some((index + 1, text))
    })
}

/// Numbers of a line; at least `needed` of them.
pub(super) fn numbers<const N: usize>(
    place: &dyn std::fmt::Display,
    words: &mut dyn Iterator<Item = &str>,
    needed: usize,
) -> Result<([f32; N], usize), Fault> {
    let mut values = [0.0_f32; N];
    let mut count = 0;
    for (value, word) in values.iter_mut().zip(words) {
        *value = word
            .parse()
            .map_err(|_| Fault::malformed(place.to_string(), format!("\"{word}\", allowed are {needed} numbers")))?;
        if value.is_nan() || value.abs() > 1e15 {
            return Err(Fault::NotFinite { place: place.to_string(), what: "number", value: word.into() });
        }
        count += 1;
    }
    if count < needed {
        return Err(Fault::malformed(place.to_string(), format!("{count} numbers, allowed are at least {needed}")));
    }
    Ok((values, count))
}
