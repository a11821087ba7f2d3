//! Sheets of one model on the graphics processor.

use super::device::Opened;
use super::model::{Frame, Model};
use super::{GpuError, Path};
use wgpu::BufferUsages as Usage;

/// Bytes of `Choice` in `passes_apart.wgsl`.
pub(super) const CHOICE_BYTES: u64 = 32;
/// Invocations of a workgroup, as in the kernels.
const WIDTH: u32 = 256;
/// Most substeps of one submission. Longer ones meet the watchdogs of drivers; llvmpipe silently
/// ends a shader's loops after 65,535 rounds in all.
const SUBSTEPS_MAX: u32 = 32;
/// What no kernel may leave behind: NaN.
const POISON: u8 = 0xff;

/// The state of sheets that share a model.
#[derive(Debug, Clone)]
pub(crate) struct Sheets {
    opened: Opened,
    path: Path,
    sheets: u32,
    nodes: u32,
    ranges: Vec<[u32; 2]>,
    facets: u32,
    frame: wgpu::Buffer,
    x: wgpu::Buffer,
    v: wgpu::Buffer,
    targets: wgpu::Buffer,
    result: wgpu::Buffer,
    data: wgpu::BindGroup,
    choice: wgpu::BindGroup,
    /// Bytes from choice to choice.
    stride: u32,
    read: Vec<[f32; 4]>,
}

/// A point per node of every sheet, sheet by sheet; the fourth number is its inverse mass, or the
/// share of the way to a target.
pub(crate) type Points = Vec<[f32; 4]>;

impl Sheets {
    /// Opens the adapter and makes room for that many sheets of a model.
    pub fn new(model: &Model, nodes: u32, sheets: u32, path: Path) -> Result<Self, GpuError> {
        Self::on(Opened::new()?, model, [nodes, sheets], path)
    }

    /// The same sheets with another model.
    pub fn renewed(&self, model: &Model) -> Result<Self, GpuError> {
        Self::on(self.opened.clone(), model, [self.nodes, self.sheets], self.path)
    }

    fn on(
        opened: Opened,
        model: &Model,
        [nodes, sheets]: [u32; 2],
        path: Path,
    ) -> Result<Self, GpuError> {
        assert!(path == Path::OneWorkgroup || sheets == 1, "a large sheet comes alone");
        let device = &opened.device;
        let scope = device.push_error_scope(wgpu::ErrorFilter::Validation);
        let make = |size, usage| buffer(device, size, usage);
        let points = (nodes * sheets) as usize * size_of::<[f32; 4]>();
        let state: [_; 5] = std::array::from_fn(|_| make(points, Usage::STORAGE));
        let [x, v, before, ahead, targets] = state;
        let frame = make(size_of::<Frame>(), Usage::UNIFORM);
        let links = make(size_of_val(&model.links[..]), Usage::STORAGE);
        let ranges = make(size_of_val(&model.ranges[..]), Usage::STORAGE);
        let facets = make(size_of_val(&model.facets[..]), Usage::STORAGE);
        let stride = device.limits().min_uniform_buffer_offset_alignment.max(CHOICE_BYTES as u32);
        let n_choices = model.ranges.len().max(model.n_facets as usize).max(1);
        let choices = make(n_choices * stride as usize, Usage::UNIFORM);
        let result = device.create_buffer(&wgpu::BufferDescriptor {
            label: None,
            size: 2 * points as u64,
            usage: Usage::MAP_READ | Usage::COPY_DST,
            mapped_at_creation: false,
        });
        let queue = &opened.queue;
        queue.write_buffer(&links, 0, bytemuck::cast_slice(&model.links));
        queue.write_buffer(&ranges, 0, bytemuck::cast_slice(&model.ranges));
        queue.write_buffer(&facets, 0, bytemuck::cast_slice(&model.facets));
        for buffer in [&before, &ahead] {
            queue.write_buffer(buffer, 0, &vec![POISON; points]);
        }
        queue.write_buffer(&result, 0, &vec![POISON; 2 * points]);
        for index in 0..n_choices as u32 {
            queue.write_buffer(&choices, u64::from(index * stride), &index.to_le_bytes());
        }
        let all = [&frame, &x, &v, &before, &ahead, &targets, &links, &ranges, &facets];
        let data = group(device, &opened.data, &all.map(|b| b.as_entire_binding()));
        let part = wgpu::BufferBinding {
            buffer: &choices,
            offset: 0,
            size: std::num::NonZeroU64::new(CHOICE_BYTES),
        };
        let choice = group(device, &opened.choice, &[wgpu::BindingResource::Buffer(part)]);
        if let Some(error) = pollster::block_on(scope.pop()) {
            return Err(GpuError::Refused { name: opened.name, why: error.to_string() });
        }
        let read = vec![[f32::NAN; 4]; 2 * (nodes * sheets) as usize];
        Ok(Self {
            ranges: model.ranges.clone(),
            facets: model.n_facets,
            path,
            sheets,
            nodes,
            frame,
            x,
            v,
            targets,
            result,
            data,
            choice,
            stride,
            read,
            opened,
        })
    }

    /// The adapter's name.
    pub fn adapter(&self) -> &str {
        &self.opened.name
    }

    /// Advances all sheets by a frame: `x` and `v` go there and come back.
    pub fn step(
        &mut self,
        frame: &Frame,
        targets: &[[f32; 4]],
        x: &mut [[f32; 4]],
        v: &mut [[f32; 4]],
    ) -> Result<(), GpuError> {
        let points = (self.nodes * self.sheets) as usize;
        assert!([targets.len(), x.len(), v.len()] == [points; 3], "a point per node");
        let Opened { device, queue, .. } = &self.opened;
        queue.write_buffer(&self.targets, 0, bytemuck::cast_slice(targets));
        queue.write_buffer(&self.x, 0, bytemuck::cast_slice(x));
        queue.write_buffer(&self.v, 0, bytemuck::cast_slice(v));
        for done in (0..frame.substeps).step_by(SUBSTEPS_MAX as usize) {
            self.submit(&Frame {
                substeps: (frame.substeps - done).min(SUBSTEPS_MAX),
                first_substep: frame.first_substep.wrapping_add(done),
                ..*frame
            });
        }
        let bytes = (points * size_of::<[f32; 4]>()) as u64;
        let mut encoder = device.create_command_encoder(&Default::default());
        encoder.copy_buffer_to_buffer(&self.x, 0, &self.result, 0, bytes);
        encoder.copy_buffer_to_buffer(&self.v, 0, &self.result, bytes, bytes);
        queue.submit([encoder.finish()]);
        self.read_back()?;
        let (new_x, new_v) = self.read.split_at(points);
        x.copy_from_slice(new_x);
        v.copy_from_slice(new_v);
        Ok(())
    }

    fn submit(&self, frame: &Frame) {
        let Opened { device, queue, .. } = &self.opened;
        queue.write_buffer(&self.frame, 0, bytemuck::bytes_of(frame));
        let mut encoder = device.create_command_encoder(&Default::default());
        {
            let mut pass = encoder.begin_compute_pass(&Default::default());
            pass.set_bind_group(0, &self.data, &[]);
            match self.path {
                Path::OneWorkgroup => {
                    pass.set_pipeline(&self.opened.sheet_frame);
                    pass.dispatch_workgroups(self.sheets, 1, 1);
                }
                Path::Apart => self.dispatch_apart(&mut pass, frame),
            }
        }
        queue.submit([encoder.finish()]);
    }

    fn dispatch_apart(&self, pass: &mut wgpu::ComputePass<'_>, frame: &Frame) {
        let over = |count: u32| count.div_ceil(WIDTH).max(1);
        pass.set_bind_group(1, &self.choice, &[0]);
        for substep in 0..frame.substeps {
            pass.set_pipeline(&self.opened.advance_all);
            pass.dispatch_workgroups(over(self.nodes), 1, 1);
            pass.set_pipeline(&self.opened.project_colour);
            for (colour, [from, to]) in self.ranges.iter().enumerate() {
                pass.set_bind_group(1, &self.choice, &[colour as u32 * self.stride]);
                pass.dispatch_workgroups(over(to - from), 1, 1);
            }
            pass.set_pipeline(&self.opened.hold_one_facet);
            for k in 0..self.facets {
                let forward = frame.first_substep.wrapping_add(substep).is_multiple_of(2);
                let facet = if forward { k } else { self.facets - 1 - k };
                pass.set_bind_group(1, &self.choice, &[facet * self.stride]);
                pass.dispatch_workgroups(1, 1, 1);
            }
            pass.set_pipeline(&self.opened.settle_all);
            pass.dispatch_workgroups(over(self.nodes), 1, 1);
        }
    }

    fn read_back(&mut self) -> Result<(), GpuError> {
        let name = &self.opened.name;
        let failed = |why: String| GpuError::Failed { name: name.clone(), why };
        let slice = self.result.slice(..);
        let (sent, received) = std::sync::mpsc::channel();
        // Nobody listens any more only if waiting failed, which is reported below.
        slice.map_async(wgpu::MapMode::Read, move |result| drop(sent.send(result)));
        let waited = self.opened.device.poll(wgpu::PollType::wait_indefinitely());
        waited.map_err(|error| failed(error.to_string()))?;
        let mapped = received.recv().map_err(|error| failed(error.to_string()))?;
        mapped.map_err(|error| failed(error.to_string()))?;
        {
            let bytes = slice.get_mapped_range().map_err(|error| failed(error.to_string()))?;
            self.read.copy_from_slice(bytemuck::cast_slice(&bytes));
        }
        self.result.unmap();
        Ok(())
    }
}

fn buffer(device: &wgpu::Device, size: usize, usage: Usage) -> wgpu::Buffer {
    device.create_buffer(&wgpu::BufferDescriptor {
        label: None,
        size: size.max(16) as u64,
        usage: usage | Usage::COPY_SRC | Usage::COPY_DST,
        mapped_at_creation: false,
    })
}

fn group(
    device: &wgpu::Device,
    layout: &wgpu::BindGroupLayout,
    resources: &[wgpu::BindingResource<'_>],
) -> wgpu::BindGroup {
    let entries: Vec<_> = (0..)
        .zip(resources)
        .map(|(binding, resource)| wgpu::BindGroupEntry { binding, resource: resource.clone() })
        .collect();
    let descriptor = wgpu::BindGroupDescriptor { label: None, layout, entries: &entries };
    device.create_bind_group(&descriptor)
}
