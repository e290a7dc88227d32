//! What a plane costs that comes by packets: opening, expanding and checking it.
//!
//! `planes/` has two of the Stanford bunny (Stanford University Computer Graphics Laboratory), with what they are compressed by, as
//! `tests/tests/image_planes.rs` has written them.

use hil_sim::image::Image;
use hil_sim::motor::Motor;
use protocol::codec::{Compressor, Hint, ImageSize, plane_check};
use protocol::message::{
    BeginTurn, Configure, Hello, Knowledge, LEARN_PART_BYTES, Learn, Message, PLANE_PART_BYTES, PlaneData, SCHEMA,
    VERSION,
};
use protocol::packet::{Decoder, FRAME_BYTES_MAX, encode};
use protocol::timing::{Direction, Rotation};
use protocol::units::{Nanos, Turns};

/// What is told apart.
pub const KINDS: [&str; 3] = ["dark", "by a mask", "by error diffusion"];

/// Slices of a turn: those of the rig's 288 do not fit in the machine's memory.
const SLICES: u16 = 24;

/// A plane as it was sent once.
struct Frozen {
    knowledge: (Knowledge, Vec<u8>),
    check: u64,
    compressed: Vec<u8>,
}

impl Frozen {
    /// A count of bytes (32 bits), so many bytes of knowledge, the plane's check (64 bits), the compressed plane.
    fn read(kind: Knowledge, file: &[u8]) -> Self {
        let (count, rest) = file.split_first_chunk().expect("a count");
        let (knowledge, rest) = rest.split_at(u32::from_le_bytes(*count) as usize);
        let (check, compressed) = rest.split_first_chunk().expect("a check");
        Self {
            knowledge: (kind, knowledge.to_vec()),
            check: u64::from_le_bytes(*check),
            compressed: compressed.to_vec(),
        }
    }
}

/// Instructions of a plane of each of [`KINDS`].
pub fn instructions(image: &mut Image) -> [u64; KINDS.len()] {
    let rotation = |slices| Rotation::new(slices, 24, 240_000_000, Turns::ZERO, Direction::CounterClockwise).unwrap();
    image.begin(&Motor::reference().firmware_config(&rotation(288), Nanos::ZERO)).unwrap();
    let size = ImageSize::new(768, 768).unwrap();
    let mut host = Host { image, sequence: 0 };
    host.ask(Hello { version: VERSION, schema: SCHEMA });
    host.ask(Configure::new(&rotation(SLICES.into()), size));
    host.ask(BeginTurn { turn: 1, slices: SLICES });
    let (dark, mut compressed) = (vec![0; size.plane_bytes()], Vec::new());
    Compressor::new(size).compress(&dark, Hint::None, &mut compressed);
    let mask = Frozen::read(Knowledge::Mask, include_bytes!("planes/bunny-blue-noise.bin"));
    let diffusion = Frozen::read(Knowledge::Codes, include_bytes!("planes/bunny-optimised-diffusion.bin"));
    for (kind, bytes) in [&mask.knowledge, &diffusion.knowledge] {
        for (part, piece) in bytes.chunks(LEARN_PART_BYTES).enumerate() {
            let (offset, total) = ((part * LEARN_PART_BYTES) as u16, bytes.len() as u16);
            host.ask(Learn { kind: *kind, offset, total, bytes: piece });
        }
    }
    let planes =
        [(plane_check(&dark), &compressed), (mask.check, &mask.compressed), (diffusion.check, &diffusion.compressed)];
    let mut slices = 0..;
    planes.map(|(check, bytes)| host.send(slices.next().unwrap(), check, bytes))
}

struct Host<'a> {
    image: &'a mut Image,
    sequence: u32,
}

impl Host<'_> {
    /// Instructions of a plane.
    fn send(&mut self, slice: u16, check: u64, compressed: &[u8]) -> u64 {
        let total = compressed.len() as u32;
        let parts = compressed.chunks(PLANE_PART_BYTES).enumerate();
        let part =
            |(part, bytes)| PlaneData { turn: 1, slice, offset: (part * PLANE_PART_BYTES) as u32, total, check, bytes };
        let instructions = parts.map(|piece| self.ask(part(piece))).sum();
        println!("slice {slice}: {total} bytes, {instructions} instructions");
        instructions
    }

    /// Sends a message, which must be acknowledged; instructions of all that it took.
    fn ask<'m>(&mut self, message: impl Into<Message<'m>>) -> u64 {
        self.sequence += 1;
        let mut frame = vec![0; FRAME_BYTES_MAX];
        let length = encode(self.sequence, &message.into(), &mut frame).unwrap();
        let (mut rest, mut instructions, mut said) = (&frame[..length], 0, Vec::new());
        while !rest.is_empty() {
            let heard = self.image.hear(Nanos(1_000), rest).unwrap();
            rest = &rest[heard.taken..];
            instructions += heard.instructions;
            said.extend_from_slice(&heard.said);
        }
        let mut decoder = Decoder::<128>::new();
        let answer = decoder.next(&mut &said[..]).expect("an answer").unwrap().message().unwrap();
        assert!(matches!(answer, Message::Ack(_) | Message::HelloReply(_)), "{answer:?}");
        instructions
    }
}
