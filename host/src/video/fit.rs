//! Whether what a monitor shows is bit for bit what it is given, as fast as a rig needs it.

use super::VideoError;
use protocol::rig::Rig;
use std::fmt::{self, Display, Formatter};

/// A monitor's rate may differ from the rig's by this share: the mirror follows the monitor, and 60 Hz is often 59.94.
const RATE_SHARE: f64 = 0.01;

/// What a monitor may be made to show.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mode {
    /// Width and height in pixels.
    pub size: [u32; 2],
    /// Refreshes a second, where the driver says it.
    pub refresh_hz: Option<f64>,
}

impl Mode {
    fn has_rate_of(&self, rig: &Rig) -> bool {
        self.refresh_hz.is_some_and(|hz| (hz / rig.rotation.refresh_hz - 1.0).abs() <= RATE_SHARE)
    }
}

impl Display for Mode {
    fn fmt(&self, to: &mut Formatter<'_>) -> fmt::Result {
        write!(to, "{}x{}", self.size[0], self.size[1])?;
        self.refresh_hz.map_or(Ok(()), |hz| write!(to, " at {hz:.2} Hz"))
    }
}

/// What is known of a monitor and of the way to it.
#[derive(Clone, Debug, PartialEq)]
pub struct Found {
    /// Its name.
    pub name: String,
    /// What it shows now.
    pub mode: Mode,
    /// What it could show.
    pub modes: Vec<Mode>,
    /// Bits of a pixel's colour.
    pub depth: u8,
    /// Whether a pixel is four bytes: blue, green, red, and one that means nothing.
    pub is_bgrx: bool,
    /// The levels that red, green and blue become, from black to white; empty where the driver has no such table.
    pub gamma: [Vec<u16>; 3],
    /// Whether the picture is turned or mirrored.
    pub is_rotated: bool,
    /// Whether the picture is scaled or sheared.
    pub is_transformed: bool,
    /// Whether a compositor of another kind stands in between.
    pub is_xwayland: bool,
    /// Properties of the output: name, value.
    pub properties: Vec<(String, Property)>,
}

/// The value of a property.
#[derive(Clone, Debug, PartialEq)]
pub enum Property {
    /// One of several names.
    Name(String),
    /// Numbers.
    Numbers(Vec<u32>),
}

/// Checks `found` against what `rig` needs. What may change bits without being certain to is returned, in words.
///
/// # Errors
/// The first thing that does not fit, with what is allowed and a remedy.
pub fn check(found: &Found, rig: &Rig) -> Result<Vec<String>, VideoError> {
    let name = || found.name.clone();
    if found.is_xwayland {
        return Err(VideoError::Xwayland);
    }
    if !matches!(found.depth, 24 | 32) || !found.is_bgrx {
        return Err(VideoError::Depth { name: name(), depth: found.depth });
    }
    let wanted = [rig.projector.width_px, rig.projector.height_px];
    if found.mode.size != wanted {
        let ([width, height], [wide, high]) = (found.mode.size, wanted);
        let remedy = remedy(found, rig, "width_px and height_px");
        return Err(VideoError::Size { name: name(), width, height, rig: rig.name.clone(), wide, high, remedy });
    }
    if !found.mode.has_rate_of(rig) {
        let hz = found.mode.refresh_hz.unwrap_or(0.0);
        let remedy = remedy(found, rig, "refresh_hz");
        return Err(VideoError::Rate {
            name: name(),
            hz,
            rig: rig.name.clone(),
            wanted: rig.rotation.refresh_hz,
            remedy,
        });
    }
    if found.is_rotated || found.is_transformed {
        return Err(VideoError::Transformed { name: name() });
    }
    if let Some((channel, level, value)) = bent(&found.gamma) {
        return Err(VideoError::Gamma { name: name(), channel, level, value });
    }
    Ok(found.properties.iter().filter_map(|(name, value)| doubt(name, value)).collect())
}

fn remedy(found: &Found, rig: &Rig, keys: &str) -> String {
    let wanted = [rig.projector.width_px, rig.projector.height_px];
    let has_mode = found.modes.iter().any(|mode| mode.size == wanted && mode.has_rate_of(rig));
    let ([wide, high], hz, name) = (wanted, rig.rotation.refresh_hz, &found.name);
    if has_mode {
        format!("xrandr --output {name} --mode {wide}x{high} --rate {hz}")
    } else {
        format!(
            "it has no mode of {wide}x{high} at {hz} Hz, so add one (xrandr --newmode, --addmode) or change {keys} in the rig"
        )
    }
}

/// The first level that is not what it is on a straight line, as channel, level and value. Both ways to widen 8 bits to 16 are straight:
/// times 256 and times 257.
fn bent(gamma: &[Vec<u16>; 3]) -> Option<(&'static str, usize, u16)> {
    ["red", "green", "blue"].into_iter().zip(gamma).find_map(|(channel, levels)| {
        let straight = |level: usize| level * 256 / levels.len();
        let is_bent = |(level, value): &(usize, &u16)| usize::from(**value >> 8) != straight(*level);
        levels.iter().enumerate().find(is_bent).map(|(level, value)| (channel, level, *value))
    })
}

/// What is doubtful of a property. Names and values are those of the kernel's drivers and NVIDIA's.
fn doubt(name: &str, value: &Property) -> Option<String> {
    let (said, is_good, wanted) = match (name, value) {
        ("Broadcast RGB", Property::Name(value)) => (value, value == "Full", "Full"),
        ("Colorspace", Property::Name(value)) => (value, value == "Default", "Default"),
        ("scaling mode", Property::Name(value)) => (value, value == "None" || value == "Center", "None"),
        ("underscan", Property::Name(value)) => (value, value == "off", "off"),
        ("dither" | "dithering mode", Property::Name(value)) => (value, value == "off", "off"),
        ("max bpc", Property::Numbers(numbers)) => {
            let bits = numbers.first().copied().unwrap_or(8);
            return (bits < 8).then(|| format!("{name} is {bits}, which may change bits: 8 is wanted"));
        }
        ("CTM", Property::Numbers(numbers)) => {
            // Nine numbers of 31 bits before the point and 32 after it, the low half first.
            let is_one = |(place, half): (usize, &u32)| *half == u32::from(matches!(place, 1 | 9 | 17));
            let is_identity = numbers.iter().enumerate().all(is_one);
            return (!is_identity).then(|| "CTM is a colour matrix, which changes bits: none is wanted".into());
        }
        _ => return None,
    };
    (!is_good).then(|| format!("{name} is {said}, which may change bits: xrandr --set \"{name}\" \"{wanted}\""))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rigs;

    fn found() -> Found {
        let straight: Vec<u16> = (0..=255).map(|level| level * 257).collect();
        Found {
            name: "DP-1".into(),
            mode: Mode { size: [768, 768], refresh_hz: Some(239.8) },
            modes: vec![Mode { size: [768, 768], refresh_hz: Some(239.8) }],
            depth: 24,
            is_bgrx: true,
            gamma: [straight.clone(), straight.clone(), straight],
            is_rotated: false,
            is_transformed: false,
            is_xwayland: false,
            properties: vec![("Broadcast RGB".into(), Property::Name("Full".into()))],
        }
    }

    #[test]
    fn straight_levels_are_straight_however_they_are_written() {
        for size in [256, 1024, 4096] {
            let exact: Vec<u16> = (0..size).map(|level| (level * 65_535 / (size - 1)) as u16).collect();
            let shifted: Vec<u16> = (0..size).map(|level| (level * 65_536 / size) as u16).collect();
            assert_eq!(bent(&[exact, shifted, vec![]]), None, "{size}");
        }
    }

    #[test]
    fn what_does_not_fit_is_refused_with_what_is_allowed_and_a_remedy() {
        let rig = rigs::find("reference").unwrap();
        assert_eq!(check(&found(), &rig).unwrap(), Vec::<String>::new());
        let mut bent = found();
        bent.gamma[1][128] -= 1_000;
        let slow = Mode { size: [768, 768], refresh_hz: Some(60.0) };
        let wide = Mode { size: [1024, 768], refresh_hz: Some(240.0) };
        for (found, words) in [
            (
                Found { mode: wide, ..found() },
                ["1024x768", "768x768", "xrandr --output DP-1 --mode 768x768 --rate 240"],
            ),
            (Found { mode: wide, modes: vec![wide], ..found() }, ["1024x768", "768x768", "--newmode"]),
            (Found { mode: slow, ..found() }, ["60.00", "240", "--rate 240"]),
            (Found { mode: slow, modes: vec![slow], ..found() }, ["60.00", "240", "refresh_hz"]),
            (Found { depth: 30, ..found() }, ["30", "24", "DefaultDepth"]),
            (Found { is_bgrx: false, ..found() }, ["24", "DP-1", "DefaultDepth"]),
            (Found { is_rotated: true, ..found() }, ["DP-1", "scaled or turned", "--transform none"]),
            (Found { is_transformed: true, ..found() }, ["DP-1", "scaled or turned", "--transform none"]),
            (Found { is_xwayland: true, ..found() }, ["Xwayland", "compositor", "X server"]),
            (bent, ["green", "128", "--gamma 1:1:1"]),
        ] {
            let error = check(&found, &rig).unwrap_err().to_string();
            assert!(words.iter().all(|word| error.contains(word)), "{error}");
            assert!(!error.contains('\n'), "{error}");
        }
    }

    #[test]
    fn what_may_change_bits_is_told() {
        let name = |value: &str| Property::Name(value.into());
        let mut identity = vec![0; 18];
        [1, 9, 17].into_iter().for_each(|place| identity[place] = 1);
        for (property, value, is_good) in [
            ("Broadcast RGB", name("Automatic"), false),
            ("Colorspace", name("Default"), true),
            ("scaling mode", name("Full aspect"), false),
            ("dithering mode", name("auto"), false),
            ("dithering mode", name("off"), true),
            ("underscan", name("on"), false),
            ("max bpc", Property::Numbers(vec![6]), false),
            ("max bpc", Property::Numbers(vec![12]), true),
            ("CTM", Property::Numbers(identity), true),
            ("CTM", Property::Numbers(vec![0; 18]), false),
            ("non-desktop", Property::Numbers(vec![0]), true),
        ] {
            let told = doubt(property, &value);
            assert_eq!(told.is_none(), is_good, "{property}: {told:?}");
            assert!(told.is_none_or(|told| told.contains(property)));
        }
    }
}
