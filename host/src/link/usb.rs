//! A controller at this machine's USB.

use super::{Connect, Link, LinkError};
use bulk::{Bulk, Size, Usb};
pub use found::{DfuInterface, Endpoints, Found, NO_USB, Name, list, udev_rule};
use std::time::{Duration, Instant, SystemTime};

pub(crate) mod found;

/// Transfers to the device: together the 25th of a second of high speed, which a host that is busy elsewhere may take.
const OUTWARD: usize = 4;
/// Bytes of each, a multiple of any packet.
const OUTWARD_BYTES: usize = 512 << 10;
/// Transfers from the device, each of one packet, so that it ends with it: a device may end what it says with a full packet.
const INWARD: usize = 16;

/// Bytes to and from a controller at USB, several transfers of them in flight.
#[derive(Debug)]
pub struct UsbLink {
    bulk: Bulk<Usb>,
    bytes_per_second: Option<f64>,
    opened: Instant,
    /// Since 1970, at `opened`: two links to one device never have the same time.
    epoch: Duration,
}

impl UsbLink {
    /// To the one controller of that name.
    pub fn open(name: &Name) -> Result<Self, LinkError> {
        let found = found::one(name, |found| found.endpoints.is_some())?;
        let Some(Endpoints { interface, outward, inward, packet_bytes }) = found.endpoints else {
            return Err(LinkError::Gone);
        };
        let handle = found.open()?;
        handle.claim_interface(interface).map_err(|error| found::refused(error, &found.name, name.id))?;
        let outward = Size { endpoint: outward, transfers: OUTWARD, bytes: OUTWARD_BYTES };
        let inward = Size { endpoint: inward, transfers: INWARD, bytes: packet_bytes.into() };
        let bulk = Bulk::new(Usb::new(handle), outward, inward).map_err(found::failed)?;
        let epoch = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default();
        Ok(Self { bulk, bytes_per_second: found.bytes_per_second, opened: Instant::now(), epoch })
    }
}

impl Link for UsbLink {
    fn send(&mut self, bytes: &[u8]) -> Result<usize, LinkError> {
        self.bulk.send(bytes).map_err(found::failed)
    }

    fn receive(&mut self, into: &mut Vec<u8>, wait: Duration) -> Result<usize, LinkError> {
        self.bulk.receive(into, wait).map_err(found::failed)
    }

    fn now(&self) -> Duration {
        self.epoch + self.opened.elapsed()
    }

    fn bytes_per_second(&self) -> Option<f64> {
        self.bytes_per_second
    }
}

/// The way to a controller at USB.
#[derive(Clone, Debug, Default)]
pub struct UsbConnect {
    /// Which one.
    pub name: Name,
}

impl Connect for UsbConnect {
    type Link = UsbLink;

    fn connect(&mut self) -> Result<UsbLink, LinkError> {
        UsbLink::open(&self.name)
    }
}
