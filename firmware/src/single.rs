//! What single precision needs often, in few instructions of a Cortex-M4F.
//!
//! Its compiler calls functions for all of this: 70 instructions for libm's square root, 15 for `f32::max` because of what that owes to
//! NaN. Here they are arithmetic and comparisons alone, so that board and simulation still agree in every bit.

/// The square root, to 3e-7 of itself; 0 where `square` is negative or below 1.2e-38; of what is no number, none.
///
/// The reciprocal root by its exponent halved and three of Newton's steps; the first guess is within 3.5 %.
pub fn root(square: f32) -> f32 {
    if !(f32::MIN_POSITIVE..=f32::MAX).contains(&square) {
        // Below the least normal number the exponent says nothing.
        return if square < f32::MIN_POSITIVE { 0.0 } else { square };
    }
    let mut reciprocal = f32::from_bits(0x5f37_59df - (square.to_bits() >> 1));
    for _ in 0..3 {
        reciprocal *= 1.5 - 0.5 * square * reciprocal * reciprocal;
    }
    square * reciprocal
}

/// `value`, or `least` where it is less or no number.
pub fn at_least(value: f32, least: f32) -> f32 {
    if value > least { value } else { least }
}

/// `value`, or `most` where it is more or no number.
pub fn at_most(value: f32, most: f32) -> f32 {
    if value < most { value } else { most }
}

/// From here on every number is whole.
const ALL_WHOLE: f32 = 8_388_608.0;

/// The largest whole number that is not above `value`.
pub fn floor(value: f32) -> f32 {
    if value.abs() < ALL_WHOLE {
        let towards_zero = value as i32 as f32;
        if towards_zero > value { towards_zero - 1.0 } else { towards_zero }
    } else {
        value
    }
}

/// `value` less its fraction. A Cortex-M4F converts to 32 bits in one instruction and to 64 in some fifty.
pub fn whole(value: f32) -> i64 {
    if value.abs() < 2_147_483_648.0 { i64::from(value as i32) } else { value as i64 }
}

/// The nearest whole number; of two that are as near, the larger one.
pub fn nearest(value: f32) -> f32 {
    if value.abs() < ALL_WHOLE { floor(value + 0.5) } else { value }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn roots_agree_with_libm(square in prop::num::f32::NORMAL | prop::num::f32::INFINITE | prop::num::f32::ZERO) {
            let exact = libm::sqrtf(square.max(0.0));
            prop_assert!(root(square) == exact || (root(square) - exact).abs() <= 3e-7 * exact, "{} for {exact}", root(square));
        }

        #[test]
        fn whole_numbers_agree_with_libm(value: f32, small in -1e4f32..1e4) {
            for value in [value, small] {
                prop_assert!(floor(value) == libm::floorf(value) || value.is_nan());
                prop_assert!((nearest(value) - value).abs() <= 0.5 || value.is_nan());
            }
        }

        #[test]
        fn bounds_agree_with_the_standard_ones(value: f32, bound in prop::num::f32::NORMAL) {
            prop_assert_eq!(at_least(value, bound), value.max(bound));
            prop_assert_eq!(at_most(value, bound), value.min(bound));
        }
    }

    #[test]
    fn what_has_no_root_has_none() {
        assert_eq!([0.0, -0.0, -4.0, f32::NEG_INFINITY, 1e-40].map(root), [0.0; 5]);
        assert!(root(f32::NAN).is_nan() && root(f32::INFINITY) == f32::INFINITY);
    }
}
