//! Flat printed things as a camera sees them, with known corners.

use orime_markers::{Dictionary, Raster};

/// Rows of a projective map, applied to (x, y, 1).
pub type Homography = [[f64; 3]; 3];

pub fn apply(h: &Homography, [x, y]: [f64; 2]) -> [f64; 2] {
    let [p, q, w] = h.map(|[a, b, c]| a * x + b * y + c);
    [p / w, q / w]
}

/// Inverse up to scale: the adjugate.
pub fn inverse(m: &Homography) -> Homography {
    let minor = |r: usize, c: usize| {
        let (r1, r2, c1, c2) = ((r + 1) % 3, (r + 2) % 3, (c + 1) % 3, (c + 2) % 3);
        m[r1][c1] * m[r2][c2] - m[r1][c2] * m[r2][c1]
    };
    [0, 1, 2].map(|r| [0, 1, 2].map(|c| minor(c, r)))
}

/// Uniform numbers in [0, 1) by counter: SplitMix64.
pub struct Random(u64);

impl Random {
    pub fn new(seed: u64) -> Self {
        Self(seed.wrapping_mul(0x2545_f491_4f6c_dd1d))
    }

    pub fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ self.0 >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        (z ^ z >> 31) as f64 * 2f64.powi(-64)
    }

    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.uniform()
    }

    /// Twelve uniforms: normal enough for noise, σ = 1.
    pub fn normal(&mut self) -> f64 {
        (0..12).map(|_| self.uniform()).sum::<f64>() - 6.0
    }
}

/// What the camera does to the scene.
#[derive(Debug, Clone, Copy)]
pub struct Lens {
    pub size_px: [usize; 2],
    /// σ of a Gaussian, on top of the pixels' own area.
    pub blur_px: f64,
    /// σ, grey levels.
    pub noise: f64,
    /// Grey level of black ink and of paper.
    pub levels: [f64; 2],
    /// Whether light is mixed before the display's curve (sRGB), as cameras do it, or after.
    pub curve: bool,
}

impl Lens {
    /// Grey level of a mixture of ink (0) and paper (1).
    fn level(&self, share: f64) -> f64 {
        let [black, white] = self.levels;
        if !self.curve {
            return black + (white - black) * share;
        }
        let [dark, bright] = [black, white].map(|level| light(level / 255.0));
        255.0 * display(dark + (bright - dark) * share)
    }
}

/// Light of a display's level, both 0 to 1 (sRGB).
fn light(level: f64) -> f64 {
    if level <= 0.04045 { level / 12.92 } else { ((level + 0.055) / 1.055).powf(2.4) }
}

/// Its inverse.
fn display(light: f64) -> f64 {
    if light <= 0.003_130_8 { 12.92 * light } else { 1.055 * light.powf(1.0 / 2.4) - 0.055 }
}

/// The scene `shade` (0 black … 1 white, in its own plane) where `plane_from_image` says.
pub fn photograph(
    lens: &Lens,
    plane_from_image: &Homography,
    seed: u64,
    shade: impl Fn([f64; 2]) -> f64,
) -> Raster {
    const PARTS: usize = 6;
    let [width, height] = lens.size_px;
    let mut image = vec![0.0; width * height];
    for (k, value) in image.iter_mut().enumerate() {
        let (x, y) = ((k % width) as f64, (k / width) as f64);
        for part in 0..PARTS * PARTS {
            let inside = |p: usize| (p as f64 + 0.5) / PARTS as f64 - 0.5;
            let at = [x + inside(part % PARTS), y + inside(part / PARTS)];
            *value += shade(apply(plane_from_image, at)) / (PARTS * PARTS) as f64;
        }
    }
    if lens.blur_px > 0.0 {
        image = blurred(&image, [width, height], lens.blur_px);
    }
    let mut random = Random::new(seed);
    let pixels = image
        .iter()
        .map(|value| {
            let level = lens.level(*value) + lens.noise * random.normal();
            level.round().clamp(0.0, 255.0) as u8
        })
        .collect();
    Raster { width, height, pixels }
}

/// Both directions; the border is repeated.
pub fn blurred(image: &[f64], [width, height]: [usize; 2], sigma_px: f64) -> Vec<f64> {
    let reach = (4.0 * sigma_px).ceil() as isize;
    let weights: Vec<f64> =
        (-reach..=reach).map(|k| (-0.5 * (k as f64 / sigma_px).powi(2)).exp()).collect();
    let total: f64 = weights.iter().sum();
    let pass = |image: &[f64], along: [isize; 2]| -> Vec<f64> {
        (0..width * height)
            .map(|k| {
                let (x, y) = ((k % width) as isize, (k / width) as isize);
                let mut sum = 0.0;
                for (weight, step) in weights.iter().zip(-reach..) {
                    let x = (x + step * along[0]).clamp(0, width as isize - 1) as usize;
                    let y = (y + step * along[1]).clamp(0, height as isize - 1) as usize;
                    sum += weight * image[y * width + x];
                }
                sum / total
            })
            .collect()
    };
    pass(&pass(image, [1, 0]), [0, 1])
}

/// A unit square somewhere in the image: about `side_px` wide, turned, seen at a slant.
pub fn image_from_square(side_px: f64, turn_rad: f64, slant: [f64; 2]) -> Homography {
    let (sin, cos) = turn_rad.sin_cos();
    let [gx, gy] = slant;
    let map = |[x, y]: [f64; 2]| [side_px * (cos * x - sin * y), side_px * (sin * x + cos * y)];
    let ([a, c], [b, d]) = (map([1.0, 0.0]), map([0.0, 1.0]));
    let [e, f] = map([-0.5, -0.5]);
    let (u, v, w) = (79.3, 60.6, 1.0 - 0.5 * gx - 0.5 * gy);
    [[a + u * gx, b + u * gy, e + u * w], [c + v * gx, d + v * gy, f + v * w], [gx, gy, w]]
}

/// White paper with one marker on the unit square.
pub fn shade_of(dictionary: &Dictionary, id: u32) -> impl Fn([f64; 2]) -> f64 {
    move |[x, y]| {
        let module = |share: f64| (share * dictionary.modules() as f64) as usize;
        let inside = (0.0..1.0).contains(&x) && (0.0..1.0).contains(&y);
        if inside && dictionary.is_black(id, module(y), module(x)) { 0.0 } else { 1.0 }
    }
}
