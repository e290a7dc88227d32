use super::*;
use crate::link::sim::{Cable, Clock, SimLink, Simulated};
use crate::link::{Connect, LinkError};
use crate::stream::{Stream, TurnPlanes};
use hil_sim::device::{Device, Endpoint};
use hil_sim::motor::Motor;
use hil_sim::scenario::Scenario;
use hil_sim::simulator::Simulator;
use protocol::codec::ImageSize;
use protocol::message::{Ack, Command, HelloReply, Message, Quantity};
use protocol::packet::{Decoder, FRAME_BYTES_MAX, PACKET_BYTES_MAX, encode};

fn rig() -> Rig {
    let text = include_str!("../../rigs/reference.toml");
    Rig::parse(&text.replace("_px = 768", "_px = 96").replace("[384.0, 384.0]", "[48.0, 48.0]")).unwrap()
}

fn examined(link: &mut dyn Link, carrier: Carrier) -> Vec<Finding> {
    let mut findings = Vec::new();
    examine(link, carrier, &rig(), &mut |finding| findings.push(finding));
    findings
}

fn verdicts(findings: &[Finding]) -> Vec<(&str, Verdict)> {
    findings.iter().map(|finding| (finding.check, finding.verdict)).collect()
}

#[test]
fn a_healthy_device_passes_every_check_and_is_left_as_it_was() {
    let simulator = Simulator::new(&rig(), Motor::reference(), Scenario::without_events(), 1).unwrap();
    let mut link = SimLink::new(simulator);
    let findings = examined(&mut link, Carrier::Other);
    let checks = ["protocol", "firmware", "link speed", "round trip", "loopback", "turns"];
    assert_eq!(verdicts(&findings), checks.map(|check| (check, Verdict::Ok)), "{findings:#?}");
    let counters = link.endpoint().device().counters();
    // The wrong plane and the wrong turn. The turn that they were of goes with the next one that is begun.
    assert_eq!((counters.refused, counters.turns_received, counters.turns_abandoned), (2, 0, 0));
    assert_eq!(link.endpoint().world().screen().turn, None);
}

#[test]
fn a_paced_line_is_measured() {
    for (cable, expected) in [(Cable::Usb, 45e6), (Cable::Serial(1_000_000), 100e3)] {
        let simulated = Simulated::new(rig(), 1, Clock::Simulated);
        let mut link = simulated.connect_by(cable).unwrap().connect().unwrap();
        let findings = examined(&mut link, Carrier::Other);
        assert!(findings.iter().all(|finding| finding.verdict != Verdict::Failed), "{findings:#?}");
        let measured = findings.last().unwrap().figures["bytes_per_second"].as_f64().unwrap();
        assert!((0.95..1.0001).contains(&(measured / expected)), "{cable:?}: {measured}");
        assert!(findings[3].figures["median_us"].as_u64().unwrap() > 0);
    }
}

#[test]
fn a_line_that_is_too_slow_is_not_put_to_the_loopback() {
    let simulated = Simulated::new(rig(), 1, Clock::Simulated);
    let mut link = simulated.connect_by(Cable::Serial(2_400)).unwrap().connect().unwrap();
    let findings = examined(&mut link, Carrier::Other);
    // 288 packets of 40 bytes at 240 bytes a second.
    assert_eq!((findings[4].verdict, findings[4].text.contains("48 s")), (Verdict::Skipped, true), "{findings:#?}");
}

struct Dark(Vec<u8>);

impl TurnPlanes for Dark {
    fn slices(&self) -> u32 {
        288
    }

    fn plane_bytes(&self, _slice: u32) -> &[u8] {
        &self.0
    }
}

#[test]
fn a_display_that_runs_is_not_disturbed() {
    let size = ImageSize::new(96, 96).unwrap();
    let simulator = Simulator::new(&rig(), Motor::reference(), Scenario::without_events(), 1).unwrap();
    let mut stream = Stream::new(SimLink::new(simulator), &rig().rotation(), size).unwrap();
    stream.command(Command::Start).unwrap();
    stream.submit(&Dark(vec![0; size.plane_bytes()])).unwrap();
    while stream.poll(Duration::from_millis(50)).unwrap().is_none_or(|status| status.turn_on_screen.is_none()) {}
    let before = stream.status().unwrap().turn_on_screen;
    let mut link = stream.into_link();
    let findings = examined(&mut link, Carrier::Other);
    let loopback = findings.iter().find(|finding| finding.check == "loopback").unwrap();
    assert_eq!(loopback.verdict, Verdict::Skipped, "{findings:#?}");
    let mut stream = Stream::new(link, &rig().rotation(), size).unwrap();
    let after = loop {
        if let Some(status) = stream.poll(Duration::from_millis(20)).unwrap() {
            break status.turn_on_screen;
        }
    };
    assert!(before.is_some() && after == before, "{before:?} {after:?}");
}

/// Answers every packet with what its function says.
struct Answering(Decoder<PACKET_BYTES_MAX>, Vec<u8>, fn(u32, bool) -> Option<Message<'static>>);

impl Endpoint for Answering {
    fn receive(&mut self, bytes: &[u8]) -> usize {
        let mut rest = bytes;
        while let Some(packet) = self.0.next(&mut rest) {
            let Ok(packet) = packet else { continue };
            let is_hello = matches!(packet.message(), Ok(Message::Hello(_)));
            if let Some(message) = (self.2)(packet.sequence, is_hello) {
                let mut frame = vec![0; FRAME_BYTES_MAX];
                let length = encode(0, &message, &mut frame).unwrap();
                self.1.extend_from_slice(&frame[..length]);
            }
        }
        bytes.len()
    }

    fn transmit(&mut self) -> Vec<u8> {
        std::mem::take(&mut self.1)
    }

    fn advance(&mut self, _seconds: f64) {}
}

fn examine_answering(answer: fn(u32, bool) -> Option<Message<'static>>) -> Vec<Finding> {
    examined(&mut SimLink::new(Answering(Decoder::new(), Vec::new(), answer)), Carrier::Usb)
}

#[test]
fn another_release_is_named_and_asked_nothing_more() {
    let findings =
        examine_answering(|answers, hello| hello.then(|| HelloReply { answers, version: 9, schema: 7 }.into()));
    assert_eq!(verdicts(&findings), [("protocol", Verdict::Failed)]);
    let text = &findings[0].text;
    assert!(text.contains("version 9") && text.contains("0x0000000000000007"), "{text}");
    let flash = "praxi flash IMAGE --device usb";
    assert!(findings[0].remedy.as_ref().is_some_and(|remedy| remedy.ends_with(flash)), "{findings:?}");
    assert!(same_release(Carrier::Other).contains("not over this line"));
}

#[test]
fn what_does_not_answer_is_no_controller() {
    assert_eq!(verdicts(&examine_answering(|_, _| None)), [("protocol", Verdict::Failed)]);
}

#[test]
fn a_device_that_takes_everything_fails_the_loopback() {
    let findings = examine_answering(|answers, hello| {
        Some(if hello {
            HelloReply { answers, version: VERSION, schema: SCHEMA }.into()
        } else {
            Ack { answers }.into()
        })
    });
    let loopback = findings.iter().find(|finding| finding.check == "loopback").unwrap();
    assert_eq!(loopback.verdict, Verdict::Failed, "{findings:#?}");
    assert!(loopback.text.contains("another's check"), "{loopback:?}");
    assert_eq!(findings[1].verdict, Verdict::Warning, "it says nothing of itself");
}

/// A device that is unplugged after so many packets.
struct Unplugged(Device, usize);

impl Endpoint for Unplugged {
    fn receive(&mut self, bytes: &[u8]) -> usize {
        self.1 = self.1.saturating_sub(1);
        self.0.receive(bytes)
    }

    fn transmit(&mut self) -> Vec<u8> {
        self.0.transmit()
    }

    fn advance(&mut self, _seconds: f64) {}

    fn plug(&self) -> Option<u32> {
        (self.1 > 0).then_some(0)
    }
}

#[test]
fn a_conversation_that_breaks_off_is_a_failure_wherever_it_does() {
    for packets in [1, 2, 30, 60, 200] {
        let findings = examined(&mut SimLink::new(Unplugged(Device::new(), packets)), Carrier::Other);
        let last = findings.last().unwrap();
        assert_eq!((last.check, last.verdict), ("answers", Verdict::Failed), "{packets}: {findings:#?}");
        assert!(last.text.contains(&LinkError::Gone.to_string()), "{}", last.text);
    }
}

#[test]
fn a_controller_that_stopped_says_why() {
    let mut status = Status {
        state: State::Fault,
        fault: Some(Fault::Overspeed),
        measured: true,
        phase_error: 0,
        speed_microhertz: 0,
        turns_shown: 0,
        turn_on_screen: Some(4_000_000_000),
        turns_received: 7,
        turns_abandoned: 0,
        packets: 0,
        packets_damaged: 0,
    };
    let mut counts = [0; 9];
    counts[usize::from(Fault::Overspeed.code())] = 3;
    let faults = Faults {
        latched: status.fault,
        quantity: Quantity::Speed,
        value_micro: 200_000_000,
        limit_micro: 150_000_000,
        at_us: 7,
        counts,
    };
    let finding = firmware(Some(&status), Some(&faults));
    assert_eq!(finding.verdict, Verdict::Failed);
    for word in ["turned too fast", "200.0000 rad/s", "3 fault(s)", "a turn on screen", "7 turn(s) came whole"] {
        assert!(finding.text.contains(word), "{}", finding.text);
    }
    assert!(!finding.text.contains("4000000000"), "{}", finding.text);
    (status.state, status.fault) = (State::Idle, None);
    assert_eq!(firmware(Some(&status), Some(&faults)).verdict, Verdict::Ok);
}

#[test]
fn turns_are_the_rate_by_the_ratio() {
    let reference = Rig::parse(include_str!("../../rigs/reference.toml")).unwrap();
    let finding = turns(Some(45e6), true, &reference);
    let allowed = finding.figures["turns_per_second"]["blue_noise"].as_f64().unwrap();
    assert!((allowed - 45e6 * 22.5 / (288.0 * 768.0 * 96.0)).abs() < 1e-9, "{allowed}");
    assert_eq!(finding.verdict, Verdict::Ok);
    let slow = turns(Some(11_520.0), false, &reference);
    assert_eq!(slow.verdict, Verdict::Warning);
    assert!(slow.text.contains("blue noise one in 82 s"), "{}", slow.text);
    assert_eq!(speed(Some(1.2e6), Carrier::Usb).verdict, Verdict::Warning);
    assert_eq!(speed(Some(1.2e6), Carrier::Other).verdict, Verdict::Ok);
}
