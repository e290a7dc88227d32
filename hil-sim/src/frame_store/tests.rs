use super::*;
use firmware::plane_store::{PlaneStore, TurnHandle};
use protocol::codec::{Compressor, ExpandError, Hint, ImageSize, plane_check, turn_check};
use protocol::message::{EndTurn, PlaneData};

const SLICES: u16 = 3;

fn size() -> ImageSize {
    ImageSize::new(20, 6).unwrap()
}

fn plane(seed: u8) -> Vec<u8> {
    (0..size().plane_bytes()).map(|at| (at as u8).wrapping_mul(37) ^ seed).collect()
}

fn store() -> MemoryStore {
    let mut store = MemoryStore::new();
    store.configure(SLICES, size()).unwrap();
    store
}

fn compressed(plane: &[u8]) -> Vec<u8> {
    let mut out = Vec::new();
    Compressor::new(size()).compress(plane, Hint::None, &mut out);
    out
}

fn part<'a>(slice: u16, plane: &[u8], compressed: &'a [u8], offset: usize, length: usize) -> PlaneData<'a> {
    let (offset, bytes, total) = (offset as u32, &compressed[offset..][..length], compressed.len() as u32);
    PlaneData { turn: 1, slice, offset, total, check: plane_check(plane), bytes }
}

fn write(store: &mut MemoryStore, turn: TurnHandle, slice: u16, plane: &[u8]) -> Result<(), StoreError> {
    let stream = compressed(plane);
    store.write(turn, &part(slice, plane, &stream, 0, stream.len()))
}

fn end(seeds: [u8; 3]) -> EndTurn {
    EndTurn { turn: 1, check: turn_check(1, seeds.map(|seed| plane_check(&plane(seed)))) }
}

fn fill(store: &mut MemoryStore, seeds: [u8; 3]) -> TurnHandle {
    let turn = store.begin().unwrap();
    (0..).zip(seeds).for_each(|(slice, seed)| write(store, turn, slice, &plane(seed)).unwrap());
    turn
}

#[test]
fn a_turn_lives_from_begin_to_release() {
    let mut store = store();
    let first = fill(&mut store, [1, 2, 3]);
    assert_eq!(store.plane(first, 0), None, "not finished");
    store.finish(first, &end([1, 2, 3])).unwrap();
    let picture = store.plane(first, 1).unwrap();
    assert_eq!(picture.bytes(), plane(2));
    for (x, y) in (0..24).flat_map(|x| (0..7).map(move |y| (x, y))) {
        let lit = x < 20 && y < 6 && plane(2)[y * 3 + x / 8] >> (x % 8) & 1 == 1;
        assert_eq!(picture.pixel(x as u32, y as u32), lit, "({x}, {y})");
    }
    assert_eq!(store.plane(first, SLICES), None);
    let second = fill(&mut store, [4, 5, 6]);
    assert_ne!(first, second);
    assert_eq!(store.begin(), Err(StoreError::Busy));
    store.release(first);
    assert_eq!(store.plane(first, 1), None);
    assert_eq!(store.begin(), Ok(first));
    assert_eq!(
        store.finish(first, &end([1, 2, 3])),
        Err(StoreError::SliceMissing { slice: 0 }),
        "left from the turn before"
    );
}

#[test]
fn a_finished_turn_is_never_written() {
    let mut store = store();
    let turn = fill(&mut store, [1, 2, 3]);
    store.finish(turn, &end([1, 2, 3])).unwrap();
    assert_eq!(write(&mut store, turn, 0, &plane(9)), Err(StoreError::NotFilling(turn.0)));
    assert_eq!(store.finish(turn, &end([1, 2, 3])), Err(StoreError::NotFilling(turn.0)));
    assert_eq!(store.configure(SLICES + 1, size()), Err(StoreError::InUse));
    assert_eq!(store.configure(SLICES, size()), Ok(()));
    assert_eq!(store.plane(turn, 0).unwrap().bytes(), plane(1));
    assert_eq!(write(&mut store, TurnHandle(9), 0, &plane(9)), Err(StoreError::NotFilling(9)));
}

#[test]
fn what_is_wrong_is_refused() {
    assert_eq!(MemoryStore::new().begin(), Err(StoreError::NotConfigured));
    let large = ImageSize::new(4096, 4096).unwrap();
    let refused = StoreError::TooLarge { slices: 4080, plane_bytes: 2 << 20 };
    assert_eq!(MemoryStore::new().configure(4080, large), Err(refused));
    assert_eq!(MemoryStore::new().configure(288, large), Ok(()));
    let mut store = store();
    let turn = store.begin().unwrap();
    assert_eq!(write(&mut store, turn, 3, &plane(1)), Err(StoreError::SliceOutOfRange { slice: 3, slices: 3 }));
    let stream = compressed(&plane(1));
    let wrong = PlaneData { check: 5, ..part(0, &plane(1), &stream, 0, stream.len()) };
    assert!(matches!(
        store.write(turn, &wrong),
        Err(StoreError::Damaged { slice: 0, error: ExpandError::Check { .. } })
    ));
    let wrong = PlaneData { total: 2, ..wrong };
    assert!(matches!(store.write(turn, &wrong), Err(StoreError::PartTooLong { slice: 0, .. })));
    (0..3).for_each(|slice| write(&mut store, turn, slice, &plane(slice as u8)).unwrap());
    assert!(matches!(store.finish(turn, &end([0, 2, 1])), Err(StoreError::Check { .. })), "slices exchanged");
    assert_eq!(store.finish(turn, &end([0, 1, 2])), Ok(()));
}

#[test]
fn parts_follow_each_other() {
    let mut store = store();
    let turn = store.begin().unwrap();
    let (plane, stream) = (plane(7), compressed(&plane(7)));
    let half = stream.len() / 2;
    let (first, second) = (part(0, &plane, &stream, 0, half), part(0, &plane, &stream, half, stream.len() - half));
    let missing = |expected| Err(StoreError::PartMissing { slice: 0, offset: half as u32, expected });
    assert_eq!(store.write(turn, &second), missing(0));
    let quarter = part(0, &plane, &stream, 0, half / 2);
    assert_eq!(store.write(turn, &quarter), Ok(()));
    assert_eq!(store.write(turn, &second), missing(half as u32 / 2));
    // Repeated packets do no harm.
    for part in [first, first, second, second, first] {
        assert_eq!(store.write(turn, &part), Ok(()));
    }
    // Another plane in between: this one starts again.
    assert_eq!(store.write(turn, &PlaneData { slice: 1, ..first }), Ok(()));
    assert_eq!(write(&mut store, turn, 2, &plane), Ok(()));
    let refused = StoreError::PartMissing { slice: 1, offset: half as u32, expected: 0 };
    assert_eq!(store.write(turn, &PlaneData { slice: 1, ..second }), Err(refused));
}
