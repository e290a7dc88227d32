//! What the drive makes of torque commands: a delay, then a first-order lag. The estimator must know which torque acts *now*.

use crate::config::Config;

const HISTORY: usize = 16;

/// The torque that acts on the mirror, modelled from what was commanded.
#[derive(Clone, Debug)]
pub struct Actuator {
    commands_nm: [f32; HISTORY],
    newest: usize,
    whole_ticks: usize,
    part_tick: f32,
    decay_per_tick: f32,
    torque_nm: f32,
    lead_s: f32,
}

impl Actuator {
    /// At rest.
    pub fn new(config: &Config) -> Self {
        let tick_s = 1.0 / config.control_rate_hz;
        let delay_s = config.motor.command_delay.0 as f32 * 1e-9;
        let lag_s = 1.0 / (core::f32::consts::TAU * config.motor.torque_bandwidth_hz);
        let ticks = (delay_s / tick_s).clamp(0.0, (HISTORY - 2) as f32);
        Self {
            commands_nm: [0.0; HISTORY],
            newest: 0,
            whole_ticks: ticks as usize,
            part_tick: ticks - ticks as usize as f32,
            decay_per_tick: libm::expf(-tick_s / lag_s),
            torque_nm: 0.0,
            lead_s: delay_s + lag_s + 0.5 * tick_s,
        }
    }

    /// How long before it is needed a torque must be commanded, seconds: delay, lag and half a tick of hold.
    pub fn lead_s(&self) -> f32 {
        self.lead_s
    }

    /// The mean torque over the tick that ends now, N m. Call once a tick, then [`Actuator::command`].
    pub fn advance(&mut self) -> f32 {
        let delayed = |ticks: usize| self.commands_nm[(self.newest + HISTORY - ticks) % HISTORY];
        let input = delayed(self.whole_ticks) * (1.0 - self.part_tick) + delayed(self.whole_ticks + 1) * self.part_tick;
        let before = self.torque_nm;
        self.torque_nm = input + (before - input) * self.decay_per_tick;
        0.5 * (before + self.torque_nm)
    }

    /// The torque commanded from this tick on, N m.
    pub fn command(&mut self, torque_nm: f32) {
        self.newest = (self.newest + 1) % HISTORY;
        self.commands_nm[self.newest] = torque_nm;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::tests::example;
    use protocol::timing::Direction;

    #[test]
    fn a_step_arrives_after_the_delay_and_rises_exponentially() {
        let config = example(288, 240, Direction::Clockwise);
        let mut actuator = Actuator::new(&config);
        let mut mean = [0.0; 12];
        for sample in &mut mean {
            *sample = actuator.advance();
            actuator.command(1.0);
        }
        // Commanded at tick 0, in effect two ticks later: the first interval that feels it ends at tick 3.
        assert!(mean[..3].iter().all(|torque| torque.abs() < 1e-6));
        let lag_ticks = 4_000.0 / (core::f32::consts::TAU * 300.0);
        let expected = |end: f32| 1.0 - libm::expf(-end / lag_ticks);
        assert!((mean[3] - 0.5 * expected(1.0)).abs() < 1e-6);
        assert!((mean[6] - 0.5 * (expected(3.0) + expected(4.0))).abs() < 1e-6);
    }
}
