//! The boot loader: finishes or takes back an interrupted swap, takes a download over USB where one is wanted or nothing can be started,
//! else starts the application under a watchdog.
#![no_std]
#![no_main]

use embassy_boot_stm32::{AlignedBuffer, BlockingFirmwareUpdater, BootLoader, BootLoaderConfig, FirmwareUpdaterConfig};
use embassy_executor::Spawner;
use embassy_stm32::flash::WRITE_SIZE;
use embassy_stm32::wdg::IndependentWatchdog;
use embassy_usb_dfu::ResetImmediate;
use embassy_usb_dfu::consts::DfuAttributes;
use embedded_storage::nor_flash::ReadNorFlash;
use static_cell::StaticCell;
use stm32h743::flash::{self, SharedFlash, Slot};
use stm32h743::layout::{ACTIVE, FLASH_BASE, RAM_BASE, RAM_SIZE};
use stm32h743::{clocks, keep, usb, usb_pins};

/// Bytes of a block of the download: whole words of flash.
const BLOCK: usize = 4096;
/// How long an application may take until it has found itself whole. It then sets a shorter time itself; if it does not, the watchdog
/// resets it, and this loader brings the one before back.
const TRIAL_US: u32 = 16_000_000;

type Download = embassy_usb_dfu::State<'static, Slot<'static>, Slot<'static>, ResetImmediate, BLOCK>;

#[embassy_executor::main(entry = "cortex_m_rt::entry")]
async fn main(_spawner: Spawner) {
    let p = embassy_stm32::init(clocks::config());
    let wanted = keep::take_download_wanted();
    static FLASH: StaticCell<SharedFlash> = StaticCell::new();
    let flash = FLASH.init(flash::shared(p.FLASH));
    let (dfu, state) = flash::download_and_state(flash);
    let config = BootLoaderConfig { active: flash::slot(flash, &ACTIVE), dfu, state };
    let prepared = BootLoader::try_prepare::<_, _, _, BLOCK>(config);
    match prepared {
        Ok(loader) if !wanted && holds_application(flash) => {
            IndependentWatchdog::new(p.IWDG1, TRIAL_US).unleash();
            silence();
            // SAFETY: a stack pointer into RAM and an entry into the slot are there, no interrupt of this program is on, and nothing of
            // it is used again.
            unsafe { loader.load(FLASH_BASE + ACTIVE.offset) }
        }
        _ => download(usb_pins!(p), flash).await,
    }
}

/// No interrupt of this program reaches the next one.
fn silence() {
    // SAFETY: the registers that clear enables and pending bits, of which every bit may be written at any time.
    let controller = unsafe { &*cortex_m::peripheral::NVIC::PTR };
    for (enabled, pending) in controller.icer.iter().zip(&controller.icpr) {
        // SAFETY: as above.
        unsafe {
            enabled.write(!0);
            pending.write(!0);
        }
    }
}

/// Whether the active slot begins as a program does: with a stack pointer into RAM and an entry into the slot.
fn holds_application(flash: &SharedFlash) -> bool {
    let mut words = [0; 8];
    let read = flash.lock(|flash| flash.borrow_mut().read(ACTIVE.offset, &mut words));
    let [stack, entry] = [[0, 1, 2, 3], [4, 5, 6, 7]].map(|at| u32::from_le_bytes(at.map(|at| words[at])));
    let start = FLASH_BASE + ACTIVE.offset;
    read.is_ok() && (RAM_BASE..=RAM_BASE + RAM_SIZE).contains(&stack) && (start..start + ACTIVE.size).contains(&entry)
}

/// A device of class DFU, until the host resets it.
async fn download(pins: usb::Pins, flash: &'static SharedFlash) -> ! {
    static CONTROL: StaticCell<[u8; BLOCK]> = StaticCell::new();
    static ALIGNED: StaticCell<AlignedBuffer<WRITE_SIZE>> = StaticCell::new();
    static STATE: StaticCell<Download> = StaticCell::new();
    let (dfu, state) = flash::download_and_state(flash);
    let aligned = ALIGNED.init(AlignedBuffer([0; WRITE_SIZE]));
    let updater = BlockingFirmwareUpdater::new(FirmwareUpdaterConfig { dfu, state }, &mut aligned.0);
    let attributes = DfuAttributes::CAN_DOWNLOAD | DfuAttributes::MANIFESTATION_TOLERANT;
    let state = STATE.init(embassy_usb_dfu::new_state(updater, attributes, ResetImmediate));
    let mut builder = usb::builder(pins, "Praxinoscope controller, loader", &CONTROL);
    embassy_usb_dfu::usb_dfu(&mut builder, state, |_| {});
    builder.build().run().await
}
