//! A device, its pipelines, and what has gone wrong with it.

use super::GpuError;
use super::needs::Constants;
use std::sync::{Arc, Mutex, PoisonError};
use wgpu::{
    Adapter, Backends, BindGroup, BindGroupEntry, BindGroupLayout, BindingResource, Buffer, BufferDescriptor,
    BufferUsages, ComputePipeline, ComputePipelineDescriptor, Device, DeviceDescriptor, DeviceType, Features, Instance,
    InstanceDescriptor, Limits, PipelineCompilationOptions, Queue, ShaderModule, ShaderModuleDescriptor, ShaderSource,
};

/// An open device.
pub(super) struct Gpu {
    pub name: String,
    pub is_software: bool,
    pub device: Device,
    pub queue: Queue,
    pub limits: Limits,
    /// What it said first of what went wrong.
    fault: Arc<Mutex<Option<String>>>,
}

/// Every adapter that there is, the best first.
pub(super) fn adapters() -> Vec<Adapter> {
    let instance = Instance::new(InstanceDescriptor::new_without_display_handle());
    let mut adapters = pollster::block_on(instance.enumerate_adapters(Backends::all()));
    adapters.sort_by_key(|adapter| match adapter.get_info().device_type {
        DeviceType::DiscreteGpu => 0,
        DeviceType::IntegratedGpu => 1,
        DeviceType::VirtualGpu => 2,
        DeviceType::Other => 3,
        DeviceType::Cpu => 4,
    });
    adapters
}

/// An adapter's name, driver and interface.
pub(super) fn name_of(adapter: &Adapter) -> String {
    let info = adapter.get_info();
    [info.name, info.driver, info.driver_info, info.backend.to_string()]
        .into_iter()
        .filter(|part| !part.is_empty())
        .collect::<Vec<_>>()
        .join(", ")
}

impl Gpu {
    /// The best adapter whose name contains `wanted` in any case.
    pub fn open(wanted: Option<&str>) -> Result<Self, GpuError> {
        let adapters = adapters();
        let names: Vec<_> = adapters.iter().map(name_of).collect();
        let part = wanted.unwrap_or_default().to_lowercase();
        let Some(index) = names.iter().position(|name| name.to_lowercase().contains(&part)) else {
            let found =
                if names.is_empty() { "there is none".into() } else { format!("there is {}", names.join("; ")) };
            return Err(GpuError::NoAdapter { wanted: wanted.map(str::to_string), found });
        };
        let (adapter, name) = (&adapters[index], names[index].clone());
        let limits = adapter.limits();
        let descriptor = DeviceDescriptor {
            required_features: Features::empty(),
            required_limits: limits.clone(),
            ..DeviceDescriptor::default()
        };
        let (device, queue) = pollster::block_on(adapter.request_device(&descriptor))
            .map_err(|error| GpuError::Lost { adapter: name.clone(), reason: error.to_string() })?;
        let fault = Arc::new(Mutex::new(None));
        let (on_error, on_loss) = (fault.clone(), fault.clone());
        device.on_uncaptured_error(Arc::new(move |error: wgpu::Error| note(&on_error, error.to_string())));
        device.set_device_lost_callback(move |reason, message| note(&on_loss, format!("{reason:?}: {message}")));
        let is_software = adapter.get_info().device_type == DeviceType::Cpu;
        Ok(Self { name, is_software, device, queue, limits, fault })
    }

    /// An error if something has gone wrong so far.
    pub fn check(&self) -> Result<(), GpuError> {
        match &*self.fault.lock().unwrap_or_else(PoisonError::into_inner) {
            None => Ok(()),
            Some(reason) => Err(self.lost(reason.clone())),
        }
    }

    /// The device does not answer any more, because of `reason`.
    pub fn lost(&self, reason: impl ToString) -> GpuError {
        // One line: what causes an error follows it in further ones.
        let reason = reason.to_string().split_whitespace().collect::<Vec<_>>().join(" ");
        GpuError::Lost { adapter: self.name.clone(), reason }
    }

    /// An error if `needed` of `what` are more than `allowed`.
    pub fn within(&self, what: &str, needed: u64, allowed: u64) -> Result<(), GpuError> {
        if needed <= allowed {
            return Ok(());
        }
        Err(GpuError::TooLarge { adapter: self.name.clone(), what: what.into(), needed, allowed })
    }

    /// The most bytes that a shader sees at once.
    pub fn largest_binding(&self) -> u64 {
        self.limits.max_storage_buffer_binding_size.min(self.limits.max_buffer_size)
    }

    /// A buffer for shaders of `bytes` bytes, zero.
    pub fn buffer(&self, what: &str, bytes: u64, usage: BufferUsages) -> Result<Buffer, GpuError> {
        self.within(&format!("bytes of {what}"), bytes, self.largest_binding())?;
        // Nothing has no buffer: a little then, for the largest element.
        let size = bytes.max(64).next_multiple_of(16);
        Ok(self.device.create_buffer(&BufferDescriptor { label: Some(what), size, usage, mapped_at_creation: false }))
    }

    /// A buffer that shaders read, with what it holds.
    pub fn filled<T: bytemuck::Pod>(&self, what: &str, data: &[T], usage: BufferUsages) -> Result<Buffer, GpuError> {
        let bytes: &[u8] = bytemuck::cast_slice(data);
        let buffer = self.buffer(what, bytes.len() as u64, usage | BufferUsages::COPY_DST)?;
        self.queue.write_buffer(&buffer, 0, bytes);
        Ok(buffer)
    }

    /// WGSL of several parts.
    pub fn module(&self, parts: &[&str]) -> ShaderModule {
        let source = ShaderSource::Wgsl(parts.join("\n").into());
        self.device.create_shader_module(ShaderModuleDescriptor { label: None, source })
    }

    /// The pipeline of `module`'s entry `entry` with values for its constants.
    pub fn compute(&self, module: &ShaderModule, entry: &str, constants: &Constants) -> ComputePipeline {
        self.device.create_compute_pipeline(&ComputePipelineDescriptor {
            label: Some(entry),
            layout: None,
            module,
            entry_point: Some(entry),
            compilation_options: PipelineCompilationOptions { constants, ..Default::default() },
            cache: None,
        })
    }

    /// `resources` by their bindings.
    pub fn bind(&self, layout: &BindGroupLayout, resources: &[(u32, BindingResource<'_>)]) -> BindGroup {
        let entries: Vec<_> = resources
            .iter()
            .map(|(binding, resource)| BindGroupEntry { binding: *binding, resource: resource.clone() })
            .collect();
        self.device.create_bind_group(&wgpu::BindGroupDescriptor { label: None, layout, entries: &entries })
    }
}

fn note(fault: &Mutex<Option<String>>, message: String) {
    fault.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(message);
}
