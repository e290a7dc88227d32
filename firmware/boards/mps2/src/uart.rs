//! A CMSDK UART for tasks. It holds one byte each way and needs no queue: the emulator keeps back what follows until that byte is read.

use crate::machine::Register;
use core::future::poll_fn;
use core::task::Poll;
use embassy_sync::waitqueue::AtomicWaker;

/// Bits of the state register.
const SENDING: u32 = 1;
const RECEIVED: u32 = 2;
/// Both directions, with their interrupts.
const ENABLE: u32 = 0b1111;
/// The least that the machine takes; it has no wire.
const BAUD_DIVIDER: u32 = 16;

/// One serial port.
pub struct Uart {
    data: Register,
    state: Register,
    control: Register,
    interrupts: Register,
    divider: Register,
    receiver: AtomicWaker,
    sender: AtomicWaker,
}

impl Uart {
    /// At `base`, which must be a UART of this machine.
    pub const fn at(base: usize) -> Self {
        Self {
            data: Register::at(base),
            state: Register::at(base + 4),
            control: Register::at(base + 8),
            interrupts: Register::at(base + 12),
            divider: Register::at(base + 16),
            receiver: AtomicWaker::new(),
            sender: AtomicWaker::new(),
        }
    }

    /// Switches it on.
    pub fn start(&self) {
        self.divider.write(BAUD_DIVIDER);
        self.control.write(ENABLE);
    }

    /// To be called by both of its interrupts.
    pub fn interrupted(&self) {
        self.interrupts.write(self.interrupts.read());
        self.receiver.wake();
        self.sender.wake();
    }

    /// Waits for a byte. No `async fn`: one that was polled after its end would panic.
    pub fn read(&self) -> impl Future<Output = u8> {
        poll_fn(|context| {
            self.receiver.register(context.waker());
            if self.state.read() & RECEIVED != 0 { Poll::Ready(self.data.read() as u8) } else { Poll::Pending }
        })
    }

    /// Sends `bytes`, at the pace of whoever reads them.
    pub fn write(&self, bytes: &[u8]) -> impl Future<Output = ()> {
        let mut left = bytes.iter();
        poll_fn(move |context| {
            self.sender.register(context.waker());
            while self.state.read() & SENDING == 0 {
                match left.next() {
                    Some(byte) => self.data.write((*byte).into()),
                    None => return Poll::Ready(()),
                }
            }
            Poll::Pending
        })
    }

    /// Sends `bytes` and lets nothing else run meanwhile.
    pub fn write_now(&self, bytes: &[u8]) {
        for byte in bytes {
            while self.state.read() & SENDING != 0 {}
            self.data.write((*byte).into());
        }
    }
}
