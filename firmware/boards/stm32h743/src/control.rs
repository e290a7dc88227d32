//! The control task: events in, the core's step, lines out.

use crate::events::{Event, What};
use crate::machine::Machine;
use crate::rig;
use core::cell::Cell;
use embassy_stm32::peripherals::IWDG1;
use embassy_stm32::wdg::IndependentWatchdog;
use embassy_sync::blocking_mutex::Mutex;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::channel::Channel;
use firmware::controller::{Controller, Input, Output};
use firmware::conversation::{Report, Request};
use firmware::plane_store::TurnHandle;
use firmware::safety::Levels;
use firmware::sequencer::Frame;
use firmware::time_base::TimeBase;
use protocol::message::{Fault, State};
use protocol::timing::Rotation;
use protocol::units::Nanos;
use stm32h743::keep;

/// The latest of the controller, for the host.
pub static REPORT: Mutex<CriticalSectionRawMutex, Cell<Option<Report>>> = Mutex::new(Cell::new(None));

/// Slots that may be filled again. Longer than any store has slots.
pub static RELEASED: Channel<CriticalSectionRawMutex, TurnHandle, 8> = Channel::new();

/// Runs for ever.
#[embassy_executor::task]
pub async fn control(mut machine: Machine, controller: Controller, mut watchdog: IndependentWatchdog<'static, IWDG1>) {
    watchdog.unleash();
    let mut control = Control {
        time: TimeBase::new(machine.time_rate()),
        controller,
        levels: Levels::default(),
        matches_host: true,
        state: State::default(),
        fault: keep::latched(),
        on_screen: None,
        turns_shown: 0,
    };
    loop {
        let event = machine.next().await;
        control.take(event, &mut machine);
        if event.is_some_and(|event| matches!(event.what, What::Tick(_))) {
            watchdog.pet();
        }
    }
}

struct Control {
    time: TimeBase,
    controller: Controller,
    levels: Levels,
    /// Whether the controller took the rotation that the host configured last.
    matches_host: bool,
    state: State,
    fault: Option<Fault>,
    on_screen: Option<TurnHandle>,
    turns_shown: u32,
}

impl Control {
    fn take(&mut self, event: Option<Event>, machine: &mut Machine) {
        let now = self.time.advance(event.map_or_else(|| machine.count(), |event| event.count));
        // Looked at with every event: an edge that nobody waited for is seen at the next tick.
        let levels = machine.levels();
        if levels != core::mem::replace(&mut self.levels, levels) {
            self.step(now, Input::Levels(levels), machine);
        }
        if let Some(input) = event.and_then(|event| self.input(event.what)) {
            self.step(now, input, machine);
        }
    }

    /// What the controller is to be told.
    fn input(&mut self, what: What) -> Option<Input> {
        Some(match what {
            What::Tick(encoder_count) => Input::Tick { encoder_count },
            What::Index(count) => Input::IndexPulse { at: self.time.stamp(count) },
            What::Frame(count) => Input::FramePulse { at: self.time.stamp(count) },
            What::Plane(count) => Input::PlanePulse { at: self.time.stamp(count) },
            What::Request(Request::Command(command)) => Input::Command(command),
            What::Request(Request::TurnReady(turn)) if self.matches_host => Input::TurnReady(turn),
            // Cut for another rotation than the controller's: given back unseen.
            What::Request(Request::TurnReady(turn)) => {
                let _ = RELEASED.try_send(turn);
                return None;
            }
            What::Request(Request::Configured(rotation, _)) => {
                self.configure(rotation);
                return None;
            }
        })
    }

    /// Another rotation needs another controller. None is put aside while it drives, or while it holds a fault.
    fn configure(&mut self, rotation: Rotation) {
        if rotation != self.controller.config().rotation && self.state == State::Idle {
            // Its levels are not ours: they are told to the new one with the next event.
            if let Ok(controller) = Controller::new(rig::config(rotation)) {
                (self.controller, self.levels, self.on_screen) = (controller, Levels::default(), None);
            }
        }
        self.matches_host = rotation == self.controller.config().rotation;
    }

    fn step(&mut self, now: Nanos, input: Input, machine: &mut Machine) {
        let output = self.controller.step(now, input);
        machine.obey(&output, self.controller.config().motor.torque_max_nm);
        for turn in output.released.into_iter().flatten() {
            let _ = RELEASED.try_send(turn);
        }
        self.report(&output);
    }

    fn report(&mut self, output: &Output) {
        if output.fault != core::mem::replace(&mut self.fault, output.fault) {
            keep::latch(output.fault);
        }
        self.state = output.state;
        let on_screen = match output.armed {
            Some(Frame::Slices { turn, .. } | Frame::Still { turn, .. }) => Some(turn),
            Some(Frame::Dark) => None,
            None => self.on_screen,
        };
        if on_screen != core::mem::replace(&mut self.on_screen, on_screen) {
            self.turns_shown = self.turns_shown.saturating_add(on_screen.is_some().into());
        }
        let (estimates, slices) = (self.controller.estimates(), self.controller.config().rotation.slices());
        let report = Report::new(output.state, output.fault, &estimates, slices);
        let report = Report { on_screen, turns_shown: self.turns_shown, ..report };
        REPORT.lock(|latest| latest.set(Some(report)));
    }
}
