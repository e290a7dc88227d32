//! Torque and light off, whatever else is broken: by registers alone, from panics and processor faults.

use core::sync::atomic::{Ordering, compiler_fence};
use cortex_m_rt::{ExceptionFrame, exception};
use embassy_stm32::pac::GPIOE;

/// Pins of port E: torque enable, light, and the drive's demand (direction and width).
const OFF: [usize; 4] = [10, 12, 8, 9];

/// Drives the four lines low, notes that the controller stopped, and resets. After the reset the pins are inputs, and the board's resistors hold the lines low.
pub fn halt() -> ! {
    GPIOE.bsrr().write(|w| OFF.into_iter().for_each(|pin| w.set_br(pin, true)));
    for pin in OFF {
        GPIOE.moder().modify(|w| w.set_moder(pin, embassy_stm32::pac::gpio::vals::Moder::OUTPUT));
    }
    crate::keep::stopped();
    compiler_fence(Ordering::SeqCst);
    cortex_m::peripheral::SCB::sys_reset()
}

#[panic_handler]
fn panic(_: &core::panic::PanicInfo<'_>) -> ! {
    halt()
}

// SAFETY: only registers are written, nothing of the interrupted program is touched, and the reset ends it.
#[exception]
unsafe fn HardFault(_: &ExceptionFrame) -> ! {
    halt()
}

// SAFETY: as above.
#[exception]
unsafe fn DefaultHandler(_: i16) -> ! {
    halt()
}
