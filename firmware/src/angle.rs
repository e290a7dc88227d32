//! Small angles in single precision, and the sine of a whole one.

use crate::single::whole;
use core::f32::consts::TAU;
use protocol::units::Turns;

/// Radians in one step of [`Turns`].
pub const RADIANS_PER_STEP: f32 = TAU / 4_294_967_296.0;
const STEPS_PER_RADIAN: f32 = 4_294_967_296.0 / TAU;

/// The way from `origin` to `angle` along the shorter arc, in radians.
pub fn radians_between(origin: Turns, angle: Turns) -> f32 {
    angle.signed_from(origin) as f32 * RADIANS_PER_STEP
}

/// `angle` moved on by `radians`, which may span several turns (then to single precision); NaN moves it nowhere.
pub fn advanced(angle: Turns, radians: f32) -> Turns {
    let steps = radians * STEPS_PER_RADIAN;
    Turns(angle.0.wrapping_add(whole(steps) as u32))
}

/// `nanos` in single precision.
///
/// In two halves of 32 bits: one in 64 takes a Cortex-M4F 75 instructions, and the compiler makes one of a conversion that is told
/// apart by size. The lower half is signed, so that nothing is lost where all of it fits.
pub fn nanos_to_f32(nanos: i64) -> f32 {
    let low = nanos as i32;
    let high = (nanos.wrapping_sub(low.into()) >> 32) as i32;
    high as f32 * 4_294_967_296.0 + low as f32
}

/// Sine and cosine, to 3e-7.
///
/// Own polynomials, because libm's `sinf` goes through double precision, which a Cortex-M4F has only in software.
pub fn sin_cos(angle: Turns) -> (f32, f32) {
    let quadrant = angle.0.wrapping_add(1 << 29) >> 30;
    let x = angle.0.wrapping_sub(quadrant << 30) as i32 as f32 * RADIANS_PER_STEP;
    let square = x * x;
    let sine = x + x * square * (-1.0 / 6.0 + square * (1.0 / 120.0 + square * (-1.0 / 5_040.0)));
    let cosine = 1.0 + square * (-0.5 + square * (1.0 / 24.0 + square * (-1.0 / 720.0 + square * (1.0 / 40_320.0))));
    match quadrant {
        0 => (sine, cosine),
        1 => (cosine, -sine),
        2 => (-sine, -cosine),
        _ => (-cosine, sine),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn sine_and_cosine_agree_with_double_precision(steps: u32) {
            let (sine, cosine) = sin_cos(Turns(steps));
            let exact = Turns(steps).radians();
            prop_assert!((f64::from(sine) - libm::sin(exact)).abs() < 4e-7);
            prop_assert!((f64::from(cosine) - libm::cos(exact)).abs() < 4e-7);
        }

        #[test]
        fn nanoseconds_are_exact_while_they_are_few_and_close_beyond(nanos: i64, few: i32) {
            prop_assert_eq!(nanos_to_f32(few.into()), few as f32);
            prop_assert!((nanos_to_f32(nanos) - nanos as f32).abs() <= 1.2e-7 * (nanos as f32).abs());
        }

        #[test]
        fn moving_on_and_looking_back_are_inverse(start: u32, radians in -3.0f32..3.0) {
            let back = radians_between(Turns(start), advanced(Turns(start), radians));
            prop_assert!((back - radians).abs() < 1e-6);
        }
    }
}
