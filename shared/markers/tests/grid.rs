//! Corners by the grid of rendered markers, whose true corners and borders are known.

mod scene;

use orime_markers::{
    Detector, DetectorParams, Dictionary, GridFit, GridRefusal, Marker, Raster, fit_grid,
    moved_outwards,
};
use scene::{Homography, Lens, Random, apply, image_from_square, inverse, photograph, shade_of};

/// A lens and a display's curve: black looks smaller by a third of a pixel on every side.
const LENS: Lens =
    Lens { size_px: [160, 120], blur_px: 0.5, noise: 2.0, levels: [45.0, 225.0], curve: true };

/// One marker found in a picture of it, beside the truth.
struct Shot {
    dictionary: Dictionary,
    image: Raster,
    marker: Marker,
    corners_px: [[f64; 2]; 4],
}

const SQUARE: [[f64; 2]; 4] = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];

impl Shot {
    fn new(lens: &Lens, name: &str, id: u32, h: &Homography, seed: u64) -> Self {
        let dictionary = Dictionary::predefined(name).unwrap();
        let image = photograph(lens, &inverse(h), seed, shade_of(&dictionary, id));
        let config = DetectorParams::default().check().unwrap();
        let mut detector = Detector::new(&config, dictionary.clone());
        let marker = detector.detect(image.view())[0];
        Self { dictionary, image, marker, corners_px: SQUARE.map(|corner| apply(h, corner)) }
    }

    fn fit(&self) -> Result<GridFit, GridRefusal> {
        fit_grid(self.image.view(), &self.dictionary, &self.marker)
    }

    /// By how much the sides of these corners are too long, as a share.
    fn side_error(&self, corners_px: &[[f64; 2]; 4]) -> f64 {
        perimeter_px(corners_px) / perimeter_px(&self.corners_px) - 1.0
    }

    /// Mean square of the corners' coordinates' errors, pixels².
    fn error_px2(&self, fit: &GridFit) -> f64 {
        let pairs = fit.corners_px.iter().flatten().zip(self.corners_px.iter().flatten());
        pairs.map(|(found, truth)| (found - truth).powi(2)).sum::<f64>() / 8.0
    }
}

fn perimeter_px(corners: &[[f64; 2]; 4]) -> f64 {
    let side = |k: usize| {
        let (a, b) = (corners[k], corners[(k + 1) % 4]);
        (b[0] - a[0]).hypot(b[1] - a[1])
    };
    (0..4).map(side).sum()
}

/// Markers of 30 to 60 px at a slant.
fn shots(lens: &Lens, count: u64) -> Vec<Shot> {
    let mut random = Random::new(11);
    let names = ["DICT_4X4_50", "DICT_4X4_50", "DICT_5X5_100", "DICT_6X6_250"];
    let each = (0..count).map(|trial| {
        let name = names[trial as usize % 4];
        let id = (random.uniform() * 50.0) as u32;
        let least_px = if name == "DICT_4X4_50" { 30.0 } else { 42.0 };
        let h = image_from_square(
            random.between(least_px, 60.0),
            random.between(-3.1, 3.1),
            [random.between(-0.25, 0.25), random.between(-0.25, 0.25)],
        );
        Shot::new(lens, name, id, &h, trial)
    });
    each.collect()
}

fn mean(values: impl Iterator<Item = f64> + Clone) -> f64 {
    values.clone().sum::<f64>() / values.count() as f64
}

#[test]
fn a_curve_moves_the_square_and_not_the_grid() {
    let shots = shots(&LENS, 40);
    let fits: Vec<GridFit> = shots.iter().map(|shot| shot.fit().unwrap()).collect();
    let both = || shots.iter().zip(&fits);
    let square = mean(shots.iter().map(|shot| shot.side_error(&shot.marker.corners_px)));
    let grid = mean(both().map(|(shot, fit)| shot.side_error(&fit.corners_px)));
    let worst = both().map(|(shot, fit)| shot.side_error(&fit.corners_px).abs());
    let worst = worst.fold(0.0, f64::max);
    eprintln!("sides: square {:.2} %, grid {:.3} %", 1e2 * square, 1e2 * grid);
    assert!(square < -0.008, "{square}");
    assert!(grid.abs() < 3e-4 && worst < 3e-3, "{grid}, worst {worst}");
    // One camera, one shift; the square moved by it is as good as the grid.
    let shift_px = mean(fits.iter().map(|fit| fit.shift_px));
    assert!(fits.iter().all(|fit| (fit.shift_px - shift_px).abs() < 0.04), "{fits:?}");
    let moved = shots
        .iter()
        .map(|shot| shot.side_error(&moved_outwards(&shot.marker.corners_px, shift_px)));
    let moved = mean(moved);
    assert!(moved.abs() < 1e-3, "{moved}");
    // What is stated as uncertain is what is off, over all.
    let off_px = mean(both().map(|(shot, fit)| shot.error_px2(fit))).sqrt();
    let stated_px = mean(fits.iter().map(|fit| fit.corner_sigma_px.powi(2))).sqrt();
    eprintln!("shift {shift_px:.3} px; corners off by {off_px:.4} px, stated {stated_px:.4} px");
    assert!((0.5..2.0).contains(&(off_px / stated_px)), "{off_px} for {stated_px}");
}

#[test]
fn without_a_curve_there_is_no_shift() {
    let shots = shots(&Lens { curve: false, ..LENS }, 12);
    let fits = shots.iter().map(|shot| shot.fit().unwrap());
    let shift_px = mean(fits.map(|fit| fit.shift_px).collect::<Vec<_>>().into_iter());
    assert!(shift_px.abs() < 0.01, "{shift_px}");
}

#[test]
fn noise_is_stated_and_too_much_of_it_refused() {
    let noisy = shots(&Lens { noise: 12.0, ..LENS }, 24);
    let fits: Vec<(&Shot, GridFit)> =
        noisy.iter().filter_map(|shot| Some((shot, shot.fit().ok()?))).collect();
    assert!(fits.len() >= 20, "{}", fits.len());
    let off_px = mean(fits.iter().map(|(shot, fit)| shot.error_px2(fit))).sqrt();
    let stated_px = mean(fits.iter().map(|(_, fit)| fit.corner_sigma_px.powi(2))).sqrt();
    eprintln!("noise 12: corners off by {off_px:.4} px, stated {stated_px:.4} px");
    assert!((0.5..2.0).contains(&(off_px / stated_px)), "{off_px} for {stated_px}");
    assert!(off_px > 0.03, "the noise must be seen: {off_px}");
    // A picture of nothing where the marker was.
    let mut shot = Shot::new(&LENS, "DICT_4X4_50", 7, &image_from_square(40.0, 0.3, [0.1, 0.0]), 1);
    let mut random = Random::new(5);
    shot.image.pixels.fill_with(|| (255.0 * random.uniform()) as u8);
    let refused = shot.fit();
    assert!(refused.is_err(), "{refused:?}");
}

#[test]
fn what_cannot_say_the_shift_is_refused() {
    let h = image_from_square(48.0, 0.4, [0.1, -0.1]);
    // A sticker hides the inside: what is left is a square, of any size and shift.
    let dictionary = Dictionary::predefined("DICT_4X4_50").unwrap();
    let open = Shot::new(&LENS, "DICT_4X4_50", 7, &h, 3);
    let hidden = photograph(&LENS, &inverse(&h), 3, |[x, y]| {
        let inside = (0.0..1.0).contains(&x) && (0.0..1.0).contains(&y);
        if inside { 0.0 } else { shade_of(&dictionary, 7)([x, y]) }
    });
    let hidden = Shot { image: hidden, dictionary: dictionary.clone(), ..open };
    let refused = hidden.fit();
    assert!(
        matches!(
            refused,
            Err(GridRefusal::Uncertain { .. }
                | GridRefusal::Unsettled
                | GridRefusal::TooFewBorders { .. })
        ),
        "{refused:?}"
    );
    // Modules of 2 px.
    let small = Shot::new(&LENS, "DICT_4X4_50", 7, &image_from_square(13.0, 0.1, [0.0, 0.0]), 3);
    assert!(matches!(small.fit(), Err(GridRefusal::TooSmall { .. })), "{:?}", small.fit());
    // Grey in grey.
    let mut faint = Shot::new(&LENS, "DICT_4X4_50", 7, &h, 3);
    faint.image.pixels.iter_mut().for_each(|level| *level = 100 + *level / 100);
    assert!(matches!(faint.fit(), Err(GridRefusal::TooFewBorders { .. })), "{:?}", faint.fit());
    // Corners that are no quadrangle.
    let mut flat = Shot::new(&LENS, "DICT_4X4_50", 7, &h, 3);
    flat.marker.corners_px = [[50.0, 50.0]; 4];
    assert!(flat.fit().is_err());
}

#[test]
fn equal_images_give_equal_grids() {
    let h = image_from_square(45.0, 1.1, [0.2, -0.1]);
    let [a, b] = [0; 2].map(|_| Shot::new(&LENS, "DICT_4X4_50", 9, &h, 4).fit().unwrap());
    assert_eq!(a, b);
}

#[test]
fn sides_are_moved_along_their_normals() {
    let square = [[10.0, 10.0], [50.0, 10.0], [50.0, 40.0], [10.0, 40.0]];
    let wider = moved_outwards(&square, 0.5);
    let expected = [[9.5, 9.5], [50.5, 9.5], [50.5, 40.5], [9.5, 40.5]];
    for (found, expected) in wider.iter().flatten().zip(expected.iter().flatten()) {
        assert!((found - expected).abs() < 1e-12, "{wider:?}");
    }
    let slanted = [[10.0, 10.0], [50.0, 14.0], [44.0, 40.0], [12.0, 33.0]];
    let back = moved_outwards(&moved_outwards(&slanted, 0.7), -0.7);
    for (found, start) in back.iter().flatten().zip(slanted.iter().flatten()) {
        assert!((found - start).abs() < 1e-9, "{back:?}");
    }
    let line = [[0.0, 0.0], [1.0, 0.0], [2.0, 0.0], [3.0, 0.0]];
    assert_eq!(moved_outwards(&line, 0.5), line);
}
