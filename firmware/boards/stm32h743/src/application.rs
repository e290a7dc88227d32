//! The controller on an STM32H743. Tasks await and forward; what they forward to is the same core that runs in simulation.
#![no_std]
#![no_main]

mod board;
mod control;
mod events;
mod link;
mod machine;
mod rig;

use board::Board;
use embassy_executor::{InterruptExecutor, Spawner};
use embassy_stm32::interrupt;
use embassy_stm32::interrupt::{InterruptExt, Priority};
use embassy_stm32::time::Hertz;
use embassy_stm32::wdg::IndependentWatchdog;
use embassy_stm32::{Peri, peripherals};
use firmware::controller::Controller;
use firmware::hosted::Hosted;
use firmware::station::Station;
use protocol::image::Identity;
use stm32h743::{clocks, flash, halt, keep};

/// A control task that takes no tick for this long is reset: four times what the core's own watchdog allows.
const WATCHDOG_US: u32 = 20_000;

/// Runs the control task, above everything but the interrupts that stamp events.
static CONTROL: InterruptExecutor = InterruptExecutor::new();

/// No serial port is in use: its interrupt is the executor's.
#[interrupt]
fn UART5() {
    // SAFETY: called from the interrupt that the executor was started with, and from nowhere else.
    unsafe { CONTROL.on_interrupt() }
}

#[embassy_executor::main]
async fn main(spawner: Spawner) {
    if let Some(mut core) = cortex_m::Peripherals::take() {
        core.SCB.enable_icache();
    }
    let mut board = Board::new(embassy_stm32::init(clocks::config()));
    // A controller that cannot be is no firmware that may stay: the loader brings the one before back.
    let controller =
        rig::rotation().ok().and_then(|rotation| Controller::after_reset(rig::config(rotation), keep::faults()).ok());
    let Some(controller) = controller.filter(|_| board.machine.is_safe()) else { halt::halt() };
    let identity = confirm(board.flash);
    // Not before: it shortens the loader's at once, and confirming takes seconds.
    let watchdog = IndependentWatchdog::new(board.watchdog, WATCHDOG_US);
    prioritise();
    board.machine.start(Hertz(controller.config().control_rate_hz as u32));
    let (device, receiver, link) = link::open(board.usb, board.store, identity);
    let above = CONTROL.start(interrupt::UART5);
    let hosted = Hosted::new(controller, |rotation| Some(rig::config(rotation)));
    let station = Station::new(hosted, board.machine.time_rate());
    let control = control::control(board.machine, station, watchdog);
    let (bus, answers, reports) = (link::bus(device), link::answers(link, receiver), link::reports(link));
    let (Ok(control), Ok(bus), Ok(answers), Ok(reports)) = (control, bus, answers, reports) else { halt::halt() };
    above.spawn(control);
    spawner.spawn(bus);
    spawner.spawn(answers);
    spawner.spawn(reports);
}

/// Smaller is more urgent. What stamps events may interrupt the control task; nothing else may.
fn prioritise() {
    for (interrupt, priority) in [
        (interrupt::TIM2, Priority::P1),
        (interrupt::TIM6_DAC, Priority::P1),
        (interrupt::EXTI0, Priority::P1),
        (interrupt::EXTI1, Priority::P1),
        (interrupt::UART5, Priority::P2),
        (interrupt::TIM8_BRK_TIM12, Priority::P6),
        (interrupt::OTG_FS, Priority::P7),
        (interrupt::OTG_HS, Priority::P7),
    ] {
        interrupt.set_priority(priority);
    }
}

/// Tells the loader that this firmware, if it is new, may stay, and says which it is. Before the control task runs: writing the notes may take seconds in which
/// nothing else happens.
fn confirm(flash: Peri<'static, peripherals::FLASH>) -> Option<Identity> {
    let flash = flash::shared(flash);
    let Ok(mut slots) = flash::slots(&flash) else { halt::halt() };
    if slots.confirm().is_err() {
        halt::halt();
    }
    flash::identity(&mut slots)
}
