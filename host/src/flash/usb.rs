//! A device on this machine's USB, in its application or in its loader.

use super::{DETACH, Device, FlashError, REQUEST_TYPE};
use crate::link::LinkError;
use crate::link::usb::{DfuInterface, Found, Name, found};
use dfu_core::functional_descriptor::FunctionalDescriptor;
use dfu_core::memory_layout::MemoryLayout;
use dfu_core::{DfuIo, DfuProtocol};
use protocol::image::Identity;
use rusb::constants::LIBUSB_ENDPOINT_IN;
use rusb::{Context, DeviceHandle};
use std::thread::sleep;
use std::time::{Duration, Instant};
use thiserror::Error;

/// A request takes as long as its work: the first block erases a slot, the last one has a signature verified.
const REQUEST: Duration = Duration::from_secs(60);
/// Two swaps, and three trials that a watchdog ends after 16 s each: the longest way to rest.
const SETTLED_WITHIN: Duration = Duration::from_secs(120);
/// A loader that is there for so long after a restart has nothing to start.
const LOADER_RESTS: Duration = Duration::from_secs(4);
/// An application that is still there so long after it was asked does not go; one that is on its way is on no bus.
const APPLICATION_STAYS: Duration = Duration::from_secs(4);
/// The loader verifies both slots first.
const DETACHED_WITHIN: Duration = Duration::from_secs(30);
const POLL: Duration = Duration::from_millis(200);

/// Why a request fails.
#[derive(Debug, Error)]
pub enum UsbError {
    /// See the message.
    #[error(transparent)]
    Usb(#[from] rusb::Error),
    /// What `dfu-core` says.
    #[error(transparent)]
    Dfu(#[from] dfu_core::Error),
    /// What the image's reader says.
    #[error(transparent)]
    Io(#[from] std::io::Error),
}

/// A device on this machine's USB.
#[derive(Debug)]
pub struct Usb {
    /// Its full name as soon as it was found: another one that is plugged in meanwhile is another one.
    name: Name,
    /// Whether it has been there: then it may take a while to come back.
    was_there: bool,
}

impl Usb {
    /// The one of that name.
    pub fn new(name: Name) -> Self {
        Self { name, was_there: false }
    }

    fn look(&mut self) -> Result<(Found, DfuInterface), LinkError> {
        let found = found::one(&self.name, |found| found.dfu.is_some())?;
        if let Some(trouble) = found.trouble {
            return Err(trouble);
        }
        self.name = found.full_name().clone();
        self.was_there = true;
        let dfu = found.dfu.ok_or(LinkError::Gone)?;
        Ok((found, dfu))
    }

    /// Looks until `enough` of what is there and how long it has been there as it is, for `within` at most.
    fn look_until(
        &mut self,
        within: Duration,
        enough: impl Fn(DfuInterface, Duration) -> bool,
    ) -> Result<(Found, DfuInterface), LinkError> {
        let begun = Instant::now();
        let mut last: Option<(bool, Instant)> = None;
        loop {
            match self.look() {
                Ok((found, dfu)) => {
                    let (was_loader, since) = *last.get_or_insert((dfu.is_loader, Instant::now()));
                    if was_loader != dfu.is_loader {
                        last = None;
                    } else if enough(dfu, since.elapsed()) || begun.elapsed() >= within {
                        return Ok((found, dfu));
                    }
                }
                // Until the operating system has set its permissions, also a device that is back may not be opened.
                Err(error) if begun.elapsed() >= within => return Err(error),
                Err(_) => last = None,
            }
            sleep(POLL);
        }
    }

    /// Its loader; an application is asked to make way.
    fn loader(&mut self) -> Result<(Found, DfuInterface), FlashError> {
        let (found, dfu) = if self.was_there { self.look_until(DETACHED_WITHIN, |_, _| true)? } else { self.look()? };
        if dfu.is_loader {
            return Ok((found, dfu));
        }
        let io = Io::open(&found, dfu, 0)?;
        // An application that restarts at once answers neither.
        let _ = io.write_control(REQUEST_TYPE, DETACH, io.descriptor.detach_timeout, &[]);
        if !io.descriptor.will_detach {
            let _ = io.handle.reset();
        }
        drop(io);
        let there = self.look_until(DETACHED_WITHIN, |dfu, since| dfu.is_loader || since >= APPLICATION_STAYS)?;
        if there.1.is_loader { Ok(there) } else { Err(FlashError::StaysInApplication) }
    }
}

/// What runs, or would be started by its loader: its product string ends with it.
fn running(found: &Found) -> Option<Identity> {
    found.product.as_deref().and_then(Identity::at_end_of)
}

impl Device for Usb {
    type Error = UsbError;
    type Io = Io;

    fn running(&mut self) -> Result<Option<Identity>, FlashError> {
        Ok(running(&self.look()?.0))
    }

    fn open(&mut self, takes_any: bool) -> Result<Io, FlashError> {
        let (found, dfu) = self.loader()?;
        Io::open(&found, dfu, takes_any.into())
    }

    fn settled(&mut self) -> Result<Option<Identity>, FlashError> {
        let enough = |dfu: DfuInterface, since| !dfu.is_loader || since >= LOADER_RESTS;
        let (found, dfu) = self.look_until(SETTLED_WITHIN, enough)?;
        match running(&found) {
            None if !dfu.is_loader => Err(FlashError::Device("it has started, and does not tell what it runs".into())),
            running => Ok(running),
        }
    }
}

/// An open DFU interface.
pub struct Io {
    handle: DeviceHandle<Context>,
    interface: u8,
    protocol: DfuProtocol<MemoryLayout>,
    descriptor: FunctionalDescriptor,
}

impl Io {
    fn open(found: &Found, dfu: DfuInterface, setting: u8) -> Result<Self, FlashError> {
        let handle = found.open()?;
        let refused = |error| found::refused(error, &found.name, found.full_name().id);
        handle.claim_interface(dfu.interface).map_err(refused)?;
        if dfu.is_loader {
            handle.set_alternate_setting(dfu.interface, setting).map_err(|error| match error {
                rusb::Error::NotFound | rusb::Error::Pipe => {
                    FlashError::Device(format!("its loader has no alternate setting {setting}, which --force needs"))
                }
                error => refused(error).into(),
            })?;
        }
        let descriptor = found::dfu_descriptor(found.device(), dfu.interface)
            .ok_or_else(|| FlashError::Device("its DFU interface has no functional descriptor".into()))?;
        Ok(Self { handle, interface: dfu.interface, protocol: DfuProtocol::Dfu, descriptor })
    }
}

impl DfuIo for Io {
    type Read = usize;
    type Write = usize;
    type Reset = ();
    type Error = UsbError;
    type MemoryLayout = MemoryLayout;

    fn read_control(&self, kind: u8, request: u8, value: u16, buffer: &mut [u8]) -> Result<usize, UsbError> {
        let kind = kind | LIBUSB_ENDPOINT_IN;
        Ok(self.handle.read_control(kind, request, value, self.interface.into(), buffer, REQUEST)?)
    }

    fn write_control(&self, kind: u8, request: u8, value: u16, buffer: &[u8]) -> Result<usize, UsbError> {
        Ok(self.handle.write_control(kind, request, value, self.interface.into(), buffer, REQUEST)?)
    }

    fn usb_reset(self) -> Result<(), UsbError> {
        // A loader that restarts at a reset is gone before the reset is over; what becomes of it is seen when it is back.
        let _ = self.handle.release_interface(self.interface);
        let _ = self.handle.reset();
        Ok(())
    }

    fn protocol(&self) -> &DfuProtocol<MemoryLayout> {
        &self.protocol
    }

    fn functional_descriptor(&self) -> &FunctionalDescriptor {
        &self.descriptor
    }
}
