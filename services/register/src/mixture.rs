//! The sheet as a Gaussian mixture: virtual nodes between the nodes, and the E-step over them.

use crate::blend::{Blend, Blender};
use crate::blocks::Blocks;
use crate::cloud::{Cell, Cloud};
use crate::expectation::{Components, POINTS, Points, Shape, splat};
use crate::visibility::Visibility;
use orime_creases::Folds;
use orime_geometry::SheetGrid;
use orime_lanes::{LANES, Lanes, Pass, Width, dot, load_points, minus};

/// σ beyond which a component is not asked about a point: exp(−3.5²/2) = 2e-3.
const CUTOFF_SIGMAS: f32 = 3.5;

/// Components of the mixture and what the last E-step gave them. All lie in the places of `blocks`.
#[derive(Debug, Clone)]
pub(crate) struct Mixture {
    /// Which component lies where.
    pub blocks: Blocks,
    /// Where they are, and what they were given.
    pub components: Components,
    /// Material coordinates, metres.
    pub uv_m: Vec<[f32; 2]>,
    /// Interpolation from the sheet's nodes.
    blends: Vec<Blend>,
    fine: SheetGrid,
    /// Positions before they were last placed.
    before_m: [Vec<f32>; 3],
    /// Prior weights where nobody knows better: 1, and 0 in places that are left over.
    present: Vec<f32>,
    near: Vec<u32>,
    width: Width,
}

/// Sums over all points and components of one E-step.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Expectation {
    /// N_p = Σ p.
    pub mass: f64,
    /// Σ p·|x − y|², m².
    pub squared_m2: f64,
}

/// How an E-step is done.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Asked {
    /// Standard deviation of the components, metres.
    pub sigma_m: f32,
    /// Density of the outlier class relative to one component: the `c` of Myronenko & Song's
    /// equation 6 without its (2πσ²)^{3/2}.
    pub uniform_per_m3: f64,
    /// Of how many points one is asked, which then counts as many times: a wide mixture does not
    /// need all.
    pub thinning: usize,
}

/// What the mixture says about one point.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Answer {
    /// Its place in the cloud.
    pub point: usize,
    /// Σ p over the components, 0 … 1.
    pub mass: f32,
    /// Σ p·(point − component), metres.
    pub away_m: [f32; 3],
}

impl Mixture {
    /// `per_cell` components per grid cell and direction.
    pub fn new(sheet: &SheetGrid, per_cell: usize) -> Self {
        let fine = SheetGrid::new(sheet.size_m, Self::fine_nodes(sheet, per_cell));
        let blocks = Blocks::new(&fine);
        let places = blocks.places();
        let uv_m: Vec<[f32; 2]> = fine.uv_m().map(|uv| uv.map(|c| c as f32)).collect();
        let mut mixture = Self {
            uv_m: blocks.components.iter().map(|c| uv_m[*c as usize]).collect(),
            blends: Vec::new(),
            components: Components::new(places),
            before_m: [(); 3].map(|()| vec![0.0; places]),
            present: (0..places).map(|m| f32::from(u8::from(blocks.is_present(m)))).collect(),
            near: Vec::new(),
            width: Width::available()[0],
            blocks,
            fine,
        };
        mixture.refold(&Blender::new(&Folds::flat(sheet)));
        mixture
    }

    /// Components along u and v.
    pub fn fine_nodes(sheet: &SheetGrid, per_cell: usize) -> [usize; 2] {
        sheet.nodes.map(|n| (n - 1) * per_cell + 1)
    }

    /// Mean distance of neighbouring components at rest, metres.
    pub fn spacing_m(&self) -> f32 {
        let [h_u, h_v] = self.fine.spacing_m();
        (0.5 * (h_u + h_v)) as f32
    }

    /// Takes over other folds: a component is a part of the facet that it lies in.
    pub fn refold(&mut self, blender: &Blender<'_>) {
        let blends: Vec<Blend> = self.fine.uv_m().map(|uv| blender.at(uv)).collect();
        self.blends.clear();
        self.blends.extend(self.blocks.components.iter().map(|c| blends[*c as usize]));
    }

    /// Moves the components with the sheet's nodes.
    pub fn place(&mut self, nodes_m: &[[f32; 3]]) {
        std::mem::swap(&mut self.before_m, &mut self.components.at_m);
        let [x, y, z] = &mut self.components.at_m;
        for (m, blend) in self.blends.iter().enumerate() {
            [x[m], y[m], z[m]] = blend.position_m(nodes_m);
        }
    }

    /// Moves the components, and says what Σ p·|x − y|² of the last E-step becomes, m².
    ///
    /// Σp|x − y'|² = Σp|x − y|² − 2 Σ_m δ·Σ_n p(x − y) + Σ_m |δ|² Σ_n p, with y' = y + δ: no
    /// large numbers are subtracted.
    pub fn place_after(&mut self, nodes_m: &[[f32; 3]], squared_m2: f64) -> f64 {
        self.place(nodes_m);
        let Components { at_m, mass, pull_m, .. } = &self.components;
        let mut lanes = [0f64; LANES];
        for axis in 0..3 {
            let [now, before, pull] = [&at_m[axis], &self.before_m[axis], &pull_m[axis]];
            for first in (0..mass.len()).step_by(LANES) {
                for (lane, sum) in lanes.iter_mut().enumerate() {
                    let m = first + lane;
                    let delta = f64::from(now[m] - before[m]);
                    *sum += delta * (delta * f64::from(mass[m]) - 2.0 * f64::from(pull[m]));
                }
            }
        }
        squared_m2 + lanes.iter().sum::<f64>()
    }

    /// Means over the components of each node's neighbourhood, weighted as they are blended:
    /// `value` of each component to one value per node.
    pub fn to_nodes(&self, value: impl Fn(usize) -> f32, nodes: &mut [f32]) {
        let mut weights = vec![0f32; nodes.len()];
        nodes.fill(0.0);
        for (m, blend) in self.blends.iter().enumerate() {
            if !self.blocks.is_present(m) {
                continue;
            }
            let value = value(m);
            for (node, weight) in blend.nodes.iter().zip(blend.weights) {
                let weight = weight.max(0.0);
                nodes[*node as usize] += weight * value;
                weights[*node as usize] += weight;
            }
        }
        for (node, weight) in nodes.iter_mut().zip(weights) {
            *node /= weight.max(1e-6);
        }
    }

    /// The E-step: fills mass and pull of the components.
    pub fn expect(&mut self, cloud: &Cloud, visibility: &Visibility, asked: &Asked) -> Expectation {
        let mut total = Expectation::default();
        self.ask(cloud, visibility, asked, None, &mut total);
        total
    }

    /// An E-step, and what it says about each point that is asked.
    pub fn answers(
        &mut self,
        cloud: &Cloud,
        visibility: &Visibility,
        asked: &Asked,
        answers: &mut Vec<Answer>,
    ) {
        answers.clear();
        self.ask(cloud, visibility, asked, Some(answers), &mut Expectation::default());
    }

    fn ask(
        &mut self,
        cloud: &Cloud,
        visibility: &Visibility,
        asked: &Asked,
        answers: Option<&mut Vec<Answer>>,
        total: &mut Expectation,
    ) {
        self.components.clear();
        self.blocks.bound(&self.components.at_m);
        self.width.run(Expect { mixture: self, cloud, visibility, asked, answers, total });
        // Thinned points count as many times.
        if asked.thinning > 1 {
            let weight = asked.thinning as f32;
            let Components { mass, pull_m: [x, y, z], .. } = &mut self.components;
            for sums in [mass, x, y, z] {
                sums.iter_mut().for_each(|sum| *sum *= weight);
            }
        }
        total.mass *= asked.thinning as f64;
        total.squared_m2 *= asked.thinning as f64;
    }

    /// Shares of the points within `reach_m` of a component, and of the components within
    /// `reach_m` of a point.
    pub fn coverage(&mut self, cloud: &Cloud, reach_m: f32) -> (f64, f64) {
        self.blocks.bound(&self.components.at_m);
        let mut covered = Covered { explained: 0, supported: vec![0; self.blocks.present.len()] };
        self.width.run(Cover { mixture: self, cloud, reach_m, covered: &mut covered });
        let supported = covered.supported.iter().zip(&self.blocks.present);
        let supported: u32 = supported.map(|(bits, present)| (bits & present).count_ones()).sum();
        let share = |k: usize, of: usize| k as f64 / of.max(1) as f64;
        (
            share(covered.explained, cloud.points_m.len()),
            share(supported as usize, self.blocks.count()),
        )
    }
}

struct Expect<'a> {
    mixture: &'a mut Mixture,
    cloud: &'a Cloud,
    visibility: &'a Visibility,
    asked: &'a Asked,
    answers: Option<&'a mut Vec<Answer>>,
    total: &'a mut Expectation,
}

impl Pass for Expect<'_> {
    #[inline(always)]
    fn run<V: Lanes>(self) {
        let Self { mixture, cloud, visibility, asked, mut answers, total } = self;
        let reach_m = CUTOFF_SIGMAS * asked.sigma_m;
        let variance = f64::from(asked.sigma_m).powi(2);
        let uniform = asked.uniform_per_m3 * (std::f64::consts::TAU * variance).powf(1.5);
        let shape = Shape { variance_m2: variance as f32, uniform: uniform as f32 };
        let Mixture { blocks, components, present, near, .. } = mixture;
        for Cell { points, bounds_m } in &cloud.cells {
            // Multiples within the whole cloud, so that cells of few points are heard too.
            let mut next = points.start.next_multiple_of(asked.thinning);
            if next >= points.end {
                continue;
            }
            blocks.near::<V>(*bounds_m, reach_m, near);
            if near.is_empty() {
                continue;
            }
            while next < points.end {
                let first = next;
                let mut some =
                    Points { at_m: [[0.0; 3]; POINTS], priors: [present; POINTS], len: 0 };
                while some.len < POINTS && next < points.end {
                    some.at_m[some.len] = cloud.points_m[next];
                    if let Some(priors) = visibility.priors(cloud.cameras[next]) {
                        some.priors[some.len] = priors;
                    }
                    some.len += 1;
                    next += asked.thinning;
                }
                let shares = components.expect::<V>(&some, near, &shape);
                for mass in shares.mass {
                    total.mass += f64::from(mass);
                }
                total.squared_m2 += f64::from(shares.squared_m2);
                if let Some(answers) = &mut answers {
                    for n in 0..some.len {
                        let away_m = components.away_m::<V>(&some, near, &shares, n);
                        let point = first + n * asked.thinning;
                        answers.push(Answer { point, mass: shares.mass[n], away_m });
                    }
                }
            }
        }
    }
}

/// What a pose covers.
struct Covered {
    /// Points near a component.
    explained: usize,
    /// Per block, a bit for each component: whether a point is near.
    supported: Vec<u16>,
}

struct Cover<'a> {
    mixture: &'a mut Mixture,
    cloud: &'a Cloud,
    reach_m: f32,
    covered: &'a mut Covered,
}

impl Pass for Cover<'_> {
    #[inline(always)]
    fn run<V: Lanes>(self) {
        let Self { mixture, cloud, reach_m, covered } = self;
        let Mixture { blocks, components, near, .. } = mixture;
        let at_m = [0, 1, 2].map(|axis| components.at_m[axis].as_slice());
        let reach_m2 = V::splat(reach_m * reach_m);
        for Cell { points, bounds_m } in &cloud.cells {
            blocks.near::<V>(*bounds_m, reach_m, near);
            for point in &cloud.points_m[points.clone()] {
                let mut is_near = false;
                for block in near.iter() {
                    let first = *block as usize * LANES;
                    let [x, y, z] = at_m;
                    let at = [
                        &x[first..first + LANES],
                        &y[first..first + LANES],
                        &z[first..first + LANES],
                    ];
                    // SAFETY: the slices have sixteen numbers.
                    let at = unsafe {
                        load_points::<V>([at[0].as_ptr(), at[1].as_ptr(), at[2].as_ptr()], 0)
                    };
                    let d = minus(splat::<V>(*point), at);
                    let bits = reach_m2.above(dot(d, d));
                    covered.supported[*block as usize] |= bits;
                    is_near |= bits != 0;
                }
                covered.explained += usize::from(is_near);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_give_what_all_pairs_give() {
        let sheet = SheetGrid::new([0.15, 0.15], [9, 9]);
        let mut mixture = Mixture::new(&sheet, 3);
        mixture.place(&sheet.flat_m());
        let points: Vec<[f32; 3]> = (0..400)
            .map(|k| k as f32)
            .map(|k| [0.09 * (k * 0.37).sin(), 0.08 * (k * 0.73).cos(), 0.01 * (k * 1.9).sin()])
            .collect();
        let mut cloud = Cloud::default();
        cloud.fill(points.iter().map(|p| (*p, 0)), 0.008);
        let (sigma, uniform) = (0.004f32, 1e6);
        let all_seen = Visibility::new(&sheet);
        let asked = Asked { sigma_m: sigma, uniform_per_m3: uniform, thinning: 1 };
        let found = mixture.expect(&cloud, &all_seen, &asked);

        let variance = f64::from(sigma).powi(2);
        let constant = uniform * (std::f64::consts::TAU * variance).powf(1.5);
        // Whole blocks look a little farther than the cut-off, so it lies between these two.
        let mass_within = |reach: f64| -> f64 {
            let explained = points.iter().map(|point| {
                let places = (0..mixture.blocks.places()).filter(|m| mixture.blocks.is_present(*m));
                let squared = places.map(|m| {
                    let y = mixture.components.position_m(m);
                    (0..3).map(|k| f64::from(point[k] - y[k]).powi(2)).sum::<f64>()
                });
                let near = squared.filter(|d| *d < reach * reach);
                let total: f64 = near.map(|d| (-d / (2.0 * variance)).exp()).sum();
                total / (total + constant)
            });
            explained.sum()
        };
        let least = mass_within(f64::from(CUTOFF_SIGMAS * sigma));
        let most = mass_within(f64::INFINITY);
        assert!(most > 1.0002 * least, "the cut-off shows, or this tests nothing");
        assert!(least * 0.9999 < found.mass && found.mass < most * 1.0001, "{}", found.mass);
        let components: f64 = mixture.components.mass.iter().map(|m| f64::from(*m)).sum();
        assert!((components / found.mass - 1.0).abs() < 1e-5);
        // Thinned, a part of the points stands for all.
        let thinned = mixture.expect(&cloud, &all_seen, &Asked { thinning: 4, ..asked });
        assert!((thinned.mass / found.mass - 1.0).abs() < 0.1, "{}", thinned.mass / found.mass);
    }

    #[test]
    fn moving_the_components_moves_the_squares() {
        let sheet = SheetGrid::new([0.15, 0.15], [9, 9]);
        let mut mixture = Mixture::new(&sheet, 2);
        mixture.place(&sheet.flat_m());
        let mut cloud = Cloud::default();
        cloud.fill(sheet.flat_m().iter().map(|p| ([p[0], p[1], 0.001], 0)), 0.008);
        let asked = Asked { sigma_m: 0.004, uniform_per_m3: 1e4, thinning: 1 };
        let found = mixture.expect(&cloud, &Visibility::new(&sheet), &asked);
        let up: Vec<[f32; 3]> = sheet.flat_m().iter().map(|p| [p[0], p[1], 0.001]).collect();
        let after = mixture.place_after(&up, found.squared_m2);
        // Every distance loses its millimetre across.
        let expected = found.squared_m2 - found.mass * 1e-6;
        assert!((after / expected - 1.0).abs() < 1e-4, "{after} {expected}");
        assert!(after < 0.95 * found.squared_m2);
    }

    #[test]
    fn coverage_of_half_a_sheet() {
        let sheet = SheetGrid::new([0.15, 0.15], [11, 11]);
        let mut mixture = Mixture::new(&sheet, 1);
        mixture.place(&sheet.flat_m());
        let mut cloud = Cloud::default();
        let half = sheet.flat_m().into_iter().filter(|p| p[0] < -0.001);
        cloud.fill(half.chain([[0.5, 0.5, 0.5]]).map(|p| (p, 0)), 0.008);
        let (explained, supported) = mixture.coverage(&cloud, 0.004);
        assert!((explained - 55.0 / 56.0).abs() < 1e-9);
        assert!((supported - 5.0 / 11.0).abs() < 1e-9);
    }

    /// Counts the pairs that an E-step looks at.
    struct Pairs<'a>(&'a mut Mixture, &'a Cloud, f32, &'a mut u64);

    impl Pass for Pairs<'_> {
        #[inline(always)]
        fn run<V: Lanes>(self) {
            let Self(Mixture { blocks, near, .. }, cloud, reach_m, pairs) = self;
            for Cell { points, bounds_m } in &cloud.cells {
                blocks.near::<V>(*bounds_m, reach_m, near);
                *pairs += (near.len() * LANES * points.len()) as u64;
            }
        }
    }

    #[test]
    #[cfg(target_arch = "x86_64")]
    #[ignore = "prints figures for docs/results.md"]
    fn what_a_pair_costs() {
        use std::arch::x86_64::_rdtsc;
        let sheet = SheetGrid::new([0.21, 0.21], [13, 13]);
        let bent = |[u, v]: [f64; 2]| [u, v, 0.02 * (20.0 * u).sin()].map(|c| c as f32);
        let nodes_m: Vec<[f32; 3]> = sheet.uv_m().map(bent).collect();
        // Evenly over the sheet: multiples of two irrational numbers.
        let at = |k: usize| [0.618_034, 0.754_878].map(|step| 0.21 * (k as f64 * step).fract());
        let points = (0..5000).map(|k| (bent(at(k)), 0));
        let mut cloud = Cloud::default();
        cloud.fill(points, 0.053 * 0.21);
        let mut mixture = Mixture::new(&sheet, 4);
        mixture.place(&nodes_m);
        let seen = Visibility::new(&sheet);
        let components = mixture.blocks.count() as u64;
        eprintln!("{components} components, 5000 points, cycles of the time-stamp counter");
        for width in Width::available() {
            for sigma_m in [0.008, 0.004, 0.002] {
                mixture.width = width;
                let asked = Asked { sigma_m, uniform_per_m3: 1e6, thinning: 1 };
                // SAFETY: every processor of this kind has the counter.
                let now = || unsafe { _rdtsc() };
                let once = |mixture: &mut Mixture| {
                    let start = now();
                    std::hint::black_box(mixture.expect(&cloud, &seen, &asked));
                    now() - start
                };
                let least = (0..200).map(|_| once(&mut mixture)).min().unwrap();
                let mut pairs = 0;
                mixture.blocks.bound(&mixture.components.at_m);
                width.run(Pairs(&mut mixture, &cloud, CUTOFF_SIGMAS * sigma_m, &mut pairs));
                let [of_looked, of_all] =
                    [pairs, 5000 * components].map(|pairs| least as f64 / pairs as f64);
                eprintln!(
                    "{width:?}, sigma {:.0} mm: {least} cycles, {:.1} % of all pairs looked at, \
                     {of_looked:.2} a pair looked at, {of_all:.3} a pair of all",
                    1e3 * sigma_m,
                    100.0 * pairs as f64 / (5000 * components) as f64
                );
            }
        }
    }
}
