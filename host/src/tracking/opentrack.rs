//! opentrack's output "UDP over network": a datagram is six little-endian doubles, x, y, z in centimetres, then yaw, pitch and roll in degrees.
//!
//! Source: what opentrack itself sends (its proto-udp writes its pose as it lies in memory) and its issues 155 and 881. opentrack's own
//! composition of angles ("relative translation", compat/euler) is, in a right-handed frame of its x, y, z with y up,
//! R = Ry(yaw) Rx(pitch) Rz(-roll): that is taken here. Which way x and z point is the input's and the output curves' matter, so that
//! `praxi register` finds it; it refuses a mirrored frame, and one axis has to be inverted in opentrack's output settings then. Curves must be
//! straight, one to one, and centring off, or the numbers are no places.

use super::{ANGLE_DEG_MAX, POSITION_M_MAX, ParseError, Pose, sensible};
use glam::{DQuat, DVec3, EulerRot};

/// Bytes of a datagram.
pub const BYTES: usize = 48;

/// Reads a datagram.
pub fn parse(bytes: &[u8]) -> Result<Pose, ParseError> {
    let length = || ParseError::Length { format: "opentrack", expected: BYTES, found: bytes.len() };
    let bytes: &[u8; BYTES] = bytes.try_into().map_err(|_| length())?;
    let (doubles, _) = bytes.as_chunks::<8>();
    let number = |index: usize| f64::from_le_bytes(doubles[index]);
    let position = sensible(["x", "y", "z"], [0, 1, 2].map(number), POSITION_M_MAX * 100.0)?;
    let angles = sensible(["yaw", "pitch", "roll"], [3, 4, 5].map(number), ANGLE_DEG_MAX)?;
    let [yaw, pitch, roll] = angles.map(f64::to_radians);
    Ok(Pose {
        sensor: 0,
        position_m: DVec3::from(position) / 100.0,
        orientation: DQuat::from_euler(EulerRot::YXZ, yaw, pitch, -roll),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn packet(numbers: [f64; 6]) -> Vec<u8> {
        numbers.iter().flat_map(|number| number.to_le_bytes()).collect()
    }

    #[test]
    fn centimetres_and_degrees_become_a_pose() {
        let pose = parse(&packet([10.0, -20.0, 30.0, 90.0, 0.0, 0.0])).unwrap();
        assert_eq!((pose.sensor, pose.position_m), (0, DVec3::new(0.1, -0.2, 0.3)));
        // A turn about y by the right hand: z goes to x.
        assert!((pose.orientation * DVec3::Z - DVec3::X).length() < 1e-12);
        let pitched = parse(&packet([0.0, 0.0, 0.0, 0.0, 90.0, 0.0])).unwrap().orientation;
        assert!((pitched * DVec3::Y - DVec3::Z).length() < 1e-12);
        let rolled = parse(&packet([0.0, 0.0, 0.0, 0.0, 0.0, 90.0])).unwrap().orientation;
        assert!((rolled * DVec3::Y - DVec3::X).length() < 1e-12);
        // Yaw comes last: what is pitched up and then turned looks up.
        let both = parse(&packet([0.0, 0.0, 0.0, 90.0, 90.0, 0.0])).unwrap().orientation;
        assert!((both * DVec3::Z + DVec3::Y).length() < 1e-12, "{}", both * DVec3::Z);
    }

    #[test]
    fn what_no_head_does_is_refused_by_name() {
        let good = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0];
        for (index, name) in ["x", "y", "z", "yaw", "pitch", "roll"].into_iter().enumerate() {
            for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e300, -10_001.0] {
                let mut numbers = good;
                numbers[index] = bad;
                let refused = parse(&packet(numbers)).unwrap_err().to_string();
                assert!(refused.starts_with(&format!("{name} = ")), "{refused}");
            }
        }
        let short = parse(&packet(good)[..47]).unwrap_err().to_string();
        assert!(short.contains("47 bytes: opentrack has 48"), "{short}");
    }

    proptest! {
        #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]
        #[test]
        fn any_bytes_are_a_pose_or_refused(bytes in prop::collection::vec(any::<u8>(), 0..64)) {
            let _ = parse(&bytes);
        }

        #[test]
        fn changed_packets_are_a_pose_or_refused(
            numbers in prop::array::uniform6(-300.0..300.0f64), at in 0..BYTES, bits in any::<u8>(),
        ) {
            let mut bytes = packet(numbers);
            prop_assert!(parse(&bytes).unwrap().orientation.is_normalized());
            bytes[at] ^= bits;
            if let Ok(pose) = parse(&bytes) {
                prop_assert!(pose.position_m.abs().max_element() <= POSITION_M_MAX && pose.orientation.is_normalized());
            }
        }
    }
}
