//! Torque as a drive takes it: a magnitude by pulse width and a direction by level, so that a dead line means no torque.

/// What a drive is asked for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Demand {
    /// Counts of the pulse width: 0 is no torque, the full width is the drive's largest.
    pub width: u16,
    /// The level of the direction line.
    pub counter_clockwise: bool,
}

impl Demand {
    /// `torque_nm` of a drive that gives `torque_max_nm` at the width `full`. More is cut off; what is no number is no torque.
    pub fn of(torque_nm: f32, torque_max_nm: f32, full: u16) -> Self {
        let share = (torque_nm.abs() / torque_max_nm).clamp(0.0, 1.0);
        Self { width: (share * f32::from(full) + 0.5) as u16, counter_clockwise: torque_nm > 0.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn torque_becomes_width_and_direction() {
        let of = |torque| Demand::of(torque, 0.45, 6_000);
        assert_eq!(of(0.0), Demand::default());
        assert_eq!(of(0.225), Demand { width: 3_000, counter_clockwise: true });
        assert_eq!(of(-0.45), Demand { width: 6_000, counter_clockwise: false });
        assert_eq!(of(f32::NEG_INFINITY), Demand { width: 6_000, counter_clockwise: false });
        assert_eq!(of(f32::NAN), Demand::default());
    }

    proptest! {
        #[test]
        fn the_width_is_never_above_full_and_off_by_half_a_count_at_most(torque: f32, full in 1u16..) {
            let demand = Demand::of(torque, 0.45, full);
            prop_assert!(demand.width <= full);
            let wanted = f64::from(torque.abs()).min(0.45) / 0.45 * f64::from(full);
            prop_assert!(torque.is_nan() || (f64::from(demand.width) - wanted).abs() < 0.51);
        }
    }
}
