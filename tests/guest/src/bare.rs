//! The device by plain libusb, one transfer at a time: what this machine can carry.

use crate::cable::Cable;
use crate::controller::{Sink, board};
use hil_sim::usb::board::{Board, ID};
use hil_sim::usb::descriptors::{IN, OUT};
use rusb::{Context, DeviceHandle, Error, UsbContext};
use std::time::{Duration, Instant};

/// How long a device may take to appear, or a transfer that is to end.
pub const PATIENCE: Duration = Duration::from_secs(10);
const MEGABYTE: f64 = 1e6;

/// Opens the one controller, as soon as it is there.
pub fn open() -> Result<DeviceHandle<Context>, Error> {
    let context = Context::new()?;
    let until = Instant::now() + PATIENCE;
    loop {
        match context.open_device_with_vid_pid(ID.0, ID.1) {
            Some(handle) => {
                handle.claim_interface(0)?;
                return Ok(handle);
            }
            None if Instant::now() > until => return Err(Error::NoDevice),
            None => std::thread::sleep(Duration::from_millis(5)),
        }
    }
}

/// Writes at least `total` bytes in pieces of `size`: megabytes a second.
fn speed(handle: &DeviceHandle<Context>, size: usize, total: usize) -> Result<f64, Error> {
    let bytes = vec![0x5A; size];
    let count = total.div_ceil(size);
    let start = Instant::now();
    for _ in 0..count {
        assert_eq!(handle.write_bulk(OUT, &bytes, PATIENCE)?, size);
    }
    Ok((count * size) as f64 / MEGABYTE / start.elapsed().as_secs_f64())
}

/// The middle one.
pub fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

/// The best that a loop of plain writes moves, by their size: megabytes a second, median of `rounds`.
pub fn best(rounds: usize) -> Result<f64, Error> {
    let handle = open()?;
    let mut best = 0.0_f64;
    for (size, total) in
        [(512, 1 << 18), (16 << 10, 4 << 20), (64 << 10, 16 << 20), (256 << 10, 16 << 20), (1 << 20, 32 << 20)]
    {
        let speeds: Result<Vec<_>, _> = (0..rounds).map(|_| speed(&handle, size, total)).collect();
        let speed = median(speeds?);
        println!("bare loop, writes of {size:7} bytes: {speed:5.1} MB/s");
        best = best.max(speed);
    }
    Ok(best)
}

/// Bytes go out by a bare loop.
pub fn moves_bytes() {
    let _cable = Cable::plug(0, || board(Sink, "1"));
    assert!(best(3).unwrap() > 0.0);
}

/// What a device does that makes it difficult arrives as libusb's errors, and passes.
pub fn errors_arrive() {
    let cable = Cable::plug(0, || board(Sink, "1"));
    let handle = open().unwrap();
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
    assert_eq!(cable.ask(|port: &mut hil_sim::usb::Port<Board<Sink>>| port.pending()), (0, 0));
    handle.reset().unwrap();
    assert_eq!(write(1000), Ok(100));
    cable.tell(|port| port.unplug());
    let gone = (0..200).find_map(|_| write(1000).err());
    assert!(matches!(gone, Some(Error::NoDevice | Error::Io | Error::Pipe)), "{gone:?}");
    drop(handle);
    // The cable has plugged it in again.
    assert_eq!(open().unwrap().write_bulk(OUT, &[1; 100], PATIENCE), Ok(100));
}
