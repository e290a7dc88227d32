//! A Polhemus Patriot's stream of text: a line is a station of two digits, an error's letter or a space, a space, and six numbers in fields of
//! seven columns: x, y, z and azimuth, elevation, roll in degrees.
//!
//! Source: Polhemus, Patriot user manual URM03PH170 (commands F, U, O, C and P, error letters), and FASTRAK manual rev. G (the fields
//! Sxxx.xx). [`COMMANDS`] ask for centimetres. Numbers without a space between them are told apart by their columns; a line of another length
//! is divided at its spaces. Azimuth turns about z, elevation about the new y, roll about the new x: R = Rz(az) Ry(el) Rx(ro), in the
//! right-handed frame of its source. **Not tried on a device.**

use super::{ANGLE_DEG_MAX, POSITION_M_MAX, ParseError, Pose, sensible};
use glam::{DQuat, DVec3, EulerRot};

/// What the host sends to a Patriot: out of whatever it does, text, centimetres, position and angles and an end of line, go on by yourself.
pub const COMMANDS: &[u8] = b"P\rF0\rU1\rO*,2,4,1\rC\r";
/// Longer lines are none: a record has 46 columns, answers to commands hardly more.
const LINE_BYTES_MAX: usize = 256;
/// Columns before the numbers, and of each.
const HEAD: usize = 4;
const FIELD: usize = 7;

/// Reads a line without its end.
pub fn parse(line: &[u8]) -> Result<Pose, ParseError> {
    let shown = || ParseError::Line(String::from_utf8_lossy(line).chars().take(60).map(visible).collect());
    if !line.is_ascii() || line.len() < HEAD {
        return Err(shown());
    }
    let (head, body) = line.split_at(HEAD);
    let digit = |byte: u8| byte.is_ascii_digit().then(|| byte - b'0');
    let (Some(tens), Some(ones)) = (digit(head[0]), digit(head[1])) else { return Err(shown()) };
    let station = tens * 10 + ones;
    if let Some(letter) = head[2..].iter().find(|byte| byte.is_ascii_alphabetic()) {
        return Err(ParseError::Doubted((*letter).into(), station));
    }
    let numbers = numbers(if head[2..] == *b"  " { body } else { &line[2..] }).ok_or_else(shown)?;
    let [x, y, z, azimuth, elevation, roll] = numbers;
    let position = sensible(["x", "y", "z"], [x, y, z], POSITION_M_MAX * 100.0)?;
    let angles = sensible(["azimuth", "elevation", "roll"], [azimuth, elevation, roll], ANGLE_DEG_MAX)?;
    let [azimuth, elevation, roll] = angles.map(f64::to_radians);
    Ok(Pose {
        sensor: station,
        position_m: DVec3::from(position) / 100.0,
        orientation: DQuat::from_euler(EulerRot::ZYX, azimuth, elevation, roll),
    })
}

/// Six numbers, in columns or between spaces.
fn numbers(body: &[u8]) -> Option<[f64; 6]> {
    let number = |field: &[u8]| std::str::from_utf8(field).ok()?.trim().parse().ok();
    let all: Option<Vec<f64>> = if body.len() == 6 * FIELD {
        body.chunks(FIELD).map(number).collect()
    } else {
        body.split(u8::is_ascii_whitespace).filter(|field| !field.is_empty()).map(number).collect()
    };
    all?.try_into().ok()
}

/// What is printed of a byte that came over a wire.
fn visible(character: char) -> char {
    if character.is_control() { '·' } else { character }
}

/// Bytes as they come, to lines.
#[derive(Debug, Default)]
pub struct Lines {
    line: Vec<u8>,
    /// The rest of a line that was too long, or of one whose beginning was missed.
    skips: bool,
}

impl Lines {
    /// For a stream that may begin within a line: what comes before the first end of line is thrown away.
    pub fn new() -> Self {
        Self { line: Vec::new(), skips: true }
    }

    /// Takes `bytes` and gives what each line in them was to `each`, with the count of bytes that came after its end. Empty lines are none.
    pub fn take(&mut self, bytes: &[u8], mut each: impl FnMut(Result<Pose, ParseError>, usize)) {
        for (index, byte) in bytes.iter().enumerate() {
            match byte {
                b'\r' | b'\n' => {
                    if !std::mem::take(&mut self.skips) && !self.line.is_empty() {
                        each(parse(&self.line), bytes.len() - 1 - index);
                    }
                    self.line.clear();
                }
                _ if self.skips => {}
                _ if self.line.len() == LINE_BYTES_MAX => {
                    each(Err(ParseError::Endless(LINE_BYTES_MAX)), bytes.len() - 1 - index);
                    self.line.clear();
                    self.skips = true;
                }
                byte => self.line.push(*byte),
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const GOOD: &str = "01    12.50 -30.25  45.00  90.00   0.00   0.00";

    fn record(station: u8, numbers: [f64; 6]) -> String {
        let fields: String = numbers.iter().map(|number| format!("{number:7.2}")).collect();
        format!("{station:02}  {fields}")
    }

    #[test]
    fn a_record_is_a_pose() {
        let pose = parse(GOOD.as_bytes()).unwrap();
        assert_eq!((pose.sensor, pose.position_m), (1, DVec3::new(0.125, -0.3025, 0.45)));
        assert!((pose.orientation * DVec3::X - DVec3::Y).length() < 1e-12);
        assert_eq!(record(1, [12.5, -30.25, 45.0, 90.0, 0.0, 0.0]), GOOD);
        // Fields without a space between, and others than the usual.
        let touching = parse(record(2, [-112.5, -130.25, -145.0, -170.0, -80.0, -100.0]).as_bytes()).unwrap();
        assert_eq!(touching.position_m, DVec3::new(-1.125, -1.3025, -1.45));
        let exponents = parse(b"01 1.250E+01 -3.0250E+01 45 9.0E+01 0 0").unwrap();
        assert_eq!((exponents.position_m, exponents.orientation), (pose.position_m, pose.orientation));
    }

    #[test]
    fn angles_turn_in_their_order() {
        let turned =
            |angles: [f64; 3]| parse(record(1, [0.0, 0.0, 0.0, angles[0], angles[1], angles[2]]).as_bytes()).unwrap();
        // The direction cosines of the sensor's x: (cos az cos el, sin az cos el, -sin el).
        let x = turned([30.0, 40.0, 50.0]).orientation * DVec3::X;
        let [azimuth, elevation] = [30.0f64, 40.0].map(f64::to_radians);
        let expected = DVec3::new(azimuth.cos() * elevation.cos(), azimuth.sin() * elevation.cos(), -elevation.sin());
        assert!((x - expected).length() < 1e-12);
        assert!((turned([0.0, 0.0, 90.0]).orientation * DVec3::Y - DVec3::Z).length() < 1e-12);
    }

    #[test]
    fn what_is_no_record_is_refused_by_name() {
        for (line, words) in [
            ("", "must be a station and six numbers"),
            ("01", "01: must be a station"),
            ("xx  1 2 3 4 5 6", "must be a station"),
            ("01  1 2 3 4 5", "must be a station"),
            ("01  1 2 3 4 5 6 7", "must be a station"),
            ("01  1 2 3 4 5 six", "must be a station"),
            ("01g   12.50 -30.25  45.00  90.00   0.00   0.00", "error 'g' of station 1"),
            ("01  nan 2 3 4 5 6", "x = NaN: must be from -10000 to 10000"),
            ("01  1 2 inf 4 5 6", "z = inf"),
            ("01  1 2 3 4 1e9 6", "elevation = 1000000000"),
            ("\u{1}\u{2}\u{3}\u{4}\u{5}", "·····: must be"),
        ] {
            let refused = parse(line.as_bytes()).unwrap_err().to_string();
            assert!(refused.contains(words), "{line}: {refused}");
        }
    }

    fn taken(lines: &mut Lines, bytes: &[u8]) -> Vec<(Result<Pose, ParseError>, usize)> {
        let mut poses = Vec::new();
        lines.take(bytes, |pose, after| poses.push((pose, after)));
        poses
    }

    #[test]
    fn lines_begin_anew_at_their_ends() {
        let mut lines = Lines::new();
        // The middle of a line, a good one, one that never ends, and a good one again.
        assert_eq!(taken(&mut lines, format!("45.00\r\n{GOOD}").as_bytes()), []);
        assert_eq!(taken(&mut lines, b"\r\n"), [(parse(GOOD.as_bytes()), 1)]);
        let endless = taken(&mut lines, &[b'7'; 3 * LINE_BYTES_MAX]);
        assert_eq!(endless, [(Err(ParseError::Endless(LINE_BYTES_MAX)), 2 * LINE_BYTES_MAX - 1)]);
        assert_eq!(taken(&mut lines, format!("\r\n{GOOD}\r\n").as_bytes()), [(parse(GOOD.as_bytes()), 1)]);
    }

    proptest! {
        #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]
        #[test]
        fn any_bytes_leave_the_next_record_whole(bytes in prop::collection::vec(any::<u8>(), 0..600)) {
            let mut lines = Lines::new();
            taken(&mut lines, &bytes);
            prop_assert!(lines.line.len() <= LINE_BYTES_MAX);
            let after = taken(&mut lines, format!("\r\n{GOOD}\r\n").as_bytes());
            prop_assert_eq!(after.last(), Some(&(parse(GOOD.as_bytes()), 1)));
        }

        #[test]
        fn changed_lines_are_a_pose_or_refused(
            numbers in prop::array::uniform6(-200.0..200.0f64), at in 0..46usize, to in any::<u8>(),
        ) {
            let mut line = record(2, numbers).into_bytes();
            let pose = parse(&line).unwrap();
            let sent = numbers.map(|number| format!("{number:7.2}").trim().parse::<f64>().unwrap());
            prop_assert!((pose.position_m * 100.0 - DVec3::new(sent[0], sent[1], sent[2])).length() < 1e-9);
            line[at] = to;
            if let Ok(pose) = parse(&line) {
                prop_assert!(pose.position_m.abs().max_element() <= POSITION_M_MAX && pose.orientation.is_normalized());
            }
        }

        /// However the stream is cut, the same lines come out.
        #[test]
        fn cuts_do_not_matter(cut in 0..100usize) {
            let stream = format!("\r\n{GOOD}\r\n{GOOD}\r\n");
            let cut = cut.min(stream.len());
            let mut lines = Lines::new();
            let mut poses = taken(&mut lines, &stream.as_bytes()[..cut]);
            poses.extend(taken(&mut lines, &stream.as_bytes()[cut..]));
            prop_assert_eq!(poses.len(), 2);
        }
    }
}
