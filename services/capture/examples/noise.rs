//! Depth noise of the rendered cameras on a plane, and of a real one beside it:
//! `cargo run --release -p orime-capture --no-default-features --example noise`
//!
//! The real plane is the desk of `paper_desk` under `$ORIME_DATA` (or `../shared/data`).

#[path = "../tests/plane/mod.rs"]
mod plane;

fn main() {
    println!("camera         z/m   sigma/mm  D415/mm  length/px  correlation at 1 2 3 4 5 12 px");
    for z_m in [0.3, 0.5, 0.8] {
        let patches = plane::rendered(z_m, 24);
        let expected_mm = (0.39f64.powi(2) + (2.8 * z_m * z_m).powi(2)).sqrt();
        print(&format!("rendered D415  {z_m:.2}"), &plane::measure(&patches), Some(expected_mm));
    }
    let Some(patches) = plane::real() else { return };
    let z_m = plane::distance_m(&patches);
    print(&format!("real Xtion     {z_m:.2}"), &plane::measure(&patches), None);
    println!("({} flat patches of paper_desk; vision.md: 0.80 mm at 0.5 m)", patches.len());
}

fn print(name: &str, noise: &plane::Figures, expected_mm: Option<f64>) {
    let correlation = [1, 2, 3, 4, 5, 12].map(|lag| format!("{:.2}", noise.correlation[lag]));
    let expected = expected_mm.map_or("      -".to_owned(), |mm| format!("{mm:7.2}"));
    println!(
        "{name}  {:8.2}  {expected}  {:9.1}  {}",
        noise.sigma_m * 1e3,
        noise.length_px,
        correlation.join(" ")
    );
}
