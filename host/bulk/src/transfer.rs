//! libusb's asynchronous transfers.
#![allow(unsafe_code)]

use crate::{Error, Transfer};
use rusb::ffi::constants::*;
use rusb::ffi::{
    libusb_alloc_transfer, libusb_cancel_transfer, libusb_fill_bulk_transfer, libusb_free_transfer,
    libusb_submit_transfer, libusb_transfer,
};
use rusb::{Context, DeviceHandle};
use std::os::raw::c_int;
use std::ptr::NonNull;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// From [`submit`](Transfer::submit) until libusb calls [`end`], transfer, buffer and device are libusb's; `is_ended` tells.
pub struct UsbTransfer {
    /// From `libusb_alloc_transfer`.
    transfer: NonNull<libusb_transfer>,
    /// From `Box::into_raw`: a box says that nobody else writes there.
    buffer: NonNull<[u8]>,
    endpoint: u8,
    /// True where libusb has nothing of this.
    is_ended: Arc<AtomicBool>,
    device: Arc<DeviceHandle<Context>>,
}

// SAFETY: the pointers are this value's own, and libusb lets any thread submit, cancel and free a transfer. Another thread that handles
// events of the same context sets `is_ended` by release, after its last write to the transfer; it is read by acquire.
unsafe impl Send for UsbTransfer {}

impl UsbTransfer {
    pub(crate) fn new(device: Arc<DeviceHandle<Context>>, endpoint: u8, bytes: usize) -> Result<Self, Error> {
        // SAFETY: no condition; null where there is no memory.
        let transfer = NonNull::new(unsafe { libusb_alloc_transfer(0) }).ok_or(Error::NoMem)?;
        let buffer = NonNull::from(Box::leak(vec![0; bytes].into_boxed_slice()));
        Ok(Self { transfer, buffer, endpoint, is_ended: Arc::new(AtomicBool::new(true)), device })
    }

    fn is_ended(&self) -> bool {
        self.is_ended.load(Ordering::Acquire)
    }
}

/// What libusb calls, in whichever thread handles its events, when a transfer has ended. It touches the transfer no more afterwards.
extern "system" fn end(transfer: *mut libusb_transfer) {
    // SAFETY: libusb gives the transfer that was submitted, whose user data is the flag of a `UsbTransfer`: that lives, or was leaked,
    // as long as the transfer is in flight. An atomic store does not panic.
    unsafe { (*(*transfer).user_data.cast::<AtomicBool>()).store(true, Ordering::Release) }
}

impl Transfer for UsbTransfer {
    fn buffer(&mut self) -> &mut [u8] {
        if !self.is_ended() {
            return &mut [];
        }
        // SAFETY: valid for as long as this value, and libusb does not have it. It is borrowed as this value is, which `submit` needs whole.
        unsafe { self.buffer.as_mut() }
    }

    fn submit(&mut self, length: usize) -> Result<(), Error> {
        if !self.is_ended() {
            return Err(Error::Busy);
        }
        let length = c_int::try_from(length.min(self.buffer.len())).map_err(|_| Error::InvalidParam)?;
        let flag = Arc::as_ptr(&self.is_ended).cast_mut().cast();
        let (device, buffer) = (self.device.as_raw(), self.buffer.as_ptr().cast());
        self.is_ended.store(false, Ordering::Relaxed);
        // SAFETY: libusb does not have the transfer. Device, buffer of at least `length` bytes, and flag stay until it has ended: `drop`
        // leaks them otherwise. No timeout.
        let result = unsafe {
            libusb_fill_bulk_transfer(self.transfer.as_ptr(), device, self.endpoint, buffer, length, end, flag, 0);
            libusb_submit_transfer(self.transfer.as_ptr())
        };
        if result == LIBUSB_SUCCESS {
            return Ok(());
        }
        self.is_ended.store(true, Ordering::Relaxed);
        Err(match result {
            LIBUSB_ERROR_NO_DEVICE => Error::NoDevice,
            LIBUSB_ERROR_NO_MEM => Error::NoMem,
            LIBUSB_ERROR_BUSY => Error::Busy,
            LIBUSB_ERROR_INVALID_PARAM => Error::InvalidParam,
            _ => Error::Io,
        })
    }

    fn outcome(&self) -> Option<Result<usize, Error>> {
        if !self.is_ended() {
            return None;
        }
        // SAFETY: allocated, and libusb has it no more.
        let (status, moved, asked) = unsafe {
            let transfer = self.transfer.as_ptr();
            ((*transfer).status, (*transfer).actual_length, (*transfer).length)
        };
        let is_short = moved < asked && self.endpoint & LIBUSB_ENDPOINT_DIR_MASK == LIBUSB_ENDPOINT_OUT;
        Some(match status {
            LIBUSB_TRANSFER_COMPLETED if !is_short => usize::try_from(moved).map_err(|_| Error::Io),
            LIBUSB_TRANSFER_STALL => Err(Error::Pipe),
            LIBUSB_TRANSFER_NO_DEVICE => Err(Error::NoDevice),
            LIBUSB_TRANSFER_OVERFLOW => Err(Error::Overflow),
            LIBUSB_TRANSFER_TIMED_OUT => Err(Error::Timeout),
            LIBUSB_TRANSFER_CANCELLED => Err(Error::Interrupted),
            _ => Err(Error::Io),
        })
    }

    fn cancel(&mut self) {
        if !self.is_ended() {
            // SAFETY: allocated, and submitted at least once. One that ends meanwhile is not found, which does no harm.
            unsafe { libusb_cancel_transfer(self.transfer.as_ptr()) };
        }
    }
}

impl Drop for UsbTransfer {
    fn drop(&mut self) {
        if self.is_ended() {
            // SAFETY: from `libusb_alloc_transfer` and from a box, and libusb has neither.
            unsafe {
                libusb_free_transfer(self.transfer.as_ptr());
                drop(Box::from_raw(self.buffer.as_ptr()));
            }
        } else {
            // libusb may still write there: transfer and buffer are leaked, the flag and the open device with them.
            std::mem::forget((Arc::clone(&self.is_ended), Arc::clone(&self.device)));
        }
    }
}
