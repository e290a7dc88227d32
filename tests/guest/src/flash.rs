//! Firmware by DFU, from the application through its loader into the next application.

use crate::bare::patiently;
use crate::cable::Cable;
use crate::controller::{Sink, board_of};
use crate::link::link;
use hil_sim::dfu::{Controller, Owner};
use hil_sim::usb::board::{Board as Device, Mode};
use host::flash::usb::Usb;
use host::flash::{FlashError, flash, public, sign};
use host::link::LinkError;
use host::link::usb::{Name, UsbLink};
use protocol::image::{Board, Header};

const SECRET: [u8; 32] = [9; 32];
const BOARD: &str = "guest";

fn image(board: &str, version: &str) -> Vec<u8> {
    let code = (0..20_000).map(|at| at as u8).collect();
    let board = Board::new(board).expect("a short name");
    sign(&SECRET, board, version.parse().expect("a version"), code).expect("a small image")
}

fn put(board: &str, version: &str, force: bool) -> Result<Header, FlashError> {
    flash(&mut Usb::new("usb".parse().expect("a device's name")), &image(board, version), force, |_| {})
}

fn owner() -> Owner {
    Owner { board: Board::new(BOARD).expect("a short name"), key: public(&SECRET) }
}

/// A board without firmware is no controller until it has some.
pub fn a_blank_board_waits() {
    let _cable =
        Cable::plug(0, || Device::blank(Sink::default(), Controller::new(owner()), "1").expect("a flash that works"));
    patiently(|| match UsbLink::open(&Name::default()) {
        Err(LinkError::Absent { remedy, .. }) if remedy.contains("praxi flash") => Ok(()),
        other => Err(format!("{other:?}")),
    });
    put(BOARD, "1.0.0", false).unwrap();
    link("usb");
}

/// A newer image runs, an older one only with force, and another board's never.
pub fn images_run() {
    let cable = Cable::plug(0, || board_of(owner(), Sink::default(), "1"));
    drop(link("usb"));
    let what_runs = || {
        let (mode, image) = cable.ask(|port| (port.function().mode(), port.function().loader().identity()));
        (mode, image.map(|image| image.version.to_string()))
    };
    assert_eq!(what_runs(), (Mode::Application, None));
    put(BOARD, "1.0.0", false).unwrap();
    assert_eq!(what_runs(), (Mode::Application, Some("1.0.0".into())));
    let older = put(BOARD, "0.9.0", false);
    assert!(matches!(older, Err(FlashError::Version { .. })), "{older:?}");
    let other = put("other", "2.0.0", true);
    assert!(matches!(other, Err(FlashError::Board { .. })), "{other:?}");
    assert_eq!(what_runs(), (Mode::Application, Some("1.0.0".into())));
    put(BOARD, "0.9.0", true).unwrap();
    assert_eq!(what_runs(), (Mode::Application, Some("0.9.0".into())));
}
