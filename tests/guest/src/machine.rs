//! The virtual machine, as its first program finds it: bare.

use rustix::mount::{MountFlags, mount};
use rustix::system::{RebootCommand, finit_module, reboot};
use std::fs::File;
use std::io;

/// What the kernel needs to attach a device, in the order in which they need each other.
const MODULES: [&str; 4] = ["usb-common", "usbcore", "usbip-core", "vhci-hcd"];

/// Makes USB and its devices visible.
pub fn set_up() -> io::Result<()> {
    for (what, place) in [("sysfs", "/sys"), ("devtmpfs", "/dev"), ("tmpfs", "/tmp")] {
        std::fs::create_dir_all(place)?;
        mount(what, place, what, MountFlags::empty(), None)?;
    }
    for name in MODULES {
        finit_module(File::open(format!("/modules/{name}.ko"))?, c"", 0)?;
    }
    Ok(())
}

/// Ends it.
pub fn power_off() -> io::Result<()> {
    Ok(reboot(RebootCommand::PowerOff)?)
}
