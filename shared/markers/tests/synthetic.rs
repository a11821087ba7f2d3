//! Rendered markers with known corners.

mod scene;

use orime_markers::{
    Detector, DetectorParams, Dictionary, GreyImage, Marker, SheetLayout, SheetSide,
    predefined_names,
};
use scene::{
    Homography, Lens, Random, apply, blurred, image_from_square, inverse, photograph, shade_of,
};

fn detector(name: &str) -> Detector {
    let config = DetectorParams::default().check().unwrap();
    Detector::new(&config, Dictionary::predefined(name).unwrap())
}

const LENS: Lens =
    Lens { size_px: [160, 120], blur_px: 0.7, noise: 2.0, levels: [35.0, 205.0], curve: false };

/// Largest distance of a marker's corners from those of the unit square, pixels.
fn error_px(marker: &Marker, image_from_square: &Homography) -> f64 {
    let square = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
    let distance = |k: usize| {
        let ([x, y], [u, v]) = (marker.corners_px[k], apply(image_from_square, square[k]));
        (x - u).hypot(y - v)
    };
    (0..4).map(distance).fold(0.0, f64::max)
}

#[test]
fn corners_are_within_a_tenth_of_a_pixel_in_every_turn() {
    let (mut worst, mut sum, mut count) = (0.0_f64, 0.0, 0);
    for name in ["DICT_4X4_50", "DICT_5X5_100", "DICT_6X6_250", "DICT_7X7_1000"] {
        let dictionary = Dictionary::predefined(name).unwrap();
        let mut detector = detector(name);
        let mut random = Random::new(7);
        for trial in 0..40 {
            let id = (random.uniform() * f64::from(dictionary.len())) as u32;
            let turn = (trial % 4) as f64 * std::f64::consts::FRAC_PI_2;
            let h = image_from_square(
                random.between(45.0, 70.0),
                turn + random.between(-0.7, 0.7),
                [random.between(-0.25, 0.25), random.between(-0.25, 0.25)],
            );
            let image = photograph(&LENS, &inverse(&h), trial, shade_of(&dictionary, id));
            let found = detector.detect(image.view());
            assert_eq!(found.iter().map(|m| m.id).collect::<Vec<_>>(), [id], "{name} {trial}");
            let error = error_px(&found[0], &h);
            // A wrong order of corners would be off by a side.
            assert!(error < 0.1, "{name} {id}: {error} px");
            worst = worst.max(error);
            sum += error;
            count += 1;
        }
    }
    eprintln!("worst corner of a marker: mean {:.3} px, max {worst:.3} px", sum / f64::from(count));
}

#[test]
fn quarter_turns_turn_the_corners() {
    for name in predefined_names() {
        let mut detector = detector(name);
        let print = detector.dictionary().render(11, 5).unwrap();
        let (side, white) = (print.width, 12);
        let total = side + 2 * white;
        for turns in 0..4 {
            let mut pixels = vec![255; total * total];
            for y in 0..side {
                for x in 0..side {
                    let (tx, ty) = match turns {
                        0 => (x, y),
                        1 => (side - 1 - y, x),
                        2 => (side - 1 - x, side - 1 - y),
                        _ => (y, side - 1 - x),
                    };
                    pixels[(ty + white) * total + tx + white] = print.pixels[y * side + x];
                }
            }
            let image = GreyImage::new(total, total, &pixels).unwrap();
            let found = detector.detect(image);
            assert_eq!(found.len(), 1, "{name}");
            assert_eq!(found[0].id, 11, "{name}");
            let (low, high) = (white as f64 - 0.5, (white + side) as f64 - 0.5);
            let square = [[low, low], [high, low], [high, high], [low, high]];
            for k in 0..4 {
                let ([x, y], [u, v]) = (found[0].corners_px[k], square[(k + turns) % 4]);
                assert!((x - u).hypot(y - v) < 0.15, "{name} {turns}: {x} {y} for {u} {v}");
            }
        }
    }
}

#[test]
fn images_without_markers_have_none() {
    let mut detector = detector("DICT_4X4_50");
    for (width, height) in [(0, 0), (0, 7), (1, 1), (2, 2), (5, 5), (6, 6), (3, 400), (400, 3)] {
        for level in [0, 127, 255] {
            let pixels = vec![level; width * height];
            let image = GreyImage::new(width, height, &pixels).unwrap();
            assert!(detector.detect(image).is_empty(), "{width} × {height}");
        }
    }
    for level in [0, 255] {
        let pixels = vec![level; 640 * 480];
        assert!(detector.detect(GreyImage::new(640, 480, &pixels).unwrap()).is_empty());
        assert!(detector.detect_rgb(640, 480, &[level; 3 * 640 * 480]).unwrap().is_empty());
    }
    assert!(detector.detect_rgb(640, 480, &[0; 640 * 480]).is_err());
    // A chessboard of single pixels: the longest border there is.
    let pixels: Vec<u8> =
        (0..480 * 640).map(|k| if (k % 640 + k / 640) % 2 == 0 { 0 } else { 255 }).collect();
    assert!(detector.detect(GreyImage::new(640, 480, &pixels).unwrap()).is_empty());
}

#[test]
fn a_marker_is_found_in_a_gigantic_image_and_as_a_gigantic_one() {
    let mut detector = detector("DICT_4X4_50");
    let print = detector.dictionary().render(3, 4).unwrap();
    let (width, height, left, top) = (9000, 7000, 8950, 6950);
    let mut pixels = vec![255; width * height];
    for (y, row) in print.pixels.chunks(print.width).enumerate() {
        let start = (top + y) * width + left;
        pixels[start..start + print.width].copy_from_slice(row);
    }
    let found = detector.detect(GreyImage::new(width, height, &pixels).unwrap());
    assert_eq!(found.len(), 1);
    let [x, y] = found[0].corners_px[0];
    assert!((x - 8949.5).abs() < 0.15 && (y - 6949.5).abs() < 0.15, "{x} {y}");

    let print = detector.dictionary().render(3, 500).unwrap();
    let total = print.width + 200;
    let mut pixels = vec![255; total * total];
    for (y, row) in print.pixels.chunks(print.width).enumerate() {
        let start = (100 + y) * total + 100;
        pixels[start..start + print.width].copy_from_slice(row);
    }
    let found = detector.detect(GreyImage::new(total, total, &pixels).unwrap());
    assert_eq!(found.iter().map(|m| m.id).collect::<Vec<_>>(), [3]);
    let [x, y] = found[0].corners_px[2];
    assert!((x - 3099.5).abs() < 0.15 && (y - 3099.5).abs() < 0.15, "{x} {y}");
}

#[test]
fn noise_holds_no_markers() {
    let [width, height] = [640, 480];
    let mut random = Random::new(3);
    let (mut images, mut false_markers) = (0, Vec::new());
    for sigma_px in [0.0, 0.7, 1.5, 3.0, 5.0, 8.0] {
        for _ in 0..3 {
            let mut noise: Vec<f64> = (0..width * height).map(|_| random.normal()).collect();
            if sigma_px > 0.0 {
                noise = blurred(&noise, [width, height], sigma_px);
            }
            let strength = (noise.iter().map(|v| v * v).sum::<f64>() / noise.len() as f64).sqrt();
            // With and without clipping to black and white.
            for contrast in [40.0, 300.0] {
                let level = |v: &f64| (128.0 + contrast * v / strength).clamp(0.0, 255.0) as u8;
                let pixels: Vec<u8> = noise.iter().map(level).collect();
                let image = GreyImage::new(width, height, &pixels).unwrap();
                for name in ["DICT_4X4_100", "DICT_6X6_250", "DICT_APRILTAG_16h5"] {
                    images += 1;
                    false_markers.extend(detector(name).detect(image).iter().map(|m| (name, m.id)));
                }
            }
        }
    }
    assert_eq!(images, 108);
    assert_eq!(false_markers, []);
}

#[test]
fn equal_images_give_equal_markers_whatever_came_before() {
    let dictionary = Dictionary::predefined("DICT_4X4_50").unwrap();
    let h = image_from_square(50.0, 0.4, [0.1, -0.2]);
    let image = photograph(&LENS, &inverse(&h), 1, shade_of(&dictionary, 9));
    let mut fresh = detector("DICT_4X4_50");
    let first = fresh.detect(image.view()).to_vec();
    let mut used = detector("DICT_4X4_50");
    used.detect(GreyImage::new(700, 500, &vec![90; 350_000]).unwrap());
    let rgb: Vec<u8> = image.pixels.iter().flat_map(|grey| [*grey; 3]).collect();
    assert_eq!(used.detect_rgb(160, 120, &rgb).unwrap(), first);
    assert_eq!(used.detect(image.view()), first);
    assert_eq!(first.len(), 1);
}

#[test]
fn a_print_is_read_as_it_was_laid_out() {
    let dictionary = Dictionary::predefined("DICT_4X4_100").unwrap();
    let (size, margin) = (720, 20);
    let total = size + 2 * margin;
    for (side, first_id) in [(SheetSide::Front, 0), (SheetSide::Back, 49)] {
        let layout = SheetLayout::new(&dictionary, [25, 25], side, first_id).unwrap();
        let print = layout.print([size, size]);
        let mut pixels = vec![255; total * total];
        for (y, row) in print.pixels.chunks(size).enumerate() {
            let start = (y + margin) * total + margin;
            pixels[start..start + size].copy_from_slice(row);
        }
        let mut detector = detector("DICT_4X4_100");
        let found = detector.detect(GreyImage::new(total, total, &pixels).unwrap());
        assert_eq!(found.len(), 49);
        for marker in found {
            let places = layout.marker(marker.id).unwrap().corners;
            for (place, [x, y]) in places.iter().zip(marker.corners_px) {
                let [u, v] = place.uv_share;
                let right = if side == SheetSide::Front { u } else { 1.0 - u };
                let expected = [right, 1.0 - v].map(|s| margin as f64 - 0.5 + s * size as f64);
                let error = (x - expected[0]).hypot(y - expected[1]);
                assert!(error < 0.2, "{side:?} {}: {error} px", marker.id);
            }
        }
    }
}

/// Where a camera of f = 600 px shows the sheet (0.15 m, shares of its sides as coordinates),
/// turned by 10° and tilted away, its middle in the image's.
fn image_from_sheet(side: SheetSide, distance_m: f64, tilt_deg: f64) -> Homography {
    const F_PX: f64 = 600.0;
    const SIDE_M: f64 = 0.15;
    let ((sin, cos), (tilt_sin, tilt_cos)) =
        (10_f64.to_radians().sin_cos(), tilt_deg.to_radians().sin_cos());
    // u to the right (to the left on the back), v upwards; image y is down.
    let mirror = if side == SheetSide::Front { 1.0 } else { -1.0 };
    let u = [cos * mirror * SIDE_M, sin * mirror * SIDE_M];
    let v = [sin * SIDE_M, -cos * SIDE_M];
    let depth = [-tilt_sin * u[1], -tilt_sin * v[1]];
    let z = [depth[0], depth[1], distance_m - (depth[0] + depth[1]) / 2.0];
    let row = |k: usize, scale: f64, middle_px: f64| {
        let (a, b) = (F_PX * scale * u[k], F_PX * scale * v[k]);
        let c = -(a + b) / 2.0;
        [a + middle_px * z[0], b + middle_px * z[1], c + middle_px * z[2]]
    };
    [row(0, 1.0, 160.2), row(1, tilt_cos, 150.7), z]
}

/// The printed sheet on a brown table, whose brightness is 0.35 of the paper's.
#[test]
fn every_point_of_a_printed_sheet_is_found() {
    let dictionary = Dictionary::predefined("DICT_4X4_100").unwrap();
    let levels = [30.0, 230.0];
    let lens = Lens { size_px: [320, 300], blur_px: 0.5, noise: 2.0, levels, curve: false };
    let mut detector = detector("DICT_4X4_100");
    for (side, first_id) in [(SheetSide::Front, 0), (SheetSide::Back, 49)] {
        let layout = SheetLayout::new(&dictionary, [25, 25], side, first_id).unwrap();
        for (distance_m, tilt_deg, points_min, limit_px) in VIEWS {
            let h = image_from_sheet(side, distance_m, tilt_deg);
            let image = photograph(&lens, &inverse(&h), 5, |uv| {
                let on_sheet = uv.iter().all(|share| (0.0..=1.0).contains(share));
                if !on_sheet { 0.35 } else { f64::from(u8::from(!layout.is_black(uv))) }
            });
            let mut seen = vec![false; 625];
            let (mut worst, mut squares, mut count) = (0.0_f64, 0.0, 0.0);
            for marker in detector.detect(image.view()) {
                let places = layout.marker(marker.id).expect("no other id").corners;
                for (place, [x, y]) in places.iter().zip(marker.corners_px) {
                    let [u, v] = apply(&h, place.uv_share);
                    let error = (x - u).hypot(y - v);
                    (squares, count) = (squares + error * error, count + 1.0);
                    worst = worst.max(error);
                    if let Some(node) = place.node {
                        seen[node] = true;
                    }
                }
            }
            let points = seen.into_iter().filter(|seen| *seen).count();
            let view = format!("{side:?}, {distance_m} m, {tilt_deg}°");
            let rms = f64::sqrt(squares / count);
            eprintln!("{view}: {points} of 169 points, rms {rms:.3} px, worst {worst:.3} px");
            assert!(points >= points_min && worst < limit_px, "{view}");
        }
    }
}

/// Distance, tilt, fewest points, largest error. Measured: all points and 0.10, 0.18, 0.31 px from
/// above (167 at 0.6 m, where the narrow markers' modules are 1.8 px); slanted all but those of
/// the last, which has modules of 1.4 px at the far end, and 0.41, 0.37, 0.41 and 0.50 px.
const VIEWS: [(f64, f64, usize, f64); 7] = [
    (0.40, 0.0, 169, 0.15),
    (0.52, 0.0, 169, 0.25),
    (0.60, 0.0, 163, 0.4),
    (0.40, 40.0, 169, 0.5),
    (0.40, 50.0, 165, 0.5),
    (0.52, 40.0, 165, 0.5),
    (0.52, 50.0, 140, 0.6),
];
