use super::*;
use proptest::prelude::*;

fn stalled() -> FaultLog {
    let mut log = FaultLog::default();
    log.latch(Fault::Stall, Cause::time(Nanos(1_000_250_000), Nanos(1_000_000_000)), Nanos(7_000_000_999));
    log
}

#[test]
fn the_first_fault_holds_with_its_cause_and_is_counted() {
    let mut log = stalled();
    log.latch(Fault::Overspeed, Cause::LEVEL, Nanos(8_000_000_000));
    let faults = log.faults();
    assert_eq!((faults.latched, faults.at_us), (Some(Fault::Stall), 7_000_000));
    assert_eq!((faults.value_micro, faults.limit_micro), (1_000_250, 1_000_000));
    assert_eq!((faults.count(Fault::Stall), faults.count(Fault::Overspeed)), (1, 0));
    log.clear();
    log.latch(Fault::Stall, Cause { value: f32::NAN, ..Cause::LEVEL }, Nanos(9_000_000_000));
    assert_eq!((log.faults().count(Fault::Stall), log.faults().value_micro), (2, 0));
}

#[test]
fn a_count_stops_at_its_largest() {
    let mut log = stalled();
    for _ in 0..70_000 {
        log.clear();
        log.latch(Fault::Stall, Cause::LEVEL, Nanos::ZERO);
    }
    assert_eq!(log.faults().count(Fault::Stall), u16::MAX);
}

#[test]
fn a_memory_that_was_never_written_is_a_fault() {
    for fill in [0x00, 0xff, 0x5a] {
        assert_eq!(FaultLog::from_bytes(&[fill; LOG_BYTES]).latched(), Some(Fault::Unknown));
    }
}

#[test]
fn every_bit_counts() {
    for log in [FaultLog::default(), stalled()] {
        let bytes = log.to_bytes();
        assert_eq!(FaultLog::from_bytes(&bytes), log);
        for bit in 0..8 * LOG_BYTES {
            let mut damaged = bytes;
            damaged[bit / 8] ^= 1 << (bit % 8);
            assert_eq!(FaultLog::from_bytes(&damaged).latched(), Some(Fault::Unknown), "bit {bit}");
        }
    }
}

/// Every byte that was or was not written yet, in order and against it: what is read is the old log, the new one, or a fault.
#[test]
fn a_torn_write_never_forgets_a_fault() {
    let mut cleared = stalled();
    cleared.clear();
    let logs = [FaultLog::default(), stalled(), cleared];
    for (old, new) in logs.iter().flat_map(|old| logs.iter().map(move |new| (old, new))) {
        for cut in 0..=LOG_BYTES {
            for upwards in [true, false] {
                let (mut bytes, from) = (old.to_bytes(), new.to_bytes());
                let written = if upwards { 0..cut } else { cut..LOG_BYTES };
                bytes[written.clone()].copy_from_slice(&from[written]);
                let read = FaultLog::from_bytes(&bytes);
                assert!(read == *old || read == *new || read.latched() == Some(Fault::Unknown), "{cut} {upwards}");
            }
        }
    }
}

proptest! {
    #[test]
    fn a_log_comes_back_as_it_was(faults in prop::collection::vec((0..Fault::ALL.len(), any::<f32>(), any::<u64>()), 0..9)) {
        let mut log = FaultLog::default();
        for (fault, value, at) in faults {
            log.clear();
            log.latch(Fault::ALL[fault], Cause { quantity: Quantity::Speed, value, limit: 3.0 }, Nanos(at));
            prop_assert_eq!(FaultLog::from_bytes(&log.to_bytes()), log);
        }
    }

    #[test]
    fn noise_is_no_log(noise in prop::collection::vec(any::<u8>(), LOG_BYTES)) {
        let bytes = *noise.first_chunk().unwrap();
        prop_assert_eq!(FaultLog::from_bytes(&bytes).latched(), Some(Fault::Unknown));
    }
}
