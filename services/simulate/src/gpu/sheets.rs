//! Sheets of one model on the graphics processor.

use super::device::Opened;
use super::kernels::{CHOICE_BYTES, Kernels, Over};
use super::model::{Frame, Model};
use super::slots::Slot;
use super::traffic::Traffic;
use super::{GpuError, Path};
use wgpu::BufferUsages as Usage;

/// Invocations of a workgroup, as in the kernels.
const WIDTH: u32 = 256;
/// Most substeps of one submission: longer ones meet the watchdogs of drivers.
const SUBSTEPS_MAX: u32 = 32;
/// Most rounds of loops of one submission: llvmpipe silently ends a shader's loops after 65,535
/// rounds in all.
const ROUNDS_MAX: u32 = 60_000;
/// What no kernel may leave behind: NaN.
const POISON: u8 = 0xff;

/// The state of sheets that share a model.
#[derive(Debug, Clone)]
pub(crate) struct Sheets {
    opened: Opened,
    kernels: Kernels,
    path: Path,
    sheets: u32,
    /// Links of each colour, and of the plate's.
    counts: [Vec<u32>; 2],
    substeps_max: u32,
    buffers: Vec<(Slot, wgpu::Buffer)>,
    result: wgpu::Buffer,
    data: wgpu::BindGroup,
    choice: wgpu::BindGroup,
    /// Bytes from choice to choice.
    stride: u32,
    /// What goes there before a step, and has come back after it.
    pub traffic: Traffic,
}

impl Sheets {
    /// Opens the adapter and makes room for that many sheets of a model.
    pub fn new(model: &Model, sheets: u32, path: Path) -> Result<Self, GpuError> {
        let opened = Opened::new()?;
        let kernels = opened.checked(|| Kernels::new(&opened.device, model.pieces, path))?;
        Self::on(opened, kernels, model, sheets, path)
    }

    /// The same sheets with another model.
    pub fn renewed(&self, model: &Model) -> Result<Self, GpuError> {
        let (opened, path) = (self.opened.clone(), self.path);
        let kernels = if model.pieces == self.kernels.pieces {
            self.kernels.clone()
        } else {
            opened.checked(|| Kernels::new(&opened.device, model.pieces, path))?
        };
        Self::on(opened, kernels, model, self.sheets, path)
    }

    fn on(
        opened: Opened,
        kernels: Kernels,
        model: &Model,
        sheets: u32,
        path: Path,
    ) -> Result<Self, GpuError> {
        assert!(path == Path::OneWorkgroup || sheets == 1, "a large sheet comes alone");
        let traffic = Traffic::new(model, sheets as usize);
        let of_each = |ranges: &mut dyn Iterator<Item = [u32; 2]>| {
            ranges.map(|[from, to]| to - from).collect::<Vec<_>>()
        };
        let counts = [
            of_each(&mut model.ranges.iter().copied()),
            of_each(&mut model.stencil_colours.iter().map(|colour| colour.range)),
        ];
        let device = &opened.device;
        let stride = device.limits().min_uniform_buffer_offset_alignment.max(CHOICE_BYTES as u32);
        // Two at least: whether a substep is odd.
        let n_choices = counts.iter().map(Vec::len).fold(2, usize::max);
        let (buffers, result, data, choice) = opened.checked(|| {
            let (buffers, result) = buffers(&opened, model, &traffic);
            let choices = buffer(device, n_choices * stride as usize, Usage::UNIFORM);
            for index in 0..n_choices as u32 {
                opened.queue.write_buffer(
                    &choices,
                    u64::from(index * stride),
                    &index.to_le_bytes(),
                );
            }
            let part = wgpu::BufferBinding {
                buffer: &choices,
                offset: 0,
                size: std::num::NonZeroU64::new(CHOICE_BYTES),
            };
            let choice = [(0, wgpu::BindingResource::Buffer(part))];
            let all = buffers.iter().map(|(slot, b)| (*slot as u32, b.as_entire_binding()));
            let data = group(device, &kernels.data, all);
            let choice = group(device, &kernels.choice, choice.into_iter());
            (buffers, result, data, choice)
        })?;
        let substeps_max = (ROUNDS_MAX / model.rounds(WIDTH)).clamp(1, SUBSTEPS_MAX);
        Ok(Self {
            kernels,
            path,
            sheets,
            counts,
            substeps_max,
            buffers,
            result,
            data,
            choice,
            stride,
            traffic,
            opened,
        })
    }

    /// The adapter's name.
    pub fn adapter(&self) -> &str {
        &self.opened.name
    }

    /// Advances all sheets by a frame: the traffic goes there and comes back.
    pub fn step(&mut self, frame: &Frame) -> Result<(), GpuError> {
        let Opened { device, queue, .. } = &self.opened;
        for (slot, buffer) in &self.buffers {
            if let Some(bytes) = self.traffic.bytes(*slot) {
                queue.write_buffer(buffer, 0, bytes);
            }
        }
        for done in (0..frame.substeps).step_by(self.substeps_max as usize) {
            self.submit(&Frame {
                substeps: (frame.substeps - done).min(self.substeps_max),
                first_substep: frame.first_substep.wrapping_add(done),
                is_first: u32::from(done == 0),
                ..*frame
            });
        }
        let mut encoder = device.create_command_encoder(&Default::default());
        let mut at = 0;
        for (slot, buffer) in &self.buffers {
            if Slot::BACK.contains(slot) {
                let bytes = self.traffic.back(*slot).len() as u64;
                encoder.copy_buffer_to_buffer(buffer, 0, &self.result, at, bytes);
                at += bytes;
            }
        }
        queue.submit([encoder.finish()]);
        self.read_back()
    }

    fn submit(&self, frame: &Frame) {
        let Opened { device, queue, .. } = &self.opened;
        let (_, buffer) = &self.buffers[Slot::Frame as usize];
        queue.write_buffer(buffer, 0, bytemuck::bytes_of(frame));
        let mut encoder = device.create_command_encoder(&Default::default());
        {
            let mut pass = encoder.begin_compute_pass(&Default::default());
            pass.set_bind_group(0, &self.data, &[]);
            pass.set_bind_group(1, &self.choice, &[0]);
            if let Some(whole) = &self.kernels.frame {
                pass.set_pipeline(whole);
                pass.dispatch_workgroups(self.sheets, 1, 1);
            }
            for substep in 0..frame.substeps {
                for (pipeline, over) in &self.kernels.passes {
                    pass.set_pipeline(pipeline);
                    self.dispatch(&mut pass, *over, frame, substep);
                }
            }
        }
        queue.submit([encoder.finish()]);
    }

    /// A pass of a sheet that is cut into dispatches.
    fn dispatch(&self, pass: &mut wgpu::ComputePass<'_>, over: Over, frame: &Frame, substep: u32) {
        let mut each = |choice: u32, count: u32| {
            pass.set_bind_group(1, &self.choice, &[choice * self.stride]);
            pass.dispatch_workgroups(count.div_ceil(WIDTH).max(1), 1, 1);
        };
        match over {
            Over::PlasticLinks if frame.is_first == 1 && substep == 0 => {
                each(0, frame.plastic_links);
            }
            Over::PlasticLinks => {}
            Over::Nodes => each(0, frame.nodes),
            Over::Colours => (0..).zip(&self.counts[0]).for_each(|(at, n)| each(at, *n)),
            Over::StencilColours => (0..).zip(&self.counts[1]).for_each(|(at, n)| each(at, *n)),
            Over::Once => each(0, 1),
            Over::ThereAndBack => each(frame.first_substep.wrapping_add(substep) % 2, 1),
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
            let mut at = 0;
            for (slot, _) in &self.buffers {
                let to = self.traffic.back(*slot);
                to.copy_from_slice(&bytes[at..at + to.len()]);
                at += to.len();
            }
        }
        self.result.unmap();
        Ok(())
    }
}

/// The buffers of a model's pieces by their numbers, filled or poisoned, and one to read from.
fn buffers(
    opened: &Opened,
    model: &Model,
    traffic: &Traffic,
) -> (Vec<(Slot, wgpu::Buffer)>, wgpu::Buffer) {
    let make = |slot: Slot| {
        let points = size_of_val(&traffic.x[..]);
        let size = match slot {
            Slot::Frame => size_of::<Frame>(),
            _ => traffic.bytes(slot).or(model.bytes(slot)).map_or(points, <[u8]>::len),
        };
        let usage = if slot == Slot::Frame { Usage::UNIFORM } else { Usage::STORAGE };
        let buffer = buffer(&opened.device, size, usage);
        match model.bytes(slot) {
            Some(bytes) => opened.queue.write_buffer(&buffer, 0, bytes),
            None => opened.queue.write_buffer(&buffer, 0, &vec![POISON; size]),
        }
        (slot, buffer)
    };
    let all: Vec<_> = Slot::of(model.pieces).map(make).collect();
    let back = Slot::BACK.iter().filter_map(|slot| traffic.bytes(*slot)).map(<[u8]>::len);
    let size = back.sum::<usize>();
    let result = opened.device.create_buffer(&wgpu::BufferDescriptor {
        label: None,
        size: size as u64,
        usage: Usage::MAP_READ | Usage::COPY_DST,
        mapped_at_creation: false,
    });
    opened.queue.write_buffer(&result, 0, &vec![POISON; size]);
    (all, result)
}

fn buffer(device: &wgpu::Device, size: usize, usage: Usage) -> wgpu::Buffer {
    device.create_buffer(&wgpu::BufferDescriptor {
        label: None,
        size: size.max(16) as u64,
        usage: usage | Usage::COPY_SRC | Usage::COPY_DST,
        mapped_at_creation: false,
    })
}

fn group<'a>(
    device: &wgpu::Device,
    layout: &wgpu::BindGroupLayout,
    resources: impl Iterator<Item = (u32, wgpu::BindingResource<'a>)>,
) -> wgpu::BindGroup {
    let entries: Vec<_> =
        resources.map(|(binding, resource)| wgpu::BindGroupEntry { binding, resource }).collect();
    let descriptor = wgpu::BindGroupDescriptor { label: None, layout, entries: &entries };
    device.create_bind_group(&descriptor)
}
