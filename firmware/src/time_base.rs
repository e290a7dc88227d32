//! A hardware counter of 32 bits as a time that does not wrap.

use core::num::NonZeroU32;
use protocol::units::Nanos;

/// The counter's ticks since the start, in 64 bits.
///
/// No overflow interrupt is needed, and so none can be missed or come late: a count is taken to be the one nearest to the last that
/// [`advance`](Self::advance) saw. Half a turn of the counter, 2³¹ ticks, must not pass without one: 8.9 s at 240 MHz.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TimeBase {
    hz: NonZeroU32,
    ticks: u64,
}

impl TimeBase {
    /// Time 0 is where the counter, which counts up `hz` times a second, showed 0.
    pub const fn new(hz: NonZeroU32) -> Self {
        Self { hz, ticks: 0 }
    }

    /// The present time; `count` is what the counter shows. A count from before the last one leaves time where it is.
    pub fn advance(&mut self, count: u32) -> Nanos {
        self.ticks = self.ticks.max(self.nearest(count));
        self.nanos(self.ticks)
    }

    /// When the counter showed `count`: less than 2³¹ ticks from the present, before or after.
    pub fn stamp(&self, count: u32) -> Nanos {
        self.nanos(self.nearest(count))
    }

    fn nearest(&self, count: u32) -> u64 {
        let ahead = count.wrapping_sub(self.ticks as u32) as i32;
        self.ticks.saturating_add_signed(ahead.into())
    }

    /// Rounded down. Whole seconds apart, so that nothing overflows before Nanos itself does.
    fn nanos(&self, ticks: u64) -> Nanos {
        let hz = u64::from(self.hz.get());
        Nanos((ticks / hz).saturating_mul(1_000_000_000) + ticks % hz * 1_000_000_000 / hz)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const HZ: NonZeroU32 = NonZeroU32::new(240_000_000).unwrap();

    #[test]
    fn a_wrap_of_the_counter_is_no_step_in_time() {
        let mut base = TimeBase::new(HZ);
        base.advance(0x7000_0000);
        base.advance(0xe000_0000);
        let before = base.advance(u32::MAX - 11);
        // A pulse that was captured before the wrap and read after it.
        let after = base.advance(12);
        assert_eq!(after.0 - before.0, 100);
        assert_eq!(base.stamp(u32::MAX - 11), before);
        assert_eq!(base.advance(u32::MAX - 11), after);
    }

    proptest! {
        #[test]
        fn times_are_those_of_a_counter_that_does_not_wrap(
            hz in 1_000_000u32.., steps in prop::collection::vec((0u32..1 << 31, -(1i64 << 31)..1 << 31), 1..50),
        ) {
            let mut base = TimeBase::new(NonZeroU32::new(hz).unwrap());
            let mut ticks = 0u64;
            let nanos = |ticks: u64| Nanos((u128::from(ticks) * 1_000_000_000 / u128::from(hz)) as u64);
            for (step, aside) in steps {
                ticks += u64::from(step);
                prop_assert_eq!(base.advance(ticks as u32), nanos(ticks));
                if let Some(captured) = ticks.checked_add_signed(aside) {
                    prop_assert_eq!(base.stamp(captured as u32), nanos(captured));
                }
            }
        }
    }
}
