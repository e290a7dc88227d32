//! All slices of one rotation.

use crate::machine::memory_left;
use shaders::halftone::plane_stride;
use thiserror::Error;

/// A turn may hold this many bytes: 288 grey slices of 4096 × 4096 pixels, and some.
const BYTES_MAX: u64 = 6 << 30;

/// A turn that would not fit in memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[error("a turn of {:.1} GB: at most {:.1} GB are allowed, so fewer slices or pixels, or no grey", *bytes as f64 / 1e9, *allowed as f64 / 1e9)]
pub struct TurnTooLarge {
    /// Its size.
    pub bytes: u64,
    /// The most that a turn may have, or all that this machine has left if that is less.
    pub allowed: u64,
}

/// What a pixel of a slice holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Depth {
    /// One bit: pixel x is bit x mod 8 of byte x div 8, rows of ⌈width / 8⌉ bytes.
    Binary,
    /// One byte of linear luminance, 255 is white.
    Grey,
}

/// The slices of one rotation, in order, each row by row from the top.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Turn {
    width: u32,
    height: u32,
    depth: Depth,
    data: Vec<u8>,
}

impl Turn {
    /// `slices` dark slices.
    pub fn dark(slices: u32, width: u32, height: u32, depth: Depth) -> Result<Self, TurnTooLarge> {
        let mut turn = Self { width, height, depth, data: Vec::new() };
        let bytes = turn.slice_bytes() as u64 * u64::from(slices);
        let allowed = memory_left().unwrap_or(u64::MAX).min(BYTES_MAX);
        if bytes > allowed {
            return Err(TurnTooLarge { bytes, allowed });
        }
        turn.data = vec![0; bytes as usize];
        Ok(turn)
    }

    /// Image width in pixels.
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Image height in pixels.
    pub fn height(&self) -> u32 {
        self.height
    }

    /// What a pixel holds.
    pub fn depth(&self) -> Depth {
        self.depth
    }

    /// Slices a turn.
    pub fn slices(&self) -> u32 {
        (self.data.len() / self.slice_bytes()) as u32
    }

    /// Bytes of one slice.
    pub fn slice_bytes(&self) -> usize {
        let row = match self.depth {
            Depth::Binary => plane_stride(self.width),
            Depth::Grey => self.width as usize,
        };
        row * self.height as usize
    }

    /// Slice `slice`, which must be below [`Turn::slices`].
    pub fn slice(&self, slice: u32) -> &[u8] {
        let bytes = self.slice_bytes();
        &self.data[slice as usize * bytes..][..bytes]
    }

    /// Slice `slice`, which must be below [`Turn::slices`], to be filled.
    pub fn slice_mut(&mut self, slice: u32) -> &mut [u8] {
        let bytes = self.slice_bytes();
        &mut self.data[slice as usize * bytes..][..bytes]
    }

    /// All slices one after the other.
    pub fn bytes(&self) -> &[u8] {
        &self.data
    }

    /// All slices one after the other, to be filled.
    pub fn bytes_mut(&mut self) -> &mut [u8] {
        &mut self.data
    }

    /// Mean luminance of slice `slice`, 0 … 1.
    pub fn mean(&self, slice: u32) -> f64 {
        let bytes = self.slice(slice).iter();
        let pixels = f64::from(self.width) * f64::from(self.height);
        match self.depth {
            Depth::Binary => f64::from(bytes.map(|byte| byte.count_ones()).sum::<u32>()) / pixels,
            Depth::Grey => bytes.map(|byte| f64::from(*byte)).sum::<f64>() / 255.0 / pixels,
        }
    }
}
