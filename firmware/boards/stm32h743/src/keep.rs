//! What outlives a reset, in the backup registers: they need no flash, and last as long as the chip or its battery has power.

use embassy_stm32::pac::{RCC, RTC};
use firmware::fault_log::{Cause, FaultLog, LOG_BYTES};
use protocol::message::Fault;
use protocol::units::Nanos;

/// Register 0: the next start is to go into the loader's download mode.
const DOWNLOAD: usize = 0;
/// Registers from here on: the fault log.
const LOG: usize = 1;

/// "DFU!".
const DOWNLOAD_WANTED: u32 = 0x4446_5521;

/// The chip has 32 registers of four bytes.
const _: () = assert!(LOG_BYTES.is_multiple_of(4) && LOG + LOG_BYTES / 4 <= 32);

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

/// Notes the log.
pub fn keep(log: &FaultLog) {
    for (register, word) in (LOG..).zip(log.to_bytes().as_chunks().0) {
        write(register, u32::from_le_bytes(*word));
    }
}

/// What was noted. Registers that have lost their power are all 0: nothing is known of before, and somebody has switched the device off.
fn kept() -> FaultLog {
    let mut bytes = [0; LOG_BYTES];
    for (register, word) in (LOG..).zip(bytes.as_chunks_mut().0) {
        *word = read(register).to_le_bytes();
    }
    if bytes == [0; LOG_BYTES] { FaultLog::default() } else { FaultLog::from_bytes(&bytes) }
}

/// The controller stopped without a word: a fault that holds from now on.
pub fn stopped() {
    let mut log = kept();
    log.latch(Fault::Watchdog, Cause::LEVEL, Nanos::ZERO);
    keep(&log);
}

/// The log of before this start. A reset by the watchdog is a fault as well.
pub fn faults() -> FaultLog {
    let bitten = RCC.rsr().read().iwdg1rstf();
    RCC.rsr().modify(|w| w.set_rmvf(true));
    if bitten {
        stopped();
    }
    kept()
}
