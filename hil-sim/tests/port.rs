//! A board's frame store behind its port refuses and accepts what the simulator's does: the same store at the port's far end.

use firmware::plane_store::{PlaneStore, TurnHandle};
use firmware::port_store::{Fields, HEAD_BYTES, Operation, Port, PortError, PortStore, REFUSALS, head};
use hil_sim::frame_store::{MemoryStore, StoreError};
use proptest::prelude::*;
use protocol::codec::{Compressor, Hint, ImageSize, plane_check, turn_check};
use protocol::message::{EndTurn, PlaneData, Reason};

const SLICES: u16 = 24;
const TABLE: [Operation; 6] =
    [Operation::Configure, Operation::Begin, Operation::Write, Operation::Finish, Operation::Release, Operation::Keep];

/// What the FPGA does, in memory. It is busy for a while after each head.
#[derive(Default)]
struct Fpga {
    store: MemoryStore,
    result: Option<Result<u8, Reason>>,
    busy: u32,
    /// The number of the head of which a bit is flipped on its way.
    damaged: Option<u32>,
    heads: u32,
}

impl Fpga {
    fn obey(&mut self, bytes: &[u8; HEAD_BYTES], part: &[u8]) -> Result<u8, Reason> {
        let word = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap());
        let half = |at: usize| u16::from_le_bytes(bytes[at..at + 2].try_into().unwrap());
        let check = u64::from_le_bytes(bytes[12..20].try_into().unwrap());
        let fields =
            Fields { slot: bytes[1], slice: half(2), offset: word(4), total: word(8), check, length: half(20) };
        let operation = TABLE.into_iter().find(|&operation| operation as u8 == bytes[0]);
        let operation = operation.filter(|&operation| head(operation, &fields) == *bytes);
        let turn = TurnHandle(fields.slot);
        let (slice, offset, total) = (fields.slice, fields.offset, fields.total);
        let reason = |error: StoreError| Reason::from(error);
        match operation {
            Some(Operation::Configure) => {
                let size = ImageSize::new(offset, total).map_err(|_| Reason::Configuration)?;
                self.store.configure(slice, size).map(|()| 0).map_err(reason)
            }
            Some(Operation::Begin) => self.store.begin().map(|turn| turn.0).map_err(reason),
            Some(Operation::Write) => {
                let data = PlaneData { turn: 0, slice, offset, total, check, bytes: part };
                self.store.write(turn, &data).map(|()| 0).map_err(reason)
            }
            Some(Operation::Finish) => {
                self.store.finish(turn, &EndTurn { turn: offset, check }).map(|()| 0).map_err(reason)
            }
            Some(Operation::Keep) => {
                let (of, to) = (TurnHandle(total as u8), offset as u16);
                self.store.keep(turn, of, slice, to).map(|()| 0).map_err(reason)
            }
            Some(Operation::Release) => {
                self.store.release(turn);
                Ok(0)
            }
            _ => Err(Reason::NotUnderstood),
        }
    }

    fn answer(&mut self) -> [u8; 4] {
        if self.busy > 0 {
            self.busy -= 1;
            return [0xa1, 0, !0xa1, !0];
        }
        match self.result {
            Some(Ok(value)) => [0xa0, value, !0xa0, !value],
            Some(Err(reason)) => {
                let value = REFUSALS.iter().position(|&refusal| refusal == reason).unwrap() as u8;
                [0xa2, value, !0xa2, !value]
            }
            None => [0; 4],
        }
    }
}

impl Port for Fpga {
    type Error = ();

    fn exchange(&mut self, head: &[u8], bytes: &[u8], answer: &mut [u8]) -> Result<(), ()> {
        if answer.is_empty() {
            let mut head: [u8; HEAD_BYTES] = head.try_into().unwrap();
            head[7] ^= u8::from(self.damaged == Some(self.heads));
            self.heads += 1;
            self.busy = self.heads % 3;
            self.result = Some(self.obey(&head, bytes));
        } else {
            answer.copy_from_slice(&self.answer());
        }
        Ok(())
    }
}

#[derive(Clone, Debug)]
enum Action {
    Configure(u32),
    Begin,
    Write { slot: u8, slice: u16, part: u8 },
    Fill(u8),
    Finish { slot: u8, right: bool },
    Release(u8),
    Keep { slot: u8, of: u8, from: u16, to: u16 },
}

fn action() -> impl Strategy<Value = Action> {
    prop_oneof![
        1 => (7u32..10).prop_map(Action::Configure),
        2 => Just(Action::Begin),
        2 => (0u8..3, 0..SLICES + 1, 0u8..3).prop_map(|(slot, slice, part)| Action::Write { slot, slice, part }),
        3 => (0u8..2).prop_map(Action::Fill),
        3 => (0u8..3, prop::bool::weighted(0.9)).prop_map(|(slot, right)| Action::Finish { slot, right }),
        1 => (0u8..3).prop_map(Action::Release),
        2 => (0u8..3, 0u8..3, 0..SLICES + 2, 0..SLICES + 2)
            .prop_map(|(slot, of, from, to)| Action::Keep { slot, of, from, to }),
    ]
}

fn plane(slice: u16, bytes: usize) -> Vec<u8> {
    (0..bytes).map(|at| (usize::from(slice) * 31 + at * 11) as u8).collect()
}

/// What came of `action`, a slot where there is one.
fn act<S: PlaneStore>(store: &mut S, action: &Action, size: &mut ImageSize) -> Result<u8, Reason> {
    let bytes = size.plane_bytes();
    let mut write = |slot: u8, slice: u16, part: Option<usize>| {
        let plane = plane(slice, bytes);
        let mut compressed = Vec::new();
        Compressor::new(*size).compress(&plane, Hint::None, &mut compressed);
        let (total, check) = (compressed.len() as u32, plane_check(&plane));
        let middle = compressed.len() / 2;
        let (offset, bytes) = match part {
            None => (0, &compressed[..]),
            Some(0) => (0, &compressed[..middle]),
            Some(1) => (middle, &compressed[middle..]),
            Some(_) => (1, &compressed[..]),
        };
        let data = PlaneData { turn: 0, slice, offset: offset as u32, total, check, bytes };
        store.write(TurnHandle(slot), &data).map(|()| 0).map_err(Into::into)
    };
    match *action {
        Action::Configure(height) => {
            let wanted = ImageSize::new(16, height).unwrap();
            store.configure(SLICES, wanted).map_err(Into::into)?;
            *size = wanted;
            Ok(0)
        }
        Action::Begin => store.begin().map(|turn| turn.0).map_err(Into::into),
        Action::Write { slot, slice, part } => write(slot, slice, Some(part.into())),
        Action::Fill(slot) => (0..SLICES).try_fold(0, |_, slice| write(slot, slice, None)),
        Action::Finish { slot, right } => {
            let check = turn_check(7, (0..SLICES).map(|slice| plane_check(&plane(slice, bytes))));
            let end = EndTurn { turn: 7, check: if right { check } else { !check } };
            store.finish(TurnHandle(slot), &end).map(|()| 0).map_err(Into::into)
        }
        Action::Keep { slot, of, from, to } => {
            store.keep(TurnHandle(slot), TurnHandle(of), from, to).map(|()| 0).map_err(Into::into)
        }
        Action::Release(slot) => {
            store.release(TurnHandle(slot));
            Ok(0)
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn a_store_behind_the_port_answers_as_the_store_itself(actions in prop::collection::vec(action(), 1..60)) {
        let (mut near, mut far) = (MemoryStore::new(), PortStore::new(Fpga::default()));
        let size = ImageSize::new(16, 8).unwrap();
        let (mut near_size, mut far_size) = (size, size);
        let whole = [Action::Configure(8), Action::Begin, Action::Fill(0), Action::Finish { slot: 0, right: true }];
        for (at, action) in whole.iter().chain(&actions).enumerate() {
            let (a, b) = (act(&mut near, action, &mut near_size), act(&mut far, action, &mut far_size));
            prop_assert_eq!(a, b, "{:?}", action);
            prop_assert!(at >= whole.len() || a == Ok(0), "{:?}", action);
        }
    }
}

#[test]
fn a_damaged_head_is_refused_and_may_be_repeated() {
    let size = ImageSize::new(16, 8).unwrap();
    let mut store = PortStore::new(Fpga { damaged: Some(1), ..Fpga::default() });
    store.configure(SLICES, size).unwrap();
    assert_eq!(store.begin(), Err(PortError::Refused(Reason::NotUnderstood)));
    assert_eq!(store.begin(), Ok(TurnHandle(0)));
}

/// A port with nothing at its far end, or something that is always busy.
struct Line([u8; 4]);

impl Port for Line {
    type Error = ();

    fn exchange(&mut self, _head: &[u8], _bytes: &[u8], answer: &mut [u8]) -> Result<(), ()> {
        if let Some(whole) = answer.first_chunk_mut() {
            *whole = self.0;
        }
        Ok(())
    }
}

#[test]
fn a_dead_line_is_no_store() {
    for answer in [[0; 4], [0xff; 4], [0xa1, 0, 0x5e, 0xff], [0xa0, 1, 0x5f, 0xff], [0xa2, 99, 0x5d, 156]] {
        let error = PortStore::new(Line(answer)).begin().unwrap_err();
        assert_eq!((error, Reason::from(error)), (PortError::Silent, Reason::Configuration), "{answer:02x?}");
    }
}
