//! The control task: events in, the core's steps, lines out.

use crate::machine::Machine;
use core::cell::Cell;
use embassy_stm32::peripherals::IWDG1;
use embassy_stm32::wdg::IndependentWatchdog;
use embassy_sync::blocking_mutex::Mutex;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::channel::Channel;
use firmware::conversation::Report;
use firmware::plane_store::TurnHandle;
use firmware::station::{Event, Station};
use protocol::message::Faults;
use stm32h743::keep;

/// The latest of the controller and its faults, for the host.
pub static REPORT: Mutex<CriticalSectionRawMutex, Cell<Option<(Report, Faults)>>> = Mutex::new(Cell::new(None));

/// Slots that may be filled again. Longer than any store has slots.
pub static RELEASED: Channel<CriticalSectionRawMutex, TurnHandle, 8> = Channel::new();

/// Runs for ever.
#[embassy_executor::task]
pub async fn control(mut machine: Machine, mut station: Station, mut watchdog: IndependentWatchdog<'static, IWDG1>) {
    let torque_max_nm = station.hosted().config().motor.torque_max_nm;
    let mut kept = *station.hosted().faults();
    keep::keep(&kept);
    watchdog.unleash();
    loop {
        let (count, event) = machine.next().await;
        station.take(count, event, machine.levels(), |output, faults| {
            // Before it is obeyed: a reset in between must not forget it.
            if core::mem::replace(&mut kept, *faults) != *faults {
                keep::keep(faults);
            }
            machine.obey(output, torque_max_nm);
            for turn in output.released.into_iter().flatten() {
                // There is room: a slot is released once, and taken out before the host fills it again.
                let _ = RELEASED.try_send(turn);
            }
        });
        if matches!(event, Some(Event::Tick(_))) {
            let hosted = station.hosted();
            REPORT.lock(|latest| latest.set(Some((hosted.report(), hosted.faults().faults()))));
            watchdog.pet();
        }
    }
}
