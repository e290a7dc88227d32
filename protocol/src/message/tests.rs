use super::*;
use crate::packet::{Decoder, FRAME_BYTES_MAX, PACKET_BYTES_MAX, encode};
use proptest::prelude::*;

fn payload(message: impl Into<Message<'static>>) -> Vec<u8> {
    let mut frame = vec![0; FRAME_BYTES_MAX];
    let length = encode(7, &message.into(), &mut frame).unwrap();
    let mut decoder = Decoder::<PACKET_BYTES_MAX>::new();
    decoder.next(&mut &frame[..length]).unwrap().unwrap().payload.to_vec()
}

/// Every message with its fields at the values that take the most bytes.
fn longest() -> Vec<Message<'static>> {
    const BYTES: &[u8] = &[255; PLANE_PART_BYTES];
    let (turn, slice, check) = (u32::MAX, u16::MAX, u64::MAX);
    let configure = Configure {
        slices: slice,
        planes_per_frame: slice,
        refresh_microhertz: check,
        phase_offset: turn,
        clockwise: true,
        width: slice,
        height: slice,
    };
    let status = Status {
        state: State::Service,
        fault: Some(Fault::Watchdog),
        measured: true,
        phase_error: i32::MIN,
        speed_microhertz: turn,
        turns_shown: turn,
        turn_on_screen: Some(turn),
        turns_received: turn,
        turns_abandoned: turn,
        packets: turn,
        packets_damaged: turn,
    };
    let faults = Faults {
        latched: Some(Fault::Unknown),
        quantity: Quantity::Turns,
        value_micro: check,
        limit_micro: check,
        at_us: check,
        counts: [slice; Fault::ALL.len()],
    };
    vec![
        Hello { version: slice, schema: check }.into(),
        HelloReply { answers: turn, version: slice, schema: check }.into(),
        configure.into(),
        BeginTurn { turn, slices: slice }.into(),
        PlaneData { turn, slice, offset: turn, total: turn, check, bytes: BYTES }.into(),
        EndTurn { turn, check }.into(),
        Control { command: Command::Service { slice, duration_ms: turn } }.into(),
        Ack { answers: turn }.into(),
        Nack { answers: turn, reason: Reason::TurnDamaged }.into(),
        status.into(),
        faults.into(),
        Learn { kind: Knowledge::Codes, offset: slice, total: slice, bytes: &BYTES[..LEARN_PART_BYTES] }.into(),
        KeepPlanes { turn, of: turn, from: slice, to: slice }.into(),
        AskMissing { turn, from: slice }.into(),
        Missing { answers: turn, from: slice, to: slice }.into(),
    ]
}

#[test]
fn every_message_fits_its_row_and_comes_back() {
    let messages = longest();
    assert_eq!(messages.len(), TABLE.len(), "a row without an example here");
    for (message, entry) in messages.iter().zip(TABLE) {
        assert_eq!(message.entry(), entry);
        let payload = payload(*message);
        assert!(payload.len() <= entry.bytes_max, "{}: {} bytes", entry.name, payload.len());
        assert_eq!(Message::decode(entry.id, &payload), Ok(*message));
    }
}

#[test]
fn codes_are_places_in_the_lists() {
    assert!(Fault::ALL.iter().enumerate().all(|(place, fault)| usize::from(fault.code()) == place));
    assert!(Quantity::ALL.iter().enumerate().all(|(place, quantity)| usize::from(quantity.code()) == place));
}

#[test]
fn a_cause_has_its_units() {
    let fast = Faults {
        latched: Some(Fault::Overspeed),
        quantity: Quantity::Speed,
        value_micro: 190_300_000,
        limit_micro: 188_500_000,
        at_us: 1,
        counts: [0, 0, 3, 0, 0, 0, 0, 0, 0],
    };
    assert_eq!(fast.cause().to_string(), "190.3000 rad/s where 188.5000 rad/s are allowed");
    assert_eq!((fast.count(Fault::Overspeed), fast.count(Fault::Stall)), (3, 0));
    assert_eq!(Faults { quantity: Quantity::Level, ..fast }.cause().to_string(), "");
}

#[test]
fn identifiers_and_names_are_unique() {
    for (index, entry) in TABLE.iter().enumerate() {
        assert!(TABLE[..index].iter().all(|other| other.id < entry.id && other.name != entry.name), "{}", entry.name);
    }
}

#[test]
fn the_hello_is_frozen() {
    // Programs of other versions depend on these very bytes.
    assert_eq!(payload(Hello { version: 0x1234, schema: 1 }), [0xb4, 0x24, 1]);
    let reply = HelloReply { answers: 3, version: 1, schema: 128 };
    assert_eq!(payload(reply), [3, 1, 0x80, 1]);
    assert_eq!((TABLE[0].id, TABLE[1].id), (1, 2));
}

#[test]
fn the_schema_reads_every_column() {
    let hash = |text: &str| fnv(0, text.as_bytes());
    assert_eq!(hash("turn: u32, bytes: & 'a [u8]"), hash("turn : u32 , bytes : &'a [u8]"));
    assert_ne!(hash("turn: u32"), hash("turn: u16"));
    let data = TABLE.iter().find(|entry| entry.name == "PlaneData").unwrap();
    assert!(data.payload.replace(' ', "").contains("slice:u16,offset:u32"), "{}", data.payload);
    let words = VOCABULARY.concat();
    assert!(words.contains("Holdover") && words.contains("duration_ms") && words.contains("TurnDamaged"), "{words}");
}

#[test]
fn what_is_not_in_the_table_is_refused() {
    assert_eq!(Message::decode(0xee, &[]), Err(MessageError::Unknown { id: 0xee }));
    assert_eq!(Message::decode(0x08, &[1, 2]), Err(MessageError::Malformed { name: "Ack" }));
    assert_eq!(Message::decode(0x08, &[]), Err(MessageError::Malformed { name: "Ack" }));
    let long = MessageError::TooLong { name: "Ack", bytes: 9, bytes_max: 8 };
    assert_eq!(Message::decode(0x08, &[0; 9]), Err(long));
    // Command 9 of 5, state 8 of 8.
    assert_eq!(Message::decode(0x07, &[9]), Err(MessageError::Malformed { name: "Control" }));
    assert_eq!(Message::decode(0x0a, &[8; 12]), Err(MessageError::Malformed { name: "Status" }));
}

#[test]
fn an_impossible_configuration_is_refused() {
    let rotation = Rotation::new(288, 24, 240_000_000, Turns(5), Direction::Clockwise).unwrap();
    let size = ImageSize::new(768, 700).unwrap();
    let configure = Configure::new(&rotation, size);
    assert_eq!(configure.parts(), Ok((rotation, size)));
    let zero = Configure { planes_per_frame: 0, ..configure };
    assert_eq!(zero.parts(), Err(RotationError::PlanesPerFrame(0).into()));
    let wide = Configure { width: 4097, ..configure };
    assert_eq!(wide.parts(), Err(ImageSizeError { width: 4097, height: 700 }.into()));
}

proptest! {
    #[test]
    fn any_payload_is_read_or_refused(id: u8, payload in prop::collection::vec(any::<u8>(), 0..80)) {
        if let Ok(message) = Message::decode(id, &payload) {
            prop_assert_eq!(message.entry().id, id);
        }
    }
}
