//! Where the sheet bends out of sight: contour that is neither border nor crease.

use nalgebra::Vector3;
use std::collections::BTreeMap;

/// Edges between two triangles of a sheet.
#[derive(Debug, Clone, Default)]
pub(super) struct Bends {
    /// Ends of each edge, and the triangles on its sides.
    joints: Vec<([u32; 2], [u32; 2])>,
}

impl Bends {
    /// Of a sheet of these triangles.
    pub fn of(triangles: &[[u32; 3]]) -> Self {
        let mut sides: BTreeMap<[u32; 2], Vec<u32>> = BTreeMap::new();
        for (k, [a, b, c]) in triangles.iter().enumerate() {
            for [p, q] in [[a, b], [b, c], [c, a]] {
                sides.entry([*p.min(q), *p.max(q)]).or_default().push(k as u32);
            }
        }
        let joint = |(ends, sides): ([u32; 2], Vec<u32>)| {
            let [a, b] = sides[..] else { return None };
            Some((ends, [a, b]))
        };
        Self { joints: sides.into_iter().filter_map(joint).collect() }
    }

    /// Ends of the edges at which the sheet turns its other side to an eye, metres.
    pub fn seen_from(
        &self,
        eye_m: Vector3<f32>,
        nodes_m: &[[f32; 3]],
        triangles: &[[u32; 3]],
    ) -> Vec<[[f32; 3]; 2]> {
        let faces = |triangle: &[u32; 3]| {
            let [a, b, c] = triangle.map(|n| Vector3::from(nodes_m[n as usize]));
            (b - a).cross(&(c - a)).dot(&(eye_m - a)) > 0.0
        };
        let faces: Vec<bool> = triangles.iter().map(faces).collect();
        let turned = |[a, b]: [u32; 2]| faces[a as usize] != faces[b as usize];
        let joints = self.joints.iter().filter(|(_, sides)| turned(*sides));
        joints.map(|(ends, _)| ends.map(|n| nodes_m[n as usize])).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use orime_geometry::SheetGrid;

    #[test]
    fn a_tunnel_is_seen_to_bend_along_its_sides_and_a_flat_sheet_nowhere() {
        let sheet = SheetGrid::new([0.2, 0.1], [21, 11]);
        let triangles = sheet.triangles();
        let bends = Bends::of(&triangles);
        let eye_m = Vector3::new(0.0, 0.0, 1.0);
        assert!(bends.seen_from(eye_m, &sheet.flat_m(), &triangles).is_empty());
        // Bent about y through 270°, open below.
        let radius_m = 0.2 / 1.5 / std::f32::consts::PI;
        let bent: Vec<[f32; 3]> = sheet
            .flat_m()
            .iter()
            .map(|[u, v, _]| {
                let angle = u / radius_m;
                [radius_m * angle.sin(), *v, radius_m * angle.cos()]
            })
            .collect();
        let seen = bends.seen_from(eye_m, &bent, &triangles);
        // Ten edges along each side, where the chord turns its back; diagonals have ends beside.
        assert!((20..60).contains(&seen.len()), "{}", seen.len());
        let off_m = |p: &[f32; 3]| (p[0].abs() - radius_m).abs();
        assert!(seen.iter().flatten().all(|p| off_m(p) < 0.003), "{seen:?}");
    }
}
