//! The lines between controller and machine: what the control task owns.

use crate::events::EVENTS;
use core::num::NonZeroU32;
use embassy_futures::select::{Either3, select3};
use embassy_stm32::exti::ExtiInput;
use embassy_stm32::gpio::Output;

use embassy_stm32::interrupt::{self, InterruptExt};
use embassy_stm32::mode::{Async, Blocking};
use embassy_stm32::pac::{GPIOE, TIM2, TIM5, timer::vals::FilterValue};
use embassy_stm32::peripherals::{TIM1, TIM2 as Time, TIM5 as Encoder, TIM6 as Tick};
use embassy_stm32::spi::{self, Spi, mode::Master};
use embassy_stm32::time::Hertz;
use embassy_stm32::timer::input_capture::CapturePin;
use embassy_stm32::timer::low_level::{InputCaptureMode, InputTISelection, RoundTo, Timer};
use embassy_stm32::timer::qei::Qei;
use embassy_stm32::timer::simple_pwm::SimplePwm;
use embassy_stm32::timer::{Ch1, Ch2, Ch3, Channel};
use firmware::controller;
use firmware::drive::Demand;
use firmware::port_store::{Port, arm_word};
use firmware::safety::Levels;
use firmware::station::Event;

/// A port to the frame store.
pub struct SerialPort {
    /// Clock and data.
    pub spi: Spi<'static, Blocking, Master>,
    /// Low while bytes are meant for the store.
    pub select: Output<'static>,
}

impl Port for SerialPort {
    type Error = spi::Error;

    fn exchange(&mut self, head: &[u8], bytes: &[u8], answer: &mut [u8]) -> Result<(), spi::Error> {
        self.select.set_low();
        let done = self.spi.blocking_write(head).and_then(|()| self.spi.blocking_write(bytes));
        let done = done.and_then(|()| self.spi.blocking_read(answer));
        self.select.set_high();
        done
    }
}

/// The machine.
pub struct Machine {
    /// High: the drive may make torque (safe-torque-off is released).
    pub torque: Output<'static>,
    /// High: the projector's light may be on.
    pub light: Output<'static>,
    /// High: torque counter-clockwise.
    pub direction: Output<'static>,
    /// How much torque.
    pub width: SimplePwm<'static, TIM1>,
    /// High: the emergency stop's loop is closed.
    pub stop: ExtiInput<'static, Async>,
    /// High: the guard's loop is closed.
    pub guard: ExtiInput<'static, Async>,
    /// Armed frames.
    pub arm: SerialPort,
    /// The encoder's counter.
    #[expect(dead_code, reason = "counts for as long as it is kept")]
    pub encoder: Qei<'static, Encoder>,
    /// The time base, which captures edges.
    pub time: Timer<'static, Time>,
    /// Index, frame, plane.
    #[expect(dead_code, reason = "inputs for as long as they are kept")]
    pub edges: (CapturePin<'static, Time, Ch1>, CapturePin<'static, Time, Ch2>, CapturePin<'static, Time, Ch3>),
    /// The control timer.
    pub tick: Timer<'static, Tick>,
}

impl Machine {
    /// Whether torque and light are low at the pins themselves, as they are driven before [`start`](Self::start).
    pub fn is_safe(&self) -> bool {
        let levels = GPIOE.idr().read();
        ![8, 9, 10, 12].into_iter().any(|pin| levels.idr(pin) == embassy_stm32::pac::gpio::vals::Idr::HIGH)
    }

    /// Starts clocks, captures and ticks. From now on [`next`](Self::next) must be called.
    pub fn start(&mut self, control_rate: Hertz) {
        // The driver of the encoder sets the lower half only.
        TIM5.arr().write_value(u32::MAX);
        TIM2.arr().write_value(u32::MAX);
        self.time.generate_update_event();
        for channel in [Channel::Ch1, Channel::Ch2, Channel::Ch3] {
            self.time.set_input_ti_selection(channel, InputTISelection::Normal);
            // Eight samples at 200 MHz: what is shorter than 40 ns is no pulse, and all edges are late by the same 40 ns.
            self.time.set_input_capture_filter(channel, FilterValue::FCK_INT_N8);
            self.time.set_input_capture_mode(channel, InputCaptureMode::Rising);
            self.time.enable_channel(channel, true);
            self.time.enable_input_interrupt(channel, true);
        }
        self.time.start();
        self.tick.set_frequency(control_rate, RoundTo::Slower);
        self.tick.enable_update_interrupt(true);
        self.tick.start();
        self.width.ch1().enable();
        for interrupt in [interrupt::TIM2, interrupt::TIM6_DAC] {
            // SAFETY: no critical section is open, and what the handlers use lives for ever.
            unsafe { interrupt.enable() };
        }
    }

    /// How fast the time base counts.
    pub fn time_rate(&self) -> NonZeroU32 {
        NonZeroU32::new(self.time.get_clock_frequency().0).unwrap_or(NonZeroU32::MIN)
    }

    /// The next event and its count of the time base. `None`: a safety input changed.
    pub async fn next(&mut self) -> (u32, Option<Event>) {
        match select3(EVENTS.receive(), self.stop.wait_for_any_edge(), self.guard.wait_for_any_edge()).await {
            Either3::First((count, event)) => (count, Some(event)),
            Either3::Second(()) | Either3::Third(()) => (TIM2.cnt().read(), None),
        }
    }

    /// Both loops are closed while all is well, so that a broken wire is an open loop.
    pub fn levels(&self) -> Levels {
        Levels { emergency_stop: self.stop.is_low(), guard_open: self.guard.is_low() }
    }

    /// Does what the controller wants; `torque_max_nm` is what the drive gives at full width.
    pub fn obey(&mut self, output: &controller::Output, torque_max_nm: f32) {
        let driven = output.state.may_drive();
        self.light.set_level(output.light.into());
        let mut width = self.width.ch1();
        let full = width.max_duty_cycle().min(u16::MAX.into()) as u16;
        let demand = if driven { Demand::of(output.torque_nm, torque_max_nm, full) } else { Demand::default() };
        self.direction.set_level(demand.counter_clockwise.into());
        width.set_duty_cycle(demand.width.into());
        self.torque.set_level(driven.into());
        if let Some(frame) = output.armed {
            // A frame that does not arrive is a dark one.
            let _ = self.arm.exchange(&arm_word(frame), &[], &mut []);
        }
    }
}
