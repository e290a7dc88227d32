//! What application and boot loader of the STM32H743 board have in common.
#![no_std]

pub mod clocks;
pub mod flash;
pub mod halt;
pub mod keep;
pub mod owner;
pub mod usb;

pub use update::stm32h743 as layout;
