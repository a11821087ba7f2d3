//! The adapter, and the kernels on it.

use super::GpuError;
use super::sheets::CHOICE_BYTES;
use wgpu::{BindGroupLayout, BindingType, BufferBindingType, ComputePipeline, ShaderStages};

const PASSES: &str = include_str!("passes.wgsl");
const SHEET: &str = include_str!("sheet.wgsl");
const APART: &str = include_str!("passes_apart.wgsl");

/// An opened adapter with the kernels of both paths.
#[derive(Debug, Clone)]
pub(super) struct Opened {
    pub name: String,
    pub device: wgpu::Device,
    pub queue: wgpu::Queue,
    pub data: BindGroupLayout,
    pub choice: BindGroupLayout,
    pub sheet_frame: ComputePipeline,
    pub advance_all: ComputePipeline,
    pub project_colour: ComputePipeline,
    pub hold_one_facet: ComputePipeline,
    pub settle_all: ComputePipeline,
}

impl Opened {
    /// Opens the adapter that the system prefers.
    pub fn new() -> Result<Self, GpuError> {
        let mut wanted = wgpu::InstanceDescriptor::new_without_display_handle();
        wanted.backends = wgpu::Backends::VULKAN;
        let instance = wgpu::Instance::new(wanted);
        let options = wgpu::RequestAdapterOptions {
            power_preference: wgpu::PowerPreference::HighPerformance,
            ..Default::default()
        };
        let adapter = pollster::block_on(instance.request_adapter(&options))
            .map_err(|error| GpuError::NoAdapter(error.to_string()))?;
        let name = adapter.get_info().name;
        let descriptor =
            wgpu::DeviceDescriptor { required_limits: adapter.limits(), ..Default::default() };
        let (device, queue) = pollster::block_on(adapter.request_device(&descriptor))
            .map_err(|e| GpuError::Refused { name: name.clone(), why: e.to_string() })?;
        let scope = device.push_error_scope(wgpu::ErrorFilter::Validation);
        let data = layout(&device, &data_bindings());
        let uniform = BufferBindingType::Uniform;
        let choice = layout(&device, &[(uniform, std::num::NonZeroU64::new(CHOICE_BYTES))]);
        let one = pipelines(&device, &[&data], SHEET);
        let apart = pipelines(&device, &[&data, &choice], APART);
        let opened = Self {
            sheet_frame: one("sheet_frame"),
            advance_all: apart("advance_all"),
            project_colour: apart("project_colour"),
            hold_one_facet: apart("hold_one_facet"),
            settle_all: apart("settle_all"),
            name: name.clone(),
            device: device.clone(),
            queue,
            data,
            choice,
        };
        match pollster::block_on(scope.pop()) {
            None => Ok(opened),
            Some(error) => Err(GpuError::Refused { name, why: error.to_string() }),
        }
    }
}

/// Kind of a binding, and the bytes of the part that is chosen at each dispatch, if it is.
type Binding = (BufferBindingType, Option<std::num::NonZeroU64>);

/// Kinds of the data's bindings, in their order in `passes.wgsl`.
fn data_bindings() -> Vec<Binding> {
    let written = BufferBindingType::Storage { read_only: false };
    let read = BufferBindingType::Storage { read_only: true };
    std::iter::once(BufferBindingType::Uniform)
        .chain([written; 4])
        .chain([read; 4])
        .map(|kind| (kind, None))
        .collect()
}

fn layout(device: &wgpu::Device, bindings: &[Binding]) -> BindGroupLayout {
    let entry = |(binding, (ty, part)): (usize, &Binding)| {
        let has_dynamic_offset = part.is_some();
        wgpu::BindGroupLayoutEntry {
            binding: binding as u32,
            visibility: ShaderStages::COMPUTE,
            ty: BindingType::Buffer { ty: *ty, has_dynamic_offset, min_binding_size: *part },
            count: None,
        }
    };
    let entries: Vec<_> = bindings.iter().enumerate().map(entry).collect();
    let descriptor = wgpu::BindGroupLayoutDescriptor { label: None, entries: &entries };
    device.create_bind_group_layout(&descriptor)
}

fn pipelines<'a>(
    device: &'a wgpu::Device,
    groups: &[&BindGroupLayout],
    entries: &str,
) -> impl Fn(&str) -> ComputePipeline + 'a {
    let source = wgpu::ShaderSource::Wgsl(format!("{PASSES}\n{entries}").into());
    let descriptor = wgpu::ShaderModuleDescriptor { label: None, source };
    let module = device.create_shader_module(descriptor);
    let groups: Vec<Option<&BindGroupLayout>> = groups.iter().copied().map(Some).collect();
    let layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        label: None,
        bind_group_layouts: &groups,
        ..Default::default()
    });
    move |entry_point| {
        device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some(entry_point),
            layout: Some(&layout),
            module: &module,
            entry_point: Some(entry_point),
            compilation_options: Default::default(),
            cache: None,
        })
    }
}
