//! Slices by raster hardware: [`super::Way::Slice`] and [`super::Way::Atlas`].

use super::device::Gpu;
use super::job::{Batch, Frame};
use super::needs::Constants;
use core::ops::Range;
use shaders::wgsl;
use wgpu::{
    BindGroup, BindingResource, Color, ColorTargetState, ColorWrites, CommandEncoder, CompareFunction, ComputePipeline,
    DepthStencilState, Extent3d, FragmentState, LoadOp, MultisampleState, Operations, PipelineCompilationOptions,
    PrimitiveState, RenderPassColorAttachment, RenderPassDepthStencilAttachment, RenderPassDescriptor, RenderPipeline,
    RenderPipelineDescriptor, StoreOp, TextureDescriptor, TextureDimension, TextureFormat, TextureUsages, TextureView,
    TextureViewDescriptor, TextureViewDimension, VertexState,
};

/// A pixel's bit or grey; both are exact in it.
const COLOUR: TextureFormat = TextureFormat::R8Unorm;
const DEPTH: TextureFormat = TextureFormat::Depth32Float;

/// Pipelines of a device.
pub(super) struct DrawPipelines {
    draw: RenderPipeline,
    pack: ComputePipeline,
}

impl DrawPipelines {
    /// Compiles them.
    pub fn new(gpu: &Gpu, constants: &Constants) -> Self {
        use wgsl::{BATCH, DRAW, HALFTONE, PACK, PACK_TARGET, PANEL, PROJECT, SHADE};
        let module = gpu.module(&[HALFTONE, BATCH, PROJECT, SHADE, PANEL, DRAW]);
        let options = PipelineCompilationOptions { constants, ..Default::default() };
        let draw = gpu.device.create_render_pipeline(&RenderPipelineDescriptor {
            label: Some("draw"),
            layout: None,
            vertex: VertexState {
                module: &module,
                entry_point: Some("draw_vertex"),
                compilation_options: options.clone(),
                buffers: &[],
            },
            // Surfaces are seen from both sides.
            primitive: PrimitiveState { cull_mode: None, ..PrimitiveState::default() },
            depth_stencil: Some(DepthStencilState {
                format: DEPTH,
                depth_write_enabled: Some(true),
                depth_compare: Some(CompareFunction::Less),
                stencil: Default::default(),
                bias: Default::default(),
            }),
            multisample: MultisampleState::default(),
            fragment: Some(FragmentState {
                module: &module,
                entry_point: Some("draw_fragment"),
                compilation_options: options.clone(),
                targets: &[Some(ColorTargetState { format: COLOUR, blend: None, write_mask: ColorWrites::ALL })],
            }),
            multiview_mask: None,
            cache: None,
        });
        let pack = gpu.compute(&gpu.module(&[HALFTONE, BATCH, PACK, PACK_TARGET]), "pack", &[]);
        Self { draw, pack }
    }
}

/// Slots that are drawn in one pass: columns and rows, and the layers of the target.
#[derive(Clone, Copy, Debug)]
pub(super) struct Grid {
    pub columns: u32,
    pub rows: u32,
    pub layers: u32,
}

impl Grid {
    /// A layer a slot.
    pub fn layers(slots: u32) -> Self {
        Self { columns: 1, rows: 1, layers: slots }
    }

    /// Where slot `slot` begins in its layer: columns, and rows times 65,536.
    pub fn cell(self, slot: u32, [width, height]: [u32; 2]) -> u32 {
        let cell = slot % (self.columns * self.rows);
        let [column, row] = [cell % self.columns, cell / self.columns];
        (column * width) | ((row * height) << 16)
    }

    /// As many of `slots` slots of `size` pixels in one layer as the device takes.
    pub fn atlas(gpu: &Gpu, size: [u32; 2], slots: u32) -> Self {
        let side = gpu.limits.max_texture_dimension_2d;
        let columns = (f64::from(slots).sqrt().ceil() as u32).min(side / size[0]).max(1);
        Self { columns, rows: slots.div_ceil(columns).min(side / size[1]).max(1), layers: 1 }
    }

    /// Slots in all.
    pub fn slots(self) -> u32 {
        self.columns * self.rows * self.layers
    }
}

/// What is drawn into, and with what.
pub(super) struct Draw<'a> {
    pipelines: &'a DrawPipelines,
    grid: Grid,
    layers: Vec<TextureView>,
    depth: TextureView,
    scene: BindGroup,
    drawn: BindGroup,
}

impl<'a> Draw<'a> {
    /// Targets for a batch, and what is drawn there.
    pub fn new(gpu: &Gpu, pipelines: &'a DrawPipelines, frame: &Frame<'_>, grid: Grid) -> Self {
        let [width, height] = frame.size;
        let texture = |format, layers, usage| {
            let size =
                Extent3d { width: grid.columns * width, height: grid.rows * height, depth_or_array_layers: layers };
            gpu.device.create_texture(&TextureDescriptor {
                label: None,
                size,
                mip_level_count: 1,
                sample_count: 1,
                dimension: TextureDimension::D2,
                format,
                usage: usage | TextureUsages::RENDER_ATTACHMENT,
                view_formats: &[],
            })
        };
        let colour = texture(COLOUR, grid.layers, TextureUsages::TEXTURE_BINDING);
        let view = |dimension, layer: Range<u32>| {
            colour.create_view(&TextureViewDescriptor {
                dimension: Some(dimension),
                base_array_layer: layer.start,
                array_layer_count: Some(layer.len() as u32),
                ..TextureViewDescriptor::default()
            })
        };
        let all = view(TextureViewDimension::D2Array, 0..grid.layers);
        let mut bindings = frame.for_drawing();
        bindings.push((4, frame.projected.as_entire_binding()));
        Self {
            pipelines,
            grid,
            layers: (0..grid.layers).map(|layer| view(TextureViewDimension::D2, layer..layer + 1)).collect(),
            depth: texture(DEPTH, 1, TextureUsages::empty()).create_view(&TextureViewDescriptor::default()),
            scene: gpu.bind(&pipelines.draw.get_bind_group_layout(0), &bindings),
            drawn: gpu.bind(&pipelines.pack.get_bind_group_layout(0), &{
                let mut bindings = frame.for_packing();
                bindings.push((7, BindingResource::TextureView(&all)));
                bindings
            }),
        }
    }

    /// Draws a batch.
    pub fn encode(&self, encoder: &mut CommandEncoder, batch: &Batch) {
        let cells = self.grid.columns * self.grid.rows;
        for (layer, first) in self.layers.iter().zip((0..batch.slots).step_by(cells as usize)) {
            let slots = first..(first + cells).min(batch.slots);
            let mut pass = encoder.begin_render_pass(&RenderPassDescriptor {
                label: None,
                color_attachments: &[Some(RenderPassColorAttachment {
                    view: layer,
                    depth_slice: None,
                    resolve_target: None,
                    ops: Operations { load: LoadOp::Clear(Color::BLACK), store: StoreOp::Store },
                })],
                depth_stencil_attachment: Some(RenderPassDepthStencilAttachment {
                    view: &self.depth,
                    depth_ops: Some(Operations { load: LoadOp::Clear(1.0), store: StoreOp::Discard }),
                    stencil_ops: None,
                }),
                timestamp_writes: None,
                occlusion_query_set: None,
                multiview_mask: None,
            });
            pass.set_pipeline(&self.pipelines.draw);
            pass.set_bind_group(0, &self.scene, &[]);
            pass.draw(0..3 * batch.triangles, slots.start * batch.faces..slots.end * batch.faces);
        }
        batch.pack(encoder, &self.pipelines.pack, &self.drawn);
    }
}
