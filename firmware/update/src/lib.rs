//! Which firmware boots, and how another takes its place: signed images in two slots, swapped by `embassy-boot`.
//!
//! `embassy-boot` copies pages between the slots so that a copy that was cut off is done again. This crate adds what it lacks:
//! a [`record`] of its progress that survives a power cut within a write or an erase, an [`image`] that is verified at every boot
//! and before every swap, and a [`loader`] that tries a new image a few times and takes the old one back.
#![no_std]

#[cfg(test)]
extern crate std;

pub mod image;
pub mod loader;
pub mod record;
pub mod stm32h743;
pub mod updater;
