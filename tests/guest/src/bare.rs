//! The device by plain libusb, one transfer at a time: what this machine can carry.

use crate::cable::Cable;
use crate::controller::{Sink, board};
use hil_sim::usb::board::ID;
use hil_sim::usb::descriptors::{IN, OUT};
use rusb::{Context, DeviceHandle, Error, UsbContext};
use std::fmt::Display;
use std::time::{Duration, Instant};

/// How long a device may take to appear, or a transfer that is to end.
pub const PATIENCE: Duration = Duration::from_secs(10);
pub const MEGABYTE: f64 = 1e6;

/// What `attempt` brings in the end: a device takes a while to come.
pub fn patiently<T, E: Display>(mut attempt: impl FnMut() -> Result<T, E>) -> T {
    let until = Instant::now() + PATIENCE;
    loop {
        match attempt() {
            Ok(result) => return result,
            Err(error) => assert!(Instant::now() < until, "in {PATIENCE:?}: {error}"),
        }
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// Opens the one controller, as soon as it is there.
pub fn open() -> DeviceHandle<Context> {
    patiently(|| {
        let handle = Context::new()?.open_device_with_vid_pid(ID.0, ID.1).ok_or(Error::NoDevice)?;
        handle.claim_interface(0).map(|()| handle)
    })
}

/// Writes at least `total` bytes in pieces of `size`: megabytes a second.
pub fn speed(handle: &DeviceHandle<Context>, size: usize, total: usize) -> f64 {
    let bytes = vec![0x5A; size];
    let count = total.div_ceil(size);
    let start = Instant::now();
    for _ in 0..count {
        assert_eq!(handle.write_bulk(OUT, &bytes, PATIENCE), Ok(size));
    }
    (count * size) as f64 / MEGABYTE / start.elapsed().as_secs_f64()
}

/// The middle one.
pub fn median<const N: usize>(mut values: [f64; N]) -> f64 {
    values.sort_by(f64::total_cmp);
    values[N / 2]
}

/// The sizes of its writes by which a bare loop is fastest, and how fast that is: megabytes a second.
pub fn fastest() -> (usize, f64) {
    const SIZES: [(usize, usize); 5] =
        [(512, 1 << 20), (16 << 10, 16 << 20), (64 << 10, 32 << 20), (256 << 10, 32 << 20), (1 << 20, 32 << 20)];
    let handle = open();
    let speeds = SIZES.map(|(size, total)| {
        let speed = median([(); 3].map(|()| speed(&handle, size, total)));
        println!("bare loop, writes of {size:7} bytes: {speed:5.1} MB/s");
        (size, speed)
    });
    speeds.into_iter().max_by(|a, b| a.1.total_cmp(&b.1)).expect("some sizes")
}

/// What a device does that makes it difficult arrives as libusb's errors, and passes.
pub fn errors_arrive() {
    let cable = Cable::plug(0, || board(Sink::default(), "1"));
    let handle = open();
    let write = |wait| handle.write_bulk(OUT, &[1; 100], Duration::from_millis(wait));
    assert_eq!(write(1000), Ok(100));
    cable.ask(|port| port.halt(OUT));
    assert_eq!(write(1000), Err(Error::Pipe));
    assert_eq!(write(1000), Err(Error::Pipe));
    handle.clear_halt(OUT).unwrap();
    assert_eq!(write(1000), Ok(100));
    cable.ask(|port| port.set_nak(true));
    assert_eq!(write(100), Err(Error::Timeout));
    cable.ask(|port| port.set_nak(false));
    assert_eq!(write(1000), Ok(100));
    // Nothing comes from it; taken back, the endpoint is as it was.
    assert_eq!(handle.read_bulk(IN, &mut [0; 512], Duration::from_millis(50)), Err(Error::Timeout));
    assert_eq!(cable.ask(|port| port.pending()), (0, 0));
    handle.reset().unwrap();
    assert_eq!(write(1000), Ok(100));
    cable.tell(|port| port.unplug());
    let gone = (0..200).find_map(|_| write(1000).err());
    assert!(matches!(gone, Some(Error::NoDevice | Error::Io | Error::Pipe)), "{gone:?}");
    drop(handle);
    // The cable has plugged it in again.
    assert_eq!(open().write_bulk(OUT, &[1; 100], PATIENCE), Ok(100));
}
