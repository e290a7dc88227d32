//! Updates of a simulated device's firmware, with power cut within every write and every erase.

mod alone;
mod bench;
mod cuts;
mod garbage;
