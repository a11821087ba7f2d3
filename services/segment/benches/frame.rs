//! What a camera's frame costs on one core, beside a copy of its bytes: `cargo bench -p
//! orime-segment --no-default-features --bench frame`.
//!
//! Frames of rendered cameras (640 × 480, depth lens beside the colour lens, noise) lie in memory
//! and are segmented in turn; after each, its colour and depth are copied, so that both meet the
//! same memory in the same state. Times are the thread's own, so that others on the machine count
//! only by what they do to caches. Per row: how much of the colour image was looked at, the median
//! and the tenth percentile of a frame's milliseconds, the frame's megabytes a second, and how
//! many copies a frame costs (medians, tenth percentiles). The last row is the whole square base
//! for the paper's five cameras, a tenth of its frames. `-- --frames N [EVERY]` segments N
//! frames of the first camera and nothing else, with every so many as a whole, for callgrind.

use std::hint::black_box;
use std::ops::Range;

use orime_capture::{CaptureParams, FaultPreset, FrameSource, SequenceKind, Viewpoints, open};
use orime_geometry::{Edgel, ObservedPoint, RgbdCamera, RgbdFrame, RgbdFrameMut, SheetGrid};
use orime_segment::{ObservedMut, SegmentParams, Segmenter};
use rustix::time::{ClockId, clock_gettime};

/// The frames: from here on the sheet is in motion.
const STEPS: Range<u64> = 20..68;
/// Every so many steps of the whole square base, this many in a row are looked at.
const STRETCH: [u64; 2] = [60, 6];
const PASSES: usize = 4;

/// What this thread has computed so far, milliseconds: others on the machine do not count.
fn busy_ms() -> f64 {
    let time = clock_gettime(ClockId::ThreadCPUTime);
    time.tv_sec as f64 * 1e3 + time.tv_nsec as f64 * 1e-6
}

/// Colour and depth of one frame.
type Frame = (Vec<u8>, Vec<u16>);

fn sheet() -> SheetGrid {
    SheetGrid::new([0.15, 0.15], [25, 25])
}

/// The cameras, and the frames of each.
fn render(
    sequence: SequenceKind,
    viewpoints: Viewpoints,
    steps: Range<u64>,
) -> (Vec<RgbdCamera>, Vec<Vec<Frame>>) {
    let mut params = CaptureParams::default();
    params.rendered.sequence = sequence;
    params.rendered.viewpoints = viewpoints;
    params.rendered.faults = FaultPreset::Noise;
    let config = params.check().expect("the bench's own parameters are good");
    let mut source = open(&config, &sheet()).expect("the source opens");
    let cameras = source.cameras().to_vec();
    let film_of = |k| film(source.as_mut(), &cameras[k], k, steps.clone());
    let frames = (0..cameras.len()).map(film_of).collect();
    (cameras, frames)
}

fn film(
    source: &mut dyn FrameSource,
    camera: &RgbdCamera,
    index: usize,
    steps: Range<u64>,
) -> Vec<Frame> {
    let read = |step| {
        let (mut rgb, mut depth) =
            (vec![0; 3 * camera.color.pixels()], vec![0; camera.depth.pixels()]);
        let frame = RgbdFrameMut { color_rgb: &mut rgb, depth_units: &mut depth };
        source.read(step, index, frame).expect("the frame is whole");
        (rgb, depth)
    };
    steps.map(read).collect()
}

/// One camera's segmenter, and room for what it finds.
struct Stage {
    segmenter: Segmenter,
    points: Vec<ObservedPoint>,
    edgels: Vec<Edgel>,
    pixels: f64,
}

impl Stage {
    fn new(camera: &RgbdCamera, whole_image_every: u32) -> Self {
        let params = SegmentParams { whole_image_every, ..SegmentParams::default() };
        let config = params.check().expect("the bench's own parameters are good");
        Self {
            segmenter: Segmenter::new(&config, std::slice::from_ref(camera), &sheet()),
            points: vec![bytemuck::Zeroable::zeroed(); 40_000],
            edgels: vec![bytemuck::Zeroable::zeroed(); 8_000],
            pixels: camera.color.pixels() as f64,
        }
    }

    /// Share of the colour image that was looked at, and whether there was a sheet.
    fn see(&mut self, (color_rgb, depth_units): &Frame) -> (f64, bool) {
        let frame = Some(RgbdFrame { color_rgb, depth_units });
        let out =
            ObservedMut { points: &mut self.points, edgels: &mut self.edgels, features: &mut [] };
        let report = self.segmenter.segment(&[frame], out);
        let window = self.segmenter.window(0).map_or([0; 2], |[_, size]| size);
        ((window[0] * window[1]) as f64 / self.pixels, report.cameras_without_sheet == 0)
    }
}

/// One frame: share of the image that was looked at, and milliseconds of looking and of copying.
#[derive(Clone, Copy)]
struct Look {
    share: f64,
    segment_ms: f64,
    copy_ms: f64,
}

/// All looks at a camera's frames, but those of the first pass, after it has learnt the sheet from
/// others.
fn measure(
    camera: &RgbdCamera,
    lesson: &[Frame],
    frames: &[Frame],
    whole_image_every: u32,
) -> Vec<Look> {
    let mut stage = Stage::new(camera, whole_image_every);
    for frame in lesson {
        stage.see(frame);
    }
    let (mut rgb, mut depth) = (frames[0].0.clone(), frames[0].1.clone());
    let (mut looks, mut lost) = (Vec::new(), 0);
    for pass in 0..=PASSES {
        // There and back, so that the sheet never jumps.
        let order: Box<dyn Iterator<Item = &Frame>> =
            if pass % 2 == 0 { Box::new(frames.iter()) } else { Box::new(frames.iter().rev()) };
        for frame in order {
            let start_ms = busy_ms();
            let (share, found) = stage.see(black_box(frame));
            let segment_ms = busy_ms() - start_ms;
            let start_ms = busy_ms();
            rgb.copy_from_slice(black_box(&frame.0));
            depth.copy_from_slice(black_box(&frame.1));
            black_box((&mut rgb, &mut depth));
            let copy_ms = busy_ms() - start_ms;
            lost += u32::from(!found);
            if pass > 0 && found {
                looks.push(Look { share, segment_ms, copy_ms });
            }
        }
    }
    if lost > 0 {
        println!("{}: {lost} frames without a sheet", camera.name);
    }
    looks
}

fn print(name: &str, bytes: usize, looks: &[Look]) {
    if looks.is_empty() {
        return;
    }
    let quantile = |q: f64, of: &dyn Fn(&Look) -> f64| {
        let mut values: Vec<f64> = looks.iter().map(of).collect();
        values.sort_by(f64::total_cmp);
        values[(q * (values.len() - 1) as f64) as usize]
    };
    let share = looks.iter().map(|look| look.share).sum::<f64>() / looks.len() as f64;
    let median_ms = quantile(0.5, &|look| look.segment_ms);
    let least_ms = quantile(0.1, &|look| look.segment_ms);
    let [copy_ms, least_copy_ms] = [0.5, 0.1].map(|q| quantile(q, &|look| look.copy_ms));
    println!(
        "{name:34} {:5.0} {:6} {median_ms:7.3} {least_ms:7.3} {:7.0} {copy_ms:7.3} {:7.1} {:7.1}",
        100.0 * share,
        looks.len(),
        bytes as f64 / median_ms / 1e3,
        median_ms / copy_ms,
        least_ms / least_copy_ms
    );
}

fn bytes(camera: &RgbdCamera) -> usize {
    3 * camera.color.pixels() + 2 * camera.depth.pixels()
}

fn mean_ms(looks: &[Look]) -> f64 {
    looks.iter().map(|look| look.segment_ms).sum::<f64>() / looks.len() as f64
}

/// A tenth of the whole square base, five cameras.
fn whole_sequence() {
    let whole_image_every = SegmentParams::default().whole_image_every;
    let (cameras, lessons) = render(SequenceKind::SquareBase, Viewpoints::Five, 0..4);
    let mut all = Vec::new();
    for first in (0..580).step_by(STRETCH[0] as usize) {
        let steps = first..(first + STRETCH[1]).min(581);
        let (_, frames) = render(SequenceKind::SquareBase, Viewpoints::Five, steps);
        for ((camera, lesson), frames) in cameras.iter().zip(&lessons).zip(&frames) {
            all.extend(measure(camera, lesson, frames, whole_image_every));
        }
    }
    print("whole square base, five cameras", bytes(&cameras[0]), &all);
    println!("whole square base: {:.3} ms a frame on average", mean_ms(&all));
}

fn compare() {
    println!("one core, one camera at a time");
    println!(
        "frames                             seen% looks   ms p50     p10    MB/s copy ms  \
         copies  at p10"
    );
    for (name, sequence) in
        [("half fold", SequenceKind::HalfFold), ("square base", SequenceKind::SquareBase)]
    {
        let (cameras, frames) = render(sequence, Viewpoints::Three, STEPS);
        let bytes = bytes(&cameras[0]);
        let all = |whole_image_every| -> Vec<Look> {
            let each = cameras.iter().zip(&frames);
            each.flat_map(|(camera, frames)| measure(camera, &[], frames, whole_image_every))
                .collect()
        };
        print(&format!("{name}, whole image"), bytes, &all(1));
        let looks = all(SegmentParams::default().whole_image_every);
        let (wide, narrow): (Vec<Look>, Vec<Look>) =
            looks.iter().partition(|look| look.share == 1.0);
        print(&format!("{name}, windows"), bytes, &narrow);
        print(&format!("{name}, whole image in between"), bytes, &wide);
        println!("{name}: {:.3} ms a frame on average, windows and whole images", mean_ms(&looks));
    }
    whole_sequence();
}

fn main() {
    let arguments: Vec<String> = std::env::args().collect();
    // A pool of one thread runs everything on itself.
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a thread");
    let Some(at) = arguments.iter().position(|argument| argument == "--frames") else {
        return pool.install(compare);
    };
    let frames = arguments.get(at + 1).and_then(|n| n.parse().ok()).unwrap_or(STEPS.count());
    let whole_image_every = arguments.get(at + 2).and_then(|n| n.parse().ok()).unwrap_or(16);
    pool.install(|| {
        let (cameras, film) = render(SequenceKind::SquareBase, Viewpoints::Three, STEPS);
        let mut stage = Stage::new(&cameras[0], whole_image_every);
        let there_and_back = film[0].iter().chain(film[0].iter().rev()).cycle();
        let seen: f64 = there_and_back.take(frames).map(|frame| stage.see(frame).0).sum();
        println!("{frames} frames, {:.0} % of the image", 100.0 * seen / frames as f64);
    });
}
