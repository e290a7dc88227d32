//! A photodiode's trace, and what it proves: which planes were lit, in which order, and which were not.

use super::sequence::Sequence;
use serde::Serialize;
use std::collections::HashMap;
use std::fmt::{self, Display, Formatter};
use thiserror::Error;

/// The most samples: an hour at 10 kHz, a minute at 600 kHz.
const SAMPLES_MAX: usize = 36_000_000;
/// Intervals between edges that lie this far, in planes, from whole numbers on average are of another plane rate.
const OFF_MEAN: f64 = 0.2;

/// Why a recording proves nothing.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum TraceError {
    /// See the message.
    #[error("line {line}: {text:?} is no pair of numbers: must be seconds, a comma and a level, later in each line")]
    Line {
        /// Counted from 1.
        line: usize,
        /// What stands there.
        text: String,
    },
    /// See the message.
    #[error("more than {SAMPLES_MAX} samples: cut it into parts")]
    TooLong,
    /// See the message.
    #[error("the level hardly changes: is the photodiode in the light, and does the display show the markers?")]
    Flat,
    /// See the message.
    #[error("{samples_a_plane:.1} samples in a plane of {plane_us:.1} us: at least 4 are needed")]
    Coarse {
        /// What there is.
        samples_a_plane: f64,
        /// A plane of this rig.
        plane_us: f64,
    },
    /// See the message.
    #[error("the light does not change in steps of {plane_us:.1} us, a plane of this rig: is it another rig's?")]
    OtherRate {
        /// A plane of this rig.
        plane_us: f64,
    },
    /// See the message.
    #[error("nowhere {needed} planes in a row are as the markers have them")]
    NoMarkers {
        /// Planes that prove a place.
        needed: usize,
    },
}

/// Something that is not as it should be.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case", tag = "finding")]
pub enum Finding {
    /// Planes that were lit and should be dark, or the other way round.
    Wrong {
        /// When the first one was, seconds of the recording.
        at_s: f64,
        /// The slice that should have been there.
        slice: u32,
        /// How many.
        planes: usize,
    },
    /// Planes that never came.
    Missing {
        /// Before this moment.
        at_s: f64,
        /// The slice that came.
        slice: u32,
        /// How many.
        planes: u32,
    },
    /// Planes that came once more, or too early.
    Repeated {
        /// Before this moment.
        at_s: f64,
        /// The slice that came.
        slice: u32,
        /// How many.
        planes: u32,
    },
}

impl Display for Finding {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self {
            Self::Wrong { at_s, slice, planes } => {
                write!(f, "{at_s:.6} s: {planes} plane(s) wrong from slice {slice} on")
            }
            Self::Missing { at_s, slice, planes } => {
                write!(f, "{at_s:.6} s: {planes} plane(s) missing before slice {slice}")
            }
            Self::Repeated { at_s, slice, planes } => {
                write!(f, "{at_s:.6} s: {planes} plane(s) again before slice {slice}")
            }
        }
    }
}

/// What a trace proves.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Proof {
    /// Planes that were read.
    pub planes: usize,
    /// The slice of the first one.
    pub first_slice: u32,
    /// How long a plane is, seconds, in the mean.
    pub plane_s: f64,
    /// How far edges are from where the mean has them, RMS, seconds.
    pub jitter_s: f64,
    /// What is not as it should be, in order.
    pub findings: Vec<Finding>,
}

/// Reads samples: a line each, seconds and level; a first line of names is left out.
pub fn read_csv(text: &str) -> Result<Vec<[f64; 2]>, TraceError> {
    let mut samples: Vec<[f64; 2]> = Vec::new();
    for (number, line) in (1..).zip(text.lines()) {
        let pair = line.split_once([',', ';', '\t']).and_then(|(time, level)| {
            let pair = [time.trim().parse::<f64>().ok()?, level.trim().parse::<f64>().ok()?];
            pair.iter().all(|value| value.is_finite()).then_some(pair)
        });
        match pair {
            Some(pair) if samples.last().is_none_or(|last| last[0] < pair[0]) => samples.push(pair),
            None if number == 1 || line.trim().is_empty() => {}
            _ => return Err(TraceError::Line { line: number, text: line.chars().take(40).collect() }),
        }
        if samples.len() > SAMPLES_MAX {
            return Err(TraceError::TooLong);
        }
    }
    Ok(samples)
}

/// What `samples` (seconds, level) prove of a display whose planes of `plane_s` seconds follow `sequence`.
pub fn prove(samples: &[[f64; 2]], sequence: &Sequence, slices: u32, plane_s: f64) -> Result<Proof, TraceError> {
    let lit = Lit::read(samples, plane_s)?;
    let (first_slice, findings) = judge(&lit, sequence, slices)?;
    let Lit { planes, plane_s, jitter_s, .. } = lit;
    Ok(Proof { planes: planes.len(), first_slice, plane_s, jitter_s, findings })
}

/// Planes as a photodiode saw them.
struct Lit {
    planes: Vec<bool>,
    starts_s: Vec<f64>,
    plane_s: f64,
    jitter_s: f64,
}

impl Lit {
    fn read(samples: &[[f64; 2]], plane_s: f64) -> Result<Self, TraceError> {
        let plane_us = plane_s * 1e6;
        let mut levels: Vec<_> = samples.iter().map(|[_, level]| *level).collect();
        levels.sort_by(f64::total_cmp);
        let share = |share: f64| levels.get((levels.len() as f64 * share) as usize).copied();
        let (Some(low), Some(high)) = (share(0.05), share(0.95)) else { return Err(TraceError::Flat) };
        if high - low <= 1e-9 * high.abs().max(low.abs()) {
            return Err(TraceError::Flat);
        }
        let seconds = samples[samples.len() - 1][0] - samples[0][0];
        let samples_a_plane = samples.len() as f64 * plane_s / seconds;
        if samples_a_plane < 4.0 {
            return Err(TraceError::Coarse { samples_a_plane, plane_us });
        }
        let edges = edges(samples, [0.6 * low + 0.4 * high, 0.4 * low + 0.6 * high]);
        let steps: Vec<f64> = edges.windows(2).map(|pair| (pair[1].0 - pair[0].0) / plane_s).collect();
        let off = steps.iter().map(|step| (step - step.round()).abs()).sum::<f64>() / steps.len().max(1) as f64;
        // What changes at random is a quarter of a plane off on average.
        if steps.len() < 4 || off > OFF_MEAN || steps.iter().any(|step| step.round() < 1.0) {
            return Err(TraceError::OtherRate { plane_us });
        }
        let total: f64 = steps.iter().map(|step| step.round()).sum();
        let mean_s = (edges[edges.len() - 1].0 - edges[0].0) / total;
        let squares = steps.iter().map(|step| (step * plane_s - step.round() * mean_s).powi(2)).sum::<f64>();
        // An interval has the jitter of two edges.
        let jitter_s = (squares / steps.len() as f64 / 2.0).sqrt();
        let (mut planes, mut starts_s) = (Vec::new(), Vec::new());
        for ((at, rises), step) in edges.iter().zip(&steps) {
            let count = step.round() as usize;
            planes.extend(std::iter::repeat_n(*rises, count));
            starts_s.extend((0..count).map(|plane| at + plane as f64 * step * plane_s / count as f64));
        }
        Ok(Self { planes, starts_s, plane_s: mean_s, jitter_s })
    }
}

/// When the level passes its middle, and whether it rises; a change must pass both thresholds.
fn edges(samples: &[[f64; 2]], [low, high]: [f64; 2]) -> Vec<(f64, bool)> {
    let middle = (low + high) / 2.0;
    let mut edges = Vec::new();
    let mut is_lit: Option<bool> = None;
    let mut passed = None;
    for pair in samples.windows(2) {
        let [[before_s, before], [after_s, after]] = [pair[0], pair[1]];
        if (before < middle) != (after < middle) {
            passed = Some(before_s + (after_s - before_s) * (middle - before) / (after - before));
        }
        let now = if after > high { Some(true) } else { (after < low).then_some(false) };
        if let (Some(now), Some(was), Some(at)) = (now, is_lit, passed)
            && now != was
        {
            edges.push((at, now));
        }
        is_lit = now.or(is_lit);
    }
    edges
}

/// The first plane's slice, and where the planes leave the sequence.
fn judge(lit: &Lit, sequence: &Sequence, slices: u32) -> Result<(u32, Vec<Finding>), TraceError> {
    let width = sequence.window();
    let places = places(&lit.planes, sequence, slices);
    let modulo = |number: i64| number.rem_euclid(i64::from(slices)) as u32;
    let follows = |(at, slice): (usize, u32), next: usize| modulo(i64::from(slice) + next as i64 - at as i64);
    // A place is proved by as many windows in a row as a wrong plane may spoil.
    let is_proved = |end: usize| {
        places[end].is_some_and(|slice| {
            (end..(end + width).min(places.len())).all(|next| places[next] == Some(follows((end, slice), next)))
        })
    };
    let first = (0..places.len()).find(|end| is_proved(*end) && end + width <= places.len());
    let Some(mut known) = first.and_then(|end| Some((end, places[end]?))) else {
        return Err(TraceError::NoMarkers { needed: 2 * width - 1 });
    };
    let (first_slice, mut findings) = (follows(known, 0), Vec::new());
    let mut end = known.0 + 1;
    while end < places.len() {
        let expected = follows(known, end);
        if places[end] == Some(expected) {
            known = (end, expected);
            end += 1;
            continue;
        }
        let Some(next) = (end..places.len()).find(|next| is_proved(*next)) else { break };
        let slice = places[next].unwrap_or(expected);
        let shift = modulo(i64::from(slice) - i64::from(follows(known, next)));
        let begins = next + 1 - width;
        let finding = match shift {
            0 => {
                let is_wrong = |plane: &usize| lit.planes[*plane] != sequence.is_lit(follows(known, *plane));
                let wrong: Vec<usize> = (known.0 + 1..next).filter(is_wrong).collect();
                let plane = wrong.first().copied().unwrap_or(end);
                Finding::Wrong { at_s: lit.starts_s[plane], slice: follows(known, plane), planes: wrong.len() }
            }
            planes => {
                let (at_s, slice) = (lit.starts_s[begins], modulo(i64::from(slice) + 1 - width as i64));
                if planes <= slices / 2 {
                    Finding::Missing { at_s, slice, planes }
                } else {
                    Finding::Repeated { at_s, slice, planes: slices - planes }
                }
            }
        };
        findings.push(finding);
        known = (next, slice);
        end = next + 1;
    }
    Ok((first_slice, findings))
}

/// For each plane the slice that it is, by it and those before it.
fn places(planes: &[bool], sequence: &Sequence, slices: u32) -> Vec<Option<u32>> {
    let mask = (1_u64 << sequence.window()) - 1;
    let table: HashMap<u64, u32> = (0..slices)
        .map(|slice| {
            let window = sequence.window() as u32;
            let bits =
                (0..window).map(|back| u64::from(sequence.is_lit((slice + window * slices - back) % slices)) << back);
            (bits.sum(), slice)
        })
        .collect();
    let mut word = 0;
    (0..)
        .zip(planes)
        .map(|(count, lit)| {
            word = (word << 1 | u64::from(*lit)) & mask;
            table.get(&word).copied().filter(|_| count + 1 >= sequence.window())
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const SLICES: u32 = 288;
    const PLANE_S: f64 = 1.0 / 5760.0;

    /// A trace of planes, with `samples` in each, a slow edge and some noise; the clock runs `fast` times as fast.
    fn trace(planes: &[bool], samples: usize, fast: f64) -> Vec<[f64; 2]> {
        let mut level = 0.0;
        (0..planes.len() * samples)
            .map(|sample| {
                let target = f64::from(u8::from(planes[sample / samples]));
                level += 0.7 * (target - level);
                let noise = 0.05 * ((sample as f64 * 12.9898).sin() * 43_758.547).fract();
                [1.0 + sample as f64 / samples as f64 * PLANE_S / fast, 0.2 + 3.0 * (level + noise)]
            })
            .collect()
    }

    fn turns(count: usize) -> Vec<bool> {
        let sequence = Sequence::new(SLICES);
        (0..SLICES * count as u32).map(|plane| sequence.is_lit(plane % SLICES)).collect()
    }

    fn proof(planes: &[bool]) -> Proof {
        prove(&trace(planes, 8, 1.001), &Sequence::new(SLICES), SLICES, PLANE_S).unwrap()
    }

    #[test]
    fn what_is_right_is_proved() {
        let proof = proof(&turns(3)[100..]);
        // The light of the first planes has no edge before it.
        assert!(proof.findings.is_empty() && proof.planes > 740, "{proof:?}");
        assert!((proof.plane_s * 1.001 / PLANE_S - 1.0).abs() < 1e-4 && proof.jitter_s < 0.1 * PLANE_S, "{proof:?}");
        assert!((100..112).contains(&proof.first_slice));
    }

    #[test]
    fn what_is_wrong_is_found() {
        let mut planes = turns(3);
        planes[400] ^= true;
        let found = proof(&planes).findings;
        assert!(matches!(found[..], [Finding::Wrong { slice: 112, planes: 1, .. }]), "{found:?}");
        let mut planes = turns(3);
        planes.drain(300..305);
        let found = proof(&planes).findings;
        assert!(matches!(found[..], [Finding::Missing { planes: 5, .. }]), "{found:?}");
        let mut planes = turns(3);
        let again = planes[290..314].to_vec();
        planes.splice(314..314, again);
        let found = proof(&planes).findings;
        assert!(matches!(found[..], [Finding::Repeated { planes: 24, .. }]), "{found:?}");
    }

    #[test]
    fn what_proves_nothing_is_named() {
        let sequence = Sequence::new(SLICES);
        let prove = |samples: &[[f64; 2]]| prove(samples, &sequence, SLICES, PLANE_S).unwrap_err();
        assert_eq!(prove(&[]), TraceError::Flat);
        assert_eq!(prove(&[[0.0, 1.0]; 100]), TraceError::Flat);
        assert!(matches!(prove(&trace(&turns(1), 2, 1.0)), TraceError::Coarse { .. }));
        assert!(matches!(prove(&trace(&turns(1), 8, 1.37)), TraceError::OtherRate { .. }));
        let other: Vec<_> = (0..600).map(|plane| plane * plane % 7 < 3).collect();
        assert!(matches!(prove(&trace(&other, 8, 1.0)), TraceError::NoMarkers { needed: 17 }));
        for text in ["t,v\n1,2\n1,2", "1,2\nx,3", "1,nan\n1 2\n3"] {
            assert!(matches!(read_csv(text), Err(TraceError::Line { line: 2 | 3, .. })), "{text}");
        }
        assert_eq!(read_csv("time_s,level\n0.5, 2\n0.6;3\n\n"), Ok(vec![[0.5, 2.0], [0.6, 3.0]]));
    }

    proptest! {
        #![proptest_config(ProptestConfig { failure_persistence: None, cases: 64, ..ProptestConfig::default() })]
        #[test]
        fn whatever_comes_is_judged(samples in prop::collection::vec(prop::array::uniform2(-1e3..1e3_f64), 0..200)) {
            let mut samples: Vec<[f64; 2]> = samples;
            samples.sort_by(|a, b| a[0].total_cmp(&b[0]));
            let _ = prove(&samples, &Sequence::new(SLICES), SLICES, PLANE_S);
        }

        #[test]
        fn planes_that_are_left_out_are_counted(at in 40_usize..800, count in 1_usize..140) {
            let mut planes = turns(4);
            planes.drain(at..at + count);
            let missing = |finding: &Finding| matches!(finding, Finding::Missing { planes, .. } if *planes as usize == count);
            let found = proof(&planes).findings;
            prop_assert!(found.len() == 1 && missing(&found[0]), "{:?}", found);
        }
    }
}
