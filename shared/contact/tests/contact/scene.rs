//! Exact folds with noise that makes their layers cross.

use orime_contact::{ContactConfig, ContactParams};
use orime_creases::{Facet, Folds};
use orime_geometry::SheetGrid;
use orime_origami::{Pose, Sequence, Sheet};

/// Side of the sheets, metres.
pub const SIDE_M: f64 = 0.15;

/// The config of all scenes: the defaults.
pub fn config() -> ContactConfig {
    ContactParams::default().check().expect("the defaults pass")
}

/// A square sheet of 0.1 mm.
pub fn paper() -> Sheet {
    Sheet { size_m: [SIDE_M; 2], thickness_m: 1e-4 }
}

/// A fold whose truth is known, followed from its start.
pub struct Scene {
    pub sequence: Sequence,
    pub sheet: SheetGrid,
    pub folds: Folds,
    pose: Pose,
}

impl Scene {
    pub fn new(sequence: Sequence) -> Self {
        let sheet = SheetGrid::new(sequence.sheet().size_m, [25, 25]);
        let facet = |f: &orime_origami::Facet| Facet { corners_m: f.corners_uv_m.clone() };
        let folds = Folds::from_facets(&sheet, sequence.facets().iter().map(facet).collect());
        let pose = sequence.pose(0.0);
        Self { sequence, sheet, folds, pose }
    }

    /// Steps of the sequence.
    pub fn steps(&self) -> u64 {
        self.sequence.intervals()
    }

    /// Where the nodes truly are at a step, metres; angles and layer order follow.
    pub fn truth_m(&mut self, step: u64) -> Vec<[f32; 3]> {
        let progress = step as f64 / self.steps() as f64;
        self.sequence.update(&mut self.pose, progress);
        let position = |uv| {
            let p = self.sequence.position_m(&self.pose, uv);
            [p.x as f32, p.y as f32, p.z as f32]
        };
        let truth: Vec<[f32; 3]> = self.sheet.uv_m().map(position).collect();
        self.folds.observe(&truth);
        truth
    }

    /// The truth, each facet bent and shifted smoothly by about `size_m`.
    pub fn noisy(&self, truth_m: &[[f32; 3]], size_m: f64, seed: u64) -> Vec<[f32; 3]> {
        let mut random = Random(seed);
        let waves: Vec<[Wave; 3]> =
            self.folds.facets().iter().map(|_| [(); 3].map(|_| Wave::new(&mut random))).collect();
        let noise = |uv: [f64; 2]| {
            let (mut sum, mut total) = ([0.0; 3], 0.0);
            for (facet, waves) in self.folds.facets().iter().zip(&waves) {
                // Facets blend over 10 mm.
                let weight = (1.0 + facet.inside_m(uv) / 0.01).clamp(0.0, 1.0).powi(2);
                total += weight;
                for (sum, wave) in sum.iter_mut().zip(waves) {
                    *sum += weight * wave.at(uv);
                }
            }
            sum.map(|sum| size_m * sum / total)
        };
        let moved = |(p, uv): (&[f32; 3], [f64; 2])| {
            let noise = noise(uv);
            [0, 1, 2].map(|k| p[k] + noise[k] as f32)
        };
        let mut x: Vec<[f32; 3]> = truth_m.iter().zip(self.sheet.uv_m()).map(moved).collect();
        self.unstretch(&mut x);
        x
    }
}

impl Scene {
    /// Largest elongation of an edge of the grid, those that a crease cuts included.
    pub fn stretch(&self, x_m: &[[f32; 3]]) -> f64 {
        let edges = self.sheet.edges().into_iter();
        let elongation = edges
            .map(|([a, b], rest_m)| distance_m(x_m[a as usize], x_m[b as usize]) / rest_m - 1.0);
        elongation.fold(0.0, f64::max)
    }

    /// Whether the nodes of a facet that truly lie over another one are on its other side now,
    /// in the mean.
    pub fn has_flipped(&self, truth_m: &[[f32; 3]], x_m: &[[f32; 3]]) -> bool {
        let count = self.folds.facets().len();
        let pairs = (0..count * count).map(|k| [k / count, k % count]);
        pairs.filter(|[f, g]| f != g).any(|[f, g]| {
            let (truth, now) = (self.heights_m(truth_m, [f, g]), self.heights_m(x_m, [f, g]));
            let both = truth.iter().zip(&now).filter_map(|(a, b)| Some([(*a)?, (*b)?]));
            let near: Vec<[f64; 2]> = both.filter(|[a, _]| a.abs() < 5e-3).collect();
            let mean = |k: usize| near.iter().map(|pair| pair[k]).sum::<f64>();
            near.len() > 3 && mean(0) * mean(1) < 0.0
        })
    }

    /// Height of every node inside facet `f` over facet `g`'s mesh, along its normal, metres.
    fn heights_m(&self, x_m: &[[f32; 3]], [f, g]: [usize; 2]) -> Vec<Option<f64>> {
        let facets = self.folds.facets();
        let frame = self.folds.frame(g, x_m);
        let point = |n: usize| nalgebra::Point3::from(x_m[n].map(f64::from));
        let height = |(n, uv): (usize, [f64; 2])| {
            let d = point(n) - frame.center_m;
            let [u, v] = frame.center_uv_m;
            let at = [u + d.dot(&frame.u), v + d.dot(&frame.v)];
            if facets[f].inside_m(uv) < 1e-3 || facets[g].inside_m(at) < 1e-3 {
                return None;
            }
            let h = self.sheet.spacing_m();
            let [i, j] = [0, 1].map(|k| (at[k] / h[k]) as usize);
            let [s, t] = [at[0] / h[0] - i as f64, at[1] / h[1] - j as f64];
            let corners = [(0, 0, (1.0 - s) * (1.0 - t)), (1, 0, s * (1.0 - t))];
            let corners = corners.into_iter().chain([(0, 1, (1.0 - s) * t), (1, 1, s * t)]);
            let below = corners
                .map(|(di, dj, weight)| point(self.sheet.index(i + di, j + dj)).coords * weight);
            Some((point(n).coords - below.sum::<nalgebra::Vector3<f64>>()).dot(&frame.normal))
        };
        self.sheet.uv_m().enumerate().map(height).collect()
    }

    /// Whether no facet has both points.
    pub fn is_cut(&self, a: [f64; 2], b: [f64; 2]) -> bool {
        let has = |f: &Facet, p| f.inside_m(p) > -1e-6;
        !self.folds.facets().iter().any(|f| has(f, a) && has(f, b))
    }

    /// Sweeps over the mesh's edges: paper that is disturbed keeps its lengths.
    fn unstretch(&self, x: &mut [[f32; 3]]) {
        let uv: Vec<[f64; 2]> = self.sheet.uv_m().collect();
        for _ in 0..40 {
            for [a, b, c] in self.sheet.triangles() {
                for [a, b] in [[a, b], [b, c], [c, a]].map(|edge| edge.map(|n| n as usize)) {
                    let rest = (uv[a][0] - uv[b][0]).hypot(uv[a][1] - uv[b][1]) as f32;
                    let d = [0, 1, 2].map(|k| x[b][k] - x[a][k]);
                    let length = d.iter().map(|d| d * d).sum::<f32>().sqrt();
                    // An edge that a crease cuts is shorter when folded.
                    let cut = self.is_cut(uv[a], uv[b]);
                    let excess = if cut { (length - rest).max(0.0) } else { length - rest };
                    let pull = 0.5 * excess / length;
                    for k in 0..3 {
                        x[a][k] += pull * d[k];
                        x[b][k] -= pull * d[k];
                    }
                }
            }
        }
    }
}

/// Mean distance of nodes, metres.
pub fn mean_distance_m(a_m: &[[f32; 3]], b_m: &[[f32; 3]]) -> f64 {
    a_m.iter().zip(b_m).map(|(a, b)| distance_m(*a, *b)).sum::<f64>() / a_m.len() as f64
}

fn distance_m(a_m: [f32; 3], b_m: [f32; 3]) -> f64 {
    (0..3).map(|k| f64::from(a_m[k] - b_m[k]).powi(2)).sum::<f64>().sqrt()
}

/// A shift and a wave about as long as the sheet, root mean square about 1.
struct Wave {
    shift: f64,
    amplitude: f64,
    frequency: [f64; 2],
    phase: f64,
}

impl Wave {
    fn new(random: &mut Random) -> Self {
        Self {
            shift: random.symmetric(),
            amplitude: random.symmetric(),
            frequency: [30.0 * random.symmetric(), 30.0 * random.symmetric()],
            phase: std::f64::consts::PI * random.symmetric(),
        }
    }

    fn at(&self, [u, v]: [f64; 2]) -> f64 {
        self.shift
            + self.amplitude * (self.frequency[0] * u + self.frequency[1] * v + self.phase).sin()
    }
}

/// Splitmix64.
struct Random(u64);

impl Random {
    /// −1 to 1.
    fn symmetric(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }
}
