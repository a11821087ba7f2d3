//! Where a facet could break: its best division into parallel strips that are each rigid.
//!
//! For every direction the nodes are binned across it; prefix sums of moments give the cost of any
//! run of bins as one rigid strip, and dynamic programming the best K strips for every K.

use super::moments::{Moments, add, rigid_cost};
use super::nodes::Nodes;

/// Most strips.
pub(crate) const STRIPS_MAX: usize = 8;
/// Most bins; where a sheet has more spacings across, bins are wider.
const BINS_MAX: usize = 128;
/// Narrowest strip, bins.
const STRIP_BINS_MIN: usize = 2;

/// The best division into a number of strips.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Division {
    /// Sum of squared distances from the rigid strips, m².
    pub cost_m2: f64,
    /// Unit normal of the strips' borders, (u, v).
    pub normal: [f64; 2],
    /// Where the borders are along the normal, metres; the first `strips − 1` count.
    pub borders_m: [f64; STRIPS_MAX - 1],
}

/// Room that a search needs.
#[derive(Debug, Clone)]
pub(crate) struct Search {
    directions: Vec<[f64; 2]>,
    prefix: Vec<Moments>,
    /// Cost of the strip from bin `b` to before bin `c` at `b * (BINS_MAX + 1) + c`.
    strip: Vec<f64>,
    cost: Vec<[f64; BINS_MAX + 1]>,
    from: Vec<[u8; BINS_MAX + 1]>,
    /// The best division by number of strips; index 0 is not used.
    pub best: [Division; STRIPS_MAX + 1],
}

impl Search {
    pub fn new(directions: usize) -> Self {
        let none =
            Division { cost_m2: f64::INFINITY, normal: [1.0, 0.0], borders_m: Default::default() };
        let direction = |k| {
            let (sin, cos) = (std::f64::consts::PI * k as f64 / directions as f64).sin_cos();
            [cos, sin]
        };
        Self {
            directions: (0..directions).map(direction).collect(),
            prefix: vec![[0.0; 14]; BINS_MAX + 1],
            strip: vec![f64::INFINITY; (BINS_MAX + 1) * (BINS_MAX + 1)],
            cost: vec![[f64::INFINITY; BINS_MAX + 1]; STRIPS_MAX + 1],
            from: vec![[0; BINS_MAX + 1]; STRIPS_MAX + 1],
            best: [none; STRIPS_MAX + 1],
        }
    }

    /// Searches every `stride`-th direction from `first` on; results are in `best`.
    pub fn run(&mut self, nodes: &Nodes, members: &[u32], first: usize, stride: usize) {
        let (center_x, center_q) = centers(nodes, members);
        for division in &mut self.best {
            division.cost_m2 = f64::INFINITY;
        }
        for at in (first..self.directions.len()).step_by(stride) {
            let normal = self.directions[at];
            let (start_m, bins, bin_m) = self.sum_bins(nodes, members, center_x, center_q, normal);
            self.divide(bins);
            let offset_m = normal[0] * center_q[0] + normal[1] * center_q[1];
            for strips in 1..=STRIPS_MAX {
                let cost_m2 = self.cost[strips][bins];
                if cost_m2 >= self.best[strips].cost_m2 {
                    continue;
                }
                let mut borders_m = [0.0; STRIPS_MAX - 1];
                let mut end = bins;
                for k in (2..=strips).rev() {
                    end = usize::from(self.from[k][end]);
                    borders_m[k - 2] = offset_m + start_m + end as f64 * bin_m;
                }
                self.best[strips] = Division { cost_m2, normal, borders_m };
            }
        }
    }

    /// Fills `prefix`; returns where the first bin starts, how many there are and their width.
    fn sum_bins(
        &mut self,
        nodes: &Nodes,
        members: &[u32],
        center_x: [f64; 3],
        center_q: [f64; 2],
        normal: [f64; 2],
    ) -> (f64, usize, f64) {
        let across = |n: u32| {
            let q = nodes.uv_m[n as usize];
            (q[0] - center_q[0]) * normal[0] + (q[1] - center_q[1]) * normal[1]
        };
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        for n in members {
            let s = across(*n);
            (low, high) = (low.min(s), high.max(s));
        }
        let bin_m = nodes.h_m.max((high - low) / (BINS_MAX - 2) as f64);
        let start_m = low - 0.5 * bin_m;
        let bins = ((high - start_m) / bin_m + 0.5) as usize + 1;
        self.prefix[..=bins].fill([0.0; 14]);
        for n in members {
            let weight = nodes.weight[*n as usize];
            if weight > 0.0 {
                let bin = (((across(*n) - start_m) / bin_m) as usize).min(bins - 1);
                let (x, q) = (nodes.x_m[*n as usize], nodes.uv_m[*n as usize]);
                let x = [x[0] - center_x[0], x[1] - center_x[1], x[2] - center_x[2]];
                let q = [q[0] - center_q[0], q[1] - center_q[1]];
                add(&mut self.prefix[bin + 1], weight, x, q);
            }
        }
        for b in 1..=bins {
            for k in 0..14 {
                self.prefix[b][k] += self.prefix[b - 1][k];
            }
        }
        (start_m, bins, bin_m)
    }

    /// The cheapest K strips of all bins, for every K.
    fn divide(&mut self, bins: usize) {
        const ROW: usize = BINS_MAX + 1;
        for b in 0..bins {
            for c in b + STRIP_BINS_MIN..=bins {
                self.strip[b * ROW + c] = rigid_cost(&self.prefix[b], &self.prefix[c]);
            }
        }
        for c in 0..=bins {
            self.cost[1][c] = if c >= STRIP_BINS_MIN { self.strip[c] } else { f64::INFINITY };
        }
        for k in 2..=STRIPS_MAX {
            for c in 0..=bins {
                let (mut least, mut at) = (f64::INFINITY, 0);
                for b in STRIP_BINS_MIN..(c + 1).saturating_sub(STRIP_BINS_MIN) {
                    let cost = self.cost[k - 1][b] + self.strip[b * ROW + c];
                    if cost < least {
                        (least, at) = (cost, b);
                    }
                }
                (self.cost[k][c], self.from[k][c]) = (least, at as u8);
            }
        }
    }
}

fn centers(nodes: &Nodes, members: &[u32]) -> ([f64; 3], [f64; 2]) {
    let mut sums = [0.0; 14];
    for n in members {
        let n = *n as usize;
        add(&mut sums, nodes.weight[n], nodes.x_m[n], nodes.uv_m[n]);
    }
    let total = sums[0].max(1e-12);
    ([1, 2, 3].map(|k| sums[k] / total), [4, 5].map(|k| sums[k] / total))
}
