//! Who crosses itself:
//! `cargo run --release -p orime-contact --example crossings -- NODES SIDE_M FILE`.
//!
//! The file holds frames of NODES × NODES positions, little-endian f32, x y z, index order of a
//! sheet. Printed are the frames that cross, by the judge's oracle, and the largest elongation of
//! an edge over all frames and in the last.

use orime_evaluate::scores::folded::self_intersections;
use orime_geometry::SheetGrid;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [nodes, side_m, file] = arguments.as_slice() else {
        return Err("usage: crossings NODES SIDE_M FILE".into());
    };
    let sheet = SheetGrid::new([side_m.parse()?; 2], [nodes.parse()?; 2]);
    let (triangles, edges) = (sheet.triangles(), sheet.edges());
    let bytes = std::fs::read(file)?;
    let number = |b: &[u8]| f32::from_le_bytes([b[0], b[1], b[2], b[3]]);
    let numbers: Vec<f32> = bytes.chunks_exact(4).map(number).collect();
    let (points, _) = numbers.as_chunks::<3>();
    let (mut crossing, mut stretch, mut last) = (Vec::new(), 0f64, 0f64);
    let frames = points.chunks_exact(sheet.len());
    let count = frames.len();
    for (frame, x) in frames.enumerate() {
        if self_intersections(x, &triangles) > 0 {
            crossing.push(frame);
        }
        let length = |[a, b]: [u32; 2]| {
            let [a, b] = [a, b].map(|n| x[n as usize].map(f64::from));
            (0..3).map(|k| (a[k] - b[k]).powi(2)).sum::<f64>().sqrt()
        };
        let elongations = edges.iter().map(|(edge, rest_m)| length(*edge) / rest_m - 1.0);
        last = elongations.fold(0.0, f64::max);
        stretch = stretch.max(last);
    }
    println!(
        "{}/{count} frames cross (first {:?}), stretch {:.1} % (end {:.1})",
        crossing.len(),
        crossing.first(),
        100.0 * stretch,
        100.0 * last,
    );
    Ok(())
}
