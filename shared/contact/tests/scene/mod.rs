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
pub struct Random(pub u64);

impl Random {
    /// −1 to 1.
    pub fn symmetric(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }
}
