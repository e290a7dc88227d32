//! The USB device: what loader and application have in common.

use core::fmt::Write;
use embassy_stm32::uid::uid_hex;
use embassy_stm32::usb::{self, Driver};
use embassy_stm32::{Peri, bind_interrupts, peripherals};
use embassy_usb::{Builder, Config};
use heapless::String;
use protocol::image::Identity;
use static_cell::StaticCell;

/// The longest product string: a role, and which image runs. Each of its characters takes two bytes of the control pipe's buffer.
const PRODUCT_CHARACTERS: usize = 80;
/// A control buffer that holds it, with its length and type.
pub const CONTROL_BYTES_MIN: usize = 2 * PRODUCT_CHARACTERS + 4;

#[cfg(not(feature = "high-speed"))]
mod chosen {
    /// Bytes of a bulk packet.
    pub const PACKET_BYTES: u16 = 64;
    /// The chip's own full-speed transceiver.
    pub type Port = embassy_stm32::peripherals::USB_OTG_FS;
}
#[cfg(feature = "high-speed")]
mod chosen {
    /// Bytes of a bulk packet.
    pub const PACKET_BYTES: u16 = 512;
    /// The controller with the ULPI port.
    pub type Port = embassy_stm32::peripherals::USB_OTG_HS;
}
pub use chosen::{PACKET_BYTES, Port};

#[cfg(not(feature = "high-speed"))]
bind_interrupts!(struct Interrupts {
    OTG_FS => usb::InterruptHandler<peripherals::USB_OTG_FS>;
});
#[cfg(feature = "high-speed")]
bind_interrupts!(struct Interrupts {
    OTG_HS => usb::InterruptHandler<peripherals::USB_OTG_HS>;
});

/// The port and its pins.
#[cfg(not(feature = "high-speed"))]
pub struct Pins {
    /// The controller.
    pub port: Peri<'static, Port>,
    /// D+.
    pub plus: Peri<'static, peripherals::PA12>,
    /// D-.
    pub minus: Peri<'static, peripherals::PA11>,
}

/// The port and its pins.
#[cfg(feature = "high-speed")]
pub struct Pins {
    /// The controller.
    pub port: Peri<'static, Port>,
    /// 60 MHz from the PHY.
    pub clock: Peri<'static, peripherals::PA5>,
    /// The PHY drives the data lines.
    pub direction: Peri<'static, peripherals::PC2>,
    /// The PHY takes or gives a byte.
    pub next: Peri<'static, peripherals::PC3>,
    /// The chip ends a packet.
    pub stop: Peri<'static, peripherals::PC0>,
    /// Data 0.
    pub d0: Peri<'static, peripherals::PA3>,
    /// Data 1.
    pub d1: Peri<'static, peripherals::PB0>,
    /// Data 2.
    pub d2: Peri<'static, peripherals::PB1>,
    /// Data 3.
    pub d3: Peri<'static, peripherals::PB10>,
    /// Data 4.
    pub d4: Peri<'static, peripherals::PB11>,
    /// Data 5.
    pub d5: Peri<'static, peripherals::PB12>,
    /// Data 6.
    pub d6: Peri<'static, peripherals::PB13>,
    /// Data 7.
    pub d7: Peri<'static, peripherals::PB5>,
}

/// Takes port and pins out of the chip's peripherals.
#[macro_export]
macro_rules! usb_pins {
    ($p:ident) => {{
        #[cfg(not(feature = "high-speed"))]
        let pins = $crate::usb::Pins { port: $p.USB_OTG_FS, plus: $p.PA12, minus: $p.PA11 };
        #[cfg(feature = "high-speed")]
        let pins = $crate::usb::Pins {
            port: $p.USB_OTG_HS,
            clock: $p.PA5,
            direction: $p.PC2,
            next: $p.PC3,
            stop: $p.PC0,
            d0: $p.PA3,
            d1: $p.PB0,
            d2: $p.PB1,
            d3: $p.PB10,
            d4: $p.PB11,
            d5: $p.PB12,
            d6: $p.PB13,
            d7: $p.PB5,
        };
        pins
    }};
}

/// A device that is still to be given its functions. Its product string says in which `role` it is and which image `runs`, its serial number
/// is the chip's, so that a host knows it again in its other role. `CONTROL` bytes go by the control pipe at once at most. Only to be
/// called once.
pub fn builder<const CONTROL: usize>(
    pins: Pins,
    role: &str,
    runs: Option<Identity>,
    control: &'static StaticCell<[u8; CONTROL]>,
) -> Builder<'static, Driver<'static, Port>> {
    // Endpoint 0 and one bulk endpoint, each with room for its longest packet.
    static OUT: StaticCell<[u8; 1024]> = StaticCell::new();
    static CONFIGURATION: StaticCell<[u8; 128]> = StaticCell::new();
    static BOS: StaticCell<[u8; 32]> = StaticCell::new();
    static PRODUCT: StaticCell<String<PRODUCT_CHARACTERS>> = StaticCell::new();
    const { assert!(CONTROL >= CONTROL_BYTES_MIN) };
    // The bus is powered apart, and the device is no candidate for it: VBUS is not looked at.
    let driver = driver(pins, OUT.init([0; 1024]), usb::Config::default());
    // The identifier that pid.codes keeps for tests, until the project has its own.
    let mut config = Config::new(0x1209, 0x0001);
    config.manufacturer = Some("Praxinoscope");
    config.product = Some(PRODUCT.init_with(|| product(role, runs)));
    config.serial_number = Some(uid_hex());
    config.self_powered = true;
    let (configuration, bos) = (CONFIGURATION.init([0; 128]), BOS.init([0; 32]));
    Builder::new(driver, config, configuration, bos, &mut [], control.init([0; CONTROL]))
}

fn product(role: &str, runs: Option<Identity>) -> String<PRODUCT_CHARACTERS> {
    let mut text = String::new();
    // What has no room is left out: a host then knows less.
    let _ = write!(text, "Praxinoscope {role}");
    if let Some(identity) = runs {
        let _ = write!(text, " {identity}");
    }
    text
}

#[cfg(not(feature = "high-speed"))]
fn driver(pins: Pins, out: &'static mut [u8], config: usb::Config) -> Driver<'static, Port> {
    Driver::new_fs(pins.port, Interrupts, pins.plus, pins.minus, out, config)
}

#[cfg(feature = "high-speed")]
fn driver(pins: Pins, out: &'static mut [u8], config: usb::Config) -> Driver<'static, Port> {
    let Pins { port, clock, direction, next, stop, d0, d1, d2, d3, d4, d5, d6, d7 } = pins;
    Driver::new_hs_ulpi(port, Interrupts, clock, direction, next, stop, d0, d1, d2, d3, d4, d5, d6, d7, out, config)
}
