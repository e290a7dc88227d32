//! A scene on a rig, ready to be rendered on a device: batches of slices, some of them on their way while the next is drawn.

use super::device::Gpu;
use super::draw::{Draw, Grid};
use super::model::Model;
use super::needs::{Needs, Pipelines};
use super::raster::{Raster, key_bytes, queue_bytes};
use super::{GpuError, Way};
use crate::render::turn::{Depth, Turn};
use crate::render::{Prepared, RenderError, Wanted};
use shaders::halftone::Halftone;
use shaders::wgsl::{self, Mask};
use std::collections::VecDeque;
use std::sync::mpsc::{Receiver, channel};
use wgpu::{
    BindGroup, BindingResource, Buffer, BufferAsyncError, BufferDescriptor, BufferUsages, CommandEncoder, ComputePass,
    ComputePipeline, MapMode, PollType, SubmissionIndex,
};

/// Slices that are drawn at once, if the device can hold them: the patent's frame.
pub(super) const SLOTS: u32 = 24;
/// Batches that may be on their way: one is drawn, one is copied, one is read.
const FLIGHTS: usize = 3;
/// Pixels of all slots of a batch.
const BATCH_PIXELS: u64 = 1 << 26;

/// What is the same in every batch.
pub(super) struct Frame<'a> {
    pub size: [u32; 2],
    pub projected: &'a Buffer,
    pub model: &'a Model,
    batch: &'a Buffer,
    instances: &'a Buffer,
    planes: &'a Buffer,
}

impl Frame<'_> {
    /// The scene and what is wanted of it.
    pub fn for_drawing(&self) -> Vec<(u32, BindingResource<'_>)> {
        let mut bindings = self.model.for_drawing();
        bindings.extend([(0, self.batch.as_entire_binding()), (2, self.instances.as_entire_binding())]);
        bindings
    }

    /// Where it goes.
    pub fn for_packing(&self) -> Vec<(u32, BindingResource<'_>)> {
        vec![(0, self.batch.as_entire_binding()), (6, self.planes.as_entire_binding())]
    }
}

/// What is drawn in a batch.
pub(super) struct Batch {
    pub slots: u32,
    pub faces: u32,
    pub triangles: u32,
    /// Words in a row, and rows.
    words: [u32; 2],
}

impl Batch {
    /// Makes planes of what was drawn.
    pub fn pack(&self, encoder: &mut CommandEncoder, pipeline: &ComputePipeline, drawn: &BindGroup) {
        let mut pass = encoder.begin_compute_pass(&Default::default());
        pass.set_pipeline(pipeline);
        pass.set_bind_group(0, drawn, &[]);
        let [across, down] = self.words.map(|count| count.div_ceil(8));
        pass.dispatch_workgroups(across, down, self.slots);
    }
}

/// `count` invocations by workgroups of 64 in each of `layers` layers.
pub(super) fn dispatch(pass: &mut ComputePass<'_>, count: u32, layers: u32) {
    // The number of workgroups across that every device takes.
    let groups = count.div_ceil(64);
    let across = groups.clamp(1, 65_535);
    pass.dispatch_workgroups(across, groups.div_ceil(across), layers);
}

enum Drawing<'a> {
    Hardware(Draw<'a>),
    Compute(Raster<'a>),
}

/// A batch on its way.
struct Flight {
    staging: Buffer,
    slices: Vec<u32>,
    submission: SubmissionIndex,
    mapped: Receiver<Result<(), BufferAsyncError>>,
}

/// A scene on a rig.
pub(super) struct Job<'a> {
    gpu: &'a Gpu,
    vertices: &'a ComputePipeline,
    halftone: Option<Halftone>,
    faces: u32,
    triangles: u32,
    vertex_count: u32,
    row_words: u32,
    size: [u32; 2],
    slots: u32,
    grid: Grid,
    drawing: Drawing<'a>,
    projecting: BindGroup,
    instances: Buffer,
    planes: Buffer,
    refused: Buffer,
    spare: Vec<Buffer>,
    /// What has ended it.
    broken: Option<GpuError>,
}

impl<'a> Job<'a> {
    /// `model` drawn by `way` in `size` pixels; `halftone` is a mask, or none for grey.
    pub fn new(
        gpu: &'a Gpu,
        pipelines: &'a Pipelines,
        model: &Model,
        way: Way,
        size: [u32; 2],
        halftone: Option<Halftone>,
    ) -> Result<Self, GpuError> {
        let side = u64::from(gpu.limits.max_texture_dimension_2d);
        if way != Way::Compute {
            gpu.within("pixels of a side", u64::from(size[0].max(size[1])), side)?;
        }
        let needs: Needs = model.needs;
        let plan = Sizes::new(gpu, model, way, size, halftone.is_some())?;
        let Sizes { grid, slots, .. } = plan;
        let values = wgsl::Batch {
            faces: model.faces,
            vertices: model.vertices,
            triangles: model.triangles,
            width: size[0],
            height: size[1],
            groups: size[0].div_ceil(32),
            words: if halftone.is_some() { 1 } else { 8 },
            columns: grid.columns,
            rows: grid.rows,
            depth_scale: 0.49 / model.radius_m,
        };
        let storage = |what, bytes, usage| gpu.buffer(what, bytes, BufferUsages::STORAGE | usage);
        let batch = gpu.filled("a batch", &[values], BufferUsages::UNIFORM)?;
        let instance_bytes = size_of::<wgsl::Instance>() as u64 * u64::from(slots * model.faces);
        let instances = storage("instances", instance_bytes, BufferUsages::COPY_DST)?;
        let projected = storage("projected vertices", plan.vertex_bytes * u64::from(slots), BufferUsages::empty())?;
        let planes = storage("planes", plan.plane_bytes * u64::from(slots), BufferUsages::COPY_SRC)?;
        let refused = storage("a count", 4, BufferUsages::COPY_SRC | BufferUsages::COPY_DST)?;
        let frame = Frame { size, projected: &projected, model, batch: &batch, instances: &instances, planes: &planes };
        let mut bindings = model.for_vertices();
        bindings.extend([
            (0, batch.as_entire_binding()),
            (2, instances.as_entire_binding()),
            (4, projected.as_entire_binding()),
            (5, refused.as_entire_binding()),
        ]);
        let vertices = pipelines.vertices(gpu, needs);
        let projecting = gpu.bind(&vertices.get_bind_group_layout(0), &bindings);
        let drawing = match way {
            Way::Compute => Drawing::Compute(Raster::new(gpu, pipelines.raster(gpu, needs), &frame, slots)?),
            _ => Drawing::Hardware(Draw::new(gpu, pipelines.draw(gpu, needs), &frame, grid)),
        };
        let staging = || {
            gpu.device.create_buffer(&BufferDescriptor {
                label: Some("staging"),
                size: plan.plane_bytes * u64::from(slots) + 4,
                usage: BufferUsages::MAP_READ | BufferUsages::COPY_DST,
                mapped_at_creation: false,
            })
        };
        let spare = (0..FLIGHTS).map(|_| staging()).collect();
        gpu.check()?;
        Ok(Self {
            gpu,
            vertices,
            halftone,
            faces: model.faces,
            triangles: model.triangles,
            vertex_count: model.vertices,
            row_words: values.groups * values.words,
            size,
            slots,
            grid,
            drawing,
            projecting,
            instances,
            planes,
            refused,
            spare,
            broken: None,
        })
    }

    fn fly(&mut self, wanted: Wanted<'_>, turn: &mut Turn) -> Result<(), GpuError> {
        let mut flights = VecDeque::new();
        for slices in wanted.slices.chunks(self.slots as usize) {
            if flights.len() == FLIGHTS
                && let Some(flight) = flights.pop_front()
            {
                self.land(flight, turn, wanted.done)?;
            }
            flights.push_back(self.launch(slices, wanted.number)?);
        }
        flights.into_iter().try_for_each(|flight| self.land(flight, turn, wanted.done))
    }

    fn launch(&mut self, slices: &[u32], turn: u32) -> Result<Flight, GpuError> {
        let instances: Vec<_> =
            (0..).zip(slices).flat_map(|(slot, slice)| self.instances_of(slot, *slice, turn)).collect();
        self.gpu.queue.write_buffer(&self.instances, 0, bytemuck::cast_slice(&instances));
        let slots = slices.len() as u32;
        let mut encoder = self.gpu.device.create_command_encoder(&Default::default());
        encoder.clear_buffer(&self.refused, 0, None);
        let mut pass = encoder.begin_compute_pass(&Default::default());
        pass.set_pipeline(self.vertices);
        pass.set_bind_group(0, &self.projecting, &[]);
        dispatch(&mut pass, self.vertex_count, slots * self.faces);
        drop(pass);
        let batch =
            Batch { slots, faces: self.faces, triangles: self.triangles, words: [self.row_words, self.size[1]] };
        match &self.drawing {
            Drawing::Hardware(draw) => draw.encode(&mut encoder, &batch),
            Drawing::Compute(raster) => raster.encode(&mut encoder, &batch),
        }
        let staging = self.spare.pop().ok_or_else(|| self.gpu.lost("no buffer is left"))?;
        let bytes = self.slice_words() as u64 * 4 * slices.len() as u64;
        encoder.copy_buffer_to_buffer(&self.refused, 0, &staging, 0, 4);
        encoder.copy_buffer_to_buffer(&self.planes, 0, &staging, 4, bytes);
        let submission = self.gpu.queue.submit([encoder.finish()]);
        self.gpu.check()?;
        let (sender, mapped) = channel();
        // Nobody listens any more where another flight has failed.
        staging.map_async(MapMode::Read, 0..4 + bytes, move |result| drop(sender.send(result)));
        Ok(Flight { staging, slices: slices.to_vec(), submission, mapped })
    }

    fn land(&mut self, flight: Flight, turn: &mut Turn, done: &(dyn Fn() + Sync)) -> Result<(), GpuError> {
        let Flight { staging, slices, submission, mapped } = flight;
        self.gpu
            .device
            .poll(PollType::Wait { submission_index: Some(submission), timeout: None })
            .map_err(|error| self.gpu.lost(error))?;
        self.gpu.check()?;
        mapped.try_recv().map_err(|error| self.gpu.lost(error))?.map_err(|error| self.gpu.lost(error))?;
        let slice_bytes = 4 * self.slice_words();
        {
            let view = staging
                .get_mapped_range(0..(4 + slice_bytes * slices.len()) as u64)
                .map_err(|error| self.gpu.lost(error))?;
            let (refused, planes) = view.split_at(4);
            if refused != [0; 4] {
                return Err(GpuError::Unsupported { what: "a vertex that single precision does not place".into() });
            }
            for (slice, words) in slices.iter().zip(planes.chunks_exact(slice_bytes)) {
                copy_rows(words, slice_bytes / self.size[1] as usize, turn, *slice);
                done();
            }
        }
        staging.unmap();
        self.spare.push(staging);
        Ok(())
    }

    /// The faces of a slot.
    fn instances_of(&self, slot: u32, slice: u32, turn: u32) -> impl Iterator<Item = wgsl::Instance> {
        let mask = self.halftone.and_then(|method| Mask::new(method, slice, turn)).unwrap_or(Mask::GREY);
        let first = slice * self.faces;
        let cell = self.grid.cell(slot, self.size);
        (first..first + self.faces).map(move |optics| wgsl::Instance { mask, slot, optics, first, cell })
    }

    /// Words of a slice on the device.
    fn slice_words(&self) -> usize {
        (self.row_words * self.size[1]) as usize
    }
}

/// Rows of whole words become those of the turn.
fn copy_rows(words: &[u8], stride: usize, turn: &mut Turn, slice: u32) {
    let row = match turn.depth() {
        Depth::Binary => turn.width().div_ceil(8) as usize,
        Depth::Grey => turn.width() as usize,
    };
    let slice = turn.slice_mut(slice);
    if row == stride {
        slice.copy_from_slice(words);
        return;
    }
    for (bytes, words) in slice.chunks_exact_mut(row).zip(words.chunks_exact(stride)) {
        bytes.copy_from_slice(&words[..row]);
    }
}

impl Prepared for Job<'_> {
    fn render(&mut self, wanted: Wanted<'_>, turn: &mut Turn) -> Result<(), RenderError> {
        if let Some(error) = &self.broken {
            return Err(error.clone().into());
        }
        let result = self.fly(wanted, turn);
        self.broken = result.as_ref().err().cloned();
        Ok(result?)
    }
}

/// How many slots fit, and what each needs.
struct Sizes {
    grid: Grid,
    slots: u32,
    vertex_bytes: u64,
    plane_bytes: u64,
}

impl Sizes {
    fn new(gpu: &Gpu, model: &Model, way: Way, size: [u32; 2], binary: bool) -> Result<Self, GpuError> {
        let [width, height] = size.map(u64::from);
        let vertex_bytes = size_of::<wgsl::Vertex>() as u64 * u64::from(model.vertices) * u64::from(model.faces);
        let plane_bytes = width.div_ceil(32) * if binary { 4 } else { 32 } * height;
        let largest = gpu.largest_binding();
        gpu.within("bytes of projected vertices", vertex_bytes, largest)?;
        gpu.within("bytes of a plane", plane_bytes, largest - 4)?;
        if way == Way::Compute {
            gpu.within("bytes of a slice's keys", key_bytes(size), largest)?;
            gpu.within("bytes of a slice's queue", queue_bytes(model), largest)?;
        }
        let keys = if way == Way::Compute { [key_bytes(size), queue_bytes(model)] } else { [0; 2] };
        let each = [vertex_bytes, plane_bytes + 1].into_iter().chain(keys);
        let fitting = each.filter(|bytes| *bytes > 0).map(|bytes| largest / bytes).min().unwrap_or(1);
        let pixels = BATCH_PIXELS / (width * height).max(1);
        let slots = u64::from(SLOTS).min(fitting).min(pixels).max(1) as u32;
        let grid = match way {
            Way::Atlas => Grid::atlas(gpu, size, slots),
            Way::Slice | Way::Compute => Grid::layers(slots.min(gpu.limits.max_texture_array_layers)),
        };
        Ok(Self { grid, slots: slots.min(grid.slots()), vertex_bytes, plane_bytes })
    }
}
