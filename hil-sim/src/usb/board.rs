//! The board stm32h743 as a host sees it on USB: its application in front of a simulated controller, and its loader in front of a
//! simulated flash.

use super::descriptors::{Descriptors, Interface, PACKET_BYTES};
use super::{Function, Setup};
use crate::device::Endpoint;
use crate::dfu::{Accept, Controller, DESCRIPTOR};
use protocol::image::Identity;
use std::collections::VecDeque;
use update::loader::LoaderError;

/// Vendor and product: those that pid.codes keeps for tests.
pub const ID: (u16, u16) = (0x1209, 0x0001);
/// A host that does not fetch an answer for this long does not get it, seconds.
const FETCHED_WITHIN_S: f64 = 0.1;
/// The bulk interface of the application, and the only one of the loader.
const FIRST: u8 = 0;
/// DFU's interface of the application.
const RUN_TIME: u8 = 1;
/// Class and subclass of DFU, and its two protocols.
const DFU: [u8; 2] = [0xFE, 1];
const PROTOCOL_RUN_TIME: u8 = 1;
const PROTOCOL_LOADER: u8 = 2;
/// bmAttributes of DFU's functional descriptor.
const CAN_DOWNLOAD: u8 = 1;
const CAN_UPLOAD: u8 = 2;
const MANIFESTATION_TOLERANT: u8 = 4;
const WILL_DETACH: u8 = 8;

/// What runs on the board.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mode {
    /// The controller.
    Application,
    /// What waits for an image.
    Loader,
}

/// A board that has `E` as its application.
#[derive(Debug)]
pub struct Board<E> {
    endpoint: E,
    loader: Controller,
    serial: String,
    /// An application runs even where the flash holds no image.
    is_built_in: bool,
    mode: Mode,
    descriptors: Descriptors,
    /// Not while it starts anew.
    is_there: bool,
    /// What was not fetched yet.
    packets: VecDeque<Vec<u8>>,
    unfetched_s: f64,
}

impl<E: Endpoint> Board<E> {
    /// Switched on: what `loader`'s flash holds runs, which is `endpoint` whatever its version. Where it holds no image, the endpoint
    /// runs all the same, as put there by a debug probe.
    pub fn new(endpoint: E, loader: Controller, serial: &str) -> Result<Self, LoaderError> {
        Self::start(endpoint, loader, serial, true)
    }

    /// The same, but a blank one waits for an image.
    pub fn blank(endpoint: E, loader: Controller, serial: &str) -> Result<Self, LoaderError> {
        Self::start(endpoint, loader, serial, false)
    }

    fn start(endpoint: E, loader: Controller, serial: &str, is_built_in: bool) -> Result<Self, LoaderError> {
        let mut board = Self {
            endpoint,
            loader,
            serial: serial.into(),
            is_built_in,
            mode: Mode::Loader,
            descriptors: Descriptors::default(),
            is_there: true,
            packets: VecDeque::new(),
            unfetched_s: 0.0,
        };
        board.restart(false)?;
        Ok(board)
    }

    /// The application.
    pub fn endpoint(&self) -> &E {
        &self.endpoint
    }

    /// The application.
    pub fn endpoint_mut(&mut self) -> &mut E {
        &mut self.endpoint
    }

    /// What runs.
    pub fn mode(&self) -> Mode {
        self.mode
    }

    /// The loader's end, which decides what runs.
    pub fn loader(&self) -> &Controller {
        &self.loader
    }

    /// The boot loader decides what runs; an application that goes may want it to wait.
    fn restart(&mut self, wants_loader: bool) -> Result<(), LoaderError> {
        self.loader.start()?;
        let image = self.loader.identity();
        let runs = image.is_some() || self.is_built_in;
        self.mode = if runs && !wants_loader { Mode::Application } else { Mode::Loader };
        self.descriptors = descriptors(self.mode, image, &self.serial);
        Ok(())
    }

    /// Off the bus, and on again as what runs then.
    fn leave(&mut self, wants_loader: bool) {
        self.is_there = false;
        self.disconnect();
        if self.restart(wants_loader).is_err() {
            // A flash that does not even hold the loader's notes.
            self.mode = Mode::Loader;
        }
    }

    fn disconnect(&mut self) {
        self.packets.clear();
        self.endpoint.lose_link();
    }

    /// What the endpoint has to say, as packets.
    fn fetch(&mut self) {
        self.packets.extend(self.endpoint.transmit().chunks(PACKET_BYTES).map(<[u8]>::to_vec));
        self.unfetched_s = 0.0;
    }

    /// A request of DFU's run-time half: into the loader, but not from a machine that turns.
    fn run_time_request(&mut self, setup: Setup) -> Option<Vec<u8>> {
        const DETACH: u8 = 0;
        const GETSTATUS: u8 = 3;
        const APP_IDLE: u8 = 0;
        if setup.index != u16::from(RUN_TIME) {
            return None;
        }
        match setup.request {
            DETACH if !setup.is_in() => {
                if self.endpoint.is_at_rest() {
                    self.leave(true);
                }
                Some(Vec::new())
            }
            GETSTATUS if setup.is_in() => Some(vec![0, 0, 0, 0, APP_IDLE, 0]),
            _ => None,
        }
    }

    fn loader_request(&mut self, setup: Setup, bytes: &[u8]) -> Option<Vec<u8>> {
        if setup.index != u16::from(FIRST) {
            return None;
        }
        let answer = self.loader.request(setup.request, setup.value, bytes).ok();
        // Its power failed.
        if self.loader.is_gone() {
            self.leave(false);
        }
        answer
    }
}

impl<E: Endpoint> Function for Board<E> {
    fn descriptors(&self) -> &Descriptors {
        &self.descriptors
    }

    fn request(&mut self, setup: Setup, bytes: &[u8]) -> Option<Vec<u8>> {
        const CLASS_OF_INTERFACE: u8 = 0x21;
        match (setup.kind & 0x7F, self.mode) {
            (CLASS_OF_INTERFACE, Mode::Application) => self.run_time_request(setup),
            (CLASS_OF_INTERFACE, Mode::Loader) => self.loader_request(setup, bytes),
            _ => None,
        }
    }

    fn set_interface(&mut self, interface: u8, setting: u8) {
        if (self.mode, interface) == (Mode::Loader, FIRST) {
            self.loader.accept(accept(setting));
        }
    }

    /// Answers go before the next packet is heard.
    fn take(&mut self, bytes: &[u8]) -> usize {
        if self.mode == Mode::Loader || !self.packets.is_empty() { 0 } else { self.endpoint.receive(bytes) }
    }

    fn give(&mut self) -> Option<Vec<u8>> {
        if self.mode == Mode::Loader {
            return None;
        }
        if self.packets.is_empty() {
            self.fetch();
        }
        self.packets.pop_front()
    }

    fn advance(&mut self, seconds: f64) {
        self.endpoint.advance(seconds);
        if self.mode == Mode::Loader {
            return;
        }
        if self.packets.is_empty() {
            self.fetch();
        }
        self.unfetched_s += seconds;
        if self.unfetched_s >= FETCHED_WITHIN_S {
            self.packets.clear();
        }
    }

    fn reset(&mut self) {
        self.disconnect();
        if self.mode == Mode::Loader {
            self.loader.accept(accept(0));
            self.loader.reset();
            if self.loader.is_gone() {
                self.leave(false);
            }
        }
    }

    fn plug(&mut self, is_in: bool) {
        self.is_there = is_in;
        self.disconnect();
        self.loader.accept(accept(0));
    }

    fn is_there(&self) -> bool {
        self.is_there && self.endpoint.plug().is_some()
    }
}

/// What an alternate setting of the loader takes.
fn accept(setting: u8) -> Accept {
    if setting == 0 { Accept::Newer } else { Accept::Any }
}

/// The product string says in which role it is, and which image is in it.
fn descriptors(mode: Mode, image: Option<Identity>, serial: &str) -> Descriptors {
    let (role, interfaces) = match mode {
        Mode::Application => ("controller", vec![bulk(), run_time()]),
        Mode::Loader => ("loader", vec![loader(0), loader(1)]),
    };
    let image = image.map(|image| format!(" {image}")).unwrap_or_default();
    Descriptors {
        vendor: ID.0,
        product: ID.1,
        release: 0x0010,
        manufacturer: "Praxinoscope".into(),
        product_name: format!("Praxinoscope {role}{image}"),
        serial: serial.into(),
        interfaces,
    }
}

fn bulk() -> Interface {
    Interface { number: FIRST, class: [0xFF, 0, 0], has_bulk: true, ..Interface::default() }
}

fn run_time() -> Interface {
    let [class, subclass] = DFU;
    let extra = functional(CAN_DOWNLOAD | WILL_DETACH, 1000, 64);
    Interface { number: RUN_TIME, class: [class, subclass, PROTOCOL_RUN_TIME], extra, ..Interface::default() }
}

fn loader(setting: u8) -> Interface {
    let [class, subclass] = DFU;
    let bits = [
        (DESCRIPTOR.can_download, CAN_DOWNLOAD),
        (DESCRIPTOR.can_upload, CAN_UPLOAD),
        (DESCRIPTOR.manifestation_tolerant, MANIFESTATION_TOLERANT),
        (DESCRIPTOR.will_detach, WILL_DETACH),
    ];
    let attributes = bits.iter().filter(|(has, _)| *has).fold(0, |all, (_, bit)| all | bit);
    let extra = functional(attributes, DESCRIPTOR.detach_timeout, DESCRIPTOR.transfer_size);
    Interface { number: FIRST, setting, class: [class, subclass, PROTOCOL_LOADER], extra, ..Interface::default() }
}

/// DFU 1.1, section 4.1.3.
fn functional(attributes: u8, detach_timeout_ms: u16, transfer_bytes: u16) -> Vec<u8> {
    let [timeout, transfer] = [detach_timeout_ms, transfer_bytes].map(u16::to_le_bytes);
    vec![9, 0x21, attributes, timeout[0], timeout[1], transfer[0], transfer[1], 0x10, 0x01]
}
