//! What of ours is at this machine's USB, told by descriptors; by name, and with reasons where it cannot be had.

use crate::link::LinkError;
use dfu_core::functional_descriptor::FunctionalDescriptor;
use rusb::{Context, Device, DeviceHandle, Direction, Speed, TransferType, UsbContext};
use std::fmt::{Display, Formatter};
use std::io;
use std::str::FromStr;

/// What `usb` alone stands for: the identifier that pid.codes keeps for tests, until the project has its own.
const OURS: (u16, u16) = (0x1209, 0x0001);
/// A class of a vendor's own.
const CLASS_VENDOR: u8 = 0xFF;
/// DFU 1.1, section 4.1.2 and 4.2.3: application specific, device firmware upgrade.
const CLASS_DFU: (u8, u8) = (0xFE, 0x01);
/// The same: an application that can be asked to make way, and a loader that takes an image.
const PROTOCOL_RUN_TIME: u8 = 1;
const PROTOCOL_DOWNLOAD: u8 = 2;

/// Which USB device: `usb`, `usb:VID:PID` or `usb:VID:PID:SERIAL`, the numbers hexadecimal; `usb:` may be left out before a number.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Name {
    /// Vendor and product.
    pub id: (u16, u16),
    /// The serial number, where it matters which.
    pub serial: Option<String>,
    is_short: bool,
}

impl Default for Name {
    fn default() -> Self {
        Self { id: OURS, serial: None, is_short: true }
    }
}

impl FromStr for Name {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if text == "usb" {
            return Ok(Self::default());
        }
        let mut parts = text.strip_prefix("usb:").unwrap_or(text).splitn(3, ':');
        // Four digits or fewer: no sign, which `from_str_radix` takes.
        let mut number = || {
            let digits =
                parts.next().filter(|part| part.len() <= 4 && part.chars().all(|digit| digit.is_ascii_hexdigit()));
            digits.and_then(|digits| u16::from_str_radix(digits, 16).ok())
        };
        let id = number().zip(number());
        let serial = parts.next();
        match id {
            Some(id) if serial != Some("") => Ok(Self { id, serial: serial.map(Into::into), is_short: false }),
            _ => {
                Err("allowed are usb, usb:VID:PID and usb:VID:PID:SERIAL with hexadecimal numbers, as in usb:1209:0001"
                    .into())
            }
        }
    }
}

impl Display for Name {
    fn fmt(&self, to: &mut Formatter<'_>) -> std::fmt::Result {
        let (vendor, product) = self.id;
        match &self.serial {
            _ if self.is_short => write!(to, "usb"),
            None => write!(to, "usb:{vendor:04x}:{product:04x}"),
            Some(serial) => write!(to, "usb:{vendor:04x}:{product:04x}:{serial}"),
        }
    }
}

/// The two endpoints of a controller's stream.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Endpoints {
    /// Their interface.
    pub interface: u8,
    /// Address of the one to the device.
    pub outward: u8,
    /// Address of the one from the device.
    pub inward: u8,
    /// Bytes of the longest packet from the device.
    pub packet_bytes: u16,
}

/// Where a device takes firmware.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DfuInterface {
    /// Its number.
    pub interface: u8,
    /// Whether it takes an image, or has to be asked first to become the loader that does.
    pub is_loader: bool,
}

/// A device that has something of ours.
pub struct Found {
    /// Its full name, as [`Name`] reads it.
    pub name: String,
    /// What it calls itself, where this user may ask.
    pub product: Option<String>,
    /// Bulk data that its speed allows, in bytes a second (USB 2.0, tables 5-9 and 5-10).
    pub bytes_per_second: Option<f64>,
    /// A controller's stream; a loader has none.
    pub endpoints: Option<Endpoints>,
    /// Where it takes firmware.
    pub dfu: Option<DfuInterface>,
    /// Why this user cannot talk to it now, if so.
    pub trouble: Option<LinkError>,
    name_parts: Name,
    device: Device<Context>,
}

impl Found {
    /// Opens it.
    pub fn open(&self) -> Result<DeviceHandle<Context>, LinkError> {
        self.device.open().map_err(|error| refused(error, &self.name, self.name_parts.id))
    }

    /// Its full name in parts.
    pub fn full_name(&self) -> &Name {
        &self.name_parts
    }

    /// The device as `rusb` has it.
    pub fn device(&self) -> &Device<Context> {
        &self.device
    }
}

/// All devices with our identifier that have something of ours. Empty on a machine without USB.
pub fn list() -> Vec<Found> {
    all(OURS).unwrap_or_default()
}

/// What a machine is told that has no USB, or none that this user may ask: the cause, and what to do.
pub const NO_USB: [&str; 2] = [
    "no USB on this machine, or none that this user may ask",
    "use a machine with USB, or a controller that is simulated: --device sim:usb",
];

/// The rule for Linux's udev that lets whoever sits at the machine open devices of that vendor and product.
pub fn udev_rule(vendor: u16, product: u16) -> String {
    format!(r#"SUBSYSTEM=="usb", ATTR{{idVendor}}=="{vendor:04x}", ATTR{{idProduct}}=="{product:04x}", TAG+="uaccess""#)
}

/// The one device of that name which is `wanted`; others do not count.
pub(crate) fn one(name: &Name, wanted: impl Fn(&Found) -> bool) -> Result<Found, LinkError> {
    let absent = |remedy: String| LinkError::Absent { name: name.to_string(), remedy };
    let all = all(name.id).map_err(|_| absent(NO_USB.join(": ")))?;
    // One that may not be opened does not tell its serial number: it may be this one.
    let is_named = |found: &Found| {
        let serial = &found.name_parts.serial;
        name.serial.is_none() || *serial == name.serial || (serial.is_none() && found.trouble.is_some())
    };
    let (mut right, others): (Vec<_>, Vec<_>) = all.into_iter().filter(is_named).partition(wanted);
    match (right.pop(), right.is_empty()) {
        (Some(found), true) => Ok(found),
        (Some(last), false) => {
            let found = right.iter().chain([&last]).map(|found| found.name.clone()).collect();
            Err(LinkError::Several { name: name.to_string(), found })
        }
        (None, _) if others.iter().any(|found| found.dfu.is_some_and(|dfu| dfu.is_loader)) => {
            Err(absent("it is there and waits for firmware: praxi flash IMAGE --device usb".into()))
        }
        (None, _) => Err(absent("plug the controller in and switch it on; praxi devices lists what is there".into())),
    }
}

/// What a failure to open or to claim means.
pub(crate) fn refused(error: rusb::Error, name: &str, (vendor, product): (u16, u16)) -> LinkError {
    let name = name.to_owned();
    match error {
        rusb::Error::Access => LinkError::Forbidden {
            name,
            remedy: format!(
                "as root, write the line {} to /etc/udev/rules.d/70-praxinoscope.rules, then plug it in again",
                udev_rule(vendor, product)
            ),
        },
        rusb::Error::Busy => LinkError::InUse { name },
        error => failed(error),
    }
}

/// What an error of an open device means.
pub(crate) fn failed(error: rusb::Error) -> LinkError {
    match error {
        rusb::Error::NoDevice => LinkError::Gone,
        rusb::Error::Pipe => io::Error::other("the device stalled an endpoint").into(),
        error => io::Error::other(error).into(),
    }
}

fn all(id: (u16, u16)) -> Result<Vec<Found>, rusb::Error> {
    let mut found: Vec<_> = Context::new()?.devices()?.iter().filter_map(|device| look_at(device, id)).collect();
    found.sort_by(|a, b| a.name.cmp(&b.name));
    Ok(found)
}

fn look_at(device: Device<Context>, id: (u16, u16)) -> Option<Found> {
    let descriptor = device.device_descriptor().ok()?;
    if (descriptor.vendor_id(), descriptor.product_id()) != id {
        return None;
    }
    let (endpoints, dfu) = interfaces(&device);
    if endpoints.is_none() && dfu.is_none() {
        return None;
    }
    let opened = device.open();
    let text = |index: Option<u8>| opened.as_ref().ok()?.read_string_descriptor_ascii(index?).ok();
    let serial = text(descriptor.serial_number_string_index()).filter(|serial| !serial.is_empty());
    let product = text(descriptor.product_string_index());
    let name_parts = Name { id, serial, is_short: false };
    let name = name_parts.to_string();
    let trouble = opened.err().map(|error| refused(error, &name, id));
    let bytes_per_second = bytes_per_second(device.speed());
    Some(Found { name, product, bytes_per_second, endpoints, dfu, trouble, name_parts, device })
}

fn bytes_per_second(speed: Speed) -> Option<f64> {
    match speed {
        // 19 packets of 64 bytes a frame of 1 ms; 13 of 512 bytes an eighth of it.
        Speed::Full => Some(19.0 * 64.0 * 1e3),
        Speed::High => Some(13.0 * 512.0 * 8e3),
        _ => None,
    }
}

/// The descriptor that a DFU interface has besides its own; hosts find it behind any of its settings.
pub(crate) fn dfu_descriptor(device: &Device<Context>, interface: u8) -> Option<FunctionalDescriptor> {
    let configuration = device.active_config_descriptor().ok()?;
    let mut settings =
        configuration.interfaces().filter(|its| its.number() == interface).flat_map(|its| its.descriptors());
    settings.find_map(|setting| FunctionalDescriptor::from_bytes(setting.extra())?.ok())
}

/// The stream and DFU among the interfaces of the device's configuration.
fn interfaces(device: &Device<Context>) -> (Option<Endpoints>, Option<DfuInterface>) {
    // One that has just been plugged in has none yet, and nothing of it can be had.
    let Ok(configuration) = device.active_config_descriptor() else { return (None, None) };
    let (mut endpoints, mut dfu) = (None, None);
    // Alternate setting 0, which is on by itself, tells for all.
    for setting in configuration.interfaces().filter_map(|interface| interface.descriptors().next()) {
        let interface = setting.interface_number();
        let bulk = |direction| {
            let is_it = |endpoint: &rusb::EndpointDescriptor<'_>| {
                endpoint.transfer_type() == TransferType::Bulk && endpoint.direction() == direction
            };
            setting.endpoint_descriptors().find(is_it)
        };
        let class = (setting.class_code(), setting.sub_class_code());
        if class.0 == CLASS_VENDOR
            && let Some((outward, inward)) = bulk(Direction::Out).zip(bulk(Direction::In))
        {
            let packet_bytes = inward.max_packet_size();
            endpoints.get_or_insert(Endpoints {
                interface,
                outward: outward.address(),
                inward: inward.address(),
                packet_bytes,
            });
        } else if class == CLASS_DFU && [PROTOCOL_RUN_TIME, PROTOCOL_DOWNLOAD].contains(&setting.protocol_code()) {
            let is_loader = setting.protocol_code() == PROTOCOL_DOWNLOAD;
            dfu.get_or_insert(DfuInterface { interface, is_loader });
        }
    }
    (endpoints, dfu)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_read_as_they_are_written() {
        for text in ["usb", "usb:1209:0001", "usb:0483:df11:A:1"] {
            assert_eq!(text.parse::<Name>().unwrap().to_string(), text);
        }
        let short: Name = "483:DF11".parse().unwrap();
        assert_eq!((short.id, short.to_string().as_str()), ((0x0483, 0xdf11), "usb:0483:df11"));
        for text in ["", "usb:", "usb:1209", "usb:1209:", "usb:12090:1", "usb:+1:1", "1:2:", "usb:1:2:", "sim"] {
            let error = text.parse::<Name>().unwrap_err();
            assert!(error.contains("usb:VID:PID"), "{text}: {error}");
        }
    }

    #[test]
    fn nothing_there_is_one_line_with_a_remedy() {
        let error = one(&"usb:ffff:fffe".parse().unwrap(), |_| true).err().unwrap().to_string();
        assert!(error.starts_with("no device usb:ffff:fffe: ") && !error.contains("Other error"), "{error}");
        assert!(error.contains(NO_USB[1]) || error.contains("plug the controller in"), "{error}");
    }

    #[test]
    fn each_refusal_has_its_kind() {
        let refused = |error| refused(error, "usb:1209:0001", OURS);
        assert!(matches!(refused(rusb::Error::Busy), LinkError::InUse { .. }));
        assert!(matches!(refused(rusb::Error::NoDevice), LinkError::Gone));
        let forbidden = refused(rusb::Error::Access).to_string();
        assert!(forbidden.contains(&udev_rule(0x1209, 0x0001)) && forbidden.contains("1209"), "{forbidden}");
    }
}
