//! Where everything lies in the memory of the board STM32H743: its linker scripts are made from this, and the simulated controller is cut
//! like it.

/// A sector, the least that can be erased, bytes. The chip has two banks of eight.
pub const SECTOR: u32 = 128 * 1024;
/// Where flash begins.
pub const FLASH_BASE: u32 = 0x0800_0000;

/// A range of flash, from [`FLASH_BASE`].
pub struct Part {
    /// Its first byte.
    pub offset: u32,
    /// Its bytes.
    pub size: u32,
}

const fn sectors(first: u32, count: u32) -> Part {
    Part { offset: first * SECTOR, size: count * SECTOR }
}

/// The boot loader. Never written in the field.
pub const LOADER: Part = sectors(0, 1);
/// The application that runs.
pub const ACTIVE: Part = sectors(1, 5);
/// Bytes of an image before its code, as in `protocol::image`.
pub const HEADER: u32 = 1024;
/// What was downloaded, or the application before. A sector more than the active slot: the swap moves it along by one. In the second
/// bank, like the state, so that neither stops the application, which runs from the first.
pub const DOWNLOAD: Part = sectors(8, 6);
/// How far a swap has come.
pub const STATE: Part = sectors(14, 2);

/// The core's own data memory: a cycle for each access, always. Nothing here is moved by DMA, which cannot reach all of it.
pub const RAM_BASE: u32 = 0x2000_0000;
/// Its bytes.
pub const RAM_SIZE: u32 = 128 * 1024;
