//! The WGSL and its twins: function by function on random inputs, and whole turns of every way of drawing against the clear renderer.

mod functions;
mod turns;

use host::render::gpu::GpuRenderer;
use host::scene::{Texture, Wrap};
use rand::{Rng, RngExt};
use std::sync::{LazyLock, Mutex, PoisonError};

/// One device for all tests: an instance of a software device costs 0.3 s and 340 MB.
static GPU: LazyLock<Option<Mutex<GpuRenderer>>> = LazyLock::new(|| GpuRenderer::open(None, None).ok().map(Mutex::new));

/// Calls `test` with the device, if there is one.
fn with_gpu(test: impl FnOnce(&mut GpuRenderer)) {
    match &*GPU {
        Some(gpu) => test(&mut gpu.lock().unwrap_or_else(PoisonError::into_inner)),
        None => println!("skipped: no GPU adapter"),
    }
}

fn random_texture(rng: &mut impl Rng, [width, height]: [u32; 2], wrap: [Wrap; 2]) -> Texture {
    Texture::new(width, height, (0..width * height).map(|_| [0; 4].map(|_: u8| rng.random())).collect(), wrap)
}
