//! The chip's pins, dealt out. The table in README.md is this file in words.

use crate::machine::{Machine, SerialPort};
use embassy_stm32::exti::{self, ExtiInput};
use embassy_stm32::gpio::{AnyPin, Level, Output, OutputType, Pull, Speed};
use embassy_stm32::interrupt::typelevel::{EXTI0, EXTI1};
use embassy_stm32::peripherals::{FLASH, IWDG1};
use embassy_stm32::spi::{self, Spi};
use embassy_stm32::time::{Hertz, khz, mhz};
use embassy_stm32::timer::input_capture::CapturePin;
use embassy_stm32::timer::low_level::{CountingMode, Timer};
use embassy_stm32::timer::qei::{self, Qei};
use embassy_stm32::timer::simple_pwm::{PwmPin, SimplePwm};
use embassy_stm32::{Peri, Peripherals, bind_interrupts};
use stm32h743::{usb, usb_pins};

bind_interrupts!(struct Interrupts {
    EXTI0 => exti::InterruptHandler<EXTI0>;
    EXTI1 => exti::InterruptHandler<EXTI1>;
});

/// Pulses of the drive's demand a second.
const WIDTH_RATE: Hertz = khz(20);
/// Bits a second to the frame store: planes, and armed frames.
const STORE_RATE: Hertz = mhz(50);
const ARM_RATE: Hertz = mhz(25);

/// Everything, by use.
pub struct Board {
    /// What the control task owns.
    pub machine: Machine,
    /// Planes.
    pub store: SerialPort,
    /// The host.
    pub usb: usb::Pins,
    /// The independent watchdog.
    pub watchdog: Peri<'static, IWDG1>,
    /// Slots of the firmware.
    pub flash: Peri<'static, FLASH>,
}

impl Board {
    /// Outputs are low from the first.
    pub fn new(p: Peripherals) -> Self {
        let low = |pin: Peri<'static, AnyPin>| Output::new(pin, Level::Low, Speed::Medium);
        let (torque, light, direction) = (low(p.PE10.into()), low(p.PE12.into()), low(p.PE8.into()));
        let select = |pin: Peri<'static, AnyPin>| Output::new(pin, Level::High, Speed::VeryHigh);
        let width = PwmPin::new(p.PE9, OutputType::PushPull);
        let machine = Machine {
            torque,
            light,
            direction,
            width: SimplePwm::new(p.TIM1, Some(width), None, None, None, WIDTH_RATE, CountingMode::EdgeAlignedUp),
            stop: ExtiInput::new(p.PD0, p.EXTI0, Pull::Down, Interrupts),
            guard: ExtiInput::new(p.PD1, p.EXTI1, Pull::Down, Interrupts),
            arm: SerialPort {
                spi: Spi::new_blocking_txonly(p.SPI4, p.PE2, p.PE6, at(ARM_RATE)),
                select: select(p.PE4.into()),
            },
            encoder: Qei::new(p.TIM5, p.PA0, p.PA1, qei::Config::default()),
            time: Timer::new(p.TIM2),
            edges: (
                CapturePin::new(p.PA15, Pull::Down),
                CapturePin::new(p.PB3, Pull::Down),
                CapturePin::new(p.PA2, Pull::Down),
            ),
            tick: Timer::new(p.TIM6),
        };
        let store = SerialPort {
            spi: Spi::new_blocking(p.SPI1, p.PG11, p.PD7, p.PG9, at(STORE_RATE)),
            select: select(p.PG10.into()),
        };
        Self { machine, store, usb: usb_pins!(p), watchdog: p.IWDG1, flash: p.FLASH }
    }
}

fn at(rate: Hertz) -> spi::Config {
    let mut config = spi::Config::default();
    config.frequency = rate;
    config
}
