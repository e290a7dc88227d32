//! How much detail a turn gets: less where rendering is late, more where there is time to spare.

use std::time::Duration;

/// So many turns in a row must be late before the detail is lowered: one may be somebody else's doing.
const LATE_TURNS: u32 = 3;
/// So many in a row must take less than [`SPARE`] of their time before it is raised again: two seconds of a mirror that turns 20 times a second.
const EARLY_TURNS: u32 = 40;
/// What is left of a turn's time where more detail is tried.
const SPARE: f64 = 0.6;
/// After a raise that was taken back at once the next one waits twice as long, at most so many times [`EARLY_TURNS`].
const PATIENCE_MAX: u32 = 64;

/// Which rung of a ladder of budgets is on: 0 is what was asked for, each further one allows twice the error.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Detail {
    rung: usize,
    late: u32,
    early: u32,
    patience: u32,
    /// Turns since the last raise.
    since_raise: u32,
}

impl Default for Detail {
    fn default() -> Self {
        Self { rung: 0, late: 0, early: 0, patience: 1, since_raise: u32::MAX }
    }
}

impl Detail {
    /// The rung.
    pub fn rung(&self) -> usize {
        self.rung
    }

    /// What follows from a turn that took `took` where it may take `period`, on a ladder of `rungs`: whether the rung changed.
    pub fn after(&mut self, took: Duration, period: Duration, rungs: usize) -> bool {
        self.since_raise = self.since_raise.saturating_add(1);
        if took > period {
            (self.late, self.early) = (self.late + 1, 0);
        } else if took < period.mul_f64(SPARE) {
            (self.late, self.early) = (0, self.early + 1);
        } else {
            (self.late, self.early) = (0, 0);
        }
        if self.late >= LATE_TURNS && self.rung + 1 < rungs {
            let in_vain = self.since_raise <= EARLY_TURNS;
            self.patience = if in_vain { (2 * self.patience).min(PATIENCE_MAX) } else { 1 };
            *self = Self { rung: self.rung + 1, late: 0, early: 0, ..*self };
            return true;
        }
        if self.early >= EARLY_TURNS * self.patience && self.rung > 0 {
            *self = Self { rung: self.rung - 1, late: 0, early: 0, since_raise: 0, ..*self };
            return true;
        }
        false
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PERIOD: Duration = Duration::from_millis(50);

    /// The rungs over `turns` turns that take what `cost_ms` says of their rung.
    fn rungs(turns: usize, cost_ms: impl Fn(usize, usize) -> u64) -> Vec<usize> {
        let mut detail = Detail::default();
        (0..turns)
            .map(|turn| {
                detail.after(Duration::from_millis(cost_ms(turn, detail.rung())), PERIOD, 4);
                detail.rung()
            })
            .collect()
    }

    #[test]
    fn late_turns_lower_it_and_one_alone_does_not() {
        assert_eq!(rungs(6, |_, rung| [100, 70, 45, 20][rung]), [0, 0, 1, 1, 1, 2]);
        assert_eq!(rungs(100, |turn, _| if turn % 3 == 0 { 90 } else { 40 }), [0; 100]);
        // The last rung is the last.
        assert_eq!(rungs(1_000, |_, _| 500)[999], 3);
    }

    #[test]
    fn when_the_load_is_gone_it_comes_back() {
        let rungs = rungs(300, |turn, rung| if turn < 20 { 100 - 20 * rung as u64 } else { 10 });
        assert_eq!((rungs[19], rungs[299]), (3, 0));
    }

    #[test]
    fn a_raise_in_vain_is_tried_less_and_less_often() {
        let rungs = rungs(20_000, |_, rung| [60, 20, 20, 20][rung]);
        let changes = rungs.windows(2).filter(|pair| pair[0] != pair[1]).count();
        assert!((10..40).contains(&changes), "{changes}");
    }
}
