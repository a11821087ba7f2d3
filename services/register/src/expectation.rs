//! The E-step's inner kernel: a few observed points against the blocks of components near them.
//!
//! Written over [`Lanes`]: every sum runs in sixteen fixed lanes, so that AVX-512, AVX2 and
//! portable code give the same bits.

use crate::blocks::fold;
use orime_lanes::{LANES, Lanes, fused_dot, load_points, minus, plus, store_points, times};

/// Points that are looked at together: what stands between the two passes stays in the cache.
pub(crate) const POINTS: usize = 8;

/// The components, in their blocks' order, and what the E-step gives them.
#[derive(Debug, Clone, Default)]
pub(crate) struct Components {
    /// Positions, metres.
    pub at_m: [Vec<f32>; 3],
    /// Σ p of each.
    pub mass: Vec<f32>,
    /// Σ p·(point − component) of each, metres.
    pub pull_m: [Vec<f32>; 3],
    /// Weights before they are shared out, block by block, a vector per point.
    weight: Vec<f32>,
}

/// Up to [`POINTS`] observed points.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Points<'a> {
    /// Positions, metres, of the first `len`.
    pub at_m: [[f32; 3]; POINTS],
    /// Prior weight of every component for each point.
    pub priors: [&'a [f32]; POINTS],
    /// How many there are.
    pub len: usize,
}

/// What the mixture is asked with.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Shape {
    /// σ², m².
    pub variance_m2: f32,
    /// `c`: weight of the outlier class beside one component's.
    pub uniform: f32,
}

/// What some points gave.
#[derive(Debug, Default, Clone, Copy, PartialEq)]
pub(crate) struct Shares {
    /// Σ p over all components, per point.
    pub mass: [f32; POINTS],
    /// 1/(Σ α exp(…) + c), per point.
    inverse: [f32; POINTS],
    /// Σ p·|point − component|², m².
    pub squared_m2: f32,
}

impl Components {
    /// So many components, at the origin.
    pub fn new(places: usize) -> Self {
        assert!(places.is_multiple_of(LANES), "whole blocks");
        let zeros = || vec![0.0; places];
        Self {
            at_m: [(); 3].map(|()| zeros()),
            mass: zeros(),
            pull_m: [(); 3].map(|()| zeros()),
            weight: vec![0.0; places * POINTS],
        }
    }

    /// Position of a component, metres.
    #[cfg(test)]
    pub fn position_m(&self, place: usize) -> [f32; 3] {
        [self.at_m[0][place], self.at_m[1][place], self.at_m[2][place]]
    }

    /// Forgets what the last E-step gave.
    pub fn clear(&mut self) {
        self.mass.fill(0.0);
        self.pull_m.iter_mut().for_each(|pull_m| pull_m.fill(0.0));
    }

    /// Soft correspondences between points and the blocks `near` them, added to mass and pull.
    ///
    /// p[m,n] = α[m] exp(−|x[n]−y[m]|²/2σ²) / (Σ_k α[k] exp(−|x[n]−y[k]|²/2σ²) + c)
    #[inline(always)]
    pub fn expect<V: Lanes>(&mut self, points: &Points<'_>, near: &[u32], shape: &Shape) -> Shares {
        let places = self.mass.len();
        assert!(near.iter().all(|block| (*block as usize + 1) * LANES <= places));
        assert!(points.priors[..points.len].iter().all(|priors| priors.len() == places));
        // SAFETY: every block's places exist, here and in the priors; see also `new`.
        unsafe {
            let shares = self.weigh::<V>(points, near, shape);
            self.share::<V>(points, near, shares)
        }
    }

    /// The first pass: weights, and what they add up to per point.
    ///
    /// # Safety
    /// The places of `near` exist in the components and in the points' priors.
    #[inline(always)]
    unsafe fn weigh<V: Lanes>(
        &mut self,
        points: &Points<'_>,
        near: &[u32],
        shape: &Shape,
    ) -> Shares {
        let exponent = V::splat(-std::f32::consts::LOG2_E / (2.0 * shape.variance_m2));
        let farthest_m2 =
            V::splat(EXPONENT_MAX / std::f32::consts::LOG2_E * 2.0 * shape.variance_m2);
        let at_m = [self.at_m[0].as_ptr(), self.at_m[1].as_ptr(), self.at_m[2].as_ptr()];
        let mut totals = [[0f32; LANES]; POINTS];
        let mut to = 0;
        for block in near {
            let first = *block as usize * LANES;
            // SAFETY: the caller's; as many vectors are written as blocks × points exist.
            unsafe {
                let y = load_points::<V>(at_m, first);
                for (n, total) in totals.iter_mut().enumerate().take(points.len) {
                    let d = minus(splat::<V>(points.at_m[n]), y);
                    let squared = fused_dot(d, d).min(farthest_m2);
                    let prior = V::load(points.priors[n].as_ptr().add(first));
                    let weight = prior.mul(exp2(squared, exponent));
                    weight.store(self.weight.as_mut_ptr().add(to));
                    V::load(total.as_ptr()).add(weight).store(total.as_mut_ptr());
                    to += LANES;
                }
            }
        }
        let mut shares = Shares::default();
        for (n, total) in totals.iter().enumerate().take(points.len) {
            let total = fold(total, |a, b| a + b);
            shares.inverse[n] = if total > 0.0 { 1.0 / (total + shape.uniform) } else { 0.0 };
            shares.mass[n] = total * shares.inverse[n];
        }
        shares
    }

    /// The second pass: shares the points out.
    ///
    /// With x and y counted from one of the points, so that no large numbers are subtracted:
    /// Σₙ p(x − y) = Σₙ p x − y Σₙ p, and Σₙ p|x − y|² = Σₙ p|x|² − y·(Σₙ p x + Σₙ p(x − y)).
    ///
    /// # Safety
    /// As for [`Self::weigh`], after it.
    #[inline(always)]
    unsafe fn share<V: Lanes>(
        &mut self,
        points: &Points<'_>,
        near: &[u32],
        mut shares: Shares,
    ) -> Shares {
        let at_m = [self.at_m[0].as_ptr(), self.at_m[1].as_ptr(), self.at_m[2].as_ptr()];
        let [x, y, z] = &mut self.pull_m;
        let pull_m = [x.as_mut_ptr(), y.as_mut_ptr(), z.as_mut_ptr()];
        let zero = V::splat(0.0);
        let origin_m = points.at_m[0];
        // Per point: what its weight adds to Σ p, Σ p x and Σ p|x|².
        let mut factors = [[0f32; 5]; POINTS];
        for (n, factors) in factors.iter_mut().enumerate().take(points.len) {
            let [x, y, z] = [0, 1, 2].map(|axis| points.at_m[n][axis] - origin_m[axis]);
            *factors = [1.0, x, y, z, x * x + y * y + z * z].map(|f| f * shares.inverse[n]);
        }
        let mut squared = zero;
        let mut from = 0;
        for block in near {
            let first = *block as usize * LANES;
            // SAFETY: the caller's.
            unsafe {
                let [mut mass, mut along, mut far] = [zero, zero, zero];
                let [mut across, mut up] = [zero; 2];
                for factors in factors.iter().take(points.len) {
                    let weight = V::load(self.weight.as_ptr().add(from));
                    mass = weight.mul_add(V::splat(factors[0]), mass);
                    along = weight.mul_add(V::splat(factors[1]), along);
                    across = weight.mul_add(V::splat(factors[2]), across);
                    up = weight.mul_add(V::splat(factors[3]), up);
                    far = weight.mul_add(V::splat(factors[4]), far);
                    from += LANES;
                }
                let y = minus(load_points::<V>(at_m, first), splat::<V>(origin_m));
                let sum = [along, across, up];
                let away = mass.mul(V::splat(-1.0));
                let pull = [
                    y[0].mul_add(away, sum[0]),
                    y[1].mul_add(away, sum[1]),
                    y[2].mul_add(away, sum[2]),
                ];
                squared = squared.add(far.sub(fused_dot(y, plus(sum, pull))));
                let to = self.mass.as_mut_ptr().add(first);
                V::load(to).add(mass).store(to);
                let before = load_points::<V>(pull_m.map(|pull_m| pull_m.cast_const()), first);
                store_points(plus(before, pull), pull_m, first);
            }
        }
        let mut lanes = [0f32; LANES];
        // SAFETY: the array has sixteen numbers.
        unsafe { squared.store(lanes.as_mut_ptr()) };
        shares.squared_m2 = fold(&lanes, |a, b| a + b);
        shares
    }

    /// Σ p·(point − component) of one of the points that [`Self::expect`] has just been asked
    /// about, metres.
    #[inline(always)]
    pub fn away_m<V: Lanes>(
        &self,
        points: &Points<'_>,
        near: &[u32],
        shares: &Shares,
        n: usize,
    ) -> [f32; 3] {
        let places = self.mass.len();
        assert!(n < points.len && near.iter().all(|b| (*b as usize + 1) * LANES <= places));
        let at_m = [self.at_m[0].as_ptr(), self.at_m[1].as_ptr(), self.at_m[2].as_ptr()];
        let mut sum = splat::<V>([0.0; 3]);
        let mut lanes = [[0f32; LANES]; 3];
        // SAFETY: the places exist, and as many weights as blocks × points.
        unsafe {
            for (k, block) in near.iter().enumerate() {
                let y = load_points::<V>(at_m, *block as usize * LANES);
                let weight = V::load(self.weight.as_ptr().add((k * points.len + n) * LANES));
                sum = plus(sum, times(minus(splat::<V>(points.at_m[n]), y), weight));
            }
            let [x, y, z] = &mut lanes;
            store_points(sum, [x.as_mut_ptr(), y.as_mut_ptr(), z.as_mut_ptr()], 0);
        }
        lanes.map(|lanes| fold(&lanes, |a, b| a + b) * shares.inverse[n])
    }
}

/// A point in all lanes.
#[inline(always)]
pub(crate) fn splat<V: Lanes>(point: [f32; 3]) -> [V; 3] {
    [V::splat(point[0]), V::splat(point[1]), V::splat(point[2])]
}

/// Exponent of two from which on a weight counts as this: far below what a sum shows, and far
/// above what processors are slow with.
const EXPONENT_MAX: f32 = 60.0;

/// 2^(a·b) for −[`EXPONENT_MAX`] ≤ a·b ≤ 0, relative error below 1e-6.
#[inline(always)]
fn exp2<V: Lanes>(a: V, b: V) -> V {
    // Adding 1.5·2²³ rounds to an integer; what is left is −½ to ½.
    let round = V::splat(orime_lanes::ROUND);
    let shifted = a.mul_add(b, round);
    let f = a.mul_add(b, round.sub(shifted));
    let mut series = V::splat(0.001_327_65);
    series = series.mul_add(f, V::splat(0.009_675_54));
    series = series.mul_add(f, V::splat(0.055_507_13));
    series = series.mul_add(f, V::splat(0.240_221_2));
    series = series.mul_add(f, V::splat(0.693_146_97));
    series = series.mul_add(f, V::splat(1.0));
    series.mul(shifted.two_to())
}

#[cfg(test)]
mod tests {
    use super::*;
    use orime_lanes::{Pass, Width};

    #[test]
    fn exp2_is_close_everywhere() {
        for k in 0..=60_000 {
            let t = -(k as f32) / 1000.0;
            let found = f64::from(exp2([t; LANES], [1.0; LANES])[5]);
            let exact = f64::from(t).exp2();
            assert!((found - exact).abs() <= 1e-6 * exact, "2^{t}: {found}");
        }
    }

    /// Three blocks, of which the first and the last are near.
    fn components() -> Components {
        let mut components = Components::new(3 * LANES);
        for k in 0..3 * LANES {
            let at = k as f32;
            let position = [0.0006 * at, 0.002 * (at * 0.7).sin(), 0.001 * (at * 1.3).cos()];
            for (at_m, position) in components.at_m.iter_mut().zip(position) {
                at_m[k] = position;
            }
        }
        components
    }

    const NEAR: [u32; 2] = [0, 2];
    const SHAPE: Shape = Shape { variance_m2: 4e-6, uniform: 0.3 };

    fn priors() -> Vec<f32> {
        (0..3 * LANES).map(|k| if k % 5 == 0 { 0.02 } else { 1.0 }).collect()
    }

    fn points(priors: &[f32]) -> Points<'_> {
        let at = |n: usize| n as f32;
        let at_m =
            std::array::from_fn(|n| [0.004 * at(n), 0.001 * at(n).sin(), 0.001 * at(n).cos()]);
        Points { at_m, priors: [priors; POINTS], len: 7 }
    }

    struct Once<'a>(&'a Points<'a>, &'a mut Components, &'a mut (Shares, [f32; 3]));

    impl Pass for Once<'_> {
        #[inline(always)]
        fn run<V: Lanes>(self) {
            let shares = self.1.expect::<V>(self.0, &NEAR, &SHAPE);
            *self.2 = (shares, self.1.away_m::<V>(self.0, &NEAR, &shares, 2));
        }
    }

    #[test]
    fn every_width_gives_the_same_bits() {
        let priors = priors();
        let at = |width: Width| {
            let (mut components, mut found) = (components(), Default::default());
            width.run(Once(&points(&priors), &mut components, &mut found));
            (found, components.mass, components.pull_m)
        };
        let portable = at(Width::Portable);
        assert!(portable.0.0.mass.iter().sum::<f32>() > 1.0);
        for width in Width::available() {
            assert_eq!(at(width), portable, "{width:?}");
        }
    }

    #[test]
    fn the_kernel_is_the_formula() {
        let (priors, mut found) = (priors(), components());
        let points = points(&priors);
        let mut given = Default::default();
        Width::Portable.run(Once(&points, &mut found, &mut given));
        let (shares, away_m) = given;
        let is_near = |k: usize| NEAR.contains(&((k / LANES) as u32));
        let mut mass = vec![0f64; 3 * LANES];
        let mut pull_x = vec![0f64; 3 * LANES];
        let (mut squared_m2, mut away_exact_m) = (0.0, [0.0; 3]);
        for n in 0..points.len {
            let way = |k: usize| -> [f64; 3] {
                let y = found.position_m(k);
                std::array::from_fn(|i| f64::from(points.at_m[n][i]) - f64::from(y[i]))
            };
            let squared = |k: usize| way(k).iter().map(|d| d * d).sum::<f64>();
            let weight = |k: usize| {
                let near = if is_near(k) { f64::from(priors[k]) } else { 0.0 };
                near * (-squared(k) / 8e-6).exp()
            };
            let total = (0..3 * LANES).map(weight).sum::<f64>();
            for k in 0..3 * LANES {
                let p = weight(k) / (total + 0.3);
                mass[k] += p;
                pull_x[k] += p * way(k)[0];
                squared_m2 += p * squared(k);
                if n == 2 {
                    (0..3).for_each(|axis| away_exact_m[axis] += p * way(k)[axis]);
                }
            }
            assert!((f64::from(shares.mass[n]) - total / (total + 0.3)).abs() < 1e-5);
        }
        for k in 0..3 * LANES {
            assert!((f64::from(found.mass[k]) - mass[k]).abs() < 1e-5);
            assert!((f64::from(found.pull_m[0][k]) - pull_x[k]).abs() < 1e-8);
        }
        assert!((f64::from(shares.squared_m2) / squared_m2 - 1.0).abs() < 1e-4);
        for (found, exact) in away_m.iter().zip(away_exact_m) {
            assert!((f64::from(*found) - exact).abs() < 1e-7);
        }
    }
}
