//! The Ethernet controller (LAN9118), as a channel that keeps frames whole: a serial port of this machine takes 50 us a byte, a frame 100.
//!
//! Whoever is at the other end of the emulator's virtual cable gets every frame; addresses mean nothing.

use crate::machine::Register;
use core::future::poll_fn;
use core::task::Poll;
use embassy_sync::waitqueue::AtomicWaker;
use heapless::Vec;

/// Bytes before the payload: two addresses and a type.
const HEADER_BYTES: usize = 14;
/// To everybody, from a made-up address, of the type that is free for experiments.
const HEADER: [u8; HEADER_BYTES] = [0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 2, 0, 0, 0, 0, 1, 0x88, 0xb5];
/// A checksum that the controller leaves at a frame's end.
const CHECK_BYTES: usize = 4;

/// Interrupts: on, active high, push-pull.
const INTERRUPT_LINE: u32 = 0x111;
/// A frame has come.
const RECEIVED: u32 = 1 << 3;
const TRANSMITTER_ON: u32 = 1 << 1;
/// The MAC's control register: both directions, whatever the address.
const MAC_CONTROL: u32 = 1;
const MAC_ON: u32 = (1 << 2) | (1 << 3) | (1 << 18);
const MAC_BUSY: u32 = 1 << 31;
/// A transmit command: first and last segment.
const WHOLE: u32 = (1 << 13) | (1 << 12);

/// The controller.
pub struct Ethernet {
    base: usize,
    receiver: AtomicWaker,
}

impl Ethernet {
    /// At `base`, which must be the machine's.
    pub const fn at(base: usize) -> Self {
        Self { base, receiver: AtomicWaker::new() }
    }

    fn register(&self, offset: usize) -> Register {
        Register::at(self.base + offset)
    }

    /// Switches it on.
    pub fn start(&self) {
        self.register(0xa8).write(MAC_ON);
        self.register(0xa4).write(MAC_BUSY | MAC_CONTROL);
        self.register(0x70).write(TRANSMITTER_ON);
        self.register(0x5c).write(RECEIVED);
        self.register(0x54).write(INTERRUPT_LINE);
    }

    /// To be called by its interrupt.
    pub fn interrupted(&self) {
        self.register(0x58).write(RECEIVED);
        self.receiver.wake();
    }

    /// Waits for a frame. No `async fn`: one that was polled after its end would panic.
    pub fn received(&self) -> impl Future<Output = ()> {
        poll_fn(|context| {
            self.receiver.register(context.waker());
            let frames = (self.register(0x7c).read() >> 16) & 0xff;
            if frames == 0 { Poll::Pending } else { Poll::Ready(()) }
        })
    }

    /// The payload of the frame that has come, cut where it is too long.
    pub fn take<const N: usize>(&self) -> Vec<u8, N> {
        let mut payload = Vec::new();
        let length = (self.register(0x40).read() >> 16) as usize & 0x3fff;
        let ours = HEADER_BYTES..length.saturating_sub(CHECK_BYTES);
        for at in (0..length).step_by(4) {
            for (i, byte) in self.register(0).read().to_le_bytes().into_iter().enumerate() {
                if ours.contains(&(at + i)) {
                    // One that is too long is no message.
                    let _ = payload.push(byte);
                }
            }
        }
        payload
    }

    /// Sends `payload`, which takes no time.
    pub fn send(&self, payload: &[u8]) {
        let length = HEADER_BYTES + payload.len();
        let fifo = self.register(0x20);
        fifo.write(WHOLE | length as u32);
        fifo.write(length as u32);
        let mut bytes = HEADER.iter().chain(payload).copied();
        for _ in (0..length).step_by(4) {
            fifo.write(u32::from_le_bytes(core::array::from_fn(|_| bytes.next().unwrap_or(0))));
        }
        // Its status is of no interest, and would fill a queue.
        self.register(0x48).read();
    }
}
