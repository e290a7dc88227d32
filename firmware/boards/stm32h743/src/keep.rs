//! What outlives a reset, in the backup registers: they need no flash, and last as long as the chip or its battery has power.

use embassy_stm32::pac::{RCC, RTC};
use protocol::message::Fault;

/// Register 0: the next start is to go into the loader's download mode.
const DOWNLOAD: usize = 0;
/// Register 1: the latched fault's place in [`FAULTS`], plus 1.
const LATCHED: usize = 1;
/// Registers from here on: how often each of [`FAULTS`] has come.
const COUNTS: usize = 2;

/// "DFU!".
const DOWNLOAD_WANTED: u32 = 0x4446_5521;

const FAULTS: [Fault; 8] = [
    Fault::EmergencyStop,
    Fault::GuardOpen,
    Fault::Overspeed,
    Fault::Stall,
    Fault::SensorLost,
    Fault::ProjectorLost,
    Fault::LockTimeout,
    Fault::Watchdog,
];

fn read(register: usize) -> u32 {
    RTC.bkpr(register).read().bkp()
}

fn write(register: usize, value: u32) {
    RTC.bkpr(register).write(|w| w.set_bkp(value));
}

/// The next start goes into the loader's download mode.
pub fn want_download() {
    write(DOWNLOAD, DOWNLOAD_WANTED);
}

/// Whether [`want_download`] was called before this start; only once.
pub fn take_download_wanted() -> bool {
    let wanted = read(DOWNLOAD) == DOWNLOAD_WANTED;
    write(DOWNLOAD, 0);
    wanted
}

/// The fault that is latched now; a new one is counted.
pub fn latch(fault: Option<Fault>) {
    let place = fault.and_then(|fault| FAULTS.iter().position(|&known| known == fault));
    write(LATCHED, place.map_or(0, |place| place as u32 + 1));
    if let Some(place) = place {
        write(COUNTS + place, read(COUNTS + place).saturating_add(1));
    }
}

/// What was latched before this start. A reset by the watchdog is a fault as well; so is a note that cannot be read.
pub fn latched() -> Option<Fault> {
    let bitten = RCC.rsr().read().iwdg1rstf();
    RCC.rsr().modify(|w| w.set_rmvf(true));
    let noted = match read(LATCHED) {
        0 => None,
        code => Some(FAULTS.get(code as usize - 1).copied().unwrap_or(Fault::Watchdog)),
    };
    if bitten && noted.is_none() {
        latch(Some(Fault::Watchdog));
    }
    noted.or(bitten.then_some(Fault::Watchdog))
}
