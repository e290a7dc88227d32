//! Turns to a simulated controller that turns its mirror meanwhile.

use crate::bare::{PATIENCE, patiently};
use crate::cable::Cable;
use crate::controller::board;
use crate::link::link;
use hil_sim::device::TurnHandle;
use hil_sim::motor::Motor;
use hil_sim::scenario::Scenario;
use hil_sim::simulator::Simulator;
use hil_sim::streaming::{Subject, rotation};
use hil_sim::usb::board::Board;
use hil_sim::usb::descriptors::{IN, OUT};
use host::link::usb::{UsbConnect, UsbLink};
use host::link::{Connect, LinkError};
use host::stream::{Stream, StreamError, TurnPlanes};
use protocol::codec::{ImageSize, plane_check};
use protocol::message::{Command, State};
use protocol::units::Nanos;
use std::time::{Duration, Instant};

type Machine = Cable<Board<Simulator>>;

/// All runs are alike.
const SEED: u64 = 1;

fn size() -> ImageSize {
    ImageSize::new(64, 48).expect("a size that can be")
}

/// A turn that no other is like.
struct Turn(Vec<Vec<u8>>);

impl Turn {
    fn new(number: u32) -> Self {
        let plane = |slice: u32| -> Vec<u8> {
            let start = (number.wrapping_mul(0x9e37_79b9) ^ slice).wrapping_mul(0x85eb_ca6b);
            (0..size().plane_bytes() as u32).map(|at| (start.wrapping_add(at * 0x0101) >> 8) as u8).collect()
        };
        Self((0..rotation(SEED).slices()).map(plane).collect())
    }

    fn checks(&self) -> Vec<u64> {
        self.0.iter().map(|plane| plane_check(plane)).collect()
    }
}

impl TurnPlanes for Turn {
    fn slices(&self) -> u32 {
        self.0.len() as u32
    }

    fn plane_bytes(&self, slice: u32) -> &[u8] {
        &self.0[slice as usize]
    }
}

/// A controller whose mirror is in step, and the stream to it.
fn machine() -> (Machine, Stream<UsbLink>) {
    let make = || {
        let scenario = Scenario::without_events();
        let simulator = Simulator::turning(&rotation(SEED), Nanos::ZERO, Motor::reference(), scenario, SEED);
        board(simulator.expect("a controller for the reference motor"), "1")
    };
    let cable = Cable::plug(0, make);
    let mut stream = Stream::new(link("usb"), &rotation(SEED), size()).unwrap();
    // Turns take each other's place only where they are shown.
    stream.submit(&Turn::new(0)).unwrap();
    stream.command(Command::Start).unwrap();
    let until = Instant::now() + 4 * PATIENCE;
    while stream.poll(Duration::from_millis(20)).unwrap().is_none_or(|status| status.state != State::Locked) {
        assert!(Instant::now() < until, "the mirror is not in step: {:?}", stream.status());
    }
    (cable, stream)
}

/// What the device holds of the turn of that number: the check of each plane.
fn held(cable: &Machine, number: u32) -> Option<Vec<u64>> {
    cable.ask(move |port| {
        let simulator = port.function_mut().endpoint_mut();
        let turn = (0..=1).map(TurnHandle).find(|turn| simulator.device().turn_number(*turn) == Some(number))?;
        (0..rotation(SEED).slices() as u16).map(|slice| simulator.check_of(turn, slice)).collect()
    })
}

/// Sends a turn and sees that the device holds it as it is; its number there.
fn send(cable: &Machine, stream: &mut Stream<UsbLink>, number: u32) -> Result<u32, StreamError> {
    let turn = Turn::new(number);
    let ticket = stream.submit(&turn)?;
    assert_eq!(held(cable, ticket.turn), Some(turn.checks()), "turn {number}");
    Ok(ticket.turn)
}

/// Turns are held as they were sent, and come on screen.
pub fn turns_arrive_whole() {
    let (cable, mut stream) = machine();
    let start = Instant::now();
    const TURNS: u32 = 20;
    let last = (1..=TURNS).map(|number| send(&cable, &mut stream, number).unwrap()).last();
    let statistics = stream.statistics();
    println!(
        "{TURNS} turns in {:.2} s, {} bytes on the wire, {} retries",
        start.elapsed().as_secs_f64(),
        statistics.bytes_on_wire,
        statistics.retries
    );
    let until = Instant::now() + PATIENCE;
    while stream.poll(Duration::from_millis(20)).unwrap().and_then(|status| status.turn_on_screen) != last {
        assert!(Instant::now() < until, "{:?}", stream.status());
    }
    let verdict = cable.ask(|port| port.function().endpoint().world().statistics().verdict);
    assert!(verdict.is_clean(), "{:?}", verdict.first);
}

/// A slow device, one that takes nothing for a while, and one that stalls: what was lost is sent again, or told.
pub fn a_bad_port_only_delays() {
    let (cable, mut stream) = machine();
    cable.ask(|port| port.set_bytes_per_second(Some(1e6)));
    send(&cable, &mut stream, 1).unwrap();
    cable.ask(|port| port.set_bytes_per_second(None));
    for number in 2..5 {
        cable.ask(|port| port.set_nak(true));
        std::thread::scope(|scope| {
            scope.spawn(|| {
                std::thread::sleep(Duration::from_millis(200));
                cable.tell(|port| port.set_nak(false));
            });
            send(&cable, &mut stream, number).unwrap();
        });
    }
    for address in [OUT, IN] {
        cable.ask(move |port| port.halt(address));
        let stalled = send(&cable, &mut stream, 5).unwrap_err().to_string();
        assert!(stalled.contains("stalled"), "{stalled}");
        send(&cable, &mut stream, 6).unwrap();
    }
}

/// In the middle of a turn: it is told, and over another link the turn goes on where it stopped.
pub fn goes_on_after_the_plug_was_pulled() {
    let (cable, mut stream) = machine();
    for number in [1, 3] {
        send(&cable, &mut stream, number).unwrap();
        cable.ask(|port| port.set_bytes_per_second(Some(5e5)));
        let gone = std::thread::scope(|scope| {
            scope.spawn(|| {
                std::thread::sleep(Duration::from_millis(100));
                cable.tell(|port| port.unplug());
            });
            send(&cable, &mut stream, number + 1).unwrap_err()
        });
        assert!(matches!(gone, StreamError::Link(LinkError::Gone)), "{gone:?}");
        let link = patiently(|| UsbConnect::default().connect());
        cable.ask(|port| port.set_bytes_per_second(None));
        let resumed = stream.statistics().planes_resumed;
        stream.reconnect(link).unwrap();
        send(&cable, &mut stream, number + 1).unwrap();
        assert!(stream.statistics().planes_resumed > resumed, "{:?}", stream.statistics());
    }
}
