//! Everything that follows from mesh and facets, rebuilt when a facet is split.

use crate::links::{Link, Links};
use crate::mesh::{Mesh, NONE};
use orime_creases::{Facet, Folds};

/// Nearer than this material points are one, metres.
const SAME_M: f64 = 1e-6;
/// A node nearer than this share of the spacing to a crease lies on it, and is of both sides.
const ON_CREASE: f64 = 0.01;

/// What is known of one facet.
#[derive(Debug, Clone)]
pub(crate) struct FacetMesh {
    /// Its nodes, those on creases included, with (u, v) from their mean.
    pub core: Vec<(u32, [f64; 2])>,
    pub core_mean_m: [f64; 2],
    /// Root mean square distance of the core from its mean, metres.
    pub core_radius_m: f64,
    /// Half planes a·u + b·v + c ≥ 0, metres.
    pub sides: Vec<[f64; 3]>,
    pub corners_m: Vec<[f64; 2]>,
    /// Facets that a corner touches.
    pub corner_touches: Vec<u32>,
    /// Edges of the mesh where the facet ends.
    pub boundary: Vec<u32>,
    /// Its other edges.
    pub interior: Vec<u32>,
    /// Its nodes and the ends of its edges, each once, ascending.
    pub reached: Vec<u32>,
    /// Numbers of its creases.
    pub creases: Vec<usize>,
}

impl FacetMesh {
    /// How deep a material point lies inside, metres; negative outside.
    pub fn inside_m(&self, [u, v]: [f64; 2]) -> f64 {
        self.sides.iter().map(|[a, b, c]| a * u + b * v + c).fold(f64::INFINITY, f64::min)
    }
}

/// A place of the mesh on a crease: `(1 − t)·x[a] + t·x[b]`.
#[derive(Debug, Clone, Copy)]
pub(crate) struct SpinePoint {
    pub nodes: [u32; 2],
    pub t: f64,
    /// Distance from the crease's first end, metres.
    pub along_m: f64,
}

/// A crease and where the mesh has it.
#[derive(Debug, Clone)]
pub(crate) struct CreaseMesh {
    pub facets: [usize; 2],
    pub ends_m: [[f64; 2]; 2],
    /// Unit direction from the first end to the second, material.
    pub direction: [f64; 2],
    /// Whether each end lies at the sheet's rim.
    pub at_rim: [bool; 2],
    /// From the first end to the second.
    pub spine: Vec<SpinePoint>,
}

/// Mesh and facets.
#[derive(Debug, Clone)]
pub(crate) struct Topology {
    pub mesh: Mesh,
    pub shape: Vec<Facet>,
    on_crease_m: f64,
    pub facets: Vec<FacetMesh>,
    pub creases: Vec<CreaseMesh>,
    /// Facets of each node, one bit each.
    pub of_node: Vec<u32>,
    /// Facets of each triangle; two or more where a crease cuts it.
    pub of_triangle: Vec<u32>,
    /// Facets that have both ends of each edge; where none has, those of its triangles.
    pub of_edge: Vec<u32>,
    /// Edges have a slot for each of their facets: the edge of each slot, ascending, and where the
    /// slots of an edge begin.
    pub of_slot: Vec<u32>,
    slots_from: Vec<u32>,
    /// Whether the sheet or a facet ends at the edge.
    pub ends: Vec<bool>,
    /// Edges, and pairs of nodes two steps apart in one facet, which keep it flat.
    pub links: Links,
    /// Distance of node `n` from crease `c`, metres, at `c·nodes + n`.
    crease_distance_m: Vec<f32>,
    /// Distance of node `n` from vertex `k`, metres, at `k·nodes + n`.
    vertex_distance_m: Vec<f32>,
    /// Distance of each node from the nearest crease, metres.
    from_creases_m: Vec<f32>,
    /// Vertices that facets `f` and `g` share, at `f·facets + g`.
    shared_vertices: Vec<Vec<usize>>,
    /// The crease that facets `f` and `g` share, at `f·facets + g`.
    shared_crease: Vec<Option<usize>>,
}

impl Topology {
    pub fn new(mesh: Mesh, folds: &Folds) -> Self {
        let count = folds.facets().len();
        let mut topology = Self {
            shape: folds.facets().to_vec(),
            on_crease_m: ON_CREASE
                * mesh.sheet.spacing_m().into_iter().fold(f64::INFINITY, f64::min),
            of_node: vec![0; mesh.uv_m.len()],
            of_triangle: Vec::new(),
            of_edge: Vec::new(),
            of_slot: Vec::new(),
            slots_from: Vec::new(),
            ends: Vec::new(),
            links: Links::default(),
            facets: Vec::new(),
            creases: Vec::new(),
            crease_distance_m: Vec::new(),
            vertex_distance_m: Vec::new(),
            from_creases_m: Vec::new(),
            shared_vertices: vec![Vec::new(); count * count],
            shared_crease: vec![None; count * count],
            mesh,
        };
        for (uv_m, facets) in topology.mesh.uv_m.iter().zip(&mut topology.of_node) {
            let inside = |f: &usize| folds.facets()[*f].inside_m(*uv_m) > -topology.on_crease_m;
            *facets = (0..count).filter(inside).fold(0, |mask, f| mask | 1 << f);
        }
        topology.own_triangles(folds);
        topology.own_links();
        topology.facets = (0..count).map(|facet| topology.facet(folds, facet)).collect();
        topology.own_creases(folds);
        topology.own_vertices();
        topology
    }

    pub fn crease_distance_m(&self, crease: usize, node: u32) -> f64 {
        f64::from(self.crease_distance_m[crease * self.of_node.len() + node as usize])
    }

    /// Distance of the nearest of some nodes from any crease, metres; infinite without creases.
    /// Corners that facets share lie on creases.
    pub fn away_from_creases_m(&self, nodes: &[u32]) -> f64 {
        let each = nodes.iter().map(|n| self.from_creases_m[*n as usize]);
        f64::from(each.fold(f32::INFINITY, f32::min))
    }

    /// Distance of a node from the nearest corner that two facets share, metres; infinite for none.
    pub fn corner_distance_m(&self, f: usize, g: usize, node: u32) -> f64 {
        let at = |k: &usize| self.vertex_distance_m[k * self.of_node.len() + node as usize];
        let shared = &self.shared_vertices[f * self.facets.len() + g];
        f64::from(shared.iter().map(at).fold(f32::INFINITY, f32::min))
    }

    /// The slot of an edge of facet `g`.
    pub fn slot(&self, edge: u32, g: usize) -> usize {
        let before = self.of_edge[edge as usize] & ((1 << g) - 1);
        (self.slots_from[edge as usize] + before.count_ones()) as usize
    }

    pub fn shared_crease(&self, f: usize, g: usize) -> Option<usize> {
        self.shared_crease[f * self.facets.len() + g]
    }

    fn own_triangles(&mut self, folds: &Folds) {
        let Self { mesh, of_node, .. } = self;
        let of = |nodes: &[u32]| {
            let masks = nodes.iter().map(|n| of_node[*n as usize]);
            (masks.clone().fold(u32::MAX, |a, b| a & b), masks.fold(0, |a, b| a | b))
        };
        let triangle = |corners: &[u32; 3]| {
            let (common, any) = of(corners);
            if common == 0 {
                return any;
            }
            let middle = [0, 1].map(|axis| {
                corners.iter().map(|n| mesh.uv_m[*n as usize][axis]).sum::<f64>() / 3.0
            });
            let deepest = 1 << folds.facet_at(middle);
            // A node near a crease counts for both sides; its triangles lie on one.
            if common & deepest != 0 { deepest } else { 1 << common.trailing_zeros() }
        };
        self.of_triangle = mesh.triangles.iter().map(triangle).collect();
        let sides = mesh.sides.iter();
        let side = |t: u32| if t == NONE { 0 } else { self.of_triangle[t as usize] };
        let of_both: Vec<u32> = sides.map(|[s, t]| side(*s) | side(*t)).collect();
        let rim = |[_, t]: &[u32; 2]| *t == NONE;
        let ends = of_both.iter().zip(&mesh.sides);
        self.ends = ends.map(|(both, sides)| rim(sides) || !both.is_power_of_two()).collect();
        let common: Vec<u32> = mesh.edges.iter().map(|edge| of(edge).0).collect();
        let own = |(common, both): (&u32, &u32)| if *common == 0 { *both } else { *common };
        self.of_edge = common.iter().zip(&of_both).map(own).collect();
        for (edge, facets) in self.of_edge.iter().enumerate() {
            self.slots_from.push(self.of_slot.len() as u32);
            self.of_slot.extend((0..facets.count_ones()).map(|_| edge as u32));
        }
    }

    fn own_links(&mut self) {
        let common =
            |nodes: &[u32]| nodes.iter().fold(u32::MAX, |a, n| a & self.of_node[*n as usize]);
        let mesh = &self.mesh;
        let edges = mesh.edges.iter().zip(&mesh.rest_m).map(|(nodes, rest_m)| Link {
            nodes: *nodes,
            rest_m: *rest_m,
            excess_min_m: if common(nodes) == 0 { 0.0 } else { f64::NEG_INFINITY },
        });
        let [rows, columns] = mesh.sheet.nodes;
        let steps_m = mesh.sheet.spacing_m();
        let nodes = (0..rows).flat_map(|i| (0..columns).map(move |j| [i, j]));
        let both = nodes.flat_map(|node| [(0, [1, 0]), (1, [0, 1])].map(|step| (node, step)));
        let skips = both.filter_map(|([i, j], (axis, [di, dj]))| {
            let [ki, kj] = [i + 2 * di, j + 2 * dj];
            if ki >= rows || kj >= columns {
                return None;
            }
            let nodes = [[i, j], [i + di, j + dj], [ki, kj]];
            let nodes = nodes.map(|[i, j]| mesh.sheet.index(i, j) as u32);
            let rest_m = 2.0 * steps_m[axis];
            let nodes = (common(&nodes) != 0).then_some([nodes[0], nodes[2]])?;
            Some(Link { nodes, rest_m, excess_min_m: f64::NEG_INFINITY })
        });
        self.links = Links::new(edges.chain(skips), self.of_node.len());
    }

    fn facet(&self, folds: &Folds, facet: usize) -> FacetMesh {
        let corners_m = folds.facets()[facet].corners_m.clone();
        let uv = &self.mesh.uv_m;
        let core = (0..uv.len()).filter(|n| self.of_node[*n] >> facet & 1 == 1);
        let core: Vec<u32> = core.map(|n| n as u32).collect();
        let share = 1.0 / core.len().max(1) as f64;
        let core_mean_m =
            [0, 1].map(|axis| core.iter().map(|n| uv[*n as usize][axis] * share).sum());
        let centred = |n: u32| [0, 1].map(|axis| uv[n as usize][axis] - core_mean_m[axis]);
        let core: Vec<(u32, [f64; 2])> = core.into_iter().map(|n| (n, centred(n))).collect();
        let radius2 = core.iter().map(|(_, [u, v])| (u * u + v * v) * share).sum::<f64>();
        let touches = |corner: &[f64; 2]| {
            let touched = folds.facets().iter().enumerate();
            let touched = touched.filter(|(_, other)| other.inside_m(*corner).abs() < SAME_M);
            touched.fold(0, |mask, (k, _)| mask | 1 << k)
        };
        let side = |(a, b): (&[f64; 2], &[f64; 2])| {
            let d = [b[0] - a[0], b[1] - a[1]];
            let length = d[0].hypot(d[1]);
            let [x, y] = d.map(|d| d / length);
            [-y, x, y * a[0] - x * a[1]]
        };
        let next = corners_m.iter().cycle().skip(1);
        let own = (0..self.mesh.edges.len()).filter(|e| self.of_edge[*e] >> facet & 1 == 1);
        let mut reached: Vec<u32> = core.iter().map(|(n, _)| *n).collect();
        reached.extend(own.clone().flat_map(|e| self.mesh.edges[e]));
        reached.sort_unstable();
        reached.dedup();
        let (boundary, interior) = own.map(|e| e as u32).partition(|e| self.ends[*e as usize]);
        FacetMesh {
            core,
            core_mean_m,
            core_radius_m: radius2.sqrt(),
            sides: corners_m.iter().zip(next).map(side).collect(),
            corner_touches: corners_m.iter().map(touches).collect(),
            corners_m,
            boundary,
            interior,
            reached,
            creases: Vec::new(),
        }
    }

    fn own_creases(&mut self, folds: &Folds) {
        let count = self.facets.len();
        for (number, crease) in folds.creases().iter().enumerate() {
            let [f, g] = crease.facets;
            self.facets[f].creases.push(number);
            self.facets[g].creases.push(number);
            self.shared_crease[f * count + g] = Some(number);
            self.shared_crease[g * count + f] = Some(number);
            let [a, b] = crease.ends_m;
            let distance = |p: &[f64; 2]| segment_distance_m(*p, a, b) as f32;
            self.crease_distance_m.extend(self.mesh.uv_m.iter().map(distance));
            self.creases.push(CreaseMesh {
                facets: crease.facets,
                ends_m: crease.ends_m,
                direction: crease.line().direction,
                at_rim: crease.ends_m.map(|end| self.is_at_rim(end)),
                spine: self.spine(crease.ends_m),
            });
        }
        let nodes = self.of_node.len();
        let nearest = |n: usize| {
            let each = self.crease_distance_m.iter().skip(n).step_by(nodes);
            each.copied().fold(f32::INFINITY, f32::min)
        };
        self.from_creases_m = (0..nodes).map(nearest).collect();
    }

    fn is_at_rim(&self, uv_m: [f64; 2]) -> bool {
        let size_m = self.mesh.sheet.size_m;
        (0..2).any(|axis| uv_m[axis] < SAME_M || uv_m[axis] > size_m[axis] - SAME_M)
    }

    /// Nodes on a crease, and where it cuts edges.
    fn spine(&self, [a, b]: [[f64; 2]; 2]) -> Vec<SpinePoint> {
        let d = [b[0] - a[0], b[1] - a[1]];
        let length = d[0].hypot(d[1]);
        let d = d.map(|d| d / length);
        let along = |p: [f64; 2]| (p[0] - a[0]) * d[0] + (p[1] - a[1]) * d[1];
        let side = |p: [f64; 2]| (p[1] - a[1]) * d[0] - (p[0] - a[0]) * d[1];
        let within = |s: f64| -self.on_crease_m < s && s < length + self.on_crease_m;
        let mut spine = Vec::new();
        for (n, p) in self.mesh.uv_m.iter().enumerate() {
            if side(*p).abs() < self.on_crease_m && within(along(*p)) {
                spine.push(SpinePoint { nodes: [n as u32; 2], t: 0.0, along_m: along(*p) });
            }
        }
        for nodes in &self.mesh.edges {
            let [p, q] = nodes.map(|n| self.mesh.uv_m[n as usize]);
            let (from, to) = (side(p), side(q));
            if from * to >= 0.0 || from.abs().min(to.abs()) < self.on_crease_m {
                continue;
            }
            let t = from / (from - to);
            let along_m = (1.0 - t) * along(p) + t * along(q);
            if within(along_m) {
                spine.push(SpinePoint { nodes: *nodes, t, along_m });
            }
        }
        spine.sort_by(|p, q| p.along_m.total_cmp(&q.along_m));
        spine
    }

    fn own_vertices(&mut self) {
        let mut vertices: Vec<([f64; 2], u32)> = Vec::new();
        for facet in &self.facets {
            for (corner, touches) in facet.corners_m.iter().zip(&facet.corner_touches) {
                let known =
                    |(p, _): &([f64; 2], u32)| (p[0] - corner[0]).hypot(p[1] - corner[1]) < SAME_M;
                if touches.count_ones() > 1 && !vertices.iter().any(known) {
                    vertices.push((*corner, *touches));
                }
            }
        }
        let count = self.facets.len();
        for (k, (corner, touches)) in vertices.iter().enumerate() {
            let distance = |p: &[f64; 2]| (p[0] - corner[0]).hypot(p[1] - corner[1]) as f32;
            self.vertex_distance_m.extend(self.mesh.uv_m.iter().map(distance));
            for f in 0..count {
                for g in 0..count {
                    if f != g && touches >> f & touches >> g & 1 == 1 {
                        self.shared_vertices[f * count + g].push(k);
                    }
                }
            }
        }
    }
}

fn segment_distance_m(p: [f64; 2], a: [f64; 2], b: [f64; 2]) -> f64 {
    let (d, e) = ([b[0] - a[0], b[1] - a[1]], [p[0] - a[0], p[1] - a[1]]);
    let length2 = d[0] * d[0] + d[1] * d[1];
    let t = ((d[0] * e[0] + d[1] * e[1]) / length2).clamp(0.0, 1.0);
    (e[0] - t * d[0]).hypot(e[1] - t * d[1])
}
