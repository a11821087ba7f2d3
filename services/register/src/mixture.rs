//! The sheet as a Gaussian mixture: virtual nodes between the nodes, and the E-step over cells.

use crate::bias::RaySums;
use crate::blend::{Blend, Blender};
use crate::cloud::{Cell, Cloud};
use crate::expectation::{Candidates, expect_cell};
use crate::lookup::Lookup;
use crate::visibility::Visibility;
use orime_creases::Folds;
use orime_geometry::SheetGrid;
use orime_lanes::{Lanes, Pass, Width};

/// σ beyond which a component is not asked about a point: exp(−3.5²/2) = 2e-3.
const CUTOFF_SIGMAS: f32 = 3.5;

/// Components of the mixture and what the last E-step gave them.
#[derive(Debug, Clone)]
pub(crate) struct Mixture {
    /// Interpolation from the sheet's nodes.
    blends: Vec<Blend>,
    /// Material coordinates, metres.
    pub uv_m: Vec<[f32; 2]>,
    fine: SheetGrid,
    /// Positions, metres.
    pub positions_m: Vec<[f32; 3]>,
    /// Σ_n p per component.
    pub mass: Vec<f64>,
    /// Σ_n p·(x − y) per component, metres.
    pub pull_m: Vec<[f64; 3]>,
    /// Camera centres, world frame, metres; empty where nobody asks.
    pub eyes_m: Vec<[f32; 3]>,
    /// What each camera's points said in the last E-step.
    pub rays: Vec<RaySums>,
    lookup: Lookup,
    candidates: Candidates,
    members: Vec<u32>,
    local: Vec<[f32; 3]>,
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

impl Mixture {
    /// `per_cell` components per grid cell and direction.
    pub fn new(sheet: &SheetGrid, per_cell: usize) -> Self {
        let fine = SheetGrid::new(sheet.size_m, Self::fine_nodes(sheet, per_cell));
        let flat = Folds::flat(sheet);
        let blender = Blender::new(&flat);
        let blends: Vec<Blend> = fine.uv_m().map(|uv| blender.at(uv)).collect();
        let n = blends.len();
        Self {
            blends,
            uv_m: fine.uv_m().map(|uv| uv.map(|c| c as f32)).collect(),
            fine,
            positions_m: vec![[0.0; 3]; n],
            mass: vec![0.0; n],
            pull_m: vec![[0.0; 3]; n],
            eyes_m: Vec::new(),
            rays: Vec::new(),
            lookup: Lookup::default(),
            candidates: Candidates::default(),
            members: Vec::new(),
            local: Vec::new(),
            width: Width::available()[0],
        }
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
        for (blend, uv) in self.blends.iter_mut().zip(self.fine.uv_m()) {
            *blend = blender.at(uv);
        }
    }

    /// Moves the components with the sheet's nodes.
    pub fn place(&mut self, nodes_m: &[[f32; 3]]) {
        for (position, blend) in self.positions_m.iter_mut().zip(&self.blends) {
            *position = blend.position_m(nodes_m);
        }
    }

    /// Means over the components of each node's neighbourhood, weighted as they are blended:
    /// `value` of each component to one value per node.
    pub fn to_nodes(&self, value: impl Fn(usize) -> f32, nodes: &mut [f32]) {
        let mut weights = vec![0f32; nodes.len()];
        nodes.fill(0.0);
        for (m, blend) in self.blends.iter().enumerate() {
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

    /// The E-step: fills `mass` and `pull_m`.
    pub fn expect(
        &mut self,
        cloud: &Cloud,
        visibility: &Visibility,
        cell_m: f32,
        asked: &Asked,
    ) -> Expectation {
        self.mass.fill(0.0);
        self.pull_m.fill([0.0; 3]);
        self.lookup.fill(&self.positions_m, cell_m);
        self.rays.clear();
        self.rays.resize(self.eyes_m.len(), RaySums::default());
        let mut total = Expectation::default();
        self.width.run(Expect { mixture: self, cloud, visibility, asked, total: &mut total });
        total
    }

    /// Shares of the points within `reach_m` of a component, and of the components within
    /// `reach_m` of a point.
    pub fn coverage(&mut self, cloud: &Cloud, cell_m: f32, reach_m: f32) -> (f64, f64) {
        self.lookup.fill(&self.positions_m, cell_m);
        let mut covered = Covered { explained: 0, supported: vec![false; self.positions_m.len()] };
        self.width.run(Cover { mixture: self, cloud, reach_m, covered: &mut covered });
        let share = |k: usize, of: usize| k as f64 / of.max(1) as f64;
        let supported = covered.supported.iter().filter(|s| **s).count();
        (share(covered.explained, cloud.points_m.len()), share(supported, self.positions_m.len()))
    }
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

struct Expect<'a> {
    mixture: &'a mut Mixture,
    cloud: &'a Cloud,
    visibility: &'a Visibility,
    asked: &'a Asked,
    total: &'a mut Expectation,
}

impl Pass for Expect<'_> {
    #[inline(always)]
    fn run<V: Lanes>(self) {
        let Self { mixture, cloud, visibility, asked, total } = self;
        let reach_m = CUTOFF_SIGMAS * asked.sigma_m;
        let variance = f64::from(asked.sigma_m).powi(2);
        let uniform = (asked.uniform_per_m3 * (std::f64::consts::TAU * variance).powf(1.5)) as f32;
        let weight = asked.thinning as f64;
        let Mixture { lookup, candidates, members, local, eyes_m, rays, mass, pull_m, .. } =
            mixture;
        candidates.reserve(mass.len());
        for Cell { points, bounds_m } in &cloud.cells {
            if points.start.next_multiple_of(asked.thinning) >= points.end {
                continue;
            }
            let low = bounds_m.0;
            members.clear();
            candidates.clear();
            lookup.near::<V>(*bounds_m, reach_m, |m, position_m| {
                members.push(m);
                candidates.push(position_m);
            });
            if members.is_empty() {
                continue;
            }
            candidates.seal();
            let mut before = [0f32; 3];
            for (camera, range) in cloud.by_camera(points.clone()) {
                match visibility.priors(camera) {
                    Some(priors) => {
                        candidates.set_priors(members.iter().map(|m| priors[*m as usize]));
                    }
                    None => candidates.set_priors(members.iter().map(|_| 1.0)),
                }
                // Multiples within the whole cloud, so that cells of few points are heard too.
                let first = range.start.next_multiple_of(asked.thinning);
                let places = (first..range.end).step_by(asked.thinning);
                local.clear();
                local.extend(places.map(|n| sub(cloud.points_m[n], low)));
                if local.is_empty() {
                    continue;
                }
                let sums = expect_cell(local, candidates, variance as f32, uniform);
                total.mass += weight * sums.mass;
                total.squared_m2 += weight * sums.squared_m2;
                if let Some(eye) = eyes_m.get(camera as usize) {
                    let after = candidates.pull_sum();
                    let ray = sub(low, *eye);
                    let toward = dot(sub(after, before), ray) / norm2(ray).sqrt();
                    let rays = &mut rays[camera as usize];
                    rays.mass += weight * sums.mass;
                    rays.toward_m += weight * f64::from(toward);
                    before = after;
                }
            }
            for (k, m) in members.iter().enumerate() {
                let m = *m as usize;
                mass[m] += weight * f64::from(candidates.mass[k]);
                let pull = [candidates.pull_x[k], candidates.pull_y[k], candidates.pull_z[k]];
                for (sum, pull) in pull_m[m].iter_mut().zip(pull) {
                    *sum += weight * f64::from(pull);
                }
            }
        }
    }
}

/// What a pose covers.
struct Covered {
    /// Points near a component.
    explained: usize,
    /// Per component: whether a point is near.
    supported: Vec<bool>,
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
        let mut near: Vec<(u32, [f32; 3])> = Vec::new();
        for Cell { points, bounds_m } in &cloud.cells {
            near.clear();
            mixture
                .lookup
                .near::<V>(*bounds_m, reach_m, |m, position_m| near.push((m, position_m)));
            for point in &cloud.points_m[points.clone()] {
                let point = sub(*point, bounds_m.0);
                let mut found = false;
                for (m, position_m) in &near {
                    if norm2(sub(point, *position_m)) < reach_m * reach_m {
                        covered.supported[*m as usize] = true;
                        found = true;
                    }
                }
                covered.explained += usize::from(found);
            }
        }
    }
}

fn sub(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn norm2(a: [f32; 3]) -> f32 {
    a[0] * a[0] + a[1] * a[1] + a[2] * a[2]
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
        let found = mixture.expect(&cloud, &all_seen, 0.008, &asked);

        let variance = f64::from(sigma).powi(2);
        let constant = uniform * (std::f64::consts::TAU * variance).powf(1.5);
        // A cell looks a little farther than the cut-off, so it lies between these two.
        let mass_within = |reach: f64| -> f64 {
            let explained = points.iter().map(|point| {
                let squared = mixture.positions_m.iter().map(|y| f64::from(norm2(sub(*point, *y))));
                let near = squared.filter(|d| *d < reach * reach);
                let total: f64 = near.map(|d| (-d / (2.0 * variance)).exp()).sum();
                total / (total + constant)
            });
            explained.sum()
        };
        let least = mass_within(f64::from(CUTOFF_SIGMAS * sigma));
        let most = mass_within(f64::INFINITY);
        assert!(most > 1.001 * least, "the cut-off shows, or this tests nothing");
        assert!(least * 0.9999 < found.mass && found.mass < most * 1.0001, "{}", found.mass);
        let components: f64 = mixture.mass.iter().sum();
        assert!((components / found.mass - 1.0).abs() < 1e-5);
    }

    #[test]
    fn coverage_of_half_a_sheet() {
        let sheet = SheetGrid::new([0.15, 0.15], [11, 11]);
        let mut mixture = Mixture::new(&sheet, 1);
        mixture.place(&sheet.flat_m());
        let mut cloud = Cloud::default();
        let half = sheet.flat_m().into_iter().filter(|p| p[0] < -0.001);
        cloud.fill(half.chain([[0.5, 0.5, 0.5]]).map(|p| (p, 0)), 0.008);
        let (explained, supported) = mixture.coverage(&cloud, 0.008, 0.004);
        assert!((explained - 55.0 / 56.0).abs() < 1e-9);
        assert!((supported - 5.0 / 11.0).abs() < 1e-9);
    }
}
