//! The controller as firmware for QEMU's mps2-an386, a Cortex-M4F. Its tasks await and forward; what they forward to is the same core
//! that runs natively.
#![no_std]
#![no_main]

mod ethernet;
mod host;
mod log;
mod machine;
mod uart;

use core::cell::RefCell;
use core::mem::transmute;
use core::sync::atomic::{AtomicBool, Ordering};
use cortex_m_rt::entry;
use critical_section::Mutex;
use embassy_executor::raw::Executor;
use ethernet::Ethernet;
use firmware::lockstep::{self, Answer, FRAME_BYTES_MAX, Request, Session};
use machine::{Machine, Psram};
use uart::Uart;

/// Where the host is.
static HOST: Uart = Uart::at(0x4000_4000);
/// Where the simulated world is.
static WORLD: Ethernet = Ethernet::at(0x4020_0000);
/// The controller.
static SESSION: Mutex<RefCell<Session<Psram>>> = Mutex::new(RefCell::new(Session::new(Psram)));

/// Nobody keeps the controller: `None` is a mistake in here, and no reason to stop.
fn with_session<T>(use_it: impl FnOnce(&mut Session<Psram>) -> T) -> Option<T> {
    critical_section::with(|cs| SESSION.borrow(cs).try_borrow_mut().ok().map(|mut session| use_it(&mut session)))
}

/// The world's end: requests in, answers out.
#[embassy_executor::task]
async fn world(mut machine: Machine) {
    loop {
        WORLD.received().await;
        let frame = WORLD.take::<FRAME_BYTES_MAX>();
        // What cannot be read is not answered: the simulator waits, and gives up.
        let Some((serial, request)) = lockstep::read::<Request<'_>>(&frame) else {
            defmt::warn!("a frame of {} bytes says nothing", frame.len());
            continue;
        };
        let answer: Option<Answer> = with_session(|session| session.answer(&request, &mut machine));
        let mut out = [0; FRAME_BYTES_MAX];
        if let Some(bytes) = answer.and_then(|answer| lockstep::write(serial, &answer, &mut out)) {
            WORLD.send(bytes);
        }
    }
}

static WOKEN: AtomicBool = AtomicBool::new(false);

#[unsafe(export_name = "__pender")]
fn pender(_context: *mut ()) {
    WOKEN.store(true, Ordering::Release);
}

#[entry]
fn main() -> ! {
    log::start();
    // The Ethernet controller's interrupt line is active until it is told otherwise: devices come before interrupts.
    HOST.start();
    WORLD.start();
    if let Some(peripherals) = cortex_m::Peripherals::take() {
        machine::start(peripherals);
    }
    defmt::info!("lockstep version {}", lockstep::VERSION);
    let executor = Executor::new(core::ptr::null_mut());
    // SAFETY: this function never returns, so that what is on its stack lives for ever.
    let executor: &'static Executor = unsafe { transmute(&executor) };
    let spawner = executor.spawner();
    // No task is spawned twice, so that none is refused.
    if let Ok(task) = world(Machine::new()) {
        spawner.spawn(task);
    }
    if let Ok(task) = host::host() {
        spawner.spawn(task);
    }
    loop {
        // SAFETY: called from here only.
        unsafe { executor.poll() };
        // An interrupt that comes in between ends the wait all the same. WFI and not WFE, which the emulator passes over.
        critical_section::with(|_| {
            if !WOKEN.swap(false, Ordering::Acquire) {
                cortex_m::asm::wfi();
            }
        });
    }
}

/// Nobody defines what this calls: were a panic left anywhere in the optimised image, it would not link.
#[panic_handler]
fn panic(_: &core::panic::PanicInfo<'_>) -> ! {
    unsafe extern "C" {
        fn a_panic_is_left_in_the_image() -> !;
    }
    // SAFETY: there is no such function, and no call in what is linked.
    unsafe { a_panic_is_left_in_the_image() }
}
