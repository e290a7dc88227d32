//! Speed from encoder counts alone, for decisions that must not depend on the filter.

use crate::single::at_least;

const TICKS: u32 = 32;
/// Windows without a count after which a mirror stands: 56 ms at 4 kHz.
const STILL_WINDOWS: u32 = 7;

/// Counts over windows of 32 control ticks.
#[derive(Clone, Debug, Default)]
pub struct SpeedWindow {
    ticks: u32,
    counts: i32,
    seconds: f32,
    speed: f32,
    still_windows: u32,
}

impl SpeedWindow {
    /// Takes one tick: `counts` passed in `seconds`, each `count_rad` wide.
    pub fn add(&mut self, counts: i32, seconds: f32, count_rad: f32) {
        self.ticks += 1;
        self.counts = self.counts.saturating_add(counts);
        self.seconds += seconds;
        if self.ticks == TICKS {
            self.speed = self.counts as f32 * count_rad / at_least(self.seconds, 1e-6);
            self.still_windows = if self.counts == 0 { self.still_windows.saturating_add(1) } else { 0 };
            (self.ticks, self.counts, self.seconds) = (0, 0, 0.0);
        }
    }

    /// Over the last whole window, rad/s.
    pub fn speed(&self) -> f32 {
        self.speed
    }

    /// Whether no count has passed for long.
    pub fn is_still(&self) -> bool {
        self.still_windows >= STILL_WINDOWS
    }
}
