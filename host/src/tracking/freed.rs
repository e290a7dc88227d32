//! FreeD's D1 packet, as studio trackers send it over UDP: 29 bytes, 0xD1, camera, pan, tilt, roll, x, y, height, zoom, focus, two
//! spare bytes and a checksum. Angles are signed 24-bit numbers, most significant byte first, of 1/32768 degree, lengths of 1/64 mm.
//!
//! Source: Vinten Radamec, free-d installation manual 1.4.4, appendices A.3.2 and B. Its frame is right-handed with z up; pan 0 looks along +y and
//! grows clockwise seen from above, tilt grows upward, roll grows clockwise seen from behind. The sensor's own axes are x right, y
//! forward, z up, so that R = Rz(-pan) Rx(tilt) Ry(roll).

use super::{ANGLE_DEG_MAX, POSITION_M_MAX, ParseError, Pose, sensible};
use glam::{DQuat, DVec3, EulerRot};

/// Bytes of a packet.
pub const BYTES: usize = 29;
const D1: u8 = 0xD1;

/// Reads a packet.
pub fn parse(bytes: &[u8]) -> Result<Pose, ParseError> {
    let length = || ParseError::Length { format: "FreeD D1", expected: BYTES, found: bytes.len() };
    let bytes: &[u8; BYTES] = bytes.try_into().map_err(|_| length())?;
    if bytes[0] != D1 {
        return Err(ParseError::Kind(bytes[0]));
    }
    let (expected, found) = (checksum(&bytes[..BYTES - 1]), bytes[BYTES - 1]);
    if expected != found {
        return Err(ParseError::Checksum { expected, found });
    }
    // As the three upper bytes of 32 bits, so that the sign comes along.
    let number = |at: usize| f64::from(i32::from_be_bytes([bytes[at], bytes[at + 1], bytes[at + 2], 0]) >> 8);
    let angles = sensible(["pan", "tilt", "roll"], [2, 5, 8].map(|at| number(at) / 32768.0), ANGLE_DEG_MAX)?;
    let position = sensible(["x", "y", "height"], [11, 14, 17].map(|at| number(at) / 64.0), POSITION_M_MAX * 1000.0)?;
    let [pan, tilt, roll] = angles.map(f64::to_radians);
    Ok(Pose {
        sensor: bytes[1],
        position_m: DVec3::from(position) / 1000.0,
        orientation: DQuat::from_euler(EulerRot::ZXY, -pan, tilt, roll),
    })
}

/// 0x40 minus every byte, modulo 256.
fn checksum(bytes: &[u8]) -> u8 {
    bytes.iter().fold(0x40, |sum: u8, byte| sum.wrapping_sub(*byte))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn packet(camera: u8, angles_deg: [f64; 3], position_mm: [f64; 3]) -> Vec<u8> {
        let mut bytes = vec![D1, camera];
        let mut push = |value: f64| bytes.extend(&(value.round() as i32).to_be_bytes()[1..]);
        angles_deg.iter().for_each(|angle| push(angle * 32768.0));
        position_mm.iter().for_each(|length| push(length * 64.0));
        bytes.extend([0; 8]);
        bytes.push(checksum(&bytes));
        bytes
    }

    #[test]
    fn a_packet_by_hand() {
        // Pan 180 degrees is 5A0000, x = -1 mm is FFFFC0, height 2 m is 01F400.
        let mut bytes = [0u8; BYTES];
        bytes[..2].copy_from_slice(&[0xD1, 7]);
        bytes[2..5].copy_from_slice(&[0x5A, 0, 0]);
        bytes[11..14].copy_from_slice(&[0xFF, 0xFF, 0xC0]);
        bytes[17..20].copy_from_slice(&[0x01, 0xF4, 0x00]);
        // 0x40 - (D1 + 07 + 5A + FF + FF + C0 + 01 + F4) = 0x40 - 0x4E5.
        bytes[28] = 0x5B;
        let pose = parse(&bytes).unwrap();
        assert_eq!((pose.sensor, pose.position_m), (7, DVec3::new(-0.001, 0.0, 2.0)));
        assert!((pose.orientation * DVec3::Y + DVec3::Y).length() < 1e-12);
    }

    #[test]
    fn pan_tilt_and_roll_have_their_senses() {
        let turned = |angles| parse(&packet(0, angles, [0.0; 3])).unwrap().orientation;
        // To the right from above, up, and clockwise from behind.
        assert!((turned([90.0, 0.0, 0.0]) * DVec3::Y - DVec3::X).length() < 1e-12);
        assert!((turned([0.0, 90.0, 0.0]) * DVec3::Y - DVec3::Z).length() < 1e-12);
        assert!((turned([0.0, 0.0, 90.0]) * DVec3::Z - DVec3::X).length() < 1e-12);
        assert!((turned([90.0, 90.0, 0.0]) * DVec3::Y - DVec3::Z).length() < 1e-12);
        assert!((turned([0.0, 90.0, 90.0]) * DVec3::Y - DVec3::Z).length() < 1e-12);
    }

    #[test]
    fn what_is_no_packet_is_refused_by_name() {
        let good = packet(1, [10.0, 20.0, 30.0], [100.0, 200.0, 300.0]);
        let changed = |at: usize, to: u8| {
            let mut bytes = good.clone();
            bytes[at] = to;
            parse(&bytes).unwrap_err()
        };
        assert_eq!(changed(0, 0xD0), ParseError::Kind(0xD0));
        assert!(matches!(changed(12, 0x7F), ParseError::Checksum { .. }));
        assert!(parse(&good[1..]).unwrap_err().to_string().contains("28 bytes: FreeD D1 has 29"));
        let far = parse(&packet(1, [0.0; 3], [0.0, 120_000.0, 0.0])).unwrap_err();
        assert!(far.to_string().starts_with("y = 120000: must be from -100000 to 100000"), "{far}");
    }

    proptest! {
        #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]
        #[test]
        fn any_bytes_are_a_pose_or_refused(bytes in prop::collection::vec(any::<u8>(), 0..40)) {
            let _ = parse(&bytes);
        }

        /// With a checksum that holds.
        #[test]
        fn any_packet_is_a_pose_or_refused(mut bytes in prop::collection::vec(any::<u8>(), BYTES - 1)) {
            bytes[0] = D1;
            bytes.push(checksum(&bytes));
            if let Ok(pose) = parse(&bytes) {
                prop_assert!(pose.position_m.abs().max_element() <= POSITION_M_MAX && pose.orientation.is_normalized());
            }
        }

        #[test]
        fn a_changed_byte_is_noticed(at in 0..BYTES, bits in 1..=u8::MAX) {
            let mut bytes = packet(1, [10.0, 20.0, 30.0], [100.0, 200.0, 300.0]);
            bytes[at] ^= bits;
            prop_assert!(parse(&bytes).is_err());
        }
    }
}
