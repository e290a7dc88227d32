//! Clicks that the others contradict.

use super::fit::{Fit, Free};
use super::{CalibrationError, Click, Wrong};
use protocol::rig::Rig;

/// How well people click, pixels along u and along v, and how many spare numbers that knowledge is worth. By the spare numbers alone, of
/// which eight clicks leave five, eight pixels of one click could be chance.
const CLICK_PX: f64 = 0.5;
const KNOWN: f64 = 10.0;
/// A right click is called wrong once in so many calibrations.
const ONCE_IN: f64 = 1000.0;
/// Of more than one in so many clicks nobody can say which are the wrong ones.
const SHARE: usize = 4;

/// Fits `rig` to those of `clicks` that agree.
pub fn fit(rig: &Rig, clicks: &[Click], free: Free) -> Result<(Fit, Vec<Click>, Vec<Wrong>), CalibrationError> {
    let mut clicks = clicks.to_vec();
    let mut wrong = Vec::new();
    let mut all = Fit::new(rig, &clicks, free);
    while wrong.len() < (clicks.len() + wrong.len()) / SHARE {
        let mut without = without_each(rig, &clicks, free);
        if without.is_empty() {
            break;
        }
        let (index, rest) = without.remove(0);
        if all.as_ref().is_ok_and(|all| !contradicts(all.squares(), &rest, clicks.len())) {
            break;
        }
        // Others without which the rest agrees no worse than by chance.
        without.retain(|(_, other)| !contradicts(other.squares(), &rest, clicks.len()));
        if !without.is_empty() {
            let mut which: Vec<_> = without.iter().map(|(other, _)| *other).chain([index]).collect();
            which.sort_unstable();
            let labels: Vec<_> = which.iter().map(|index| clicks[*index].label.as_str()).collect();
            return Err(CalibrationError::OneOf(labels.join(", ")));
        }
        let click = clicks.remove(index);
        let off_px = rest.distance_px(&click);
        wrong.push(Wrong { click, off_px });
        all = Ok(rest);
    }
    Ok((all?, clicks, wrong))
}

/// Each click's index with the fit of the others, those that agree best first; none where no number would be spare.
fn without_each(rig: &Rig, clicks: &[Click], free: Free) -> Vec<(usize, Fit)> {
    let without = |index: usize| {
        let mut rest = clicks.to_vec();
        rest.remove(index);
        Fit::new(rig, &rest, free).ok().filter(|fit| fit.spare() > 0).map(|fit| (index, fit))
    };
    let mut each: Vec<_> = (0..clicks.len()).filter_map(without).collect();
    each.sort_by(|(_, a), (_, b)| a.squares().total_cmp(&b.squares()));
    each
}

/// Whether `squares`, of a fit that one click more or another one has to suit, are more above those of `rest` than chance makes them: by the F distribution of 2 and n degrees of freedom,
/// P(F > f) = (1 + 2 f / n)^(−n / 2), for the best of `count` choices.
fn contradicts(squares: f64, rest: &Fit, count: usize) -> bool {
    let freedom = rest.spare() as f64 + KNOWN;
    let variance = (rest.squares() + KNOWN * CLICK_PX * CLICK_PX) / freedom;
    let ratio = (squares - rest.squares()) / 2.0 / variance;
    (1.0 + 2.0 * ratio / freedom).powf(-freedom / 2.0) * count as f64 * ONCE_IN < 1.0
}
