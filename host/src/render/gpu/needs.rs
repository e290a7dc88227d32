//! What a scene on a rig needs of the shaders, and pipelines that have just that.

use super::device::Gpu;
use super::draw::DrawPipelines;
use super::raster::RasterPipelines;
use shaders::wgsl;
use std::sync::OnceLock;
use wgpu::ComputePipeline;

/// Constants of the shaders.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Needs {
    /// The projector's lens distorts.
    pub lens: bool,
    /// The cone is followed.
    pub cone: bool,
    /// A viewer of some pixel may be behind the mirror.
    pub dim: bool,
    /// Viewers are on a curve.
    pub curve: bool,
    /// Something has a texture.
    pub textured: bool,
    /// The mirror has several faces.
    pub faces: bool,
}

/// Constants of a pipeline.
pub(super) type Constants = [(&'static str, f64)];

impl Needs {
    /// How many there are.
    const COUNT: usize = 64;

    fn index(self) -> usize {
        let Self { lens, cone, dim, curve, textured, faces } = self;
        [lens, cone, dim, curve, textured, faces].into_iter().fold(0, |index, need| 2 * index + usize::from(need))
    }

    /// Of the shaders that draw; those that project know the first four.
    pub fn constants(self) -> [(&'static str, f64); 6] {
        let Self { lens, cone, dim, curve, textured, faces } = self;
        [("LENS", lens), ("CONE", cone), ("DIM", dim), ("CURVE", curve), ("TEXTURED", textured), ("FACES", faces)]
            .map(|(name, need)| (name, f64::from(u8::from(need))))
    }
}

/// Pipelines, compiled when they are first used.
pub(super) struct Pipelines {
    variants: [Variant; Needs::COUNT],
}

#[derive(Default)]
struct Variant {
    vertices: OnceLock<ComputePipeline>,
    draw: OnceLock<DrawPipelines>,
    raster: OnceLock<RasterPipelines>,
}

impl Pipelines {
    /// None yet.
    pub fn new() -> Self {
        Self { variants: core::array::from_fn(|_| Variant::default()) }
    }

    /// What projects vertices.
    pub fn vertices(&self, gpu: &Gpu, needs: Needs) -> &ComputePipeline {
        self.variants[needs.index()].vertices.get_or_init(|| {
            let module = gpu.module(&[wgsl::HALFTONE, wgsl::BATCH, wgsl::PROJECT, wgsl::VERTICES]);
            gpu.compute(&module, "vertices", &needs.constants()[..4])
        })
    }

    /// What draws by raster hardware.
    pub fn draw(&self, gpu: &Gpu, needs: Needs) -> &DrawPipelines {
        self.variants[needs.index()].draw.get_or_init(|| DrawPipelines::new(gpu, &needs.constants()))
    }

    /// What draws by compute shaders.
    pub fn raster(&self, gpu: &Gpu, needs: Needs) -> &RasterPipelines {
        self.variants[needs.index()].raster.get_or_init(|| RasterPipelines::new(gpu, &needs.constants()))
    }
}
