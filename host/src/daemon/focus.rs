//! What is rendered where a whole turn takes longer than the mirror's: the slices that somebody who is followed sees, in each turn, from the
//! newest that is known of them; and of the others as many as there is time for, round and round. Who stands elsewhere sees fewer pictures a
//! second, which sweep around the display as fast as there is time; and the link carries only what is new.

use std::time::Duration;

/// A whole turn may take so much of the mirror's.
const FULL: f64 = 0.85;
/// More of a turn than this is no part to look at.
const PART: f64 = 0.7;
/// The others are all rendered anew within so many turns of the mirror.
const SWEEP_TURNS: usize = 8;
/// How much one turn counts among those before.
const NEWS: f64 = 0.2;

/// How long slices take, and where the sweep is.
#[derive(Debug, Default)]
pub struct Focus {
    /// Seconds that a slice takes: of those that are seen, of the others.
    slice_s: Option<[f64; 2]>,
    next: u32,
}

impl Focus {
    /// Whether only `seen` of `slices` are to be rendered in each turn, of which a mirror's takes `period`.
    pub fn applies(&self, seen: usize, slices: usize, period: Duration) -> bool {
        let Some([seen_s, other_s]) = self.slice_s else { return false };
        let whole_s = seen_s * seen as f64 + other_s * (slices - seen) as f64;
        (seen as f64) < PART * slices as f64 && whole_s > FULL * period.as_secs_f64()
    }

    /// So many slices of a whole turn took this long.
    pub fn took_whole(&mut self, slices: usize, took: Duration) {
        self.took(slices, took).iter_mut().for_each(|known| learn(known, slices, took));
    }

    /// So many slices that are seen took this long.
    pub fn took_seen(&mut self, slices: usize, took: Duration) {
        learn(&mut self.took(slices, took)[0], slices, took);
    }

    /// So many of the others took this long.
    pub fn took_others(&mut self, slices: usize, took: Duration) {
        learn(&mut self.took(slices, took)[1], slices, took);
    }

    fn took(&mut self, slices: usize, took: Duration) -> &mut [f64; 2] {
        self.slice_s.get_or_insert_with(|| [slice_s(slices, took); 2])
    }

    /// Which of `slices` slices, beside those that are `seen`, are to be rendered until the next turn, for which there is so much time `left`;
    /// in order.
    pub fn others(&mut self, seen: &[u32], slices: u32, left: Duration) -> Vec<u32> {
        let least = (slices as usize - seen.len()).div_ceil(SWEEP_TURNS);
        let other_s = self.slice_s.map_or(f64::INFINITY, |[_, other_s]| other_s);
        let fitting = (left.as_secs_f64() / other_s) as usize;
        let round = (0..slices).map(|step| (self.next + step) % slices);
        let mut chunk: Vec<u32> =
            round.filter(|slice| seen.binary_search(slice).is_err()).take(fitting.max(least)).collect();
        self.next = chunk.last().map_or(0, |last| last + 1);
        chunk.sort_unstable();
        chunk
    }
}

fn slice_s(slices: usize, took: Duration) -> f64 {
    took.as_secs_f64() / slices.max(1) as f64
}

fn learn(known: &mut f64, slices: usize, took: Duration) {
    *known += NEWS * (slice_s(slices, took) - *known);
}

#[cfg(test)]
mod tests {
    use super::*;

    const PERIOD: Duration = Duration::from_millis(50);

    #[test]
    fn it_applies_where_a_whole_turn_takes_too_long_and_a_part_of_it_is_seen() {
        let mut focus = Focus::default();
        assert!(!focus.applies(60, 288, PERIOD));
        focus.took_whole(288, Duration::from_millis(100));
        assert!(focus.applies(60, 288, PERIOD) && !focus.applies(250, 288, PERIOD));
        (0..40).for_each(|_| focus.took_others(228, Duration::from_millis(10)));
        assert!(!focus.applies(60, 288, PERIOD));
        (0..40).for_each(|_| focus.took_seen(60, Duration::from_millis(45)));
        assert!(focus.applies(60, 288, PERIOD));
    }

    #[test]
    fn the_others_come_round_in_order_after_a_few_turns_at_most() {
        let seen = Vec::from_iter(100..160);
        for (left, turns) in [(0, SWEEP_TURNS), (100, 3), (1_000, 1)] {
            let mut focus = Focus::default();
            focus.took_whole(288, Duration::from_millis(288));
            let mut painted = Vec::new();
            for _ in 0..turns {
                let chunk = focus.others(&seen, 288, Duration::from_millis(left));
                assert!(chunk.is_sorted() && chunk.iter().all(|slice| seen.binary_search(slice).is_err()));
                painted.extend(chunk);
            }
            painted.sort_unstable();
            painted.dedup();
            let others: Vec<u32> = (0..100).chain(160..288).collect();
            assert_eq!(painted, others, "{left} ms");
        }
    }

    #[test]
    fn the_sweep_goes_on_where_it_was() {
        let mut focus = Focus::default();
        focus.took_whole(100, Duration::from_millis(100));
        let mut others = |seen: &[u32]| focus.others(seen, 100, Duration::from_millis(30));
        assert_eq!(others(&[10, 11]), [Vec::from_iter(0..10), Vec::from_iter(12..32)].concat());
        assert_eq!(others(&[50]), [Vec::from_iter(32..50), Vec::from_iter(51..63)].concat());
        assert_eq!(others(&[]), Vec::from_iter(63..93));
        assert_eq!(others(&[0, 99]), [Vec::from_iter(1..25), Vec::from_iter(93..99)].concat());
    }
}
