//! How fast the firmware's estimator follows, measured on itself.
//!
//! Beside a controller in step run two more of its estimators on the same counts, pulses and torques; one of them is told a little more torque than
//! acts. What tells them apart is the estimator's answer to an acceleration `a` that it does not know, without the noise, which is the same
//! in both. For an observer with gains l₁, l₂, l₃ the angles differ by x with the Laplace transform X = a / D, D(s) = s³ + l₁ s² + l₂ s + l₃, so
//! that X at three real rates gives the gains; what changes slowly beside them weighs little there.

use crate::loop_model::Observer;
use crate::motor::Motor;
use crate::scenario::Scenario;
use crate::world::{Core, World};
use firmware::actuator::Actuator;
use firmware::angle::radians_between;
use firmware::config::ConfigError;
use firmware::controller::{Controller, Estimates, Input, Output};
use firmware::rotation::RotationEstimator;
use protocol::message::State;
use protocol::timing::{Direction, Rotation};
use protocol::units::Nanos;
use rayon::prelude::*;
use std::sync::{Arc, Mutex, PoisonError};

/// After this much time in step the estimator has settled, ns.
const SETTLED_NS: u64 = 3_000_000_000;
/// The answer is over after this, seconds.
const ANSWER_S: f64 = 1.5;
/// Counts fall in with ticks differently from seed to seed and from moment to moment, and the estimator follows accordingly: answers have half
/// or twice the size of others.
const SEEDS: u64 = 24;
/// Of each seed, one after the other.
const ANSWERS: usize = 5;
/// The torque more, as a share of the limit: small against what makes the estimator doubt itself.
const MORE: f32 = 1e-3;

/// A controller with two estimators beside it.
struct Probe {
    controller: Controller,
    actuator: Actuator,
    sign: f32,
    locked_since: Option<Nanos>,
    twins: Option<[RotationEstimator; 2]>,
    /// How long an answer is.
    ticks: usize,
    /// One after the other.
    answers: Arc<Mutex<Vec<f64>>>,
}

impl Core for Probe {
    fn step(&mut self, now: Nanos, input: Input) -> Output {
        match input {
            Input::Tick { encoder_count } => self.tick(now, encoder_count),
            Input::IndexPulse { at } => self.twins.iter_mut().flatten().for_each(|twin| {
                twin.index(at);
            }),
            _ => {}
        }
        let output = self.controller.step(now, input);
        if let Input::Tick { .. } = input {
            self.actuator.command(output.torque_nm * self.sign);
        }
        let locked = output.state == State::Locked;
        self.locked_since = locked.then(|| self.locked_since.unwrap_or(now));
        let recorded = self.answers.lock().unwrap_or_else(PoisonError::into_inner).len();
        let settled = self.locked_since.is_some_and(|since| (now - since).0 > SETTLED_NS);
        if settled && recorded.is_multiple_of(self.ticks) {
            let estimator = self.controller.rotation();
            self.twins = Some([estimator.clone(), estimator.clone()]);
        }
        output
    }

    fn estimates(&self) -> Estimates {
        self.controller.estimates()
    }
}

impl Probe {
    fn tick(&mut self, now: Nanos, count: u32) {
        let acted = self.actuator.advance();
        let Some([plain, pushed]) = &mut self.twins else { return };
        let more = MORE * self.controller.config().motor.torque_max_nm;
        plain.tick(now, count, acted);
        pushed.tick(now, count, acted + more);
        let acceleration = f64::from(more * plain.acceleration_per_torque());
        let apart = f64::from(radians_between(plain.angle(), pushed.angle()));
        self.answers.lock().unwrap_or_else(PoisonError::into_inner).push(apart / acceleration);
    }
}

/// The gains of the estimator in step with `rotation` on `motor`, from the median of several answers of several seeds. `Ok(None)` where it does
/// not lock, or follows in no way that three gains describe.
pub fn measure(rotation: &Rotation, motor: &Motor) -> Result<Option<Observer>, ConfigError> {
    let ticks = (ANSWER_S * motor.controller.rate_hz) as usize;
    let runs = (0..SEEDS).into_par_iter().map(|seed| answers(rotation, motor, seed, ticks));
    let runs: Vec<Vec<f64>> = runs.collect::<Result<_, _>>()?;
    if runs.iter().any(|run| run.len() < ANSWERS * ticks) {
        return Ok(None);
    }
    // Not the mean: where one twin believes an index that the other does not, they part.
    let middle = |tick: usize| {
        let of_run = |run: &Vec<f64>| (0..ANSWERS).map(|answer| run[answer * ticks + tick]).collect::<Vec<_>>();
        let mut apart: Vec<f64> = runs.iter().flat_map(of_run).collect();
        apart.sort_by(f64::total_cmp);
        apart[apart.len() / 2]
    };
    Ok(gains(&(0..ticks).map(middle).collect::<Vec<_>>(), 1.0 / motor.controller.rate_hz))
}

/// What tells the twins apart, a sample a tick, answer after answer.
fn answers(rotation: &Rotation, motor: &Motor, seed: u64, ticks: usize) -> Result<Vec<f64>, ConfigError> {
    let controller = Controller::new(motor.firmware_config(rotation, Nanos::ZERO))?;
    let answers = Arc::new(Mutex::new(Vec::new()));
    let probe = Probe {
        actuator: Actuator::new(controller.config()),
        sign: if rotation.direction() == Direction::CounterClockwise { 1.0 } else { -1.0 },
        controller,
        locked_since: None,
        twins: None,
        ticks,
        answers: Arc::clone(&answers),
    };
    let mut world = World::with_core(rotation, Nanos::ZERO, motor, &Scenario::default(), seed, Box::new(probe));
    let recorded = || answers.lock().unwrap_or_else(PoisonError::into_inner);
    world.advance_until(30.0, |_| recorded().len() >= ANSWERS * ticks);
    let answers = std::mem::take(&mut *recorded());
    Ok(answers)
}

/// The gains from the answer to a unit acceleration, a sample a tick: a parabola through 1 / X(s) - s³ at three rates about its own.
fn gains(answer: &[f64], tick_s: f64) -> Option<Observer> {
    const RATES: [f64; 3] = [6.0, 15.0, 40.0];
    let characteristic = |s: f64| {
        let weighted = answer.iter().enumerate().map(|(tick, apart)| apart * (-s * tick as f64 * tick_s).exp());
        1.0 / (weighted.sum::<f64>() * tick_s)
    };
    let [a, b, c] = RATES;
    let [at_a, at_b, at_c] = RATES.map(|s| characteristic(s) - s.powi(3));
    let (slope_ab, slope_bc) = ((at_b - at_a) / (b - a), (at_c - at_b) / (c - b));
    let angle = (slope_bc - slope_ab) / (c - a);
    let speed = slope_ab - angle * (a + b);
    let disturbance = at_a - angle * a * a - speed * a;
    let observer = Observer { angle, speed, disturbance };
    // A polynomial of third degree with all roots on the left.
    (disturbance > 0.0 && speed > 0.0 && angle * speed > disturbance).then_some(observer)
}

#[cfg(test)]
mod tests {
    use super::*;
    use protocol::units::Turns;

    #[test]
    fn the_gains_of_a_known_observer_come_back() {
        let known = Observer { angle: 40.0, speed: 800.0, disturbance: 8_000.0 };
        let tick_s = 1e-4;
        let (mut state, mut answer) = ([0.0f64; 3], Vec::new());
        for _ in 0..40_000 {
            answer.push(state[0]);
            let [x, v, d] = state;
            state[0] += tick_s * (v - known.angle * x);
            state[1] += tick_s * (1.0 + d - known.speed * x);
            state[2] += tick_s * (-known.disturbance * x);
        }
        let found = gains(&answer, tick_s).unwrap();
        for (found, known) in
            [(found.angle, known.angle), (found.speed, known.speed), (found.disturbance, known.disturbance)]
        {
            assert!((found / known - 1.0).abs() < 0.02, "{found} {known}");
        }
    }

    #[test]
    fn the_firmwares_estimator_follows_in_about_a_tenth_of_a_second() {
        let rotation = Rotation::new(288, 24, 240_000_000, Turns::ZERO, Direction::Clockwise).unwrap();
        let observer = measure(&rotation, &Motor::reference()).unwrap().unwrap();
        let rate = observer.disturbance.cbrt();
        // 12.5 rad/s was seen.
        assert!((10.0..18.0).contains(&rate), "{rate} {observer:?}");
    }
}
