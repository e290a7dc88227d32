//! The pairs x.wgsl and x.rs: what a GPU runs, and its twin on the CPU.
