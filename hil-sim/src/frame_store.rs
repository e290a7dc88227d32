//! The frame store of the simulated controller: turns in memory, expanded, as the projector shows them.

use firmware::frame_store::{FrameStore, Memory};
pub use firmware::frame_store::{PlaneRef, SLOTS, StoreError};
use protocol::codec::Codebook;

/// The memory that a store takes at most: two turns of 288 slices of 4096 x 4096 pixels take 1.2 GB.
pub const BYTES_MAX: usize = 4 << 30;

/// Memory of this machine. The system gives it where it is first written.
#[derive(Debug)]
pub struct Heap {
    planes: Vec<u8>,
    book: Box<Codebook>,
}

impl Default for Heap {
    fn default() -> Self {
        Self { planes: Vec::new(), book: Box::new(Codebook::EMPTY) }
    }
}

impl Memory for Heap {
    fn make_room(&mut self, bytes: usize) -> bool {
        let fits = bytes <= BYTES_MAX;
        if fits {
            self.planes = vec![0; bytes];
        }
        fits
    }

    fn bytes(&self) -> &[u8] {
        &self.planes
    }

    fn parts(&mut self) -> (&mut [u8], &mut Codebook) {
        (&mut self.planes, &mut self.book)
    }
}

/// [`SLOTS`] turns in memory.
pub type MemoryStore = FrameStore<Heap>;

#[cfg(test)]
mod tests;
