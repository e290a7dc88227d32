//! Any bytes from a wire, in pieces: packets, and the messages and knowledge in them, or refusals; and what was read can be written.

#![no_main]

use protocol::codec::Codebook;
use protocol::message::{Learn, Message};
use protocol::packet::{Decoder, FRAME_BYTES_MAX, PACKET_BYTES_MAX, encode};

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    let [id, piece, rest @ ..] = bytes else { return };
    // The check of a packet is hard to guess: a message by itself, then as a packet of its own.
    if let Ok(message) = Message::decode(*id, rest) {
        let mut frame = vec![0; FRAME_BYTES_MAX];
        let length = encode(7, &message, &mut frame).expect("what was read fits");
        let mut decoder = Decoder::<PACKET_BYTES_MAX>::new();
        let packet = decoder.next(&mut &frame[..length]).expect("a packet").expect("undamaged");
        assert_eq!(packet.message(), Ok(message));
        if let Message::Learn(Learn { kind, offset, total, bytes }) = message {
            let _ = Codebook::EMPTY.clone().learn(kind, [offset.into(), total.into()], bytes);
        }
    }
    let mut decoder = Decoder::<PACKET_BYTES_MAX>::new();
    for mut piece in rest.chunks(usize::from(*piece).max(1)) {
        while let Some(packet) = decoder.next(&mut piece) {
            let _ = packet.map(|packet| packet.message().is_ok());
        }
    }
});
