//! Frames that come as video: a host counts them, a graphics card and a link carry them, and both may fail.

use crate::noise::{Noise, Source};
use protocol::frame_mark::{PIXELS, SIDE, pixel};
use protocol::timing::Rotation;
use serde::{Deserialize, Serialize};
use std::collections::VecDeque;

/// What goes wrong with a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub enum VideoFault {
    /// A bit of the mark arrives the other way.
    Bit,
    /// The whole mark arrives as another, whole one: what no link is known to do.
    Mark {
        /// That of this frame.
        number: u32,
    },
    /// The card shows the frame before it once more, and the host catches up with the next.
    Late,
    /// The card shows the frame before it once more, and all that follow come one later.
    Repeated,
    /// The card leaves the frame out.
    Dropped,
    /// The host begins anew after so many frames of a desktop.
    Restart {
        /// Frames of the desktop.
        gap: u32,
        /// The first one after them.
        first: u32,
    },
}

/// From a host to the projector.
#[derive(Clone, Debug)]
pub struct Video {
    frames: u32,
    /// The frame that the host has for the next refresh.
    next: u32,
    on_screen: Option<u32>,
    gap: u32,
    faults: VecDeque<VideoFault>,
    noise: Noise,
}

impl Video {
    /// A host that is about to show frame `first` of the turn.
    pub fn new(rotation: &Rotation, first: u32, seed: u64) -> Self {
        let frames = rotation.frames();
        let noise = Noise::new(seed, Source::Video);
        Self { frames, next: first % frames, on_screen: None, gap: 0, faults: VecDeque::new(), noise }
    }

    /// This happens to the next refresh that nothing happens to yet.
    pub fn fail(&mut self, fault: VideoFault) {
        self.faults.push_back(fault);
    }

    /// The frame of the turn that the last refresh put on screen; none where it is a desktop.
    pub fn on_screen(&self) -> Option<u32> {
        self.on_screen
    }

    /// The pixels, where a mark is, of the next refresh.
    pub fn refresh(&mut self) -> [u32; PIXELS] {
        let fault = self.faults.pop_front();
        let mut is_shown_again = false;
        match fault {
            Some(VideoFault::Late) => is_shown_again = true,
            Some(VideoFault::Repeated) => (is_shown_again, self.next) = (true, self.next + self.frames - 1),
            Some(VideoFault::Dropped) => self.next += 1,
            Some(VideoFault::Restart { gap, first }) => {
                (self.gap, self.next) = (gap, first % self.frames + self.frames - gap % self.frames);
            }
            Some(VideoFault::Bit | VideoFault::Mark { .. }) | None => {}
        }
        if self.gap > 0 {
            (self.gap, self.on_screen) = (self.gap - 1, None);
        } else if !is_shown_again {
            self.on_screen = Some(self.next % self.frames);
        }
        self.next = (self.next + 1) % self.frames;
        let mark = |frame| std::array::from_fn(|place| pixel(frame, place as u32 % SIDE, place as u32 / SIDE));
        let mut pixels = self.on_screen.map_or([0x30_40_50; PIXELS], mark);
        match fault {
            Some(VideoFault::Bit) => {
                let mut below = |count: usize| (self.noise.uniform() * count as f64) as usize;
                pixels[below(PIXELS)] ^= 1 << below(24);
            }
            Some(VideoFault::Mark { number }) => pixels = mark(number),
            _ => {}
        }
        pixels
    }
}
