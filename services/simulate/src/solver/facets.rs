//! Stiff facets: each is held by its best rigid pose. GPU twins: `fit_facet` and `polar` in
//! `gpu/fit.wgsl`, `hold_facet` in `gpu/facets.wgsl`.
//!
//! ```text
//! a = Σ (x − x̄)(u − ū),  b = Σ (x − x̄)(v − v̄),  M = [a b],  S = √(MᵀM) in closed form
//! [U V] = M·S⁻¹,  g = x̄ + (u − ū)·U + (v − v̄)·V,  x ← x + k·(g − x)
//! ```

use orime_creases::Folds;
use orime_geometry::SheetGrid;
use orime_lanes::{Field, Layout};
use orime_lanes::{LANES, Lanes, Pass};

/// The nodes of one facet, as vectors of the rows.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct FacetNodes {
    /// First place of each vector, and its members.
    pub spans: Vec<(u32, u16)>,
    /// How many nodes.
    pub count: u32,
    /// Their mean (u, v), metres.
    pub center_uv_m: [f32; 2],
}

/// All facets, and the nodes' material coordinates.
#[derive(Debug, Clone)]
pub(crate) struct FacetTable {
    /// The facets.
    pub facets: Vec<FacetNodes>,
    /// Material coordinates of every place, metres.
    pub uv_m: [Field; 2],
}

/// A rigid pose: (u, v) lies at `center + (u − ū)·u + (v − v̄)·v`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Frame {
    /// Mean position, metres.
    pub center_m: [f64; 3],
    /// Unit direction of growing u.
    pub u: [f64; 3],
    /// Unit direction of growing v.
    pub v: [f64; 3],
}

impl FacetTable {
    /// No facets yet.
    pub fn new(sheet: &SheetGrid) -> Self {
        let layout = Layout::new(sheet);
        let mut uv_m = [layout.field(), layout.field()];
        for (place, uv) in layout.places().zip(sheet.uv_m()) {
            uv_m[0].rows_mut()[place] = uv[0] as f32;
            uv_m[1].rows_mut()[place] = uv[1] as f32;
        }
        Self { facets: Vec::new(), uv_m }
    }

    /// Takes over the facets.
    pub fn set(&mut self, layout: Layout, folds: &Folds) {
        let facet = |facet: usize| {
            let mut nodes = FacetNodes { spans: Vec::new(), count: 0, center_uv_m: [0.0; 2] };
            let mut sum = [0f64; 2];
            for node in folds.members(facet) {
                let place = layout.place(*node as usize);
                let first = (place - place % LANES) as u32;
                if nodes.spans.last().is_none_or(|span| span.0 != first) {
                    nodes.spans.push((first, 0));
                }
                if let Some(span) = nodes.spans.last_mut() {
                    span.1 |= 1 << (place % LANES);
                }
                nodes.count += 1;
                for (sum, uv_m) in sum.iter_mut().zip(&self.uv_m) {
                    *sum += f64::from(uv_m.rows()[place]);
                }
            }
            nodes.center_uv_m = sum.map(|sum| (sum / f64::from(nodes.count.max(1))) as f32);
            nodes
        };
        self.facets = (0..folds.facets().len()).map(facet).collect();
    }

    /// Bytes that it takes.
    pub fn bytes(&self) -> usize {
        let spans: usize = self.facets.iter().map(|facet| size_of_val(&facet.spans[..])).sum();
        spans + self.uv_m.iter().map(Field::bytes).sum::<usize>()
    }
}

/// Finds the best rigid pose of a facet.
pub(crate) struct FitFacet<'a> {
    /// Its nodes.
    pub nodes: &'a FacetNodes,
    /// Material coordinates, metres.
    pub uv_m: &'a [Field; 2],
    /// Positions, metres.
    pub x: &'a [Field; 3],
    /// The pose.
    pub frame: &'a mut Frame,
}

impl Pass for FitFacet<'_> {
    #[inline(always)]
    fn run<V: Lanes>(self) {
        let x = self.x.each_ref().map(Field::rows);
        let [u, v] = self.uv_m.each_ref().map(Field::rows);
        let [u_mean, v_mean] = self.nodes.center_uv_m;
        let (u_mean, v_mean) = (V::splat(u_mean), V::splat(v_mean));
        let zero = V::splat(0.0);
        let mut sums = [[zero; 3]; 3];
        for (first, bits) in &self.nodes.spans {
            let at = *first as usize..*first as usize + LANES;
            // SAFETY: the slices have sixteen numbers.
            unsafe {
                let du = V::load(u[at.clone()].as_ptr()).sub(u_mean);
                let dv = V::load(v[at.clone()].as_ptr()).sub(v_mean);
                for axis in 0..3 {
                    let x = V::load(x[axis][at.clone()].as_ptr()).keep(*bits);
                    sums[0][axis] = sums[0][axis].add(x);
                    sums[1][axis] = sums[1][axis].add(x.mul(du));
                    sums[2][axis] = sums[2][axis].add(x.mul(dv));
                }
            }
        }
        let [center, a, b] = [totals(sums[0]), totals(sums[1]), totals(sums[2])];
        let (u, v) = polar(a, b);
        let count = f64::from(self.nodes.count.max(1));
        *self.frame = Frame { center_m: center.map(|c| c / count), u, v };
    }
}

/// Sums of the lanes of each.
#[inline(always)]
fn totals<V: Lanes>(lanes: [V; 3]) -> [f64; 3] {
    [total(lanes[0]), total(lanes[1]), total(lanes[2])]
}

/// Sum of the lanes, in f64.
#[inline(always)]
fn total<V: Lanes>(lanes: V) -> f64 {
    let mut each = [0f32; LANES];
    // SAFETY: the array has sixteen numbers.
    unsafe { lanes.store(each.as_mut_ptr()) };
    each.into_iter().map(f64::from).sum()
}

/// Moves a facet's nodes that share of the way to its pose.
pub(crate) struct HoldFacet<'a> {
    /// Its nodes.
    pub nodes: &'a FacetNodes,
    /// Material coordinates, metres.
    pub uv_m: &'a [Field; 2],
    /// Its pose.
    pub frame: &'a Frame,
    /// Share of the way.
    pub strength: f32,
    /// Inverse masses, where not all are 1.
    pub weights: Option<&'a Field>,
    /// Positions, metres.
    pub x: &'a mut [Field; 3],
}

impl Pass for HoldFacet<'_> {
    #[inline(always)]
    fn run<V: Lanes>(self) {
        let [u, v] = self.uv_m.each_ref().map(Field::rows);
        let weights = self.weights.map(Field::rows);
        let [u_mean, v_mean] = self.nodes.center_uv_m;
        let (u_mean, v_mean) = (V::splat(u_mean), V::splat(v_mean));
        let strength = V::splat(self.strength);
        for (first, bits) in &self.nodes.spans {
            let at = *first as usize..*first as usize + LANES;
            // SAFETY: the slices have sixteen numbers.
            unsafe {
                let mut bits = *bits;
                if let Some(weights) = weights {
                    bits &= V::load(weights[at.clone()].as_ptr()).above(V::splat(0.0));
                }
                let du = V::load(u[at.clone()].as_ptr()).sub(u_mean);
                let dv = V::load(v[at.clone()].as_ptr()).sub(v_mean);
                for (axis, field) in self.x.iter_mut().enumerate() {
                    let x = &mut field.rows_mut()[at.clone()];
                    let Frame { center_m, u, v } = self.frame;
                    let (u, v) = (V::splat(u[axis] as f32), V::splat(v[axis] as f32));
                    let c = V::splat(center_m[axis] as f32);
                    let here = V::load(x.as_ptr());
                    let goal = c.add(u.mul(du)).add(v.mul(dv));
                    let way = goal.sub(here).mul(strength).keep(bits);
                    here.add(way).store(x.as_mut_ptr());
                }
            }
        }
    }
}

/// Finds how far a facet's nodes are from a pose that need not be theirs.
pub(crate) struct Away<'a> {
    /// The nodes.
    pub nodes: &'a FacetNodes,
    /// Mean (u, v) that the pose is about, metres.
    pub center_uv_m: [f32; 2],
    /// Material coordinates, metres.
    pub uv_m: &'a [Field; 2],
    /// The pose.
    pub frame: &'a Frame,
    /// Positions, metres.
    pub x: &'a [Field; 3],
    /// Greatest squared distance so far, m².
    pub worst_m2: &'a mut f32,
}

impl Pass for Away<'_> {
    #[inline(always)]
    fn run<V: Lanes>(self) {
        let x = self.x.each_ref().map(Field::rows);
        let [u, v] = self.uv_m.each_ref().map(Field::rows);
        let [u_mean, v_mean] = self.center_uv_m;
        let mut worst = V::splat(*self.worst_m2);
        for (first, bits) in &self.nodes.spans {
            let at = *first as usize..*first as usize + LANES;
            let mut squared = V::splat(0.0);
            // SAFETY: the slices have sixteen numbers.
            unsafe {
                let du = V::load(u[at.clone()].as_ptr()).sub(V::splat(u_mean));
                let dv = V::load(v[at.clone()].as_ptr()).sub(V::splat(v_mean));
                for axis in 0..3 {
                    let Frame { center_m, u, v } = self.frame;
                    let (u, v) = (V::splat(u[axis] as f32), V::splat(v[axis] as f32));
                    let goal = V::splat(center_m[axis] as f32).add(u.mul(du)).add(v.mul(dv));
                    let way = V::load(x[axis][at.clone()].as_ptr()).sub(goal);
                    squared = squared.add(way.mul(way));
                }
            }
            worst = worst.max(squared.keep(*bits));
        }
        let mut each = [0f32; LANES];
        // SAFETY: the array has sixteen numbers.
        unsafe { worst.store(each.as_mut_ptr()) };
        *self.worst_m2 = each.into_iter().fold(0.0, f32::max);
    }
}

pub(crate) fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// The nearest pair of orthonormal vectors to (a, b).
///
/// M = [a b], MᵀM = [[p, q], [q, r]], S = √(MᵀM) = (MᵀM + √det·1)/trace.
pub(crate) fn polar(a: [f64; 3], b: [f64; 3]) -> ([f64; 3], [f64; 3]) {
    let (p, q, r) = (dot(a, a), dot(a, b), dot(b, b));
    let root_det = (p * r - q * q).max(0.0).sqrt();
    let trace = (p + r + 2.0 * root_det).sqrt();
    if root_det <= 1e-12 * (p + r) || trace == 0.0 {
        // All on a line or a point: any frame that holds the line.
        let along = if p >= r { a } else { b };
        let length = dot(along, along).sqrt();
        let u = if length > 0.0 { along.map(|c| c / length) } else { [1.0, 0.0, 0.0] };
        let away = if u[0].abs() < 0.7 { [1.0, 0.0, 0.0] } else { [0.0, 1.0, 0.0] };
        let share = dot(u, away);
        let v = [0, 1, 2].map(|k| away[k] - share * u[k]);
        let length = dot(v, v).sqrt();
        return (u, v.map(|c| c / length));
    }
    let scale = 1.0 / (trace * root_det);
    let u = [0, 1, 2].map(|k| (a[k] * (r + root_det) - b[k] * q) * scale);
    let v = [0, 1, 2].map(|k| (b[k] * (p + root_det) - a[k] * q) * scale);
    (u, v)
}

#[cfg(test)]
mod tests {
    use super::*;
    use orime_creases::Line;
    use orime_lanes::Width;
    use orime_lanes::scatter;

    #[test]
    fn the_pose_is_that_of_the_creases_library() {
        let sheet = SheetGrid::new([0.15, 0.12], [25, 21]);
        let layout = Layout::new(&sheet);
        let mut folds = Folds::flat(&sheet);
        folds.split(0, &Line::through([0.03, 0.0], [0.11, 0.12])).unwrap();
        let wavy: Vec<[f32; 3]> = sheet
            .uv_m()
            .map(|[u, v]| [v + 0.01 * (40.0 * u).sin(), 0.3 - u, 0.2 * u + 0.02 * (50.0 * v).cos()])
            .map(|x| x.map(|c| c as f32))
            .collect();
        let mut x = layout.fields();
        scatter(layout, &wavy, &mut x);
        let mut table = FacetTable::new(&sheet);
        table.set(layout, &folds);
        for (facet, nodes) in table.facets.iter().enumerate() {
            let mut frame = Frame { center_m: [0.0; 3], u: [0.0; 3], v: [0.0; 3] };
            let fit = FitFacet { nodes, uv_m: &table.uv_m, x: &x, frame: &mut frame };
            Width::available()[0].run(fit);
            let expected = folds.frame(facet, &wavy);
            for axis in 0..3 {
                assert!((frame.center_m[axis] - expected.center_m[axis]).abs() < 1e-7);
                assert!((frame.u[axis] - expected.u[axis]).abs() < 1e-5, "{frame:?}");
                assert!((frame.v[axis] - expected.v[axis]).abs() < 1e-5, "{frame:?}");
            }
        }
    }

    #[test]
    fn a_frame_is_orthonormal_even_of_a_line_or_a_point() {
        let cases = [
            ([1.0, 0.2, -0.3], [0.1, 0.9, 0.4]),
            ([1.0, 2.0, 3.0], [2.0, 4.0, 6.0]),
            ([0.0; 3], [0.0, 5.0, 0.0]),
            ([0.0; 3], [0.0; 3]),
        ];
        for (a, b) in cases {
            let (u, v) = polar(a, b);
            let error = [dot(u, u) - 1.0, dot(v, v) - 1.0, dot(u, v)];
            assert!(error.iter().all(|e| e.abs() < 1e-9), "{a:?} {b:?}: {u:?} {v:?}");
        }
    }
}
