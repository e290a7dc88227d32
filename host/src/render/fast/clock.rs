//! Where the time of a task goes.

use crate::machine::thread_time;
use core::time::Duration;

/// A part of a slice.
#[derive(Clone, Copy)]
pub enum Part {
    /// Vertices are projected.
    Vertices,
    /// Triangles are set up and filled.
    Triangles,
    /// Masks are laid out, luminances diffused, planes packed.
    Planes,
}

impl Part {
    const ALL: [(&'static str, Self); 3] =
        [("vertices", Self::Vertices), ("triangles", Self::Triangles), ("planes", Self::Planes)];
}

/// A sum of times of threads, by parts: what other programs take in between does not count.
#[derive(Default)]
pub struct Clock {
    parts: [Duration; Part::ALL.len()],
    last: Option<Duration>,
}

impl Clock {
    /// The next part begins.
    pub fn start(&mut self) {
        self.last = thread_time();
    }

    /// `part` ends, and the next begins.
    pub fn end(&mut self, part: Part) {
        let now = thread_time();
        if let (Some(last), Some(now)) = (self.last, now) {
            self.parts[part as usize] += now.saturating_sub(last);
        }
        self.last = now;
    }

    /// Takes over what `other` has.
    pub fn take(&mut self, other: &mut Self) {
        for (own, others) in self.parts.iter_mut().zip(core::mem::take(&mut other.parts)) {
            *own += others;
        }
    }

    /// The parts with their names, as [`crate::render::Prepared::stages`] has them.
    pub fn stages(&self) -> Vec<(&'static str, Duration)> {
        Part::ALL.into_iter().map(|(name, part)| (name, self.parts[part as usize])).collect()
    }
}
