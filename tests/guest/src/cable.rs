//! A cable from a simulated device to this kernel: what is plugged in, pulled out and made difficult.

use hil_sim::usb::{Function, Port};
use hil_sim::usbip::{serve, wire::HIGH_SPEED};
use std::fs;
use std::io;
use std::net::Shutdown;
use std::os::fd::AsRawFd;
use std::os::unix::net::UnixStream;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread::JoinHandle;
use std::time::Duration;

const ATTACH: &str = "/sys/devices/platform/vhci_hcd.0/attach";

type Order<F> = Box<dyn FnOnce(&mut Port<F>) + Send>;

/// A device that is plugged in again whenever it has left the bus, until the cable is dropped.
pub struct Cable<F> {
    orders: Sender<Order<F>>,
    is_wanted: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl<F: Function + 'static> Cable<F> {
    /// Plugs the device that `make` makes into the kernel's `port`.
    pub fn plug(port: u8, make: impl FnOnce() -> F + Send + 'static) -> Self {
        let (orders, received) = channel();
        let is_wanted = Arc::new(AtomicBool::new(true));
        let wanted = Arc::clone(&is_wanted);
        let thread = std::thread::spawn(move || {
            let mut device = Port::new(make());
            while wanted.load(Ordering::Relaxed) {
                if let Err(error) = attach(port, &mut device, &received, &wanted) {
                    println!("cable {port}: {error}");
                }
                wait_until_gone(port);
            }
        });
        Self { orders, is_wanted, thread: Some(thread) }
    }

    /// Does something with the device and returns what comes of it. Waits until it is plugged in.
    pub fn ask<T: Send + 'static>(&self, what: impl FnOnce(&mut Port<F>) -> T + Send + 'static) -> T {
        let (answer, answered) = channel();
        self.tell(move |port| drop(answer.send(what(port))));
        answered.recv().expect("the cable's thread runs")
    }

    /// Does something with the device, about a millisecond later.
    pub fn tell(&self, what: impl FnOnce(&mut Port<F>) + Send + 'static) {
        self.orders.send(Box::new(what)).expect("the cable's thread runs");
    }
}

impl<F> Drop for Cable<F> {
    fn drop(&mut self) {
        self.is_wanted.store(false, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            // It prints its own panic.
            let _ = thread.join();
        }
    }
}

/// The kernel takes its leave of a device in its own time.
fn wait_until_gone(port: u8) {
    // Bus 1 is that of high speed; its ports count from 1.
    let device = format!("/sys/bus/usb/devices/1-{}", port + 1);
    while fs::exists(&device).unwrap_or(false) {
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// Serves the device until it leaves the bus.
fn attach<F: Function>(
    port: u8,
    device: &mut Port<F>,
    orders: &Receiver<Order<F>>,
    is_wanted: &AtomicBool,
) -> io::Result<()> {
    let (ours, kernels) = UnixStream::pair()?;
    // Bus 1, device 2, as the server has them.
    let line = format!("{port} {} {} {HIGH_SPEED}", kernels.as_raw_fd(), 1 << 16 | 2);
    fs::write(ATTACH, &line)?;
    // The kernel has its own hold of it now, and is to see the end of the connection.
    drop(kernels);
    let ending = serve(ours.try_clone()?, &ours, device, |device| {
        orders.try_iter().for_each(|order| order(device));
        if !is_wanted.load(Ordering::Relaxed) {
            device.unplug();
        }
    });
    ours.shutdown(Shutdown::Both)?;
    ending.map(drop).map_err(io::Error::other)
}
