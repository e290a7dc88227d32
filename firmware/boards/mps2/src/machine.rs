//! The machine: addresses, interrupts, time, and what is measured of it. All of the image's `unsafe` but the executor's is in here.

use core::arch::asm;
use core::cell::{Cell, RefCell};
use core::task::Waker;
use cortex_m::Peripherals;
use cortex_m::peripheral::syst::SystClkSource;
use cortex_m::peripheral::{SCB, SYST};
use cortex_m_rt::{STACK_PAINT_VALUE, exception};
use critical_section::{CriticalSection, Mutex};
use embassy_time_driver::Driver;
use embassy_time_queue_utils::Queue;
use firmware::frame_store::{Codebook, Memory};
use firmware::lockstep::Gauge;

/// Processor and peripheral clock, MHz.
const CLOCK_MHZ: u32 = 25;
/// SysTick's period, µs. An alarm is late by that at most: tasks here wait for the host, not for microseconds.
const PERIOD_US: u32 = 1_000;

/// A 32-bit register.
pub struct Register(usize);

impl Register {
    /// At `address`, which must be a register of this machine.
    pub const fn at(address: usize) -> Self {
        Self(address)
    }

    pub fn read(&self) -> u32 {
        // SAFETY: a register of this machine, aligned; see `at`. Reads of it do nothing to memory.
        unsafe { (self.0 as *const u32).read_volatile() }
    }

    pub fn write(&self, value: u32) {
        // SAFETY: as above.
        unsafe { (self.0 as *mut u32).write_volatile(value) }
    }
}

/// An interrupt that has a handler here.
#[derive(Clone, Copy)]
#[repr(u16)]
pub enum Interrupt {
    HostReceived = 0,
    HostSent = 1,
    Ethernet = 13,
}

// SAFETY: numbers of this machine.
unsafe impl cortex_m::interrupt::InterruptNumber for Interrupt {
    fn number(self) -> u16 {
        self as u16
    }
}

type Handler = unsafe extern "C" fn();

/// What the vector table has after the processor's own exceptions.
#[unsafe(link_section = ".vector_table.interrupts")]
#[unsafe(no_mangle)]
#[used]
static __INTERRUPTS: [Handler; 14] = {
    let mut handlers: [Handler; 14] = [DefaultHandler; 14];
    handlers[Interrupt::HostReceived as usize] = host_interrupt;
    handlers[Interrupt::HostSent as usize] = host_interrupt;
    handlers[Interrupt::Ethernet as usize] = world_interrupt;
    handlers
};

unsafe extern "C" {
    fn DefaultHandler();
}

extern "C" fn host_interrupt() {
    crate::HOST.interrupted();
}

extern "C" fn world_interrupt() {
    crate::WORLD.interrupted();
}

/// Starts clocks, and lets interrupts in.
pub fn start(peripherals: Peripherals) {
    let mut tick = peripherals.SYST;
    tick.set_clock_source(SystClkSource::Core);
    tick.set_reload(CLOCK_MHZ * PERIOD_US - 1);
    tick.clear_current();
    tick.enable_counter();
    tick.enable_interrupt();
    COUNTER_RELOAD.write(u32::MAX);
    COUNTER_VALUE.write(u32::MAX);
    COUNTER_CONTROL.write(1);
    for interrupt in [Interrupt::HostReceived, Interrupt::HostSent, Interrupt::Ethernet] {
        // SAFETY: no critical section is made of masking these.
        unsafe { cortex_m::peripheral::NVIC::unmask(interrupt) };
    }
}

/// Time for tasks, µs since the start.
struct Ticks {
    periods: Mutex<Cell<u64>>,
    queue: Mutex<RefCell<Queue>>,
}

embassy_time_driver::time_driver_impl!(static TICKS: Ticks = Ticks {
    periods: Mutex::new(Cell::new(0)),
    queue: Mutex::new(RefCell::new(Queue::new())),
});

impl Ticks {
    fn micros(&self, cs: CriticalSection<'_>) -> u64 {
        let mut periods = self.periods.borrow(cs).get();
        let mut left = SYST::get_current();
        // The counter may have begun anew without its interrupt having run.
        if SCB::is_pendst_pending() {
            periods += 1;
            left = SYST::get_current();
        }
        periods * u64::from(PERIOD_US) + u64::from((CLOCK_MHZ * PERIOD_US - 1).wrapping_sub(left) / CLOCK_MHZ)
    }

    fn wake(&self, cs: CriticalSection<'_>) {
        if let Ok(mut queue) = self.queue.borrow(cs).try_borrow_mut() {
            queue.next_expiration(self.micros(cs));
        }
    }
}

impl Driver for Ticks {
    fn now(&self) -> u64 {
        critical_section::with(|cs| self.micros(cs))
    }

    fn schedule_wake(&self, at: u64, waker: &Waker) {
        critical_section::with(|cs| {
            if let Ok(mut queue) = self.queue.borrow(cs).try_borrow_mut() {
                queue.schedule_wake(at, waker);
            }
        });
    }
}

#[exception]
fn SysTick() {
    critical_section::with(|cs| {
        let periods = TICKS.periods.borrow(cs);
        periods.set(periods.get() + 1);
        TICKS.wake(cs);
    });
}

/// The CMSDK timer 0: 32 bits, down, at the processor's clock.
const COUNTER_CONTROL: Register = Register::at(0x4000_0000);
const COUNTER_VALUE: Register = Register::at(0x4000_0004);
const COUNTER_RELOAD: Register = Register::at(0x4000_0008);

/// What the machine measures around a controller.
pub struct Machine {
    /// Counter ticks that an empty measurement takes.
    empty: u32,
}

impl Machine {
    /// Calibrates itself; after [`start`].
    pub fn new() -> Self {
        let mut machine = Self { empty: 0 };
        (_, machine.empty) = machine.count(|| ());
        machine
    }
}

impl Gauge for Machine {
    /// Ticks of 40 ns. The emulator makes an instruction last a constant time, so that they count instructions. Interrupts wait meanwhile.
    fn count<T>(&mut self, step: impl FnOnce() -> T) -> (T, u32) {
        critical_section::with(|_| {
            let before = COUNTER_VALUE.read();
            let result = step();
            (result, before.wrapping_sub(COUNTER_VALUE.read()).saturating_sub(self.empty))
        })
    }

    fn thousand(&mut self) -> u32 {
        // SAFETY: counts a register down.
        let loops = || unsafe { asm!("movw {0}, #499", "2:", "subs {0}, #1", "bne 2b", "nop", out(reg) _) };
        self.count(loops).1
    }

    fn stack_bytes(&self) -> u32 {
        unsafe extern "C" {
            static _stack_start: u32;
            static _stack_end: u32;
        }
        let (top, end) = (&raw const _stack_start, &raw const _stack_end);
        let mut deepest = end;
        // SAFETY: the linker's own bounds of the stack, which the reset handler painted from `end` up to its own frame; the value is
        // read as memory, whatever the compiler keeps there.
        while deepest < top && unsafe { deepest.read_volatile() } == STACK_PAINT_VALUE {
            deepest = deepest.wrapping_add(1);
        }
        (top as usize - deepest as usize) as u32
    }
}

/// The machine's second memory, where planes live, and before them what they are compressed by. There is one: whoever makes another
/// shares it.
#[derive(Debug)]
pub struct Psram;

impl Psram {
    const BOOK: *mut Codebook = 0x2100_0000 as *mut Codebook;
    const BASE: *mut u8 = (0x2100_0000 + Self::BOOK_BYTES) as *mut u8;
    const BOOK_BYTES: usize = 128 << 10;
    const BYTES: usize = (16 << 20) - Self::BOOK_BYTES;
}

const _: () = assert!(size_of::<Codebook>() <= Psram::BOOK_BYTES);

impl Default for Psram {
    fn default() -> Self {
        let mut psram = Self;
        psram.parts().1.forget();
        psram
    }
}

impl Memory for Psram {
    fn make_room(&mut self, bytes: usize) -> bool {
        bytes <= Self::BYTES
    }

    fn bytes(&self) -> &[u8] {
        // SAFETY: memory of this machine, bytes whatever they are, that no linker knows of; the only frame store is the session's.
        unsafe { core::slice::from_raw_parts(Self::BASE, Self::BYTES) }
    }

    fn parts(&mut self) -> (&mut [u8], &mut Codebook) {
        // SAFETY: as above, and borrowed for as long as the store that is asked; the two lie apart. The emulator gives out memory full of
        // zeros, which is an empty codebook.
        unsafe { (core::slice::from_raw_parts_mut(Self::BASE, Self::BYTES), &mut *Self::BOOK) }
    }
}
