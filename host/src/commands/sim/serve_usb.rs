//! `praxi sim --serve usb`: the simulated controller as a USB device that a Linux kernel attaches over USB/IP.

use super::Args;
use crate::commands::{Failure, say, until_interrupted};
use crate::flash;
use hil_sim::dfu::{Controller, Owner};
use hil_sim::served::{Pump, STEP};
use hil_sim::simulator::Simulator;
use hil_sim::usb::board::Board;
use hil_sim::usb::descriptors::Descriptors;
use hil_sim::usb::{Function, Port};
use hil_sim::usbip::wire::{BUS_ID, Request, UsbIpError, read_request};
use hil_sim::usbip::{Ending, greet, serve};
use protocol::image::Board as Name;
use serde_json::{Value, json};
use std::io::ErrorKind;
use std::net::{IpAddr, Ipv4Addr, Shutdown, SocketAddr, TcpListener, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::{Duration, Instant};

/// The name of the simulated controller's board.
const BOARD: &str = "sim";
/// How long a client may take over its first message.
const ASKED_WITHIN: Duration = Duration::from_secs(2);
/// Clients that may be about it at once; more are sent away.
const ASKING_MAX: usize = 32;
/// Where it is offered, if nobody says another place: the port that USB/IP has.
const LISTEN: SocketAddr = SocketAddr::new(IpAddr::V4(Ipv4Addr::LOCALHOST), 3240);
/// How long a client may take to read what it is sent.
const READ_WITHIN: Duration = Duration::from_secs(5);

/// Serves `simulator` until it is told to end; says what to type there, and when a host came or went. The board's loader
/// takes images that the owner of the key has signed; without one it takes none.
pub(super) fn run(simulator: Simulator, args: &Args) -> Result<(), Failure> {
    let key = args.key.as_deref().map(flash::read_key).transpose()?.unwrap_or_default();
    let owner = Owner { board: Name::new(BOARD)?, key };
    let board = Board::new(simulator, Controller::new(owner), &format!("sim{}", args.seed))
        .map_err(|error| Failure(format!("the simulated flash: {error}")))?;
    let address = args.listen.unwrap_or(LISTEN);
    let listener = TcpListener::bind(address).map_err(|error| match error.kind() {
        ErrorKind::AddrInUse => Failure(format!(
            "--listen {address}: somebody listens there already: end that program, or name another port"
        )),
        _ => Failure(format!("--listen {address}: {error}")),
    })?;
    let address = listener.local_addr()?;
    listener.set_nonblocking(true)?;
    let tell = |text: String, value: Value| say(if args.json { value.to_string() } else { text });
    tell(instructions(address), json!({ "event": "ready", "address": address.to_string(), "bus_id": BUS_ID }));
    let (mut port, interrupted) = (Port::new(board), until_interrupted());
    let (mut start, mut pump) = (Instant::now(), Pump::new());
    let door = Door::new(listener);
    while !interrupted.load(Ordering::Relaxed) {
        if let Some(client) = door.newcomer(port.function().descriptors(), true) {
            tell("a host attached the controller".into(), json!({ "event": "attached" }));
            let ending = attend(&client, &mut port, &door, interrupted);
            let is_over = interrupted.load(Ordering::Relaxed);
            let why = if is_over { "this program was told to end".into() } else { farewell(ending) };
            tell(why.clone(), json!({ "event": "left", "why": why }));
            (start, pump) = (Instant::now(), Pump::new());
        }
        while pump.step(start.elapsed()) {
            port.advance(STEP.as_secs_f64());
        }
        std::thread::sleep(pump.wait(start.elapsed()));
    }
    Ok(())
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

/// A client, and what it wants.
type Asked = (TcpStream, Request);

/// Where clients come in. Each says what it wants to a thread of its own, so that one that says nothing holds up nobody.
struct Door {
    listener: TcpListener,
    asking: (Sender<Asked>, Receiver<Asked>),
    /// One more of these than threads that listen to a client.
    listeners: Arc<()>,
}

impl Door {
    fn new(listener: TcpListener) -> Self {
        Self { listener, asking: channel(), listeners: Arc::new(()) }
    }

    /// Lets in who waits outside, and answers who has asked; a client that has been given the device.
    fn newcomer(&self, descriptors: &Descriptors, is_free: bool) -> Option<TcpStream> {
        while let Ok((client, _)) = self.listener.accept() {
            if Arc::strong_count(&self.listeners) <= ASKING_MAX {
                let (asking, listener) = (self.asking.0.clone(), Arc::clone(&self.listeners));
                std::thread::spawn(move || {
                    let _listener = listener;
                    // Nobody answers when the program ends.
                    hear(client).and_then(|asked| asking.send(asked).ok())
                });
            }
        }
        while let Ok((mut client, request)) = self.asking.1.try_recv() {
            if greet(&request, &mut client, descriptors, is_free).is_ok_and(|is_given| is_given) {
                return Some(client);
            }
        }
        None
    }
}

/// What a client wants, if it says so in time.
fn hear(mut client: TcpStream) -> Option<Asked> {
    client.set_nonblocking(false).ok()?;
    client.set_read_timeout(Some(ASKED_WITHIN)).ok()?;
    let request = read_request(&mut client).ok()?;
    Some((client, request))
}

/// Serves the device to a client until one of them leaves, or the program is told to end. Others are told that it is taken.
fn attend<F: Function>(
    client: &TcpStream,
    port: &mut Port<F>,
    door: &Door,
    interrupted: &AtomicBool,
) -> Result<Ending, UsbIpError> {
    client.set_read_timeout(None)?;
    client.set_write_timeout(Some(READ_WITHIN))?;
    client.set_nodelay(true)?;
    let ending = serve(client.try_clone()?, client, port, |port| {
        drop(door.newcomer(port.function().descriptors(), false));
        if interrupted.load(Ordering::Relaxed) {
            port.unplug();
        }
    });
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
