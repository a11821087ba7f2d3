//! A sweep over contacts that lie run by run over one facet.
//!
//! The contacts of a run push along one normal, so that no push changes where nodes lie beside
//! each other: there a contact is a weighted sum of its nodes' heights that has to keep a gap. The
//! weights are those of the last look, and taken anew where some node has slid since; the round's
//! end finds contacts anew in any case, and judges by those.

use crate::frames::{Frames, ordered};
use crate::pose::Pose;
use crate::push::Worst;
use nalgebra::Vector3;

/// Weights are taken anew where a node of a run has slid farther than this, spacings.
const SLIP: f64 = 0.02;

/// What a sweep asks of a contact.
pub(crate) trait Contact {
    /// The pushed side's facet, then the one whose normal is pushed along.
    fn facets(&self) -> [u8; 2];
    fn nodes(&self) -> [u32; 4];
    /// Least weighted sum of the heights, metres.
    fn gap_m(&self) -> f64;
    /// Weights of the nodes' heights when it was found.
    fn weights(&self) -> [f64; 4];
    /// The same where the nodes are now, (u, v) in the second facet's frame; none where they do not
    /// lie over each other any more. `flat_m2`: twice the area below which a triangle spans
    /// nothing.
    fn weigh(&self, uv_m: [[f64; 2]; 4], flat_m2: f64) -> Option<[f64; 4]>;
}

/// What contacts move, and by what.
pub(crate) struct Room<'a> {
    pub x: &'a mut [Vector3<f64>],
    pub mobility: &'a [f64],
    pub poses: &'a [Pose],
    /// Greatest distance of two neighbours at rest, metres.
    pub spacing_m: f64,
    /// Twice the area below which a triangle spans nothing, m².
    pub flat_m2: f64,
    /// Whether anything but contacts has moved nodes since the last sweep.
    pub slid: bool,
    /// Room for (u, v, height) per node.
    pub local: &'a mut [[f64; 3]],
}

/// Successive contacts of one pair of facets.
#[derive(Debug, Clone, Copy)]
struct Run {
    over: u8,
    /// Where its contacts and its nodes end.
    ends: [u32; 2],
}

/// A node of a run.
#[derive(Debug, Clone, Copy)]
struct Seen {
    node: u32,
    /// Where it was when weights were taken, metres.
    uv_m: [f64; 2],
    /// Its height before the run's contacts pushed, metres.
    height_m: f64,
}

/// A weighted sum of heights and how great it has to be, metres.
#[derive(Debug, Clone, Copy)]
struct Sum {
    nodes: [u32; 4],
    weights: [f64; 4],
    gap_m: f64,
}

/// The runs of a list of contacts.
#[derive(Debug, Clone, Default)]
pub(crate) struct Runs {
    runs: Vec<Run>,
    nodes: Vec<Seen>,
    sums: Vec<Sum>,
    /// The last run of each node.
    last: Vec<u32>,
}

impl Runs {
    /// Parts contacts that were just found into runs.
    pub fn part<C: Contact>(&mut self, contacts: &[C], frames: &Frames, node_count: usize) {
        self.runs.clear();
        self.nodes.clear();
        self.sums.clear();
        self.last.clear();
        self.last.resize(node_count, u32::MAX);
        for same in contacts.chunk_by(|a, b| a.facets() == b.facets()) {
            let run = self.runs.len() as u32;
            let over = same[0].facets()[1];
            let local = frames.over(usize::from(over));
            for node in same.iter().flat_map(Contact::nodes) {
                if std::mem::replace(&mut self.last[node as usize], run) != run {
                    let [u, v, height_m] = local[node as usize];
                    self.nodes.push(Seen { node, uv_m: [u, v], height_m });
                }
            }
            self.sums.extend(same.iter().map(|contact| Sum {
                nodes: contact.nodes(),
                weights: contact.weights(),
                gap_m: contact.gap_m(),
            }));
            let ends = [self.sums.len() as u32, self.nodes.len() as u32];
            self.runs.push(Run { over, ends });
        }
    }

    /// One sweep over the contacts that were parted, back to front where `reverse`.
    pub fn sweep<C: Contact>(
        &mut self,
        contacts: &[C],
        reverse: bool,
        room: &mut Room<'_>,
        worst: &mut Worst,
    ) {
        let count = self.runs.len();
        for at in 0..count {
            let at = if reverse { count - 1 - at } else { at };
            let starts = if at == 0 { [0; 2] } else { self.runs[at - 1].ends };
            let Run { over, ends } = self.runs[at];
            let range = starts[0] as usize..ends[0] as usize;
            let (contacts, sums) = (&contacts[range.clone()], &mut self.sums[range]);
            let nodes = &mut self.nodes[starts[1] as usize..ends[1] as usize];
            let pose = &room.poses[usize::from(over)];
            if !room.slid {
                raise(nodes, pose, room);
            } else if look(nodes, pose, room) > SLIP * room.spacing_m {
                weigh(contacts, sums, nodes, room);
            }
            let Room { mobility, local, .. } = room;
            let mut each = |sum: &Sum| sum.keep(local, mobility, worst);
            if reverse {
                sums.iter().rev().for_each(&mut each);
            } else {
                sums.iter().for_each(&mut each);
            }
            for Seen { node, height_m, .. } in nodes {
                let node = *node as usize;
                room.x[node] += pose.normal * (room.local[node][2] - *height_m);
            }
        }
    }
}

impl Sum {
    /// Pushes the nodes along the normal, the mobile ones more, where the gap is not kept:
    /// Δhₖ = short · weightₖ·mₖ / Σ weightⱼ²·mⱼ
    fn keep(&self, local: &mut [[f64; 3]], mobility: &[f64], worst: &mut Worst) {
        // Written out: arrays that are mapped go through memory.
        let [p, q, r, s] = self.nodes;
        let [p, q, r, s] = [p as usize, q as usize, r as usize, s as usize];
        let [a, b, c, d] = self.weights;
        let height_m = (a * local[p][2] + b * local[q][2]) + (c * local[r][2] + d * local[s][2]);
        if height_m >= self.gap_m {
            return;
        }
        worst.note(self.gap_m, height_m);
        let shares = [a * mobility[p], b * mobility[q], c * mobility[r], d * mobility[s]];
        let sum = (a * shares[0] + b * shares[1]) + (c * shares[2] + d * shares[3]);
        if sum <= 1e-12 {
            return; // All of them are held.
        }
        let short_m = (self.gap_m - height_m) / sum;
        local[p][2] += short_m * shares[0];
        local[q][2] += short_m * shares[1];
        local[r][2] += short_m * shares[2];
        local[s][2] += short_m * shares[3];
    }
}

/// Where a run's nodes are now. How far any has slid since weights were taken, metres.
fn look(nodes: &mut [Seen], pose: &Pose, room: &mut Room<'_>) -> f64 {
    let mut slid_m = 0f64;
    for Seen { node, uv_m, height_m } in nodes {
        let ([u, v], height_now_m) = pose.local_m(&room.x[*node as usize]);
        let slid = ordered((u - uv_m[0]).abs(), (v - uv_m[1]).abs())[1];
        slid_m = ordered(slid_m, slid)[1];
        *height_m = height_now_m;
        room.local[*node as usize] = [u, v, height_now_m];
    }
    slid_m
}

/// Their heights alone.
fn raise(nodes: &mut [Seen], pose: &Pose, room: &mut Room<'_>) {
    for Seen { node, height_m, .. } in nodes {
        *height_m = (room.x[*node as usize] - pose.center_m).dot(&pose.normal);
        room.local[*node as usize][2] = *height_m;
    }
}

/// Takes a run's weights anew.
fn weigh<C: Contact>(contacts: &[C], sums: &mut [Sum], nodes: &mut [Seen], room: &Room<'_>) {
    for (contact, sum) in contacts.iter().zip(sums) {
        let at_m = sum.nodes.map(|n| [room.local[n as usize][0], room.local[n as usize][1]]);
        match contact.weigh(at_m, room.flat_m2) {
            Some(weights) => (sum.weights, sum.gap_m) = (weights, contact.gap_m()),
            None => sum.gap_m = f64::NEG_INFINITY,
        }
    }
    for Seen { node, uv_m, .. } in nodes {
        let [u, v, _] = room.local[*node as usize];
        *uv_m = [u, v];
    }
}
