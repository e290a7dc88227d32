//! Renderers by name.

use crate::render::Renderer;
use crate::render::clear::ClearRenderer;
use crate::render::fast::{FastRenderer, Level};
use crate::render::gpu::{GpuError, GpuRenderer, Way};
use clap::ValueEnum;
use core::fmt::{self, Display, Formatter};
use serde::{Deserialize, Serialize};
use thiserror::Error;

/// A renderer to measure.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum Who {
    /// The reference on the CPU
    Clear,
    /// The fast one on the CPU with what every machine has
    CpuPortable,
    /// The same with 256 bits
    #[value(name = "cpu-avx2")]
    #[serde(rename = "cpu-avx2")]
    CpuAvx2,
    /// The same with 512 bits
    #[value(name = "cpu-avx512")]
    #[serde(rename = "cpu-avx512")]
    CpuAvx512,
    /// A GPU, a pass for each slice: the baseline
    GpuSlice,
    /// A GPU, 24 slices a pass
    GpuAtlas,
    /// A GPU, compute shaders for all slices
    GpuCompute,
}

/// Why a renderer cannot be had.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum NotHere {
    /// The processor lacks the instructions.
    #[error("{0}: this processor has no {1}")]
    Instructions(Who, Level),
    /// No GPU, or not that one.
    #[error("{0}: {1}")]
    Gpu(Who, GpuError),
}

impl Who {
    /// All there are.
    pub const ALL: [Self; 7] = [
        Self::Clear,
        Self::CpuPortable,
        Self::CpuAvx2,
        Self::CpuAvx512,
        Self::GpuSlice,
        Self::GpuAtlas,
        Self::GpuCompute,
    ];

    /// Makes it, on the GPU whose name contains `adapter`.
    pub fn open(self, adapter: Option<&str>) -> Result<Box<dyn Renderer>, NotHere> {
        let cpu = |level| FastRenderer::with(level).ok_or(NotHere::Instructions(self, level));
        let gpu = |way| GpuRenderer::open(adapter, Some(way)).map_err(|error| NotHere::Gpu(self, error));
        Ok(match self {
            Self::Clear => Box::new(ClearRenderer),
            Self::CpuPortable => Box::new(cpu(Level::Portable)?),
            Self::CpuAvx2 => Box::new(cpu(Level::Avx2)?),
            Self::CpuAvx512 => Box::new(cpu(Level::Avx512)?),
            Self::GpuSlice => Box::new(gpu(Way::Slice)?),
            Self::GpuAtlas => Box::new(gpu(Way::Atlas)?),
            Self::GpuCompute => Box::new(gpu(Way::Compute)?),
        })
    }

    /// Whether it needs a GPU.
    pub fn is_gpu(self) -> bool {
        matches!(self, Self::GpuSlice | Self::GpuAtlas | Self::GpuCompute)
    }
}

impl Display for Who {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let value = self.to_possible_value();
        f.write_str(value.as_ref().map_or("", |value| value.get_name()))
    }
}
