//! What happens, stamped where it happens: interrupts that only read a counter and put it into the controller's queue.

use embassy_stm32::interrupt;
use embassy_stm32::pac::{TIM2, TIM5, TIM6};
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::channel::Channel;
use embassy_time::Timer;
use firmware::conversation::Request;
use firmware::station::Event;

/// An event and the time base's count when it was queued.
pub type Stamped = (u32, Event);

/// Some 3 ms of all pulses together at 240 Hz. A pulse that finds it full is lost, which the controller survives; ticks that are lost
/// stop it by its watchdog.
pub static EVENTS: Channel<CriticalSectionRawMutex, Stamped, 32> = Channel::new();

/// Puts `event` into the queue, if there is room. Stamp and place are given at once, so that the queue is in the order of time.
fn post(event: Event) -> bool {
    critical_section::with(|_| EVENTS.try_send((TIM2.cnt().read(), event)).is_ok())
}

/// Puts `request` into the queue, however long it takes.
pub async fn ask(request: Request) {
    while !post(Event::Request(request)) {
        Timer::after_millis(1).await;
    }
}

/// Edges at the capture inputs.
#[interrupt]
fn TIM2() {
    let flags = TIM2.sr().read();
    // Writing 1 leaves a flag as it is: an edge since the read is not lost.
    TIM2.sr().write(|w| w.0 = !flags.0);
    let captured = |channel: usize| flags.ccif(channel).then(|| TIM2.ccr(channel).read());
    let edges = [captured(0).map(Event::Index), captured(1).map(Event::Frame), captured(2).map(Event::Plane)];
    for edge in edges.into_iter().flatten() {
        post(edge);
    }
}

/// The control tick.
#[interrupt]
fn TIM6_DAC() {
    TIM6.sr().write(|w| w.set_uif(false));
    post(Event::Tick(TIM5.cnt().read()));
}
