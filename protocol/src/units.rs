//! Angles that wrap and times that do not.

use core::ops::{Add, AddAssign, Neg, Sub, SubAssign};
use serde::{Deserialize, Serialize};

/// A mirror angle as a fraction of a turn: the whole turn is 2³², so that arithmetic wraps as an angle does.
///
/// One step is 0.3 nanoturns: at 288 slices a slice is 14.9 million steps, and nothing accumulates.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct Turns(pub u32);

impl Turns {
    /// The angle 0.
    pub const ZERO: Self = Self(0);

    /// `numerator / denominator` of a turn, rounded down. `denominator` must not be 0.
    pub const fn fraction(numerator: u64, denominator: u64) -> Self {
        Self((((numerator % denominator) as u128) << 32).div_euclid(denominator as u128) as u32)
    }

    /// From any finite number of turns; whole turns drop out.
    pub fn from_turns(turns: f64) -> Self {
        let whole = turns as i64;
        Self(((turns - whole as f64) * 4_294_967_296.0) as i64 as u32)
    }

    /// In turns, 0 ≤ result < 1.
    pub fn turns(self) -> f64 {
        f64::from(self.0) / 4_294_967_296.0
    }

    /// In radians, 0 ≤ result < 2π.
    pub fn radians(self) -> f64 {
        self.turns() * core::f64::consts::TAU
    }

    /// The way from `origin` to `self` along the shorter arc, in units of 2⁻³² turn: −2³¹ ≤ result < 2³¹.
    pub const fn signed_from(self, origin: Self) -> i32 {
        self.0.wrapping_sub(origin.0) as i32
    }
}

impl Add for Turns {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        Self(self.0.wrapping_add(other.0))
    }
}

impl Sub for Turns {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        Self(self.0.wrapping_sub(other.0))
    }
}

impl Neg for Turns {
    type Output = Self;
    fn neg(self) -> Self {
        Self(self.0.wrapping_neg())
    }
}

impl AddAssign for Turns {
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

impl SubAssign for Turns {
    fn sub_assign(&mut self, other: Self) {
        *self = *self - other;
    }
}

/// Nanoseconds since the controller started. 64 bits last 584 years; whoever reads a narrower hardware counter extends it.
///
/// Nanoseconds, because a plane at 240 Hz lasts 173 611 ns and a timer capture resolves about 5.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct Nanos(pub u64);

impl Nanos {
    /// The start.
    pub const ZERO: Self = Self(0);

    /// From seconds, rounded to the nearest nanosecond; negative and NaN become 0.
    pub fn from_seconds(seconds: f64) -> Self {
        Self((seconds * 1e9 + 0.5) as u64)
    }

    /// In seconds.
    pub fn seconds(self) -> f64 {
        self.0 as f64 * 1e-9
    }

    /// `self - earlier` in nanoseconds, negative where `self` comes first.
    pub const fn signed_since(self, earlier: Self) -> i64 {
        self.0.wrapping_sub(earlier.0) as i64
    }
}

impl Add for Nanos {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        Self(self.0.saturating_add(other.0))
    }
}

impl Sub for Nanos {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        Self(self.0.saturating_sub(other.0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_angle_wraps() {
        let almost = Turns::fraction(287, 288);
        assert!((almost + Turns::fraction(2, 288)).signed_from(Turns::fraction(1, 288)).abs() <= 1);
        assert_eq!(Turns::from_turns(-0.25), Turns::fraction(3, 4));
        assert_eq!(Turns::from_turns(7.5), Turns::fraction(1, 2));
        assert_eq!(Turns::fraction(3, 4).signed_from(Turns::ZERO), -(1 << 30));
    }

    #[test]
    fn a_time_never_wraps_backwards() {
        assert_eq!(Nanos(3) - Nanos(5), Nanos(0));
        assert_eq!(Nanos(3).signed_since(Nanos(5)), -2);
        assert_eq!(Nanos::from_seconds(f64::NAN), Nanos(0));
    }
}
