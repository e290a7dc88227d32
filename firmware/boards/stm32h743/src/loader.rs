//! The boot loader: the thin shell of `update`. It starts what `update` decides, under a watchdog, or waits for an image over USB.
#![no_std]
#![no_main]

use core::sync::atomic::{AtomicBool, Ordering};
use cortex_m::peripheral::{NVIC, SCB};
use embassy_executor::Spawner;
use embassy_stm32::wdg::IndependentWatchdog;
use embassy_usb::class::dfu::consts::{DfuAttributes, Status};
use embassy_usb::class::dfu::dfu_mode::{DfuState, Handler};
use embassy_usb::types::InterfaceNumber;
use protocol::image::Identity;
use static_cell::StaticCell;
use stm32h743::flash::{SharedFlash, Slot};
use stm32h743::layout::{ACTIVE, FLASH_BASE, HEADER};
use stm32h743::owner::owner;
use stm32h743::{clocks, flash, keep, usb, usb_pins};
use update::image::{Owner, Refusal};
use update::loader::{Decision, Slots};
use update::updater::{Accept, Transfer};

/// Bytes of a block of the download.
const BLOCK: usize = 4096;
/// DFU 1.1, section 4.2.3 and 4.1.3: the interface of a device that takes an image, and the descriptor behind its settings.
const DFU_INTERFACE: [u8; 3] = [0xFE, 1, 2];
const DFU_FUNCTIONAL: u8 = 0x21;
/// The host makes the device restart by a reset of the bus, which it gives after a manifestation that is neither tolerant nor detaches.
const ATTRIBUTES: DfuAttributes = DfuAttributes::CAN_DOWNLOAD;

/// How long an application may take until it has found itself whole. It then sets a shorter time itself; if it does not, the watchdog
/// resets it.
const TRIAL_US: u32 = 16_000_000;

#[embassy_executor::main(entry = "cortex_m_rt::entry")]
async fn main(_spawner: Spawner) {
    let p = embassy_stm32::init(clocks::config());
    let wanted = keep::take_download_wanted();
    static FLASH: StaticCell<SharedFlash> = StaticCell::new();
    let flash = FLASH.init(flash::shared(p.FLASH));
    let decision = owner().and_then(|owner| flash::slots(flash).ok()?.boot(&owner).ok());
    if matches!(decision, Some(Decision::Run(_) | Decision::Try(..))) && !wanted {
        IndependentWatchdog::new(p.IWDG1, TRIAL_US).unleash();
        start(FLASH_BASE + ACTIVE.offset + HEADER)
    }
    let runs = match decision {
        Some(Decision::Run(header) | Decision::Try(header, _)) => Some(header.identity()),
        _ => None,
    };
    download(usb_pins!(p), flash, runs).await;
}

/// Starts the program whose vectors are at `vectors`, which somebody has signed.
fn start(vectors: u32) -> ! {
    // SAFETY: registers that clear enables and pending bits, and where the vectors are; nothing of this program is used again. What
    // starts was verified.
    unsafe {
        let controller = &*NVIC::PTR;
        for (enabled, pending) in controller.icer.iter().zip(&controller.icpr) {
            enabled.write(!0);
            pending.write(!0);
        }
        (*SCB::PTR).vtor.write(vectors);
        cortex_m::asm::bootload(vectors as *const u32)
    }
}

/// A device of class DFU, until the host resets it. `runs` is what would be started.
async fn download(pins: usb::Pins, flash: &'static SharedFlash, runs: Option<Identity>) {
    static CONTROL: StaticCell<[u8; BLOCK]> = StaticCell::new();
    static STATE: StaticCell<DfuState<Download>> = StaticCell::new();
    static SETTING: StaticCell<Setting> = StaticCell::new();
    let mut builder = usb::builder(pins, "loader", runs, &CONTROL);
    let [low, high] = (BLOCK as u16).to_le_bytes();
    let mut function = builder.function(0, 0, 0);
    let mut interface = function.interface();
    let [class, subclass, protocol] = DFU_INTERFACE;
    // Setting 0 takes newer images, 1 any.
    for _ in [Accept::Newer, Accept::Any] {
        let mut setting = interface.alt_setting(class, subclass, protocol, None);
        // No time to detach, which it already is; DFU 1.1.
        setting.descriptor(DFU_FUNCTIONAL, &[ATTRIBUTES.bits(), 0, 0, low, high, 0x10, 0x01]);
    }
    drop(function);
    builder.handler(STATE.init(DfuState::new(Download { flash, under_way: None }, ATTRIBUTES)));
    builder.handler(SETTING.init(Setting));
    builder.build().run().await;
}

/// Whether the host has chosen the alternate setting that takes any version.
static TAKES_ANY: AtomicBool = AtomicBool::new(false);

/// Hears which alternate setting is on. There is one interface; a reset of the bus puts it back to 0.
struct Setting;

impl embassy_usb::Handler for Setting {
    fn set_alternate_setting(&mut self, _: InterfaceNumber, setting: u8) {
        TAKES_ANY.store(setting == 1, Ordering::Relaxed);
    }
}

type OurSlots = Slots<Slot<'static>, Slot<'static>, Slot<'static>>;

/// What comes in.
struct Download {
    flash: &'static SharedFlash,
    under_way: Option<(OurSlots, Transfer)>,
}

impl Handler for Download {
    fn start(&mut self) -> Result<(), Status> {
        let owner: Owner = owner().ok_or(Status::ErrVendor)?;
        let slots = flash::slots(self.flash).map_err(|_| Status::ErrFirmware)?;
        let accept = if TAKES_ANY.load(Ordering::Relaxed) { Accept::Any } else { Accept::Newer };
        self.under_way = Some((slots, Transfer::new(owner, accept)));
        Ok(())
    }

    fn write(&mut self, data: &[u8]) -> Result<(), Status> {
        let (slots, transfer) = self.under_way.as_mut().ok_or(Status::ErrNotDone)?;
        transfer.take(slots, data).map_err(|refusal| status(&refusal))
    }

    fn finish(&mut self) -> Result<(), Status> {
        let (mut slots, transfer) = self.under_way.take().ok_or(Status::ErrNotDone)?;
        transfer.finish(&mut slots).map(drop).map_err(|refusal| status(&refusal))
    }

    fn system_reset(&mut self) {
        SCB::sys_reset()
    }
}

/// The nearest of DFU's words.
fn status(refusal: &Refusal) -> Status {
    match refusal {
        Refusal::Image(_) | Refusal::Size { .. } => Status::ErrFile,
        Refusal::Board { .. } | Refusal::Version { .. } => Status::ErrTarget,
        Refusal::Signature => Status::ErrVerify,
        Refusal::Flash(_) => Status::ErrWrite,
        Refusal::OnTrial => Status::ErrFirmware,
        Refusal::Order { .. } => Status::ErrAddress,
    }
}
