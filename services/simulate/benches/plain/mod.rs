//! The plainest sheet of links: XPBD in one loop over a list, link by link, colour after colour.
//!
//! What `../../shared/design/simulate.md` has as a table was measured with such a loop, whose text
//! is lost; this one is hung, dragged and measured as the bench's own sheet.

/// A list of links and the nodes between them.
pub struct Plain {
    x_m: Vec<[f32; 3]>,
    v_m_per_s: Vec<[f32; 3]>,
    before_m: Vec<[f32; 3]>,
    /// 0 holds a node, 1 does not.
    weight: Vec<f32>,
    /// Two nodes and their distance at rest, metres.
    links: Vec<([usize; 2], f32)>,
}

const G_M_PER_S2: f32 = 9.81;

impl Plain {
    /// A square sheet in the plane, held by two corners of its first row; links reach 1 to 4 steps
    /// along rows, columns and diagonals.
    pub fn hung(side_m: f32, nodes: usize) -> Self {
        let step_m = side_m / (nodes - 1) as f32;
        let count = nodes * nodes;
        let at = |n: usize| [(n / nodes) as f32 * step_m, (n % nodes) as f32 * step_m, 0.0];
        let mut links = Vec::new();
        for direction in [[0, 1], [1, 0], [1, 1], [1, -1]] {
            for reach in 1..=4isize {
                for parity in 0..2 {
                    links.extend(colour(nodes, step_m, direction, reach, parity));
                }
            }
        }
        Self {
            x_m: (0..count).map(at).collect(),
            v_m_per_s: vec![[0.0; 3]; count],
            before_m: vec![[0.0; 3]; count],
            weight: (0..count).map(|n| f32::from(u8::from(n != 0 && n != nodes - 1))).collect(),
            links,
        }
    }

    /// Node positions, metres.
    pub fn positions_m(&self) -> &[[f32; 3]] {
        &self.x_m
    }

    /// A frame in this many substeps, slowed by air as `exp(−drag·t)`.
    pub fn frame(&mut self, frame_s: f32, substeps: u32, drag_per_s: f32) {
        let dt_s = frame_s / substeps as f32;
        let keep = (-drag_per_s * dt_s).exp();
        for _ in 0..substeps {
            self.before_m.copy_from_slice(&self.x_m);
            for ((x, v), weight) in self.x_m.iter_mut().zip(&mut self.v_m_per_s).zip(&self.weight) {
                *v = v.map(|v| v * keep);
                v[2] -= G_M_PER_S2 * dt_s;
                (0..3).for_each(|axis| x[axis] += weight * v[axis] * dt_s);
            }
            for ([a, b], rest_m) in &self.links {
                let d: [f32; 3] = std::array::from_fn(|k| self.x_m[*b][k] - self.x_m[*a][k]);
                let length_m = d.iter().map(|d| d * d).sum::<f32>().sqrt();
                let [wa, wb] = [self.weight[*a], self.weight[*b]];
                if wa + wb > 0.0 && length_m > 1e-9 {
                    let share = (length_m - rest_m) / (length_m * (wa + wb));
                    (0..3).for_each(|k| self.x_m[*a][k] += wa * share * d[k]);
                    (0..3).for_each(|k| self.x_m[*b][k] -= wb * share * d[k]);
                }
            }
            let moved = self.x_m.iter().zip(&self.before_m);
            for (v, (x, before)) in self.v_m_per_s.iter_mut().zip(moved) {
                *v = std::array::from_fn(|k| (x[k] - before[k]) / dt_s);
            }
        }
    }
}

/// Links of one direction and reach that share no node.
fn colour(
    nodes: usize,
    step_m: f32,
    [di, dj]: [isize; 2],
    reach: isize,
    parity: usize,
) -> impl Iterator<Item = ([usize; 2], f32)> {
    let all = (0..nodes * nodes).map(move |n| [n / nodes, n % nodes]);
    all.filter_map(move |[i, j]| {
        let to = [i.checked_add_signed(reach * di)?, j.checked_add_signed(reach * dj)?];
        let along = if di == 0 { j } else { i };
        let is_ours = to.iter().all(|k| *k < nodes) && (along / reach as usize) % 2 == parity;
        let length = ((di * di + dj * dj) as f32).sqrt() * reach as f32;
        is_ours.then(|| ([i * nodes + j, to[0] * nodes + to[1]], step_m * length))
    })
}
