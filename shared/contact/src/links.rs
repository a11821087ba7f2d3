//! Lengths of the mesh's edges, and of the links that keep facets flat.
//!
//! Every link sees what those before it did to its nodes. Links without a common node see nothing
//! of each other, so that they stand in layers: no two of a layer meet, and of two that meet the
//! one that came first in the mesh still comes first. The result is the same to the bit, and no
//! link has to wait for the root of the one before it.

use nalgebra::Vector3;

/// Two nodes and their distance at rest.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Link {
    pub nodes: [u32; 2],
    pub rest_m: f64,
    /// Where it is longer than at rest by less than this, nothing is done, metres: 0 where a crease
    /// cuts it, because folded its chord is shorter; else −∞. A number, because excess has either
    /// sign at random and a branch by sign would be guessed wrong half of the time.
    pub excess_min_m: f64,
}

/// Links in layers.
#[derive(Debug, Clone, Default)]
pub(crate) struct Links(Vec<Link>);

impl Links {
    /// In the order that sweeps have to look as if they went in.
    pub fn new(links: impl Iterator<Item = Link>, node_count: usize) -> Self {
        let mut layers = vec![0u32; node_count];
        let mut layered: Vec<(u32, Link)> = links
            .map(|link| {
                let layer =
                    1 + link.nodes.map(|n| layers[n as usize]).into_iter().fold(0, u32::max);
                for n in link.nodes {
                    layers[n as usize] = layer;
                }
                (layer, link)
            })
            .collect();
        layered.sort_by_key(|(layer, _)| *layer); // Stable.
        Self(layered.into_iter().map(|(_, link)| link).collect())
    }

    /// One sweep over all links, back to front where `reverse`.
    pub fn sweep(&self, x: &mut [Vector3<f64>], mobility: &[f64], reverse: bool) {
        if reverse {
            self.0.iter().rev().for_each(|link| link.solve(x, mobility));
        } else {
            self.0.iter().for_each(|link| link.solve(x, mobility));
        }
    }
}

impl Link {
    fn solve(&self, x: &mut [Vector3<f64>], mobility: &[f64]) {
        let [a, b] = self.nodes.map(|n| n as usize);
        let d = x[b] - x[a];
        let length = d.norm();
        let excess = length - self.rest_m;
        let sum = mobility[a] + mobility[b];
        if length < 1e-9 || sum <= 0.0 || excess < self.excess_min_m {
            return;
        }
        let step = d * (excess / (length * sum));
        x[a] += step * mobility[a];
        x[b] -= step * mobility[b];
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::Mesh;
    use orime_geometry::SheetGrid;

    #[test]
    fn layers_change_no_bit() {
        let mesh = Mesh::new(&SheetGrid::new([0.2, 0.3], [13, 9]));
        let rest = mesh.edges.iter().zip(&mesh.rest_m).enumerate();
        let links: Vec<Link> = rest
            .map(|(k, (nodes, rest_m))| Link {
                nodes: *nodes,
                rest_m: *rest_m,
                excess_min_m: if k % 5 == 0 { 0.0 } else { f64::NEG_INFINITY },
            })
            .collect();
        let layered = Links::new(links.iter().copied(), mesh.uv_m.len());
        let order = |links: &[Link]| links.iter().map(|link| link.nodes).collect::<Vec<_>>();
        assert_ne!(order(&layered.0), order(&links), "nothing was reordered, nothing is tested");
        let start = mesh.uv_m.iter().enumerate().map(|(n, [u, v])| {
            let wave = (n as f64 * 0.7).sin();
            Vector3::new(u + 0.004 * wave, *v, 0.01 * wave)
        });
        let start: Vec<Vector3<f64>> = start.collect();
        let mobility: Vec<f64> = (0..start.len()).map(|n| (n % 4) as f64 * 0.5).collect();
        let (mut a, mut b) = (start.clone(), start.clone());
        for sweep in 0..4 {
            layered.sweep(&mut a, &mobility, sweep % 2 == 1);
            let each = |link: &Link| link.solve(&mut b, &mobility);
            if sweep % 2 == 1 {
                links.iter().rev().for_each(each);
            } else {
                links.iter().for_each(each);
            }
            assert_eq!(a, b);
        }
        assert_ne!(a, start);
    }
}
