//! The wire as a page and as frozen bytes: `protocol/WIRE.md` says what the table says, and packets of before are still read.
//! `WRITE_WIRE=1 cargo test -p protocol --test wire` writes both anew; the packets only together with a new version of the protocol.

use protocol::message::{
    Ack, AskMissing, BeginTurn, Command, Configure, Control, EndTurn, Fault, Faults, Hello, HelloReply, KeepPlanes,
    Knowledge, Learn, Message, Missing, Nack, PlaneData, Quantity, Reason, Receiver, State, Status, TABLE, VERSION,
    VOCABULARY,
};
use protocol::packet::{Decoder, FRAME_BYTES_MAX, PACKET_BYTES_MAX, encode};
use std::fs;
use std::path::{Path, PathBuf};

fn here(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(path)
}

fn is_writing() -> bool {
    std::env::var_os("WRITE_WIRE").is_some()
}

/// Rust's tokens, however a compiler spaces them.
fn spaced(tokens: &str) -> String {
    let mut text = tokens.split_whitespace().collect::<Vec<_>>().join(" ");
    for (from, to) in [(" :", ":"), (" ,", ","), ("& 'a", "&'a"), ("{ ", "{"), (" }", "}"), (" {", "{"), (",}", "}")] {
        text = text.replace(from, to);
    }
    text.replace(":", ": ")
        .replace(":  ", ": ")
        .replace(" < ", "<")
        .replace(" >", ">")
        .replace("{", " { ")
        .replace("}", " }")
}

/// The values of a word, one a line.
fn values(word: &str) -> (String, Vec<String>) {
    let text = spaced(word);
    let (name, rest) = text.split_once(" { ").expect("a type and its values");
    let (mut values, mut depth) = (vec![String::new()], 0);
    for letter in rest.trim_end_matches('}').chars() {
        depth += i32::from(letter == '{') - i32::from(letter == '}');
        match letter {
            ',' if depth == 0 => values.push(String::new()),
            _ => values.last_mut().expect("one at least").push(letter),
        }
    }
    let values = values.iter().map(|value| value.trim().to_owned()).filter(|value| !value.is_empty()).collect();
    (name.to_owned(), values)
}

fn page() -> String {
    let mut page = format!(
        "# The wire, version {VERSION}\n\
         Made from the table in `src/message.rs` by `WRITE_WIRE=1 cargo test -p protocol --test wire`.\n\n\
         Payloads are postcard: unsigned integers above 8 bits as varints of 7 bits, lowest first; signed ones by zigzag; an enum by the place of\n\
         its value; bytes and options by their length. A packet is\n\
         ```text\n\
         COBS( sequence u32 | id u8 | payload | CRC-32 u32 )  0x00        integers little-endian, CRC-32/ISO-HDLC over all before it\n\
         ```\n\
         Every packet to the device is answered by `HelloReply`, `Ack`, `Nack` or `Missing` with its sequence number; one without an answer is sent again.\n\
         A turn is `BeginTurn`, the `PlaneData` of every slice in any order, or `KeepPlanes` for slices that are as they were, `EndTurn`;\n\
         `src/codec.rs` has the form of planes. After a lost link a host says `Hello` and asks by `AskMissing` where the turn goes on.\n\n"
    );
    for entry in TABLE {
        let receiver = match entry.receiver {
            Receiver::Device => "to the device",
            Receiver::Host => "to the host",
        };
        page += &format!("## {:#04x} {}, {receiver}, at most {} bytes\n", entry.id, entry.name, entry.bytes_max);
        page += &format!("{}\n\n", links(entry.about.trim()));
        for [name, kind, about] in entry.fields {
            page += &format!("- `{name}: {}`: {}\n", spaced(kind), links(about.trim()));
        }
        page.push('\n');
    }
    page += "## Words\n";
    for word in VOCABULARY {
        let (name, values) = values(word);
        page += &format!("- `{name}`: ");
        let numbered: Vec<_> = values.iter().enumerate().map(|(place, value)| format!("{place} `{value}`")).collect();
        page += &format!("{}\n", numbered.join(", "));
    }
    page
}

/// Documentation links as plain names.
fn links(about: &str) -> String {
    let mut text = about.replace("[`", "`").replace("`]", "`");
    while let Some((start, end)) =
        text.find("(crate::").and_then(|start| Some((start, start + text[start..].find(')')?)))
    {
        text.replace_range(start..=end, "");
    }
    text.replace("`(Self::", "`(")
}

#[test]
fn the_page_is_what_the_table_says() {
    let (path, page) = (here("WIRE.md"), page());
    if is_writing() {
        fs::write(&path, &page).unwrap();
    }
    let written = fs::read_to_string(&path).unwrap();
    assert!(written == page, "protocol/WIRE.md is not current: WRITE_WIRE=1 cargo test -p protocol --test wire");
}

/// One or more of every message, with values small and large.
fn examples() -> Vec<Message<'static>> {
    let configure = Configure {
        slices: 288,
        planes_per_frame: 24,
        refresh_microhertz: 240_000_000,
        phase_offset: 1 << 30,
        clockwise: false,
        width: 768,
        height: 768,
    };
    let status = Status {
        state: State::Locked,
        fault: None,
        phase_error: -12_345,
        speed_microhertz: 20_000_000,
        turns_shown: 7,
        turn_on_screen: Some(300),
        turns_received: 8,
        turns_abandoned: 1,
        packets: 70_000,
        packets_damaged: 0,
        measured: true,
    };
    let faults = Faults {
        latched: Some(Fault::Overspeed),
        quantity: Quantity::Speed,
        value_micro: 190_300_000,
        limit_micro: 188_500_000,
        at_us: 1 << 40,
        counts: [0, 1, 2, 3, 4, 5, 6, 700, u16::MAX],
    };
    vec![
        Hello { version: VERSION, schema: 0x0123_4567_89ab_cdef }.into(),
        HelloReply { answers: 0, version: VERSION, schema: u64::MAX }.into(),
        configure.into(),
        BeginTurn { turn: u32::MAX, slices: 288 }.into(),
        PlaneData { turn: 1, slice: 287, offset: 0, total: 5, check: 1, bytes: &[0, 0x43, 0, 0xff, 0] }.into(),
        PlaneData { turn: 1, slice: 0, offset: 70_000, total: 70_000, check: u64::MAX, bytes: &[] }.into(),
        EndTurn { turn: 1, check: 0x8000_0000_0000_0000 }.into(),
        Control { command: Command::Start }.into(),
        Control { command: Command::Service { slice: 3, duration_ms: 60_000 } }.into(),
        Ack { answers: 128 }.into(),
        Nack { answers: 127, reason: Reason::Busy }.into(),
        status.into(),
        Status { state: State::Fault, fault: Some(Fault::Stall), turn_on_screen: None, ..status }.into(),
        faults.into(),
        Learn { kind: Knowledge::Mask, offset: 0, total: 128, bytes: &[1, 0, 0, 0] }.into(),
        KeepPlanes { turn: 300, of: 299, from: 24, to: 48 }.into(),
        AskMissing { turn: 300, from: 0 }.into(),
        Missing { answers: 9, from: 255, to: 288 }.into(),
    ]
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

fn frame(sequence: u32, message: &Message<'_>) -> Vec<u8> {
    let mut frame = vec![0; FRAME_BYTES_MAX];
    let length = encode(sequence, message, &mut frame).unwrap();
    frame.truncate(length);
    frame
}

/// The frozen packets: bytes, and what they mean.
fn corpus() -> Vec<(Vec<u8>, String)> {
    let path = here(&format!("tests/packets-v{VERSION}.txt"));
    if is_writing() {
        let line =
            |(sequence, message): (u32, &Message<'_>)| format!("{} {message:?}\n", hex(&frame(sequence, message)));
        fs::write(&path, (250..).zip(&examples()).map(line).collect::<String>()).unwrap();
    }
    let text = fs::read_to_string(&path)
        .unwrap_or_else(|_| panic!("no packets of version {VERSION}: see the head of this file"));
    let byte = |pair: &[u8]| u8::from_str_radix(std::str::from_utf8(pair).unwrap(), 16).unwrap();
    let read = |line: &str| {
        let (bytes, meaning) = line.split_once(' ').unwrap();
        (bytes.as_bytes().chunks(2).map(byte).collect(), meaning.to_owned())
    };
    text.lines().map(read).collect()
}

/// What a reader makes of `bytes`: each packet as its meaning.
fn read(mut bytes: &[u8]) -> Vec<Option<String>> {
    let mut decoder = Box::new(Decoder::<PACKET_BYTES_MAX>::new());
    let mut found = Vec::new();
    while let Some(packet) = decoder.next(&mut bytes) {
        found.push(packet.ok().and_then(|packet| Some(format!("{:?}", packet.message().ok()?))));
    }
    found
}

#[test]
fn packets_of_before_are_read_and_written_as_they_were() {
    let corpus = corpus();
    let read_back: Vec<_> = corpus.iter().map(|(bytes, _)| read(bytes)).collect();
    let meanings: Vec<_> = corpus.iter().map(|(_, meaning)| vec![Some(meaning.clone())]).collect();
    assert_eq!(read_back, meanings);
    let written: Vec<_> = (250..).zip(&examples()).map(|(sequence, message)| hex(&frame(sequence, message))).collect();
    assert_eq!(written, corpus.iter().map(|(bytes, _)| hex(bytes)).collect::<Vec<_>>());
    for entry in TABLE {
        assert!(corpus.iter().any(|(_, meaning)| meaning.starts_with(entry.name)), "no packet with {}", entry.name);
    }
}

#[test]
fn no_truncation_and_no_flipped_bit_gives_another_packet() {
    for (bytes, meaning) in corpus() {
        for length in 0..bytes.len() - 1 {
            let cut = [&bytes[..length], &[0]].concat();
            assert!(read(&cut).iter().all(Option::is_none), "{meaning} cut to {length} bytes");
        }
        for bit in 0..8 * bytes.len() {
            let mut flipped = bytes.clone();
            flipped[bit / 8] ^= 1 << (bit % 8);
            assert!(read(&flipped).iter().all(Option::is_none), "{meaning} with bit {bit} flipped");
        }
    }
}
