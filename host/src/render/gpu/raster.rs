//! Slices by compute shaders: [`super::Way::Compute`].

use super::GpuError;
use super::device::Gpu;
use super::job::{Batch, Frame, dispatch};
use super::model::Model;
use super::needs::Constants;
use shaders::wgsl;
use wgpu::{BindGroup, Buffer, BufferUsages, CommandEncoder, ComputePipeline};

/// Workgroups that fill large triangles until none is left, and how many share the tiles of one: as in `raster.wgsl`.
const FILLERS: [u32; 2] = [256, 16];

/// Pipelines of a device.
pub(super) struct RasterPipelines {
    small: ComputePipeline,
    large: ComputePipeline,
    pack: ComputePipeline,
}

impl RasterPipelines {
    /// Compiles them.
    pub fn new(gpu: &Gpu, constants: &Constants) -> Self {
        use wgsl::{BATCH, HALFTONE, PACK, PACK_KEYS, PANEL, PROJECT, RASTER, SHADE};
        let module = gpu.module(&[HALFTONE, BATCH, PROJECT, SHADE, PANEL, RASTER]);
        Self {
            small: gpu.compute(&module, "fill_small", constants),
            large: gpu.compute(&module, "fill_large", constants),
            pack: gpu.compute(&gpu.module(&[HALFTONE, BATCH, PACK, PACK_KEYS]), "pack", &[]),
        }
    }
}

/// Bytes of the keys of one slot of `size` pixels.
pub(super) fn key_bytes([width, height]: [u32; 2]) -> u64 {
    128 * u64::from(width.div_ceil(32)) * u64::from(height)
}

/// Bytes of the queue of one slot of `model`: every triangle of every face may be large.
pub(super) fn queue_bytes(model: &Model) -> u64 {
    8 * u64::from(model.triangles) * u64::from(model.faces)
}

/// What is drawn into, and with what.
pub(super) struct Raster<'a> {
    pipelines: &'a RasterPipelines,
    queued: Buffer,
    small: BindGroup,
    large: BindGroup,
    keys: BindGroup,
}

impl<'a> Raster<'a> {
    /// Keys for a batch of `slots` slots, and what is drawn there.
    pub fn new(gpu: &Gpu, pipelines: &'a RasterPipelines, frame: &Frame<'_>, slots: u32) -> Result<Self, GpuError> {
        let keys = gpu.buffer("keys", key_bytes(frame.size) * u64::from(slots), BufferUsages::STORAGE)?;
        let queued = gpu.buffer("a count", 4, BufferUsages::STORAGE | BufferUsages::COPY_DST)?;
        let queue = gpu.buffer("a queue", queue_bytes(frame.model) * u64::from(slots), BufferUsages::STORAGE)?;
        let bind = |pipeline: &ComputePipeline| {
            let mut bindings = frame.for_drawing();
            bindings.extend([
                (4, frame.projected.as_entire_binding()),
                (8, keys.as_entire_binding()),
                (9, queued.as_entire_binding()),
                (10, queue.as_entire_binding()),
            ]);
            gpu.bind(&pipeline.get_bind_group_layout(0), &bindings)
        };
        let mut packing = frame.for_packing();
        packing.push((8, keys.as_entire_binding()));
        Ok(Self {
            small: bind(&pipelines.small),
            large: bind(&pipelines.large),
            keys: gpu.bind(&pipelines.pack.get_bind_group_layout(0), &packing),
            queued,
            pipelines,
        })
    }

    /// Draws a batch.
    pub fn encode(&self, encoder: &mut CommandEncoder, batch: &Batch) {
        encoder.clear_buffer(&self.queued, 0, None);
        let mut pass = encoder.begin_compute_pass(&Default::default());
        pass.set_pipeline(&self.pipelines.small);
        pass.set_bind_group(0, &self.small, &[]);
        dispatch(&mut pass, batch.triangles, batch.slots * batch.faces);
        pass.set_pipeline(&self.pipelines.large);
        pass.set_bind_group(0, &self.large, &[]);
        pass.dispatch_workgroups(FILLERS[0], FILLERS[1], 1);
        drop(pass);
        batch.pack(encoder, &self.pipelines.pack, &self.keys);
    }
}
