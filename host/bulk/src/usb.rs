//! [`Bus`] over libusb.

use crate::transfer::UsbTransfer;
use crate::{Bus, Error};
use rusb::{Context, DeviceHandle, UsbContext};
use std::sync::Arc;
use std::time::Duration;

/// A device that `rusb` has opened.
#[derive(Debug)]
pub struct Usb(Arc<DeviceHandle<Context>>);

impl Usb {
    /// It, with the interface of its endpoints claimed.
    pub fn new(handle: DeviceHandle<Context>) -> Self {
        Self(Arc::new(handle))
    }
}

impl Bus for Usb {
    type Transfer = UsbTransfer;

    fn transfer(&self, endpoint: u8, bytes: usize) -> Result<UsbTransfer, Error> {
        UsbTransfer::new(Arc::clone(&self.0), endpoint, bytes)
    }

    fn handle_events(&self, wait: Duration) -> Result<(), Error> {
        match self.0.context().handle_events(Some(wait)) {
            // By a signal of the operating system: nothing has happened, as after a wait.
            Err(Error::Interrupted) => Ok(()),
            handled => handled,
        }
    }

    fn clear_halt(&self, endpoint: u8) -> Result<(), Error> {
        self.0.clear_halt(endpoint)
    }
}
