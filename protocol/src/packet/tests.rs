use super::*;
use crate::message::{Ack, EndTurn, PLANE_PART_BYTES, PlaneData};
use proptest::prelude::*;

type Reader = Decoder<PACKET_BYTES_MAX>;

fn frame(sequence: u32, message: &Message<'_>) -> Vec<u8> {
    let mut out = vec![0; FRAME_BYTES_MAX];
    let length = encode(sequence, message, &mut out).unwrap();
    out.truncate(length);
    out
}

fn plane(sequence: u32, bytes: &[u8]) -> Vec<u8> {
    frame(sequence, &PlaneData { turn: 1, slice: 2, offset: 3, total: 4, check: 5, bytes }.into())
}

/// Everything that `reader` finds in `stream`, as sequence numbers and errors.
fn read(reader: &mut Reader, mut stream: &[u8]) -> Vec<Result<u32, PacketError>> {
    let mut found = Vec::new();
    while let Some(packet) = reader.next(&mut stream) {
        found.push(packet.map(|packet| packet.sequence));
    }
    found
}

#[test]
fn the_bytes_of_a_packet() {
    // Worked by hand: sequence 0x01020304, id 8, payload 5; CRC-32 of 04 03 02 01 08 05; no zeros, so that COBS adds one byte.
    let check = CRC_32.checksum(&[4, 3, 2, 1, 8, 5]).to_le_bytes();
    let bytes = frame(0x0102_0304, &Ack { answers: 5 }.into());
    assert_eq!(bytes[..7], [11, 4, 3, 2, 1, 8, 5]);
    assert_eq!(bytes[7..11], check);
    assert_eq!(bytes[11..], [0]);
    // Each zero becomes the way to the next one.
    let bytes = frame(0, &Ack { answers: 0 }.into());
    assert_eq!(bytes[..7], [1, 1, 1, 1, 2, 8, 5]);
    assert_eq!(CRC_32.checksum(b"123456789"), 0xcbf4_3926, "CRC-32 as everybody knows it");
}

#[test]
fn the_longest_packet_fits_and_a_longer_one_is_refused() {
    let bytes = vec![0xff; PLANE_PART_BYTES];
    let message = PlaneData { turn: !0, slice: !0, offset: !0, total: !0, check: !0, bytes: &bytes };
    assert_eq!(read(&mut Reader::new(), &frame(!0, &message.into())), [Ok(!0)]);
    let bytes = vec![0xff; PLANE_PART_BYTES + 64];
    let message = PlaneData { bytes: &bytes, ..message };
    let mut out = vec![0; FRAME_BYTES_MAX + 200];
    let refused = encode(0, &message.into(), &mut out);
    assert!(
        matches!(refused, Err(PacketError::Message(MessageError::TooLong { name: "PlaneData", .. }))),
        "{refused:?}"
    );
}

#[test]
fn a_short_buffer_is_refused_at_every_length() {
    let message = EndTurn { turn: 7, check: 9 }.into();
    // Checks that end in a zero too: its place in the frame is not written before the end.
    let ends_in_zero = |sequence: &u32| {
        let [a, b, c, d] = sequence.to_le_bytes();
        CRC_32.checksum(&[a, b, c, d, 6, 7, 9]) >> 24 == 0
    };
    let zero = (0..).find(ends_in_zero).unwrap();
    for sequence in [1, zero] {
        let length = frame(sequence, &message).len();
        for bytes in 0..length {
            assert_eq!(encode(sequence, &message, &mut vec![0; bytes]), Err(PacketError::NoRoom { bytes }));
        }
        assert_eq!(encode(sequence, &message, &mut vec![0; length]), Ok(length));
    }
}

#[test]
fn every_kind_of_damage_is_named_and_counted() {
    let good = plane(9, &[0, 1, 2, 3]);
    let mut stream = vec![0, 0, 0];
    stream.extend([5, 1, 0]);
    stream.extend([1, 1, 1, 0]);
    stream.extend(vec![7; PACKET_BYTES_MAX * 2]);
    stream.push(0);
    let mut flipped = good.clone();
    flipped[4] ^= 0x40;
    stream.extend(flipped);
    stream.extend(&good);
    let mut reader = Reader::new();
    let found = read(&mut reader, &stream);
    assert_eq!(found.len(), 5, "{found:?}");
    assert_eq!(found[0], Err(PacketError::Framing));
    assert_eq!(found[1], Err(PacketError::TooShort { bytes: 2 }));
    assert_eq!(found[2], Err(PacketError::TooLong { bytes_max: PACKET_BYTES_MAX }));
    assert!(found[3].is_err() && found[4] == Ok(9), "{found:?}");
    assert_eq!((reader.counts().packets, reader.counts().damaged()), (1, 4));
}

#[test]
fn every_bit_flip_and_truncation_is_refused_and_the_next_packet_arrives() {
    let (first, second) = (plane(1, &[0, 0, 9, 200, 0]), frame(2, &Ack { answers: 1 }.into()));
    for bit in 0..first.len() * 8 {
        let mut stream = first.clone();
        stream[bit / 8] ^= 1 << (bit % 8);
        let lost_delimiter = bit / 8 == first.len() - 1;
        stream.extend(&second);
        stream.extend(&second);
        let found = read(&mut Reader::new(), &stream);
        assert!(!found.contains(&Ok(1)), "bit {bit}: {found:?}");
        let good = found.iter().filter(|packet| **packet == Ok(2)).count();
        assert_eq!(good, if lost_delimiter { 1 } else { 2 }, "bit {bit}: {found:?}");
    }
    for length in 1..first.len() - 1 {
        let stream = [&first[..length], &[0], &second].concat();
        let found = read(&mut Reader::new(), &stream);
        assert!(found.len() == 2 && found[0].is_err() && found[1] == Ok(2), "{length}: {found:?}");
    }
}

proptest! {
    #[test]
    fn packets_arrive_in_any_pieces_with_garbage_between(
        payloads in prop::collection::vec(prop::collection::vec(any::<u8>(), 0..600), 1..8),
        garbage in prop::collection::vec(prop::collection::vec(any::<u8>(), 0..300), 8),
        pieces in prop::collection::vec(1usize..400, 1..40),
    ) {
        let mut stream = Vec::new();
        for (sequence, (payload, garbage)) in payloads.iter().zip(&garbage).enumerate() {
            stream.extend(garbage);
            stream.push(0);
            stream.extend(plane(sequence as u32, payload));
        }
        let mut reader = Reader::new();
        let (mut rest, mut pieces, mut found) = (&stream[..], pieces.iter().cycle(), Vec::new());
        while !rest.is_empty() {
            let (mut piece, after) = rest.split_at((*pieces.next().unwrap()).min(rest.len()));
            rest = after;
            while let Some(packet) = reader.next(&mut piece) {
                if let Ok(packet) = packet {
                    let Ok(Message::PlaneData(data)) = packet.message() else { panic!("another message") };
                    found.push((packet.sequence as usize, data.bytes.to_vec()));
                }
            }
        }
        let sent: Vec<_> = payloads.into_iter().enumerate().collect();
        prop_assert_eq!(found, sent);
    }

    #[test]
    fn any_bytes_are_read_without_panic_by_a_small_decoder(stream in prop::collection::vec(0u8..8, 0..2000)) {
        let mut reader = Decoder::<16>::new();
        let mut rest = &stream[..];
        while let Some(packet) = reader.next(&mut rest) {
            prop_assert!(packet.is_err(), "a CRC-32 by chance");
        }
        prop_assert!(rest.is_empty());
    }
}
