//! What a device tells of itself: USB 2.0, chapter 9.6.

/// Bytes of a bulk packet at high speed.
pub const PACKET_BYTES: usize = 512;
/// In an endpoint's address: it sends to the host.
pub const FROM_DEVICE: u8 = 0x80;
/// The bulk endpoint to the device.
pub const OUT: u8 = 0x01;
/// The bulk endpoint from the device.
pub const IN: u8 = OUT | FROM_DEVICE;

pub(super) const DEVICE: u8 = 1;
pub(super) const CONFIGURATION: u8 = 2;
pub(super) const STRING: u8 = 3;
const INTERFACE: u8 = 4;
const ENDPOINT: u8 = 5;
pub(super) const QUALIFIER: u8 = 6;
pub(super) const BOS: u8 = 15;
const CAPABILITY: u8 = 16;
/// USB 2.1, which has a BOS.
const RELEASE: [u8; 2] = [0x10, 0x02];
/// English of the United States.
const LANGUAGE: [u8; 2] = [0x09, 0x04];
/// Indices of strings.
const MANUFACTURER: u8 = 1;
const PRODUCT: u8 = 2;
const SERIAL: u8 = 3;
/// The first string of an interface.
const NAMES: u8 = 4;

/// An interface in one of its alternate settings.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Interface {
    /// Its number.
    pub number: u8,
    /// The alternate setting.
    pub setting: u8,
    /// Class, subclass and protocol.
    pub class: [u8; 3],
    /// Whether it has the two bulk endpoints.
    pub has_bulk: bool,
    /// Descriptors of its class, after its own.
    pub extra: Vec<u8>,
    /// Its name, if it has one.
    pub name: Option<String>,
}

/// A device with one configuration, whose number is 1.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Descriptors {
    /// idVendor.
    pub vendor: u16,
    /// idProduct.
    pub product: u16,
    /// bcdDevice.
    pub release: u16,
    /// iManufacturer's text.
    pub manufacturer: String,
    /// iProduct's text.
    pub product_name: String,
    /// iSerialNumber's text.
    pub serial: String,
    /// What it has, by number and then by setting.
    pub interfaces: Vec<Interface>,
}

impl Descriptors {
    /// The device descriptor.
    pub fn device(&self) -> Vec<u8> {
        let mut bytes = vec![18, DEVICE];
        bytes.extend(RELEASE);
        // Each interface has its own class; packets of 64 bytes on endpoint 0.
        bytes.extend([0, 0, 0, 64]);
        [self.vendor, self.product, self.release].iter().for_each(|word| bytes.extend(word.to_le_bytes()));
        bytes.extend([MANUFACTURER, PRODUCT, SERIAL, 1]);
        bytes
    }

    /// What it would be at the other speed.
    pub fn qualifier(&self) -> Vec<u8> {
        vec![10, QUALIFIER, RELEASE[0], RELEASE[1], 0, 0, 0, 64, 1, 0]
    }

    /// The binary object store: the extension of USB 2.0, with nothing in it.
    pub fn bos(&self) -> Vec<u8> {
        vec![5, BOS, 12, 0, 1, 7, CAPABILITY, 2, 0, 0, 0, 0]
    }

    /// The configuration with everything in it. Powered by itself.
    pub fn configuration(&self) -> Vec<u8> {
        let mut bytes = vec![9, CONFIGURATION, 0, 0, self.interface_count(), 1, 0, 0xC0, 50];
        let mut name = NAMES;
        for interface in &self.interfaces {
            let Interface { number, setting, class: [class, subclass, protocol], has_bulk, extra, .. } = interface;
            let index = if interface.name.is_some() { name } else { 0 };
            name += u8::from(interface.name.is_some());
            bytes.extend([
                9,
                INTERFACE,
                *number,
                *setting,
                u8::from(*has_bulk) * 2,
                *class,
                *subclass,
                *protocol,
                index,
            ]);
            bytes.extend(extra);
            if *has_bulk {
                const BULK: u8 = 2;
                let [low, high] = (PACKET_BYTES as u16).to_le_bytes();
                [OUT, IN].iter().for_each(|address| bytes.extend([7, ENDPOINT, *address, BULK, low, high, 0]));
            }
        }
        let length = (bytes.len() as u16).to_le_bytes();
        bytes[2..4].copy_from_slice(&length);
        bytes
    }

    /// How many interfaces it has, whatever their settings.
    pub fn interface_count(&self) -> u8 {
        self.interfaces.iter().filter(|interface| interface.setting == 0).count() as u8
    }

    /// The string of this index, if there is one.
    pub fn string(&self, index: u8) -> Option<Vec<u8>> {
        let mut names = self.interfaces.iter().filter_map(|interface| interface.name.as_deref());
        let text = match index {
            0 => return Some(vec![4, STRING, LANGUAGE[0], LANGUAGE[1]]),
            MANUFACTURER => &self.manufacturer,
            PRODUCT => &self.product_name,
            SERIAL => &self.serial,
            name => names.nth(usize::from(name - NAMES))?,
        };
        // Its length is a byte.
        let mut bytes = vec![0, STRING];
        bytes.extend(text.encode_utf16().take(126).flat_map(u16::to_le_bytes));
        bytes[0] = bytes.len() as u8;
        Some(bytes)
    }
}
