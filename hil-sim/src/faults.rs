//! Faults between the world and the controller's inputs.

/// Long enough for a capture unit to see two edges, short enough for a contact or a cable to make them.
const ECHO_NS: f64 = 3_000.0;

/// Pulses of one line that do not arrive, or come twice. Times in nanoseconds.
#[derive(Clone, Copy, Debug, Default)]
pub struct PulseFaults {
    to_lose: u32,
    silent_until: f64,
    doubled_until: f64,
}

impl PulseFaults {
    /// The next `count` pulses are lost.
    pub fn lose(&mut self, count: u32) {
        self.to_lose = self.to_lose.saturating_add(count);
    }

    /// No pulse before `until`.
    pub fn silence(&mut self, until: f64) {
        self.silent_until = self.silent_until.max(until);
    }

    /// Every pulse comes twice before `until`.
    pub fn double(&mut self, until: f64) {
        self.doubled_until = self.doubled_until.max(until);
    }

    /// When the pulse at `at` comes a second time, if it does.
    pub fn echo(&self, at: f64) -> Option<f64> {
        (at < self.doubled_until).then_some(at + ECHO_NS)
    }

    /// Whether the pulse at `at` arrives.
    pub fn passes(&mut self, at: f64) -> bool {
        if at < self.silent_until {
            return false;
        }
        if self.to_lose > 0 {
            self.to_lose -= 1;
            return false;
        }
        true
    }
}

/// A counter that slips or stands still.
#[derive(Clone, Copy, Debug, Default)]
pub struct CounterFaults {
    slipped: i64,
    frozen: Option<(i64, f64)>,
    last: i64,
}

impl CounterFaults {
    /// `counts` are added, or lost where negative.
    pub fn slip(&mut self, counts: i64) {
        self.slipped += counts;
    }

    /// The counter stands still before `until`.
    pub fn freeze(&mut self, until: f64) {
        self.frozen = Some((self.last, until));
    }

    /// What the controller reads where the counter would be at `count`.
    pub fn read(&mut self, at: f64, count: i64) -> u32 {
        if let Some((stood_at, until)) = self.frozen {
            self.slipped = stood_at - count;
            if at >= until {
                self.frozen = None;
            }
        }
        self.last = count + self.slipped;
        self.last as u32
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pulses_are_lost_by_number_and_by_time() {
        let mut faults = PulseFaults::default();
        faults.lose(2);
        faults.silence(3.0);
        let passed: Vec<bool> = [1.0, 3.0, 4.0, 5.0].map(|at| faults.passes(at)).to_vec();
        assert_eq!(passed, [false, false, false, true]);
    }

    #[test]
    fn a_frozen_counter_goes_on_from_where_it_stood() {
        let mut faults = CounterFaults::default();
        assert_eq!(faults.read(0.0, 100), 100);
        faults.slip(-1);
        assert_eq!(faults.read(1.0, 110), 109);
        faults.freeze(3.0);
        assert_eq!(faults.read(2.0, 120), 109);
        assert_eq!(faults.read(3.0, 130), 109);
        assert_eq!(faults.read(4.0, 140), 119);
    }
}
