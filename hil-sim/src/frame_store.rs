//! The frame store of the simulated controller: turns in memory, expanded, as the projector shows them.

use firmware::frame_store::{FrameStore, Memory};
pub use firmware::frame_store::{PlaneRef, SLOTS, StoreError};

/// The memory that a store takes at most: two turns of 288 slices of 4096 x 4096 pixels take 1.2 GB.
pub const BYTES_MAX: usize = 4 << 30;

/// Memory of this machine. The system gives it where it is first written.
#[derive(Debug, Default)]
pub struct Heap(Vec<u8>);

impl Memory for Heap {
    fn make_room(&mut self, bytes: usize) -> bool {
        let fits = bytes <= BYTES_MAX;
        if fits {
            self.0 = vec![0; bytes];
        }
        fits
    }

    fn bytes(&self) -> &[u8] {
        &self.0
    }

    fn bytes_mut(&mut self) -> &mut [u8] {
        &mut self.0
    }
}

/// [`SLOTS`] turns in memory.
pub type MemoryStore = FrameStore<Heap>;

#[cfg(test)]
mod tests;
