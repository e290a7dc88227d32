//! One run of a compute shader by itself.

use super::device::Gpu;
use super::{GpuError, GpuRenderer};
use std::sync::mpsc::channel;
use wgpu::{Buffer, BufferDescriptor, BufferUsages, MapMode, PollType};

impl GpuRenderer {
    /// Runs `count` invocations, by workgroups of 64, of the entry `main` that `parts` of WGSL make up, and gives the `bytes` bytes,
    /// at first 0, of its storage buffer at binding 100. `inputs`: binding and bytes of its other storage buffers. So is WGSL compared
    /// with its twin.
    ///
    /// # Errors
    /// [`GpuError::Lost`] where the WGSL is refused, too.
    pub fn evaluate(
        &self,
        parts: &[&str],
        inputs: &[(u32, &[u8])],
        bytes: u64,
        count: u32,
    ) -> Result<Vec<u8>, GpuError> {
        let gpu = &self.gpu;
        let pipeline = gpu.compute(&gpu.module(parts), "main", &[]);
        let output = gpu.buffer("an output", bytes, BufferUsages::STORAGE | BufferUsages::COPY_SRC)?;
        let inputs =
            inputs.iter().map(|(binding, data)| Ok((*binding, gpu.filled("an input", data, BufferUsages::STORAGE)?)));
        let inputs: Vec<(u32, Buffer)> = inputs.collect::<Result<_, GpuError>>()?;
        let bindings: Vec<_> = inputs
            .iter()
            .map(|(binding, buffer)| (*binding, buffer.as_entire_binding()))
            .chain([(100, output.as_entire_binding())])
            .collect();
        gpu.check()?;
        let group = gpu.bind(&pipeline.get_bind_group_layout(0), &bindings);
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        let mut pass = encoder.begin_compute_pass(&Default::default());
        pass.set_pipeline(&pipeline);
        pass.set_bind_group(0, &group, &[]);
        super::job::dispatch(&mut pass, count, 1);
        drop(pass);
        let staging = gpu.device.create_buffer(&BufferDescriptor {
            label: None,
            size: bytes,
            usage: BufferUsages::MAP_READ | BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        encoder.copy_buffer_to_buffer(&output, 0, &staging, 0, bytes);
        gpu.queue.submit([encoder.finish()]);
        gpu.check()?;
        read(gpu, &staging)
    }
}

fn read(gpu: &Gpu, staging: &Buffer) -> Result<Vec<u8>, GpuError> {
    let (sender, mapped) = channel();
    // The receiver outlives the wait.
    staging.map_async(MapMode::Read, .., move |result| drop(sender.send(result)));
    gpu.device.poll(PollType::wait_indefinitely()).map_err(|error| gpu.lost(error))?;
    mapped.try_recv().map_err(|error| gpu.lost(error))?.map_err(|error| gpu.lost(error))?;
    let view = staging.get_mapped_range(..).map_err(|error| gpu.lost(error))?;
    Ok(view.to_vec())
}
