//! When turns are rendered: so that each is on the controller shortly before the mirror begins the turn in which it is lit. One that is there
//! earlier waits, and shows viewers where they were.

use std::collections::VecDeque;
use std::time::Duration;

/// The shortest wait of so many turns counts: rendering and the link take a different time each turn.
const TURNS: usize = 10;
/// As long before its light the soonest of them is to be there.
const MARGIN_S: f64 = 0.008;
/// Below this share of it they are rendered sooner again.
const SCARCE: f64 = 0.4;

/// How long turns waited on the controller.
#[derive(Clone, Debug, Default)]
pub struct Phase(VecDeque<f64>);

impl Phase {
    /// One more turn was lit, after it had waited for `wait`: by how many seconds the next ones are to be rendered later, or sooner.
    pub fn after(&mut self, wait: Duration) -> Option<f64> {
        self.0.push_back(wait.as_secs_f64());
        if self.0.len() < TURNS {
            return None;
        }
        let least = self.0.iter().copied().fold(f64::INFINITY, f64::min);
        let excess_s = least - MARGIN_S;
        if (SCARCE * MARGIN_S..=2.0 * MARGIN_S).contains(&least) {
            self.0.pop_front();
            return None;
        }
        self.0.clear();
        Some(excess_s)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PERIOD_S: f64 = 0.05;

    /// Waits of turns that take `makes(turn)` seconds from their beginning to the controller, which holds two, after `turns` of them.
    fn settle(turns: usize, makes: impl Fn(usize) -> f64) -> Vec<f64> {
        let (mut phase, mut shift, mut shown_until, mut free_at) = (Phase::default(), 0.0, 0.0_f64, 0.0_f64);
        let mut waits = Vec::new();
        for turn in 0..turns {
            let begins = (turn as f64 * PERIOD_S + shift).max(free_at);
            // The controller takes a turn when the one before is lit.
            let there = (begins + makes(turn)).max(shown_until);
            let lit = (there / PERIOD_S).floor() * PERIOD_S + PERIOD_S;
            let lit = lit.max(shown_until + PERIOD_S);
            (shown_until, free_at) = (lit, there);
            waits.push(lit - there);
            shift += phase.after(Duration::from_secs_f64(lit - there)).unwrap_or(0.0);
        }
        waits
    }

    #[test]
    fn turns_come_shortly_before_their_light() {
        for makes_s in [0.01, 0.03, 0.045] {
            let waits = settle(400, |_| makes_s);
            assert!(
                waits[300..].iter().all(|wait| (0.3 * MARGIN_S..3.0 * MARGIN_S).contains(wait)),
                "{:?}",
                &waits[380..]
            );
        }
    }

    #[test]
    fn what_takes_a_different_time_each_turn_is_rarely_late() {
        let waits = settle(600, |turn| 0.025 + 0.01 * ((turn * 7919 % 100) as f64 / 100.0));
        let mean = waits[300..].iter().sum::<f64>() / 300.0;
        assert!((MARGIN_S..0.03).contains(&mean), "{mean}");
    }
}
