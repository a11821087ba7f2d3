//! The pipelines of a scene: those of its pieces, for one path.

use super::Path;
use super::pieces::{Piece, Pieces};
use super::slots::Slot;
use wgpu::{BindGroupLayout, BindingType, BufferBindingType, ComputePipeline, ShaderStages};

/// Bytes of `Choice` in `passes.wgsl`.
pub(super) const CHOICE_BYTES: u64 = 32;

/// What a pass is dispatched over.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Over {
    /// The plastic links; once a frame, all others once a substep.
    PlasticLinks,
    /// The nodes.
    Nodes,
    /// The links of each colour, one colour after the other.
    Colours,
    /// The same with the plate's hinges and twists.
    StencilColours,
    /// One workgroup goes through all.
    Once,
    /// The same, with the other direction in odd substeps.
    ThereAndBack,
}

/// The passes of [`Path::Apart`] in their order.
const APART: [(&str, Option<Piece>, Over); 8] = [
    ("yield_all", Some(Piece::Plastic), Over::PlasticLinks),
    ("advance_all", None, Over::Nodes),
    ("grip_all", Some(Piece::Grippers), Over::Once),
    ("flatten_colour", Some(Piece::Plate), Over::StencilColours),
    ("project_colour", None, Over::Colours),
    ("turn_all", Some(Piece::Crease), Over::Once),
    ("hold_all", Some(Piece::Facets), Over::ThereAndBack),
    ("settle_all", None, Over::Nodes),
];

/// The pipelines, and the layouts of their bindings.
#[derive(Debug, Clone)]
pub(super) struct Kernels {
    pub pieces: Pieces,
    pub data: BindGroupLayout,
    pub choice: BindGroupLayout,
    /// A frame in one workgroup, or nothing.
    pub frame: Option<ComputePipeline>,
    /// The passes of a frame that is cut into dispatches, or none.
    pub passes: Vec<(ComputePipeline, Over)>,
}

impl Kernels {
    /// Compiles what these pieces need on that path, and nothing else.
    pub fn new(device: &wgpu::Device, pieces: Pieces, path: Path) -> Self {
        let data = data_layout(device, pieces);
        let choice = choice_layout(device);
        let source = wgpu::ShaderSource::Wgsl(pieces.kernels().into());
        let descriptor = wgpu::ShaderModuleDescriptor { label: None, source };
        let module = device.create_shader_module(descriptor);
        let layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: None,
            bind_group_layouts: &[Some(&data), Some(&choice)],
            ..Default::default()
        });
        let pipeline = |entry_point: &str| {
            device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
                label: Some(entry_point),
                layout: Some(&layout),
                module: &module,
                entry_point: Some(entry_point),
                compilation_options: Default::default(),
                cache: None,
            })
        };
        let mut passes = Vec::new();
        if path == Path::Apart {
            let needed = |(_, piece, _): &&(&str, Option<Piece>, Over)| {
                piece.is_none_or(|piece| pieces.contains(piece))
            };
            let pass = |(entry, _, over): &(&str, Option<Piece>, Over)| (pipeline(entry), *over);
            passes.extend(APART.iter().filter(needed).map(pass));
        }
        let frame = (path == Path::OneWorkgroup).then(|| pipeline("sheet_frame"));
        Self { pieces, data, choice, frame, passes }
    }
}

fn data_layout(device: &wgpu::Device, pieces: Pieces) -> BindGroupLayout {
    let entry = |slot: Slot| wgpu::BindGroupLayoutEntry {
        binding: slot as u32,
        visibility: ShaderStages::COMPUTE,
        ty: BindingType::Buffer {
            ty: slot.kind(),
            has_dynamic_offset: false,
            min_binding_size: None,
        },
        count: None,
    };
    let entries: Vec<_> = Slot::of(pieces).map(entry).collect();
    let descriptor = wgpu::BindGroupLayoutDescriptor { label: None, entries: &entries };
    device.create_bind_group_layout(&descriptor)
}

fn choice_layout(device: &wgpu::Device) -> BindGroupLayout {
    let entry = wgpu::BindGroupLayoutEntry {
        binding: 0,
        visibility: ShaderStages::COMPUTE,
        ty: BindingType::Buffer {
            ty: BufferBindingType::Uniform,
            has_dynamic_offset: true,
            min_binding_size: std::num::NonZeroU64::new(CHOICE_BYTES),
        },
        count: None,
    };
    let descriptor = wgpu::BindGroupLayoutDescriptor { label: None, entries: &[entry] };
    device.create_bind_group_layout(&descriptor)
}
