//! The rendered depth noise, measured back from frames of a plane, is that of real D415s.

mod plane;

#[test]
fn a_plane_is_as_noisy_as_to_real_cameras() {
    for z_m in [0.3, 0.5, 0.8] {
        let noise = plane::measure(&plane::rendered(z_m, 12));
        // Fitted on three real D415s at 0.35 to 1.2 m; vision.md.
        let expected_m = (0.00039f64.powi(2) + (0.0028 * z_m * z_m).powi(2)).sqrt();
        let ratio = noise.sigma_m / expected_m;
        assert!((ratio - 1.0).abs() < 0.15, "{z_m} m: {} of {expected_m} m", noise.sigma_m);
        // Real: 3 to 6 px.
        assert!((3.0..=6.0).contains(&noise.length_px), "{z_m} m: {} px", noise.length_px);
    }
}
