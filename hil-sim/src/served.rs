//! Simulated time that keeps step with the wall's, for a device that somebody outside this program talks to.

use crate::device::Endpoint;
use std::time::Duration;

/// Simulated time goes at most so far at once: how late a byte is at most.
pub const STEP: Duration = Duration::from_millis(1);

/// What is further behind than this is left out: a simulation that is too slow, or a machine that was asleep.
pub const LAG_MAX: Duration = Duration::from_millis(250);

/// How far a simulation is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Pump {
    /// What is further behind is left out.
    lag_max: Duration,
    /// Simulated time that has passed.
    simulated: Duration,
    /// Wall time that was left out.
    skipped: Duration,
}

impl Default for Pump {
    fn default() -> Self {
        Self::new()
    }
}

impl Pump {
    /// Nothing has passed. What is more than [`LAG_MAX`] behind is left out.
    pub fn new() -> Self {
        Self::lagging(LAG_MAX)
    }

    /// The same for another lag.
    pub fn lagging(lag_max: Duration) -> Self {
        Self { lag_max, simulated: Duration::ZERO, skipped: Duration::ZERO }
    }

    /// Simulated time that has passed.
    pub fn simulated(&self) -> Duration {
        self.simulated
    }

    /// Wall time that was left out, as the simulation was too far behind.
    pub fn skipped(&self) -> Duration {
        self.skipped
    }

    /// Whether a whole [`STEP`] is due at `wall`, the time on the wall's clock since the start: then it counts as done.
    pub fn step(&mut self, wall: Duration) -> bool {
        let is_due = self.behind(wall) >= STEP;
        self.simulated += if is_due { STEP } else { Duration::ZERO };
        is_due
    }

    /// How long after `wall` the next whole [`STEP`] is due; nothing where it is.
    pub fn wait(&self, wall: Duration) -> Duration {
        (self.simulated + self.skipped + STEP).saturating_sub(wall)
    }

    /// How far simulated time is behind `wall`, less what is left out.
    fn behind(&mut self, wall: Duration) -> Duration {
        let behind = wall.saturating_sub(self.simulated + self.skipped);
        let left_out = behind.saturating_sub(self.lag_max);
        self.skipped += left_out;
        behind - left_out
    }

    /// Lets `endpoint` catch up with `wall`, the time on the wall's clock since the start, in steps of at most [`STEP`]. `exchange` moves bytes
    /// to it and from it before each step and after the last one; its error ends it.
    /// Nothing is due for [`STEP`] then.
    pub fn catch_up<E: Endpoint, X>(
        &mut self,
        wall: Duration,
        endpoint: &mut E,
        mut exchange: impl FnMut(&mut E) -> Result<(), X>,
    ) -> Result<(), X> {
        exchange(endpoint)?;
        loop {
            let step = self.behind(wall).min(STEP);
            if step.is_zero() {
                return Ok(());
            }
            endpoint.advance(step.as_secs_f64());
            self.simulated += step;
            exchange(endpoint)?;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::convert::Infallible;

    /// Notes how time goes.
    #[derive(Default)]
    struct Clock {
        steps: Vec<f64>,
    }

    impl Endpoint for Clock {
        fn receive(&mut self, bytes: &[u8]) -> usize {
            bytes.len()
        }

        fn transmit(&mut self) -> Vec<u8> {
            Vec::new()
        }

        fn advance(&mut self, seconds: f64) {
            self.steps.push(seconds);
        }
    }

    fn catch_up(pump: &mut Pump, wall: Duration, clock: &mut Clock) -> usize {
        let mut exchanges = 0;
        let Ok(()) = pump.catch_up(wall, clock, |_| {
            exchanges += 1;
            Ok::<_, Infallible>(())
        });
        exchanges
    }

    #[test]
    fn time_goes_in_small_steps_with_bytes_between_them() {
        let (mut pump, mut clock) = (Pump::new(), Clock::default());
        assert_eq!(catch_up(&mut pump, Duration::from_micros(3_500), &mut clock), 5);
        assert_eq!(clock.steps, [0.001, 0.001, 0.001, 0.0005]);
        assert_eq!(catch_up(&mut pump, Duration::from_micros(3_500), &mut clock), 1);
        assert_eq!(clock.steps.len(), 4);
    }

    #[test]
    fn a_machine_that_slept_is_not_caught_up_with() {
        let (mut pump, mut clock) = (Pump::new(), Clock::default());
        catch_up(&mut pump, Duration::from_secs(3_600), &mut clock);
        assert_eq!(clock.steps.len(), 250);
        assert_eq!((pump.simulated(), pump.skipped()), (LAG_MAX, Duration::from_secs(3_600) - LAG_MAX));
        catch_up(&mut pump, Duration::from_millis(3_600_001), &mut clock);
        assert_eq!(clock.steps.len(), 251);
    }

    #[test]
    fn whole_steps_are_done_one_by_one() {
        let mut pump = Pump::new();
        let ms = Duration::from_millis;
        assert_eq!((pump.wait(Duration::ZERO), pump.step(Duration::from_micros(999))), (STEP, false));
        assert_eq!([0; 4].map(|_| pump.step(ms(3))), [true, true, true, false]);
        assert_eq!((pump.simulated(), pump.wait(ms(3)), pump.wait(ms(9))), (ms(3), STEP, Duration::ZERO));
        // After a long sleep it is only so far behind.
        assert_eq!((0..).take_while(|_| pump.step(ms(10_000))).count(), 250);
        assert_eq!(pump.simulated() + pump.skipped(), ms(10_000));
    }

    #[test]
    fn a_broken_wire_ends_it() {
        let (mut pump, mut clock) = (Pump::new(), Clock::default());
        let mut left = 3;
        let outcome = pump.catch_up(Duration::from_millis(9), &mut clock, |_| {
            left -= 1;
            if left == 0 { Err("broken") } else { Ok(()) }
        });
        assert_eq!((outcome, clock.steps.len()), (Err("broken"), 2));
    }

    proptest! {
        #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]
        #[test]
        fn simulated_and_skipped_time_are_the_walls(waits_us in prop::collection::vec(0u64..400_000, 1..50)) {
            let (mut pump, mut clock, mut wall) = (Pump::new(), Clock::default(), Duration::ZERO);
            for wait in waits_us {
                wall += Duration::from_micros(wait);
                catch_up(&mut pump, wall, &mut clock);
                prop_assert_eq!(pump.simulated() + pump.skipped(), wall);
            }
            prop_assert!(clock.steps.iter().all(|step| *step <= STEP.as_secs_f64()));
            prop_assert!((clock.steps.iter().sum::<f64>() - pump.simulated().as_secs_f64()).abs() < 1e-9);
        }
    }
}
