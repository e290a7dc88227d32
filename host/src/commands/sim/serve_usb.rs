//! `praxi sim --serve usb`: the simulated controller as a USB device that a Linux kernel attaches over USB/IP.

use crate::commands::{Failure, say};
use crate::flash;
use hil_sim::dfu::{Controller, Owner};
use hil_sim::simulator::Simulator;
use hil_sim::usb::board::Board;
use hil_sim::usb::{Function, Port};
use hil_sim::usbip::wire::{BUS_ID, UsbIpError};
use hil_sim::usbip::{Clock, Ending, STEP, greet, serve};
use protocol::image::Board as Name;
use serde_json::{Value, json};
use std::io::ErrorKind;
use std::net::{Shutdown, SocketAddr, TcpListener, TcpStream};
use std::path::Path;
use std::time::Duration;

/// The name of the simulated controller's board.
const BOARD: &str = "sim";
/// How long a client may take over its first message. Meanwhile nothing turns.
const GREETED_WITHIN: Duration = Duration::from_millis(200);
/// How long a client may take to read what it is sent.
const READ_WITHIN: Duration = Duration::from_secs(5);

/// Serves `simulator` at `address` until the program is ended; says what to type there, and when a host came or went. The board's loader
/// takes images that the owner of `key`, a file with a public key, has signed; without one it takes none.
pub(super) fn run(
    simulator: Simulator,
    seed: u64,
    address: SocketAddr,
    key: Option<&Path>,
    as_json: bool,
) -> Result<(), Failure> {
    let owner = Owner { board: Name::new(BOARD)?, key: key.map(flash::read_key).transpose()?.unwrap_or_default() };
    let board = Board::new(simulator, Controller::new(owner), &format!("sim{seed}"))
        .map_err(|error| Failure(format!("the simulated flash: {error}")))?;
    let listener = TcpListener::bind(address).map_err(|error| match error.kind() {
        ErrorKind::AddrInUse => Failure(format!(
            "--listen {address}: somebody listens there already: end that program, or name another port"
        )),
        _ => Failure(format!("--listen {address}: {error}")),
    })?;
    let address = listener.local_addr()?;
    listener.set_nonblocking(true)?;
    let tell = |text: String, value: Value| say(if as_json { value.to_string() } else { text });
    tell(instructions(address), json!({ "event": "ready", "address": address.to_string(), "bus_id": BUS_ID }));
    let (mut port, mut clock) = (Port::new(board), Clock::start());
    loop {
        if let Some(client) = newcomer(&listener, &port, true) {
            tell("a host attached the controller".into(), json!({ "event": "attached" }));
            let why = farewell(attend(&client, &mut port, &listener));
            tell(why.clone(), json!({ "event": "left", "why": why }));
            clock = Clock::start();
        }
        while clock.step() {
            port.advance(STEP.as_secs_f64());
        }
        std::thread::sleep(clock.wait());
    }
}

fn instructions(address: SocketAddr) -> String {
    let port = match address.port() {
        3240 => String::new(),
        port => format!("--tcp-port {port} "),
    };
    format!(
        "serving the simulated controller at {address}; attach it, as root, on this machine or another, with\n  modprobe vhci-hcd\n  \
         usbip {port}attach -r {} -b {BUS_ID}\nthen it is --device usb; Ctrl-C ends it",
        address.ip()
    )
}

/// A client that has been given the device.
fn newcomer<F: Function>(listener: &TcpListener, port: &Port<F>, is_free: bool) -> Option<TcpStream> {
    let (mut client, _) = listener.accept().ok()?;
    let prepared = client.set_nonblocking(false).and_then(|()| client.set_read_timeout(Some(GREETED_WITHIN)));
    prepared.ok()?;
    greet(&mut client, port.function().descriptors(), is_free).ok()?.then_some(client)
}

/// Serves the device to a client until one of them leaves. Others are told that it is taken.
fn attend<F: Function>(client: &TcpStream, port: &mut Port<F>, listener: &TcpListener) -> Result<Ending, UsbIpError> {
    client.set_read_timeout(None)?;
    client.set_write_timeout(Some(READ_WITHIN))?;
    client.set_nodelay(true)?;
    let ending = serve(client.try_clone()?, client, port, |port| drop(newcomer(listener, port, false)));
    // It may have gone by itself.
    let _ = client.shutdown(Shutdown::Both);
    ending
}

fn farewell(ending: Result<Ending, UsbIpError>) -> String {
    match ending {
        Ok(Ending::HostLeft) => "the host detached the controller".into(),
        Ok(Ending::DeviceLeft) => "the controller started anew, and left the bus: attach it again".into(),
        Err(error) => format!("the host was sent away: {error}"),
    }
}
