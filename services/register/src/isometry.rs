//! Isometry projection: paper bends but does not stretch.

use orime_geometry::SheetGrid;

/// Edges and cell diagonals with their rest lengths.
#[derive(Debug)]
pub(crate) struct Isometry {
    links: Vec<([u32; 2], f32)>,
}

impl Isometry {
    /// Links between neighbours along u, v and both diagonals, at the distances of `rest_m`.
    pub fn new(sheet: &SheetGrid, rest_m: &[[f32; 3]]) -> Self {
        let mut links = Vec::new();
        for i in 0..sheet.nodes[0] {
            for j in 0..sheet.nodes[1] {
                for [di, dj] in [[1, 0], [0, 1], [1, 1], [1, -1]] {
                    let (Some(i2), Some(j2)) = (i.checked_add_signed(di), j.checked_add_signed(dj))
                    else {
                        continue;
                    };
                    if i2 < sheet.nodes[0] && j2 < sheet.nodes[1] {
                        let (a, b) = (sheet.index(i, j), sheet.index(i2, j2));
                        let length = norm(sub(rest_m[b], rest_m[a]));
                        links.push(([a as u32, b as u32], length));
                    }
                }
            }
        }
        Self { links }
    }

    /// Moves the ends of every link half way to its rest length each, sweeping to and fro.
    pub fn project(&self, x: &mut [[f32; 3]], sweeps: u32) {
        for sweep in 0..sweeps {
            if sweep % 2 == 0 {
                self.links.iter().for_each(|link| relax(link, x));
            } else {
                self.links.iter().rev().for_each(|link| relax(link, x));
            }
        }
    }

    /// Largest and mean relative change of a link's length.
    pub fn strain(&self, x: &[[f32; 3]]) -> (f32, f32) {
        let mut largest = 0f32;
        let mut sum = 0f64;
        for ([a, b], rest) in &self.links {
            let strain = (norm(sub(x[*b as usize], x[*a as usize])) / rest - 1.0).abs();
            largest = largest.max(strain);
            sum += f64::from(strain);
        }
        (largest, (sum / self.links.len() as f64) as f32)
    }
}

fn relax(([a, b], rest): &([u32; 2], f32), x: &mut [[f32; 3]]) {
    let (a, b) = (*a as usize, *b as usize);
    let d = sub(x[b], x[a]);
    let length = norm(d);
    if length < 1e-9 {
        return;
    }
    let scale = 0.5 * (length - rest) / length;
    for axis in 0..3 {
        x[a][axis] += scale * d[axis];
        x[b][axis] -= scale * d[axis];
    }
}

fn sub(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

fn norm(d: [f32; 3]) -> f32 {
    (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stretched_sheet_comes_back_and_a_bent_one_stays() {
        let sheet = SheetGrid::new([0.15, 0.15], [13, 13]);
        let rest = sheet.flat_m();
        let isometry = Isometry::new(&sheet, &rest);
        let mut stretched: Vec<[f32; 3]> =
            rest.iter().map(|p| [p[0] * 1.03, p[1] * 0.98, p[2]]).collect();
        let before = isometry.strain(&stretched).1;
        isometry.project(&mut stretched, 200);
        assert!(isometry.strain(&stretched).1 < before / 20.0);

        // A right angle along a grid line keeps every link's length.
        let bent: Vec<[f32; 3]> =
            rest.iter().map(|p| if p[0] > 0.0 { [0.0, p[1], p[0]] } else { *p }).collect();
        let mut projected = bent.clone();
        isometry.project(&mut projected, 10);
        let moved = bent.iter().zip(&projected).map(|(a, b)| norm(sub(*a, *b)));
        assert!(moved.fold(0f32, f32::max) < 1e-5);
    }
}
