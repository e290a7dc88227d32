//! Log lines by defmt, out of the third serial port.

use crate::uart::Uart;
use core::cell::{Cell, UnsafeCell};
use critical_section::RestoreState;
use defmt::{Encoder, Logger};

static PORT: Uart = Uart::at(0x4000_6000);

/// Switches the port on.
pub fn start() {
    PORT.start();
}

#[defmt::global_logger]
struct Log;

/// Belongs to whoever is between `acquire` and `release`, with interrupts off.
struct State {
    encoder: UnsafeCell<Encoder>,
    restore: Cell<Option<RestoreState>>,
}

// SAFETY: one core, and interrupts are off where it is used.
unsafe impl Sync for State {}

static STATE: State = State { encoder: UnsafeCell::new(Encoder::new()), restore: Cell::new(None) };

// SAFETY: the four are called in order by defmt, which nests no log lines.
unsafe impl Logger for Log {
    fn acquire() {
        // SAFETY: released in `release`, with the state that is kept here.
        STATE.restore.set(Some(unsafe { critical_section::acquire() }));
        // SAFETY: interrupts are off, and no other reference lives.
        unsafe { (*STATE.encoder.get()).start_frame(|bytes| PORT.write_now(bytes)) };
    }

    unsafe fn flush() {}

    unsafe fn release() {
        // SAFETY: between `acquire` and here interrupts are off.
        unsafe { (*STATE.encoder.get()).end_frame(|bytes| PORT.write_now(bytes)) };
        if let Some(restore) = STATE.restore.take() {
            // SAFETY: what `acquire` returned.
            unsafe { critical_section::release(restore) };
        }
    }

    unsafe fn write(bytes: &[u8]) {
        // SAFETY: as in `release`.
        unsafe { (*STATE.encoder.get()).write(bytes, |bytes| PORT.write_now(bytes)) };
    }
}
