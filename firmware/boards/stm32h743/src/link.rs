//! The host's end: packets in bulk transfers, and the way into the loader.

use crate::control::{RELEASED, REPORT};
use crate::events;
use crate::machine::SerialPort;
use embassy_stm32::usb::Driver;
use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use embassy_sync::mutex::Mutex;
use embassy_time::{Duration, Ticker, with_timeout};
use embassy_usb::UsbDevice;
use embassy_usb::class::dfu::app_mode::{self, DfuState};
use embassy_usb::class::dfu::consts::DfuAttributes;
use embassy_usb::driver::{self, Endpoint, EndpointIn, EndpointOut};
use firmware::port_store::PortStore;
use firmware::wire_end::WireEnd;
use protocol::image::Identity;
use protocol::message::State;
use static_cell::StaticCell;
use stm32h743::keep;
use stm32h743::usb::{CONTROL_BYTES_MIN, PACKET_BYTES, Pins, Port, builder};

/// How often the controller reports.
const REPORT_EVERY: Duration = Duration::from_millis(10);
/// A host that does not fetch an answer for this long does not get it.
const FETCHED_WITHIN: Duration = Duration::from_millis(100);

type Usb = Driver<'static, Port>;
type Receiver = <Usb as driver::Driver<'static>>::EndpointOut;
type Sender = <Usb as driver::Driver<'static>>::EndpointIn;

/// What the tasks of the host's end share.
pub struct Link {
    wire: WireEnd<PortStore<SerialPort>>,
    sender: Sender,
}

/// Shared by tasks of one priority.
pub type SharedLink = Mutex<NoopRawMutex, Link>;

/// Into the loader, but not from a machine that turns.
struct IntoLoader;

impl app_mode::Handler for IntoLoader {
    fn enter_dfu(&mut self) {
        let state = REPORT.lock(|report| report.get()).map(|(report, _)| report.state);
        if state.is_none_or(State::is_at_rest) {
            keep::want_download();
            cortex_m::peripheral::SCB::sys_reset();
        }
    }
}

/// The device with its two functions: ours, and the run-time half of DFU. Only to be called once.
pub fn open(
    pins: Pins,
    store: SerialPort,
    runs: Option<Identity>,
) -> (UsbDevice<'static, Usb>, Receiver, &'static SharedLink) {
    static CONTROL: StaticCell<[u8; CONTROL_BYTES_MIN]> = StaticCell::new();
    static DFU: StaticCell<DfuState<IntoLoader>> = StaticCell::new();
    static LINK: StaticCell<SharedLink> = StaticCell::new();
    let mut builder = builder(pins, "controller", runs, &CONTROL);
    let (receiver, sender) = {
        // Class, subclass and protocol of a vendor's own.
        let mut function = builder.function(0xff, 0, 0);
        let mut interface = function.interface();
        let mut setting = interface.alt_setting(0xff, 0, 0, None);
        (setting.endpoint_bulk_out(None, PACKET_BYTES), setting.endpoint_bulk_in(None, PACKET_BYTES))
    };
    let attributes = DfuAttributes::CAN_DOWNLOAD | DfuAttributes::WILL_DETACH;
    let dfu = DFU.init(DfuState::new(IntoLoader, attributes, Duration::from_millis(1_000)));
    app_mode::usb_dfu(&mut builder, dfu, |_| {});
    let link = LINK.init_with(|| Mutex::new(Link { wire: WireEnd::new(PortStore::new(store)), sender }));
    (builder.build(), receiver, link)
}

/// The bus itself.
#[embassy_executor::task]
pub async fn bus(mut device: UsbDevice<'static, Usb>) {
    device.run().await;
}

/// Answers every packet by one.
#[embassy_executor::task]
pub async fn answers(link: &'static SharedLink, mut receiver: Receiver) {
    let mut buffer = [0; PACKET_BYTES as usize];
    loop {
        receiver.wait_enabled().await;
        while let Ok(length) = receiver.read(&mut buffer).await {
            link.lock().await.hear(buffer.get(..length).unwrap_or_default()).await;
        }
        link.lock().await.wire.disconnect();
    }
}

/// Reports, once a host has said hello.
#[embassy_executor::task]
pub async fn reports(link: &'static SharedLink) {
    let mut ticker = Ticker::every(REPORT_EVERY);
    loop {
        ticker.next().await;
        let mut link = link.lock().await;
        if let Some((report, faults)) = REPORT.lock(|report| report.get()) {
            for packet in [link.wire.status(&report), link.wire.faults(faults)].into_iter().flatten() {
                link.send(&packet).await;
            }
        }
    }
}

impl Link {
    async fn hear(&mut self, mut bytes: &[u8]) {
        while !bytes.is_empty() {
            while let Ok(turn) = RELEASED.try_receive() {
                self.wire.conversation.release(turn);
            }
            let Some((answer, request)) = self.wire.hear(&mut bytes) else { return };
            if let Some(request) = request {
                events::ask(request).await;
            }
            self.send(&answer).await;
        }
    }

    async fn send(&mut self, bytes: &[u8]) {
        for packet in bytes.chunks(PACKET_BYTES.into()) {
            if !matches!(with_timeout(FETCHED_WITHIN, self.sender.write(packet)).await, Ok(Ok(()))) {
                return;
            }
        }
    }
}
