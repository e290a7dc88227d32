//! The names of devices, as users write them.

use super::serial::{BAUD, SerialConnect};
use super::sim::{Cable, Simulated};
use super::{Connect, Link, LinkError, usb};
use std::fmt::{self, Display, Formatter};
use std::str::FromStr;
use std::time::Duration;
use thiserror::Error;

/// What may stand for a device, in words.
pub const ALLOWED: &str =
    "usb, usb:VID:PID[:SERIAL], /dev/ttyACM0[@BAUD], COM3[@BAUD], sim, sim:usb, sim:serial[@BAUD]";

/// Rates of a serial line, bits a second.
const BAUDS: std::ops::RangeInclusive<u32> = 300..=50_000_000;

/// A device's name. Printed and read again it is the same one.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Address {
    /// A controller on this machine's USB.
    Usb(usb::Name),
    /// A controller on a serial port.
    Serial(SerialConnect),
    /// A simulated controller in this process.
    Sim(Cable),
}

/// Why a name is none.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum AddressError {
    /// See the message.
    #[error("{0} names no device: allowed are {ALLOWED}")]
    Unknown(String),
    /// See the message.
    #[error("{0}: {1}")]
    Usb(String, String),
    /// See the message.
    #[error("{0}: a rate is a whole number of bits a second from {least} to {most}", least = BAUDS.start(), most = BAUDS.end())]
    Baud(String),
}

impl FromStr for Address {
    type Err = AddressError;

    fn from_str(text: &str) -> Result<Self, AddressError> {
        let is_com = |name: &str| {
            let number = name.get(..3).filter(|start| start.eq_ignore_ascii_case("com")).and_then(|_| name.get(3..));
            number.is_some_and(|number| !number.is_empty() && number.bytes().all(|digit| digit.is_ascii_digit()))
        };
        let (name, rate) = text.rsplit_once('@').map_or((text, None), |(name, rate)| (name, Some(rate)));
        let baud = || rate.map_or(Ok(BAUD), |rate| baud(rate).ok_or_else(|| AddressError::Baud(text.into())));
        match text {
            "sim" => Ok(Self::Sim(Cable::None)),
            "sim:usb" => Ok(Self::Sim(Cable::Usb)),
            _ if name == "sim:serial" => Ok(Self::Sim(Cable::Serial(baud()?))),
            _ if text == "usb" || text.starts_with("usb:") => {
                text.parse().map(Self::Usb).map_err(|error| AddressError::Usb(text.into(), error))
            }
            _ if (name.starts_with('/') && name.len() > 1) || is_com(name) => {
                Ok(Self::Serial(SerialConnect { port: name.into(), baud: baud()? }))
            }
            _ => Err(AddressError::Unknown(text.into())),
        }
    }
}

fn baud(text: &str) -> Option<u32> {
    text.parse().ok().filter(|baud| BAUDS.contains(baud))
}

impl Display for Address {
    fn fmt(&self, formatter: &mut Formatter<'_>) -> fmt::Result {
        let mut at_rate = |name: &str, baud: u32| match baud {
            BAUD => write!(formatter, "{name}"),
            baud => write!(formatter, "{name}@{baud}"),
        };
        match self {
            Self::Usb(name) => name.fmt(formatter),
            Self::Serial(SerialConnect { port, baud }) => at_rate(port, *baud),
            Self::Sim(Cable::None) => write!(formatter, "sim"),
            Self::Sim(Cable::Usb) => write!(formatter, "sim:usb"),
            Self::Sim(Cable::Serial(baud)) => at_rate("sim:serial", *baud),
        }
    }
}

/// A way to some device.
pub type Way = Box<dyn Connect<Link = Box<dyn Link>>>;

impl Address {
    /// The way to that device; nothing is opened yet. A simulated one is switched on here, and lives as long as the way to it.
    pub fn way(&self, simulated: &Simulated) -> Result<Way, LinkError> {
        Ok(match self {
            Self::Usb(name) => Box::new(Any(usb::UsbConnect { name: name.clone() })),
            Self::Serial(port) => Box::new(Any(port.clone())),
            Self::Sim(cable) => Box::new(Any(simulated.connect_by(*cable)?)),
        })
    }
}

/// Links of one kind as links of any.
struct Any<C>(C);

impl<C: Connect<Link: 'static>> Connect for Any<C> {
    type Link = Box<dyn Link>;

    fn connect(&mut self) -> Result<Box<dyn Link>, LinkError> {
        Ok(Box::new(self.0.connect()?))
    }

    fn wait(&mut self, time: Duration) {
        self.0.wait(time);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn names_are_what_they_say() {
        let usb = |name: &str| Address::Usb(name.parse().unwrap());
        let serial = |port: &str, baud| Address::Serial(SerialConnect { port: port.into(), baud });
        for (text, address) in [
            ("usb", usb("usb")),
            ("usb:1209:0001", usb("1209:1")),
            ("usb:1209:0001:A:7", usb("1209:1:A:7")),
            ("/dev/ttyACM0", serial("/dev/ttyACM0", BAUD)),
            ("/dev/ttyUSB3@115200", serial("/dev/ttyUSB3", 115_200)),
            ("COM3", serial("COM3", BAUD)),
            ("COM12@9600", serial("COM12", 9_600)),
            ("sim", Address::Sim(Cable::None)),
            ("sim:usb", Address::Sim(Cable::Usb)),
            ("sim:serial", Address::Sim(Cable::Serial(BAUD))),
            ("sim:serial@115200", Address::Sim(Cable::Serial(115_200))),
        ] {
            assert_eq!(text.parse(), Ok(address.clone()), "{text}");
            assert_eq!(address.to_string(), text);
        }
    }

    #[test]
    fn wrong_names_are_refused_with_what_is_allowed() {
        for text in [
            "",
            "/",
            "usbx",
            "ttyACM0",
            "COM",
            "COMX",
            "com3x",
            "sim:can",
            "sim@9600",
            "sim:usb@9600",
            "usb@9600",
            "1209:0001",
        ] {
            let error = text.parse::<Address>().unwrap_err();
            assert_eq!(error, AddressError::Unknown(text.into()));
            assert!(error.to_string().contains(ALLOWED), "{error}");
        }
        for text in ["usb:", "usb:1209", "usb:1209:", "usb:1209:0001:", "usb:x:y", "usb:12090:1", "usb:+1:1"] {
            let error = text.parse::<Address>().unwrap_err().to_string();
            assert!(error.starts_with(text) && error.contains("usb:VID:PID:SERIAL"), "{error}");
        }
        for text in
            ["/dev/ttyS0@", "/dev/ttyS0@fast", "COM3@0", "sim:serial@299", "sim:serial@50000001", "/dev/x@-9600"]
        {
            assert_eq!(text.parse::<Address>(), Err(AddressError::Baud(text.into())), "{text}");
        }
    }

    fn any_address() -> impl Strategy<Value = Address> {
        let usb = (any::<(u16, u16)>(), "(:[ -~]{1,20})?").prop_map(|((vendor, product), serial)| {
            Address::Usb(format!("{vendor:x}:{product:x}{serial}").parse().unwrap())
        });
        let serial = ("(/[a-zA-Z0-9/._-]{1,30}|COM[0-9]{1,3})", BAUDS)
            .prop_map(|(port, baud)| Address::Serial(SerialConnect { port, baud }));
        let cable = prop_oneof![Just(Cable::None), Just(Cable::Usb), BAUDS.prop_map(Cable::Serial)];
        prop_oneof![usb, serial, cable.prop_map(Address::Sim)]
    }

    proptest! {
        #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]
        #[test]
        fn printed_and_read_again_it_is_the_same(address in any_address()) {
            prop_assert_eq!(address.to_string().parse(), Ok(address));
        }

        #[test]
        fn any_text_is_a_name_that_is_kept_or_refused(text in "\\PC{0,24}|(usb|sim|COM|/)[:@/0-9a-f]{0,12}") {
            if let Ok(address) = text.parse::<Address>() {
                prop_assert_eq!(address.to_string().parse(), Ok(address));
            }
        }
    }
}
