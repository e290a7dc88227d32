//! A sensor that is held still: the mean of what it said.

use crate::tracking::Pose;
use glam::{DQuat, DVec3};

/// Poses of one sensor, summed.
#[derive(Clone, Copy, Debug)]
pub struct Mean {
    count: u32,
    /// The first one: sums are of differences from it, which lose no digits.
    first: Pose,
    offset: DVec3,
    square: f64,
    orientation: DQuat,
}

impl Mean {
    /// Of one pose.
    pub fn of(pose: Pose) -> Self {
        Self { count: 1, first: pose, offset: DVec3::ZERO, square: 0.0, orientation: pose.orientation }
    }

    /// And of another of the same sensor.
    pub fn add(&mut self, pose: &Pose) {
        let offset = pose.position_m - self.first.position_m;
        self.count += 1;
        self.offset += offset;
        self.square += offset.length_squared();
        // A quaternion and its negative are one orientation.
        let sign = if pose.orientation.dot(self.first.orientation) < 0.0 { -1.0 } else { 1.0 };
        self.orientation += pose.orientation * sign;
    }

    /// How many poses.
    pub fn count(&self) -> u32 {
        self.count
    }

    /// The mean of positions, and of orientations, which are near each other where a sensor is held still.
    pub fn pose(&self) -> Pose {
        let position_m = self.first.position_m + self.offset / f64::from(self.count);
        // Orientations all over the place have no mean: the first stands for them.
        let orientation = if self.orientation.length_squared() > 1e-6 {
            self.orientation.normalize()
        } else {
            self.first.orientation
        };
        Pose { position_m, orientation, ..self.first }
    }

    /// RMS distance of the positions from their mean, metres: the tracker's noise, or somebody who moved.
    pub fn spread_m(&self) -> f64 {
        let count = f64::from(self.count);
        (self.square / count - (self.offset / count).length_squared()).max(0.0).sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_poses_have_a_middle() {
        let pose = |x: f64, angle: f64| Pose {
            sensor: 3,
            position_m: DVec3::new(x, 1.0, 2.0),
            orientation: DQuat::from_rotation_z(angle),
        };
        let mut mean = Mean::of(pose(0.1, 0.2));
        assert_eq!((mean.pose(), mean.spread_m()), (pose(0.1, 0.2), 0.0));
        let second = pose(0.3, 0.4);
        mean.add(&Pose { orientation: -second.orientation, ..second });
        let middle = mean.pose();
        assert!(middle.position_m.distance(DVec3::new(0.2, 1.0, 2.0)) < 1e-15);
        assert!(middle.orientation.angle_between(DQuat::from_rotation_z(0.3)) < 1e-7);
        assert!((mean.spread_m() - 0.1).abs() < 1e-15 && mean.count() == 2 && middle.sensor == 3);
    }
}
