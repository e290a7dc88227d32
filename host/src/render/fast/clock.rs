//! Where the time of a task goes.

use core::time::Duration;
use std::time::Instant;

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

/// A sum of times, by parts.
#[derive(Default)]
pub struct Clock {
    parts: [Duration; Part::ALL.len()],
    last: Option<Instant>,
}

impl Clock {
    /// The next part begins.
    pub fn start(&mut self) {
        self.last = Some(Instant::now());
    }

    /// `part` ends, and the next begins.
    pub fn end(&mut self, part: Part) {
        let now = Instant::now();
        if let Some(last) = self.last.replace(now) {
            self.parts[part as usize] += now - last;
        }
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
