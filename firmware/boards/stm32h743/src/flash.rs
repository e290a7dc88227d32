//! The chip's flash, where a word that a power cut tore is an error and not a fault of the processor.
//!
//! Each word of 32 bytes has its own error-correcting code. One whose programming or erasing was cut off may have two bits wrong, and
//! reading it is answered by a bus error. A loader that died of that would die at each start.

use crate::layout::{ACTIVE, DOWNLOAD, Part, STATE};
use core::arch::asm;
use core::cell::RefCell;
use cortex_m::peripheral::SCB;
use embassy_embedded_hal::flash::partition::BlockingPartition;
use embassy_stm32::flash::{Blocking, Flash, MAX_ERASE_SIZE, WRITE_SIZE};
use embassy_stm32::pac::FLASH;
use embassy_stm32::{Peri, peripherals};
use embassy_sync::blocking_mutex::Mutex;
use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use embedded_storage::nor_flash::{ErrorType, NorFlash, NorFlashError, NorFlashErrorKind, ReadNorFlash};
use protocol::image::{HEADER_BYTES, Header, Identity};
use update::loader::{LoaderError, Slots};

/// Both banks.
pub struct CheckedFlash(Flash<'static, Blocking>);

/// Shared by its parts.
pub type SharedFlash = Mutex<NoopRawMutex, RefCell<CheckedFlash>>;
/// One of its parts.
pub type Slot<'a> = BlockingPartition<'a, NoopRawMutex, CheckedFlash>;

/// `part` of `flash`.
fn slot<'a>(flash: &'a SharedFlash, part: &Part) -> Slot<'a> {
    BlockingPartition::new(flash, part.offset, part.size)
}

/// Both slots of firmware, and the notes on their swap.
pub fn slots(flash: &SharedFlash) -> Result<Slots<Slot<'_>, Slot<'_>, Slot<'_>>, LoaderError> {
    Slots::open(slot(flash, &ACTIVE), slot(flash, &DOWNLOAD), slot(flash, &STATE))
}

/// Which image is in the active slot, whether it is signed or not.
pub fn identity(slots: &mut Slots<Slot<'_>, Slot<'_>, Slot<'_>>) -> Option<Identity> {
    let mut bytes = [0; HEADER_BYTES];
    slots.active.read(0, &mut bytes).ok()?;
    Header::parse(&bytes).ok().map(|header| header.identity())
}

/// All of the chip's flash.
pub fn shared(flash: Peri<'static, peripherals::FLASH>) -> SharedFlash {
    Mutex::new(RefCell::new(CheckedFlash(Flash::new_blocking(flash))))
}

impl ErrorType for CheckedFlash {
    type Error = NorFlashErrorKind;
}

impl ReadNorFlash for CheckedFlash {
    const READ_SIZE: usize = 1;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), NorFlashErrorKind> {
        let banks = [FLASH.bank(0), FLASH.bank(1)];
        banks.iter().for_each(|bank| bank.ccr().write(|w| w.set_clr_dbeccerr(true)));
        unfaulted(|| self.0.blocking_read(offset, bytes)).map_err(|error| error.kind())?;
        let torn = banks.iter().any(|bank| bank.sr().read().dbeccerr());
        if torn { Err(NorFlashErrorKind::Other) } else { Ok(()) }
    }

    fn capacity(&self) -> usize {
        self.0.capacity()
    }
}

impl NorFlash for CheckedFlash {
    const WRITE_SIZE: usize = WRITE_SIZE;
    const ERASE_SIZE: usize = MAX_ERASE_SIZE;

    fn erase(&mut self, from: u32, to: u32) -> Result<(), NorFlashErrorKind> {
        self.0.blocking_erase(from, to).map_err(|error| error.kind())
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), NorFlashErrorKind> {
        self.0.blocking_write(offset, bytes).map_err(|error| error.kind())
    }
}

/// CCR's BFHFNMIGN: at the priority of FAULTMASK a load that is answered by a bus error gives whatever it gives, and no fault.
const IGNORE_BUS_FAULTS: u32 = 1 << 8;

/// `read` with no interrupt but the non-maskable one, and without faults of the bus.
fn unfaulted<R>(read: impl FnOnce() -> R) -> R {
    // SAFETY: a register of the core; one bit of it is set here and put back below, with no other code running in between.
    let control = unsafe { &(*SCB::PTR).ccr };
    let before = control.read();
    // SAFETY: as above. The barriers keep loads on their side of the mask.
    unsafe {
        asm!("cpsid f");
        control.write(before | IGNORE_BUS_FAULTS);
        asm!("dsb", "isb");
    }
    let result = read();
    // SAFETY: as above.
    unsafe {
        asm!("dsb", "isb");
        control.write(before);
        asm!("cpsie f");
    }
    result
}
