//! A sweep over contacts that lie run by run over one facet.
//!
//! The contacts of a run push along one normal. The heights of their nodes along it are known
//! throughout the run, so that a contact whose nodes are clear of each other by their heights alone
//! is passed over: nothing else would come of asking it.

use crate::pose::Pose;
use crate::push::Worst;
use nalgebra::Vector3;

/// What a sweep asks of a contact.
pub(crate) trait Contact {
    /// The pushed side's facet, then the one whose normal is pushed along.
    fn facets(&self) -> [u8; 2];
    fn nodes(&self) -> [u32; 4];
    /// Whether the nodes' heights alone show that the gap is kept.
    fn is_clear(&self, heights_m: &[f64]) -> bool;
    /// Pushes its nodes apart where they are nearer than their gap. Whether it moved any.
    fn solve(&self, room: &mut Room<'_>, worst: &mut Worst) -> bool;
}

/// What contacts move, and by what.
pub(crate) struct Room<'a> {
    pub x: &'a mut [Vector3<f64>],
    pub mobility: &'a [f64],
    pub poses: &'a [Pose],
    /// Twice the area below which a triangle spans nothing, m².
    pub flat_m2: f64,
    /// Room for a height per node.
    pub heights_m: &'a mut [f64],
}

/// Successive contacts of one pair of facets.
#[derive(Debug, Clone, Copy)]
struct Run {
    over: u8,
    /// Where its contacts and its nodes end.
    ends: [u32; 2],
}

/// The runs of a list of contacts.
#[derive(Debug, Clone, Default)]
pub(crate) struct Runs {
    runs: Vec<Run>,
    nodes: Vec<u32>,
    /// The last run of each node.
    seen: Vec<u32>,
}

impl Runs {
    /// Parts contacts into runs.
    pub fn part<C: Contact>(&mut self, contacts: &[C], node_count: usize) {
        self.runs.clear();
        self.nodes.clear();
        self.seen.clear();
        self.seen.resize(node_count, u32::MAX);
        let mut end = 0;
        for same in contacts.chunk_by(|a, b| a.facets() == b.facets()) {
            let run = self.runs.len() as u32;
            for node in same.iter().flat_map(Contact::nodes) {
                if std::mem::replace(&mut self.seen[node as usize], run) != run {
                    self.nodes.push(node);
                }
            }
            end += same.len() as u32;
            self.runs.push(Run { over: same[0].facets()[1], ends: [end, self.nodes.len() as u32] });
        }
    }

    /// One sweep over the contacts, back to front where `reverse`.
    pub fn sweep<C: Contact>(
        &self,
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
            let contacts = &contacts[starts[0] as usize..ends[0] as usize];
            let nodes = &self.nodes[starts[1] as usize..ends[1] as usize];
            let normal = room.poses[usize::from(over)].normal;
            raise(room, nodes, &normal);
            let mut each = |contact: &C| {
                if !contact.is_clear(room.heights_m) && contact.solve(room, worst) {
                    raise(room, &contact.nodes(), &normal);
                }
            };
            if reverse {
                contacts.iter().rev().for_each(&mut each);
            } else {
                contacts.iter().for_each(&mut each);
            }
        }
    }
}

/// Takes the heights of some nodes anew.
fn raise(room: &mut Room<'_>, nodes: &[u32], normal: &Vector3<f64>) {
    for node in nodes {
        room.heights_m[*node as usize] = room.x[*node as usize].dot(normal);
    }
}
