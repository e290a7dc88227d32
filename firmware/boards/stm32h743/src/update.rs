//! Two slots and what passes between application and loader.

use crate::layout::{DOWNLOAD, Part, STATE};
use core::cell::RefCell;
use embassy_embedded_hal::flash::partition::BlockingPartition;
use embassy_stm32::flash::{Blocking, Flash};
use embassy_stm32::pac::RTC;
use embassy_sync::blocking_mutex::Mutex;
use embassy_sync::blocking_mutex::raw::NoopRawMutex;

/// The chip's flash, shared by its parts.
pub type SharedFlash = Mutex<NoopRawMutex, RefCell<Flash<'static, Blocking>>>;
/// One of its parts.
pub type Slot<'a> = BlockingPartition<'a, NoopRawMutex, Flash<'static, Blocking>>;

/// `part` of `flash`.
pub fn slot<'a>(flash: &'a SharedFlash, part: &Part) -> Slot<'a> {
    BlockingPartition::new(flash, part.offset, part.size)
}

/// Where downloads go, and the state of the swap.
pub fn download_and_state(flash: &SharedFlash) -> (Slot<'_>, Slot<'_>) {
    (slot(flash, &DOWNLOAD), slot(flash, &STATE))
}

/// "DFU!" in a backup register survives a reset and no loss of power: whoever pulls the plug gets the application back.
const DOWNLOAD_WANTED: u32 = 0x4446_5521;

/// The next start goes into the loader's download mode. No flash is written, so that nothing can be torn.
pub fn want_download() {
    RTC.bkpr(0).write(|w| w.set_bkp(DOWNLOAD_WANTED));
}

/// Whether [`want_download`] was called before this start; only once.
pub fn take_download_wanted() -> bool {
    let wanted = RTC.bkpr(0).read().bkp() == DOWNLOAD_WANTED;
    RTC.bkpr(0).write(|w| w.set_bkp(0));
    wanted
}
