use orime_calibrate::{agreement::left_out, fit::fit, observe::observe, start::TargetKind};
use orime_capture::CaptureParams;
use orime_markers::*;
fn main() {
    let set = orime_runtime::SetFile::load(std::path::Path::new("tests/sets/three_cameras.toml")).unwrap();
    let sheet = set.checked("sheet", orime_geometry::SheetParams::check).unwrap();
    let config = set.checked("capture", CaptureParams::check).unwrap();
    let mut source = orime_capture::open(&config, &sheet).unwrap();
    let mut det = Detector::new(&DetectorParams::default().check().unwrap(), Dictionary::predefined("DICT_4X4_50").unwrap());
    let seen = observe(source.as_mut(), &mut det, 0.022, 500);
    println!("{} views", seen.views.len());
    let f = fit(&seen, TargetKind::Rigid, |_| true).unwrap();
    println!("{:?} {:?}", f.termination, f.corner_px);
    for (d, p) in f.depth.iter().zip(&f.first_from_camera) { println!("{d:?} {:?}", p.translation.vector.as_slice()); }
    for (id, m) in &f.target_from_marker { println!("{id} {:?} {:?}", m.translation.vector.map(|x| x*1e3).as_slice(), m.rotation.euler_angles()); }
    for a in left_out(&seen, TargetKind::Rigid).unwrap() { println!("{a:?}"); }
}
