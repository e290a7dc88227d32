//! Turns as video: each frame full screen on a monitor, bit for bit, in the refresh that it belongs to.
//!
//! By X11's own protocol, with its extensions RandR (which monitor, and what is done to its pixels) and Present (a frame for a refresh by number, and
//! when it was shown). wgpu says nothing of when a frame was shown, and neither it nor winit of what a driver does to the bits.
//! [`pace`] and [`fit`] decide; `x11` asks and obeys.

pub mod fit;
pub mod pace;
pub mod x11;

use crate::render::turn::Turn;
use crate::rendered::frame;
use protocol::frame_mark::{SIDE, pixel};
use protocol::rig::Rig;
use std::str::FromStr;
use thiserror::Error;

/// Where pictures go.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Output {
    /// Over the wire to the controller.
    Device,
    /// To the monitor of this name.
    Video(String),
}

/// No place where pictures go.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[error("output = {0}: allowed is device, or video:MONITOR; video:? lists monitors")]
pub struct OutputError(String);

impl FromStr for Output {
    type Err = OutputError;

    fn from_str(text: &str) -> Result<Self, OutputError> {
        match text.split_once(':') {
            None if text == "device" => Ok(Self::Device),
            Some(("video", monitor)) if !monitor.is_empty() => Ok(Self::Video(monitor.into())),
            _ => Err(OutputError(text.into())),
        }
    }
}

/// Why there is no video.
#[derive(Clone, Debug, PartialEq, Error)]
#[expect(missing_docs, reason = "the messages say it")]
pub enum VideoError {
    #[error("no X display: {0}: set DISPLAY (DISPLAY=:0) and let this user in (xhost +si:localuser:NAME)")]
    NoDisplay(String),
    #[error("the X server has no {0}: another one is needed")]
    NoExtension(&'static str),
    #[error("no monitor {name}: there is {}", if there.is_empty() { "none".into() } else { there.join(", ") })]
    NoMonitor { name: String, there: Vec<String> },
    #[error("an Xwayland display: a compositor may scale and recolour what it shows: use a plain X server")]
    Xwayland,
    #[error("monitor {name} is {width}x{height}: rig {rig} needs {wide}x{high}: {remedy}")]
    Size { name: String, width: u32, height: u32, rig: String, wide: u32, high: u32, remedy: String },
    #[error("monitor {name} shows {hz:.2} frames a second: rig {rig} needs {wanted} within 1 %: {remedy}")]
    Rate { name: String, hz: f64, rig: String, wanted: f64, remedy: String },
    #[error(
        "monitor {name} has pixels of {depth} bits that are not 8 each of red, green and blue: DefaultDepth 24 in xorg.conf"
    )]
    Depth { name: String, depth: u8 },
    #[error(
        "the picture of monitor {name} is scaled or turned: xrandr --output {name} --transform none --rotate normal --reflect normal"
    )]
    Transformed { name: String },
    #[error(
        "monitor {name} changes levels ({channel} {level} becomes {value} of 65535): xrandr --output {name} --gamma 1:1:1, and end programs that set colours"
    )]
    Gamma { name: String, channel: &'static str, level: usize, value: u16 },
    #[error("the X server did not say for {0} s that a frame was shown: is the monitor on? xset dpms force on")]
    Silent(u64),
    #[error("the monitor's settings were changed")]
    Changed,
    #[error("the X server: {0}")]
    Lost(String),
}

/// Bytes of frame `index` of `turn` as a monitor takes them: rows of blue, green, red and one that means nothing, with the
/// [mark](protocol::frame_mark) of its number at the upper left. Dark but for that without a turn.
pub fn bytes_of(turn: Option<&Turn>, rig: &Rig, index: u32) -> Vec<u8> {
    let (width, height) = (rig.projector.width_px, rig.projector.height_px);
    let mut bytes = vec![0; width as usize * height as usize * 4];
    let (pixels, _) = bytes.as_chunks_mut::<4>();
    if let Some(turn) = turn {
        let frame = frame(turn, rig, index);
        for (to, from) in pixels.iter_mut().zip(frame.as_chunks::<3>().0) {
            *to = [from[2], from[1], from[0], 0];
        }
    }
    for (row, line) in (0..SIDE.min(height)).zip(pixels.chunks_mut(width as usize)) {
        for (column, to) in (0..SIDE).zip(line) {
            let [red, green, blue, _] = pixel(index, column, row).to_le_bytes();
            *to = [blue, green, red, 0];
        }
    }
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pattern::{Pattern, draw};
    use crate::rigs;
    use crate::volume::display_radius_m;
    use glam::DVec2;
    use protocol::frame_mark::read;
    use shaders::project::{Model, SliceOptics, Viewer};

    #[test]
    fn outputs_have_names() {
        assert_eq!("device".parse(), Ok(Output::Device));
        assert_eq!("video:DP-1".parse(), Ok(Output::Video("DP-1".into())));
        for wrong in ["", "video", "video:", "DP-1", "device:1"] {
            let error = wrong.parse::<Output>().unwrap_err().to_string();
            assert!(error.contains("video:MONITOR"), "{error}");
        }
    }

    #[test]
    fn a_frame_is_what_render_writes_with_its_mark() {
        let rig = rigs::find("reference").unwrap();
        let turn = draw(&rig, Pattern::Grid).unwrap();
        for index in [0, 7, 11] {
            let (bytes, rgb) = (bytes_of(Some(&turn), &rig, index), frame(&turn, &rig, index));
            let words: Vec<u32> =
                bytes.as_chunks().0.iter().map(|&[b, g, r, _]| u32::from_be_bytes([0, b, g, r])).collect();
            let mark = std::array::from_fn(|place| words[place / 8 * 768 + place % 8]);
            assert_eq!(read(&mark), Some(index));
            for (place, (word, rgb)) in words.iter().zip(rgb.as_chunks().0).enumerate() {
                let &[r, g, b] = rgb;
                let is_mark = place % 768 < 8 && place / 768 < 8;
                assert!(is_mark || *word == u32::from_be_bytes([0, b, g, r]), "pixel {place}");
            }
        }
    }

    /// How near the sight lines of the mark's pixels come to the middle of the display, in metres, of all slices of all faces.
    fn nearest_m(rig: &Rig) -> f64 {
        let corners = [[0.5, 0.5], [7.5, 0.5], [0.5, 7.5], [7.5, 7.5]].map(DVec2::from_array);
        let mut nearest = f64::INFINITY;
        for face in 0..rig.mirror.face.len() {
            for slice in 0..rig.rotation.slices {
                let optics = SliceOptics::new(rig, face, rig.slice_angle(slice), Model::Cone);
                for sight in corners.into_iter().filter_map(|pixel| optics.sight(pixel)) {
                    let toward = match sight.viewer {
                        Viewer::At(place) => (place - sight.mirror).normalize(),
                        Viewer::Toward(direction) => direction,
                    };
                    nearest = nearest.min(sight.mirror.cross(toward).length());
                }
            }
        }
        nearest
    }

    #[test]
    fn no_eye_that_looks_at_the_display_volume_sees_the_mark() {
        for name in ["reference", "reference-180hz", "high-viewer", "tent"] {
            let rig = rigs::find(name).unwrap();
            let (nearest, radius) = (nearest_m(&rig), display_radius_m(&rig));
            println!(
                "{name}: the mark is seen {:.1} mm from the middle, the display's radius is {:.1} mm",
                nearest * 1e3,
                radius * 1e3
            );
            assert!(nearest > radius, "{name}: {nearest} {radius}");
        }
    }
}
