//! Crossings, and a start that has some.

use super::{GenericContact, is_usable, load, store};
use crate::mesh::Mesh;
use nalgebra::Vector3;

/// Ends nearer than this to a triangle's plane are not counted as a crossing, metres.
const OFF_PLANE_M: f64 = 1e-6;
/// What the net leaves pokes through by nothing at all: from there on the way deeper would be one
/// away from the layer.
const STRICTLY_M: f64 = 0.0;
/// Cosine of 60°.
const COSINE_MIN: f64 = 0.5;
/// Rounds at most.
const ROUNDS: u32 = 60;
/// An end is pulled back by at most this at a time, metres.
const PULL_MAX_M: f64 = 1e-3;
/// An end is pulled back by this share more than it has to be.
const BEYOND: f64 = 0.1;

/// What [`GenericContact::untangle`] did.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct UntangleReport {
    /// Crossings of an edge and a triangle at first.
    pub crossings_before: u32,
    /// What is left of them.
    pub crossings_after: u32,
    /// Rounds that were needed.
    pub rounds: u32,
}

/// An edge through a triangle.
pub(super) struct Piercing {
    /// The end on the shorter side.
    end: u32,
    /// Where, barycentric.
    weights: [f64; 3],
    /// Moves the end to the other end's side, metres.
    back: Vector3<f64>,
}

impl GenericContact {
    /// Pairs of a mesh edge and a triangle that cross, in f64: both ends more than 1 µm off the
    /// triangle's plane on different sides. Pairs that share a node always touch and do not count.
    pub fn crossings(&mut self, x_m: &[[f32; 3]]) -> usize {
        if !is_usable(x_m, self.from.len()) {
            return 0;
        }
        self.origin_m = Vector3::from(x_m[0]).cast();
        load(&mut self.to, x_m, &self.origin_m);
        let mut count = 0;
        self.piercings(OFF_PLANE_M, |_, _, _| count += 1);
        count
    }

    /// Whether nothing crosses, be it by the last bit; what is not finite is not free. The next net
    /// may begin here.
    pub(crate) fn is_free(&mut self, x_m: &[[f32; 3]]) -> bool {
        if !is_usable(x_m, self.from.len()) {
            return false;
        }
        self.origin_m = Vector3::from(x_m[0]).cast();
        load(&mut self.to, x_m, &self.origin_m);
        let mut free = true;
        if !is_gently_bent(&self.mesh, &self.to) {
            self.piercings(STRICTLY_M, |_, _, _| free = false);
        }
        if free {
            self.proven_m.copy_from_slice(x_m);
        }
        free
    }

    /// Pulls edges out of the triangles that they pierce, the shorter end first, until nothing
    /// crosses: for what pokes through a little. It does not know which layer belongs where, so
    /// that layers that lie in each other stay tangled; the report says so.
    pub fn untangle(&mut self, x_m: &mut [[f32; 3]]) -> UntangleReport {
        let before = self.crossings(x_m) as u32;
        let mut report =
            UntangleReport { crossings_before: before, crossings_after: before, rounds: 0 };
        let mut found: Vec<([u32; 2], [u32; 3])> = Vec::new();
        while report.crossings_after > 0 && report.rounds < ROUNDS {
            found.clear();
            self.piercings(OFF_PLANE_M, |edge, triangle, _| found.push((edge, triangle)));
            report.crossings_after = found.len() as u32;
            report.rounds += 1;
            for (edge, triangle) in &found {
                self.pull_back(*edge, *triangle);
            }
        }
        if report.rounds > 0 {
            store(x_m, &self.to, &self.origin_m);
            report.crossings_after = self.crossings(x_m) as u32;
        }
        report
    }

    /// Pulls the shorter end of an edge back, if it still pierces the triangle.
    fn pull_back(&mut self, edge: [u32; 2], triangle: [u32; 3]) {
        let Some(piercing) = pierce(edge, triangle, &self.to, OFF_PLANE_M) else { return };
        let Piercing { end, weights, back } = piercing;
        let nodes = [end, triangle[0], triangle[1], triangle[2]];
        let weights = [1.0, -weights[0], -weights[1], -weights[2]];
        let length = back.norm();
        let push = back * ((1.0 + BEYOND) * (PULL_MAX_M / length).min(1.0));
        crate::push::weighted_push(&mut self.to, &self.mobility, &nodes, &weights, push);
    }

    /// All crossings of `to` with ends so far off the triangle's plane, in a fixed order.
    fn piercings(&mut self, off_plane_m: f64, mut found: impl FnMut([u32; 2], [u32; 3], Piercing)) {
        let Self { mesh, parts, cells, quads, to, .. } = self;
        cells.find(mesh, to, to, 0.0);
        quads.fill(to);
        cells.near.retain(|near| !quads.are_parted(*near));
        cells.near.sort_unstable();
        for near in &cells.near {
            parts.piercings(mesh, *near, |edge, triangle| {
                let (edge, triangle) =
                    (mesh.edges[edge as usize], mesh.triangles[triangle as usize]);
                if let Some(piercing) = pierce(edge, triangle, to, off_plane_m) {
                    found(edge, triangle, piercing);
                }
            });
        }
    }
}

/// Whether all normals lie within 60° of their mean: then paper cannot meet itself. Of what does
/// not stretch, a cone wraps farthest with such normals, and comes round once where it takes 180°
/// of paper about its tip: as much as there is at a side; inside, a tip is no place of paper.
fn is_gently_bent(mesh: &Mesh, x: &[Vector3<f64>]) -> bool {
    let normals = || {
        mesh.triangles.iter().map(|nodes| {
            let [a, b, c] = nodes.map(|n| x[n as usize]);
            (b - a).cross(&(c - a))
        })
    };
    let mean = normals().sum::<Vector3<f64>>();
    let length2 = mean.norm_squared();
    normals().all(|normal| {
        let along = normal.dot(&mean);
        along > 0.0 && along * along > COSINE_MIN.powi(2) * normal.norm_squared() * length2
    })
}

pub(super) fn pierce(
    edge: [u32; 2],
    triangle: [u32; 3],
    x: &[Vector3<f64>],
    off_plane_m: f64,
) -> Option<Piercing> {
    let ([p, q], [a, b, c]) = (edge.map(|n| x[n as usize]), triangle.map(|n| x[n as usize]));
    let (e, f) = (b - a, c - a);
    let normal = e.cross(&f);
    let double_area = normal.norm();
    if double_area <= 0.0 {
        return None;
    }
    let normal = normal / double_area;
    let (over, under) = (normal.dot(&(p - a)), normal.dot(&(q - a)));
    if over * under >= 0.0 || over.abs().min(under.abs()) < off_plane_m {
        return None;
    }
    let r = p + (q - p) * (over / (over - under)) - a;
    let v = r.cross(&f).dot(&normal) / double_area;
    let w = e.cross(&r).dot(&normal) / double_area;
    if v <= 0.0 || w <= 0.0 || v + w >= 1.0 {
        return None;
    }
    let (end, height) = if over.abs() < under.abs() { (edge[0], over) } else { (edge[1], under) };
    let weights = [1.0 - v - w, v, w];
    Some(Piercing { end, weights, back: normal * -height })
}
