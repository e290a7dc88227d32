//! A controller's firmware update over USB: the requests of DFU 1.1, in front of the boot loader's own code and a flash in memory.
//! They come by `dfu-core`'s trait, without a bus, or from the [simulated USB device](crate::usb::board).

use crate::flash::{Chip, Region};
use dfu_core::functional_descriptor::FunctionalDescriptor;
use dfu_core::memory_layout::MemoryLayout;
use dfu_core::{DfuIo, DfuProtocol, State, Status};
use protocol::image::Identity;
use std::cell::RefCell;
use std::rc::Rc;
use thiserror::Error;
use update::image::Refusal;
use update::loader::{Decision, LoaderError, Slots};
use update::stm32h743;
use update::updater::Transfer;

pub use update::image::Owner;
pub use update::updater::Accept;

const WORD: usize = 32;
const SECTOR: usize = stm32h743::SECTOR as usize;
/// Sectors of the two slots and the notes, as on that board.
const SECTORS: [usize; 3] = [sectors(stm32h743::ACTIVE), sectors(stm32h743::DOWNLOAD), sectors(stm32h743::STATE)];
/// Bytes of a block.
pub const BLOCK_BYTES: u16 = 1024;
/// What it can do (DFU 1.1, section 4.1.3).
pub const DESCRIPTOR: FunctionalDescriptor = FunctionalDescriptor {
    can_download: true,
    can_upload: false,
    manifestation_tolerant: false,
    will_detach: false,
    detach_timeout: 0,
    transfer_size: BLOCK_BYTES,
    dfu_version: (1, 0x10),
};

// Requests (chapter 3).
const DNLOAD: u8 = 1;
const GETSTATUS: u8 = 3;
const CLRSTATUS: u8 = 4;
const GETSTATE: u8 = 5;
const ABORT: u8 = 6;

type Part = Region<WORD, SECTOR>;

const fn sectors(part: stm32h743::Part) -> usize {
    part.size as usize / SECTOR
}

/// Why a request fails.
#[derive(Debug, Error)]
pub enum UsbError {
    /// The device answers nothing.
    #[error("the device went away")]
    Gone,
    /// The device refuses the request.
    #[error("the device stalled a request")]
    Stalled,
    /// What `dfu-core` says.
    #[error(transparent)]
    Dfu(#[from] dfu_core::Error),
    /// What the image's reader says.
    #[error(transparent)]
    Io(#[from] std::io::Error),
}

/// What goes wrong with a block.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fault {
    /// The request is refused.
    Stall,
    /// The block arrives with the next one's number.
    WrongNumber,
    /// A bit of it has changed.
    FlippedBit,
    /// The device loses power.
    PowerCut,
}

/// A controller on the bench, which any number of [`Port`]s lead to.
#[derive(Clone, Debug)]
pub struct Controller(Rc<RefCell<Board>>);

#[derive(Debug)]
struct Board {
    chip: Rc<RefCell<Chip<WORD, SECTOR>>>,
    owner: Owner,
    passes_its_test: bool,
    fault: Option<(u32, Fault)>,
    is_gone: bool,
    slots: Option<Slots<Part, Part, Part>>,
    decision: Option<Decision>,
    accept: Accept,
    transfer: Option<Transfer>,
    blocks: u32,
    state: State,
    status: Status,
}

impl Controller {
    /// A blank one, which takes images of its owner's.
    pub fn new(owner: Owner) -> Self {
        let chip = Rc::new(RefCell::new(Chip::blank(SECTORS.iter().sum(), 1)));
        let board = Board {
            chip,
            owner,
            passes_its_test: true,
            fault: None,
            is_gone: true,
            slots: None,
            decision: None,
            accept: Accept::Newer,
            transfer: None,
            blocks: 0,
            state: State::DfuIdle,
            status: Status::Ok,
        };
        Self(Rc::new(RefCell::new(board)))
    }

    /// Something goes wrong with the block of this number, counted from 0, once.
    pub fn break_at(&self, block: u32, fault: Fault) {
        self.0.borrow_mut().fault = Some((block, fault));
    }

    /// Whether images that run on trial from now on pass their test.
    pub fn set_test(&self, passes: bool) {
        self.0.borrow_mut().passes_its_test = passes;
    }

    /// What runs.
    pub fn decision(&self) -> Option<Decision> {
        self.0.borrow().decision
    }

    /// The image that runs, which a device's product string ends with.
    pub fn identity(&self) -> Option<Identity> {
        match self.decision()? {
            Decision::Run(header) | Decision::Try(header, _) => Some(header.identity()),
            Decision::Wait(_) => None,
        }
    }

    /// Plugs it in, switched on again where power had failed. The alternate setting decides which versions it `accept`s.
    pub fn open(&self, accept: Accept) -> Result<Port, LoaderError> {
        if self.is_gone() {
            self.start()?;
        }
        self.accept(accept);
        Ok(Port { controller: self.clone(), protocol: DfuProtocol::Dfu, descriptor: DESCRIPTOR })
    }

    /// Switches it on, or off and on again.
    pub fn start(&self) -> Result<(), LoaderError> {
        self.0.borrow_mut().start()
    }

    /// Whether it answers nothing, until it is [started](Self::start).
    pub fn is_gone(&self) -> bool {
        self.0.borrow().is_gone
    }

    /// Chooses which versions are taken.
    pub fn accept(&self, accept: Accept) {
        self.0.borrow_mut().accept = accept;
    }

    /// The host resets the bus: a controller that has an image whole starts anew.
    pub fn reset(&self) {
        let mut board = self.0.borrow_mut();
        board.is_gone |= matches!(board.state, State::DfuManifestSync | State::DfuManifest);
    }

    /// A request of DFU 1.1 (chapter 3), with wValue and what comes with it: what is answered.
    pub fn request(&self, request: u8, value: u16, bytes: &[u8]) -> Result<Vec<u8>, UsbError> {
        let mut board = self.0.borrow_mut();
        if board.is_gone {
            return Err(UsbError::Gone);
        }
        match request {
            DNLOAD => board.download(value, bytes).map(|()| Vec::new()),
            GETSTATUS => Ok(board.report().to_vec()),
            GETSTATE => Ok(vec![board.state.into()]),
            CLRSTATUS | ABORT => {
                (board.state, board.status, board.transfer, board.blocks) = (State::DfuIdle, Status::Ok, None, 0);
                Ok(Vec::new())
            }
            _ => {
                board.fail(Status::ErrStalledpkt);
                Err(UsbError::Stalled)
            }
        }
    }
}

impl Board {
    /// The boot loader, then the image's test of itself, until all is at rest.
    fn start(&mut self) -> Result<(), LoaderError> {
        loop {
            self.chip.borrow_mut().power_on();
            let [active, spare, notes] = Region::split(&self.chip, SECTORS);
            let mut slots = Slots::open(active, spare, notes)?;
            let decision = slots.boot(&self.owner)?;
            self.decision = Some(decision);
            match decision {
                Decision::Try(..) if !self.passes_its_test => slots.give_up()?,
                Decision::Try(..) => slots.confirm()?,
                Decision::Run(_) | Decision::Wait(_) => {
                    self.slots = Some(slots);
                    (self.is_gone, self.state, self.status) = (false, State::DfuIdle, Status::Ok);
                    (self.transfer, self.blocks) = (None, 0);
                    return Ok(());
                }
            }
        }
    }

    fn fail(&mut self, status: Status) {
        (self.state, self.status, self.transfer) = (State::DfuError, status, None);
    }

    fn download(&mut self, number: u16, block: &[u8]) -> Result<(), UsbError> {
        if !matches!(self.state, State::DfuIdle | State::DfuDnloadIdle) {
            self.fail(Status::ErrStalledpkt);
            return Err(UsbError::Stalled);
        }
        let (mut number, mut block) = (number, block.to_vec());
        let now = self.blocks;
        match self.fault.take_if(|(at, _)| *at == now) {
            Some((_, Fault::Stall)) => {
                self.fail(Status::ErrStalledpkt);
                return Err(UsbError::Stalled);
            }
            Some((_, Fault::PowerCut)) => {
                self.is_gone = true;
                return Err(UsbError::Gone);
            }
            Some((_, Fault::WrongNumber)) => number = number.wrapping_add(1),
            Some((_, Fault::FlippedBit)) => block.iter_mut().take(1).for_each(|byte| *byte ^= 1),
            None => {}
        }
        if block.is_empty() {
            self.state = State::DfuManifestSync;
            return Ok(());
        }
        if u32::from(number) != self.blocks & 0xFFFF {
            self.fail(Status::ErrAddress);
            return Ok(());
        }
        let (owner, accept) = (self.owner, self.accept);
        let transfer = self.transfer.get_or_insert_with(|| Transfer::new(owner, accept));
        let Some(slots) = &mut self.slots else { return Err(UsbError::Gone) };
        match transfer.take(slots, &block) {
            Ok(()) => {
                self.blocks += 1;
                self.state = State::DfuDnloadSync;
            }
            Err(refusal) => self.fail(status(&refusal)),
        }
        Ok(())
    }

    /// What GETSTATUS moves on, and its six bytes.
    fn report(&mut self) -> [u8; 6] {
        match self.state {
            State::DfuDnloadSync => self.state = State::DfuDnloadIdle,
            State::DfuManifestSync => match (self.transfer.take(), &mut self.slots) {
                (Some(transfer), Some(slots)) => match transfer.finish(slots) {
                    Ok(_) => self.state = State::DfuManifest,
                    Err(refusal) => self.fail(status(&refusal)),
                },
                _ => self.fail(Status::ErrNotdone),
            },
            _ => {}
        }
        [self.status.into(), 0, 0, 0, self.state.into(), 0]
    }
}

/// As DFU 1.1 names it (section 6.1.2), and the board's loader.
fn status(refusal: &Refusal) -> Status {
    match refusal {
        Refusal::Image(_) | Refusal::Size { .. } => Status::ErrFile,
        Refusal::Board { .. } | Refusal::Version { .. } => Status::ErrTarget,
        Refusal::Flash(_) => Status::ErrWrite,
        Refusal::Signature => Status::ErrVerify,
        Refusal::OnTrial => Status::ErrFirmware,
        Refusal::Order { .. } => Status::ErrAddress,
    }
}

/// A way to a [`Controller`] that is plugged in.
pub struct Port {
    controller: Controller,
    protocol: DfuProtocol<MemoryLayout>,
    descriptor: FunctionalDescriptor,
}

impl DfuIo for Port {
    type Read = usize;
    type Write = usize;
    type Reset = ();
    type Error = UsbError;
    type MemoryLayout = MemoryLayout;

    fn read_control(&self, _: u8, request: u8, value: u16, buffer: &mut [u8]) -> Result<usize, UsbError> {
        let answer = self.controller.request(request, value, &[])?;
        let count = answer.len().min(buffer.len());
        buffer[..count].copy_from_slice(&answer[..count]);
        Ok(count)
    }

    fn write_control(&self, _: u8, request: u8, value: u16, buffer: &[u8]) -> Result<usize, UsbError> {
        self.controller.request(request, value, buffer)?;
        Ok(buffer.len())
    }

    fn usb_reset(self) -> Result<(), UsbError> {
        self.controller.reset();
        Ok(())
    }

    fn protocol(&self) -> &DfuProtocol<MemoryLayout> {
        &self.protocol
    }

    fn functional_descriptor(&self) -> &FunctionalDescriptor {
        &self.descriptor
    }
}
