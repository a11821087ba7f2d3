//! The sheet as a Gaussian mixture: virtual nodes between the nodes, and the E-step over cells.

use crate::bias::RaySums;
use crate::blend::{Blend, Blender};
use crate::expectation::{Candidates, expect_cell};
use crate::visibility::Visibility;
use orime_creases::Folds;
use orime_geometry::SheetGrid;
use std::ops::Range;

/// σ beyond which a component is not asked about a point: exp(−3.5²/2) = 2e-3.
const CUTOFF_SIGMAS: f32 = 3.5;
/// Most cells of the lookup grid along an axis.
const CELLS_MAX: usize = 48;

/// Observed points, sorted into cells for the whole frame.
#[derive(Debug, Clone, Default)]
pub(crate) struct Cloud {
    /// Positions, metres, cell after cell.
    pub points_m: Vec<[f32; 3]>,
    /// Ranges of points in one cell.
    cells: Vec<Range<usize>>,
    /// Camera of each point; within a cell they ascend.
    cameras: Vec<u32>,
    /// Cell, then camera and place in the input.
    keys: Vec<(u64, u64)>,
}

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
    explained: Vec<f32>,
}

/// Sums over all points and components of one E-step.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Expectation {
    /// N_p = Σ p.
    pub mass: f64,
    /// Σ p·|x − y|², m².
    pub squared_m2: f64,
}

impl Cloud {
    /// Sorts points, each with its camera, into cells of `cell_m`; all must be finite. Their order
    /// does not matter.
    pub fn fill(&mut self, points: impl Iterator<Item = ([f32; 3], u32)>, cell_m: f32) {
        let unsorted: Vec<([f32; 3], u32)> = points.collect();
        let cell =
            |c: f32| ((c / cell_m).floor() as i64 + (1 << 20)).clamp(0, (1 << 21) - 1) as u64;
        self.keys.clear();
        self.keys.extend(unsorted.iter().enumerate().map(|(n, (p, camera))| {
            let key = (cell(p[0]) << 42) | (cell(p[1]) << 21) | cell(p[2]);
            (key, (u64::from(*camera) << 32) | n as u64)
        }));
        self.keys.sort_unstable();
        let place = |key: &(u64, u64)| unsorted[(key.1 & 0xffff_ffff) as usize];
        self.points_m.clear();
        self.points_m.extend(self.keys.iter().map(|key| place(key).0));
        self.cameras.clear();
        self.cameras.extend(self.keys.iter().map(|key| place(key).1));
        self.cells.clear();
        let mut start = 0;
        for end in 1..=self.keys.len() {
            if end == self.keys.len() || self.keys[end].0 != self.keys[start].0 {
                self.cells.push(start..end);
                start = end;
            }
        }
    }

    /// The points of a cell, camera by camera.
    fn by_camera(&self, cell: Range<usize>) -> impl Iterator<Item = (u32, Range<usize>)> + '_ {
        let mut start = cell.start;
        std::iter::from_fn(move || {
            let camera = *self.cameras[start..cell.end].first()?;
            let others = self.cameras[start..cell.end].iter();
            let end = start + others.take_while(|c| **c == camera).count();
            let range = start..end;
            start = end;
            Some((camera, range))
        })
    }
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
            explained: Vec::new(),
        }
    }

    /// Components along u and v.
    pub fn fine_nodes(sheet: &SheetGrid, per_cell: usize) -> [usize; 2] {
        sheet.nodes.map(|n| (n - 1) * per_cell + 1)
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
    ///
    /// `uniform_per_m3` is the density of the outlier class relative to one component: the `c` of
    /// Myronenko & Song's equation 6 without its (2πσ²)^{3/2}.
    pub fn expect(
        &mut self,
        cloud: &Cloud,
        visibility: &Visibility,
        cell_m: f32,
        sigma_m: f32,
        uniform_per_m3: f64,
    ) -> Expectation {
        self.mass.fill(0.0);
        self.pull_m.fill([0.0; 3]);
        self.lookup.fill(&self.positions_m, cell_m);
        let reach_m = CUTOFF_SIGMAS * sigma_m;
        let variance = f64::from(sigma_m).powi(2);
        let uniform = (uniform_per_m3 * (std::f64::consts::TAU * variance).powf(1.5)) as f32;
        let mut total = Expectation::default();
        self.rays.clear();
        self.rays.resize(self.eyes_m.len(), RaySums::default());
        for cell in &cloud.cells {
            let points = &cloud.points_m[cell.clone()];
            let (low, high) = bounds(points);
            self.members.clear();
            self.lookup.near(&self.positions_m, low, high, reach_m, &mut self.members);
            if self.members.is_empty() {
                continue;
            }
            self.candidates.clear();
            for m in &self.members {
                self.candidates.push(sub(self.positions_m[*m as usize], low), 1.0);
            }
            self.candidates.seal();
            let mut before = [0f32; 3];
            for (camera, range) in cloud.by_camera(cell.clone()) {
                match visibility.priors(camera) {
                    Some(priors) => {
                        self.candidates.set_priors(self.members.iter().map(|m| priors[*m as usize]))
                    }
                    None => self.candidates.set_priors(self.members.iter().map(|_| 1.0)),
                }
                let points = &cloud.points_m[range];
                self.local.clear();
                self.local.extend(points.iter().map(|p| sub(*p, low)));
                self.explained.clear();
                self.explained.resize(points.len(), 0.0);
                let sums = expect_cell(
                    &self.local,
                    &mut self.candidates,
                    variance as f32,
                    uniform,
                    &mut self.explained,
                );
                total.mass += sums.mass;
                total.squared_m2 += sums.squared_m2;
                if let Some(eye) = self.eyes_m.get(camera as usize) {
                    let after = self.candidates.pull_sum();
                    let ray = sub(low, *eye);
                    let toward = dot(sub(after, before), ray) / norm2(ray).sqrt();
                    let rays = &mut self.rays[camera as usize];
                    rays.mass += sums.mass;
                    rays.toward_m += f64::from(toward);
                    before = after;
                }
            }
            for (k, m) in self.members.iter().enumerate() {
                let m = *m as usize;
                self.mass[m] += f64::from(self.candidates.mass[k]);
                self.pull_m[m][0] += f64::from(self.candidates.pull_x[k]);
                self.pull_m[m][1] += f64::from(self.candidates.pull_y[k]);
                self.pull_m[m][2] += f64::from(self.candidates.pull_z[k]);
            }
        }
        total
    }

    /// Shares of the points within `reach_m` of a component, and of the components within
    /// `reach_m` of a point.
    pub fn coverage(&mut self, cloud: &Cloud, cell_m: f32, reach_m: f32) -> (f64, f64) {
        self.lookup.fill(&self.positions_m, cell_m);
        let mut supported = vec![false; self.positions_m.len()];
        let mut explained = 0usize;
        for cell in &cloud.cells {
            let points = &cloud.points_m[cell.clone()];
            let (low, high) = bounds(points);
            self.members.clear();
            self.lookup.near(&self.positions_m, low, high, reach_m, &mut self.members);
            for point in points {
                let mut found = false;
                for m in &self.members {
                    if norm2(sub(*point, self.positions_m[*m as usize])) < reach_m * reach_m {
                        supported[*m as usize] = true;
                        found = true;
                    }
                }
                explained += usize::from(found);
            }
        }
        let share = |k: usize, of: usize| k as f64 / of.max(1) as f64;
        let supported = supported.iter().filter(|s| **s).count();
        (share(explained, cloud.points_m.len()), share(supported, self.positions_m.len()))
    }
}

/// Counting-sorted grid over the components.
#[derive(Debug, Clone, Default)]
struct Lookup {
    low: [f32; 3],
    cell_m: f32,
    cells: [usize; 3],
    starts: Vec<u32>,
    order: Vec<u32>,
}

impl Lookup {
    fn fill(&mut self, positions_m: &[[f32; 3]], cell_m: f32) {
        let (low, high) = bounds(positions_m);
        let extent = (0..3).map(|axis| high[axis] - low[axis]).fold(0f32, f32::max);
        self.low = low;
        self.cell_m = cell_m.max(extent / (CELLS_MAX - 1) as f32);
        self.cells = [0, 1, 2].map(|axis| ((high[axis] - low[axis]) / self.cell_m) as usize + 1);
        self.starts.clear();
        self.starts.resize(self.cells.iter().product::<usize>() + 1, 0);
        for position in positions_m {
            let cell = self.cell(*position);
            self.starts[cell + 1] += 1;
        }
        for cell in 1..self.starts.len() {
            self.starts[cell] += self.starts[cell - 1];
        }
        self.order.clear();
        self.order.resize(positions_m.len(), 0);
        // Filling from the back keeps the order within a cell, and `starts` becomes the ends'
        // mirror: afterwards starts[cell] is the cell's first place.
        let mut next = self.starts.clone();
        for (m, position) in positions_m.iter().enumerate() {
            let cell = self.cell(*position);
            self.order[next[cell] as usize] = m as u32;
            next[cell] += 1;
        }
    }

    fn cell(&self, p: [f32; 3]) -> usize {
        let at = |axis: usize| {
            (((p[axis] - self.low[axis]) / self.cell_m) as usize).min(self.cells[axis] - 1)
        };
        (at(0) * self.cells[1] + at(1)) * self.cells[2] + at(2)
    }

    /// Appends the components within `reach_m` of the box `low … high`, cell by cell.
    fn near(
        &self,
        positions_m: &[[f32; 3]],
        low: [f32; 3],
        high: [f32; 3],
        reach_m: f32,
        members: &mut Vec<u32>,
    ) {
        let range = |axis: usize| -> Option<Range<usize>> {
            let first = (low[axis] - reach_m - self.low[axis]) / self.cell_m;
            let last = (high[axis] + reach_m - self.low[axis]) / self.cell_m;
            if last < 0.0 || first >= self.cells[axis] as f32 {
                return None;
            }
            Some(first.max(0.0) as usize..(last as usize + 1).min(self.cells[axis]))
        };
        let (Some(xs), Some(ys), Some(zs)) = (range(0), range(1), range(2)) else { return };
        for x in xs {
            for y in ys.clone() {
                let row = (x * self.cells[1] + y) * self.cells[2];
                let places = self.starts[row + zs.start]..self.starts[row + zs.end];
                for m in &self.order[places.start as usize..places.end as usize] {
                    let p = positions_m[*m as usize];
                    let outside = [
                        (low[0] - p[0]).max(p[0] - high[0]).max(0.0),
                        (low[1] - p[1]).max(p[1] - high[1]).max(0.0),
                        (low[2] - p[2]).max(p[2] - high[2]).max(0.0),
                    ];
                    if norm2(outside) < reach_m * reach_m {
                        members.push(*m);
                    }
                }
            }
        }
    }
}

/// Corners of the bounding box; an inverted box for no points.
pub(crate) fn bounds(points: &[[f32; 3]]) -> ([f32; 3], [f32; 3]) {
    let mut low = [f32::INFINITY; 3];
    let mut high = [f32::NEG_INFINITY; 3];
    for p in points {
        for axis in 0..3 {
            low[axis] = low[axis].min(p[axis]);
            high[axis] = high[axis].max(p[axis]);
        }
    }
    (low, high)
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
        let found = mixture.expect(&cloud, &all_seen, 0.008, sigma, uniform);

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
