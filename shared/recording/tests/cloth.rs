//! Template and clouds of the real cloth recording, where it is at hand.

use std::path::{Path, PathBuf};

use orime_geometry::Surface;
use orime_recording::{Obj, QuadGrid, ply};

#[test]
fn the_template_is_a_grid_and_lies_where_the_first_cloud_is() {
    let data = std::env::var_os("ORIME_DATA").map_or_else(
        || Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data"),
        PathBuf::from,
    );
    let cloth = data.join("cloth_swing");
    if !cloth.is_dir() {
        eprintln!("SKIPPED: no `{}`; set ORIME_DATA", cloth.display());
        return;
    }
    let grid = QuadGrid::from_obj(&Obj::read(&cloth.join("template.obj")).unwrap()).unwrap();
    assert_eq!(grid.nodes, [32, 32]);
    let [a, b] = grid.size_m();
    assert!((0.5..0.65).contains(&a) && (0.5..0.65).contains(&b), "{a} × {b} m");
    // Neighbours are neighbours: no link is longer than twice the mean.
    let m = grid.nodes[1];
    for (k, here) in grid.positions_m.iter().enumerate() {
        let right = (k % m + 1 < m).then(|| grid.positions_m[k + 1]);
        let up = grid.positions_m.get(k + m).copied();
        for there in [right, up].into_iter().flatten() {
            let length = (0..3).map(|k| (here[k] - there[k]).powi(2)).sum::<f32>().sqrt();
            assert!((0.004..0.04).contains(&length), "a link of {length} m at node {k}");
        }
    }

    // The README: negate x and y to match the clouds.
    let sheet = orime_geometry::SheetGrid::new([a, b], [25, 25]);
    let nodes: Vec<[f32; 3]> =
        grid.resampled(sheet.nodes).iter().map(|[x, y, z]| [-x, -y, *z]).collect();
    let triangles = sheet.triangles();
    let surface = Surface::new(&nodes, &triangles);
    let cloud = ply::read_points(&cloth.join("cloud/cloud_000.ply")).unwrap();
    assert_eq!(cloud.len(), 34_862);
    let mut distances: Vec<f32> =
        cloud.iter().step_by(10).map(|point| surface.distance_m(*point)).collect();
    distances.sort_by(f32::total_cmp);
    let median_m = distances[distances.len() / 2];
    println!("median distance of cloud 0 from the template: {:.2} mm", 1e3 * median_m);
    assert!(median_m < 0.02, "{median_m} m");
}
