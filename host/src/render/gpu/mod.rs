//! The renderers on a GPU, by wgpu.

use super::plan::Plan;
use super::{Prepared, RenderError, Renderer};
use crate::scene::ShadedScene;
use clap::ValueEnum;
use protocol::rig::Rig;
use serde::{Deserialize, Serialize};
use thiserror::Error;

/// Why a GPU does not render.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum GpuError {
    /// There is none, or none of that name.
    #[error("no GPU adapter{}: {found}", wanted.as_ref().map(|name| format!(" named {name:?}")).unwrap_or_default())]
    NoAdapter {
        /// Part of a name that was asked for.
        wanted: Option<String>,
        /// What there is.
        found: String,
    },
    /// The device has been lost.
    #[error("GPU {adapter}: {reason}")]
    Lost {
        /// The device's name.
        adapter: String,
        /// What it said.
        reason: String,
    },
    /// The device cannot hold or do what is asked for.
    #[error("GPU {adapter}: {what} needs {needed}, allowed are {allowed}")]
    TooLarge {
        /// The device's name.
        adapter: String,
        /// What is too large.
        what: String,
        /// How much it needs.
        needed: u64,
        /// What the device has.
        allowed: u64,
    },
    /// Only the CPU renders by this plan.
    #[error("GPU: {what} is rendered on the CPU only")]
    Unsupported {
        /// What of the plan, rig or scene.
        what: String,
    },
}

/// How slices are drawn on a GPU.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum Way {
    /// A pass a slice: the patent's way.
    Slice,
    /// 24 slices a pass, into an atlas.
    Atlas,
    /// A rasteriser of compute shaders, all slices at once.
    Compute,
}

impl Way {
    /// All there are.
    pub const ALL: [Self; 3] = [Self::Slice, Self::Atlas, Self::Compute];
}

/// Renders on one adapter.
pub struct GpuRenderer {
    adapter: String,
}

impl GpuRenderer {
    /// Opens the first adapter whose name contains `adapter` in any case, or the best one. `way`: how to draw; without one, what is
    /// found the quicker of [`Way::Atlas`] and [`Way::Compute`] for each scene.
    pub fn open(adapter: Option<&str>, _way: Option<Way>) -> Result<Self, GpuError> {
        Err(GpuError::NoAdapter { wanted: adapter.map(str::to_string), found: "this build has none".into() })
    }

    /// The adapter's name and driver.
    pub fn adapter(&self) -> &str {
        &self.adapter
    }

    /// Whether the adapter is a processor that plays a GPU, and slower than [`super::fast`].
    pub fn is_software(&self) -> bool {
        true
    }
}

impl Renderer for GpuRenderer {
    fn name(&self) -> String {
        format!("gpu {}", self.adapter)
    }

    fn prepare<'a>(
        &'a self,
        _scene: &'a ShadedScene,
        _rig: &Rig,
        _plan: &Plan,
    ) -> Result<Box<dyn Prepared + 'a>, RenderError> {
        Err(GpuError::Unsupported { what: "everything".into() }.into())
    }
}
