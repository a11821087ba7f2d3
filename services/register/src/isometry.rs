//! Isometry projection: paper bends but does not stretch; and between creases it stays flat.
//!
//! A sheet that is pushed from its sides by noisy or slightly too small data can only give way by
//! buckling, so lengths alone leave wrinkles. Three nodes in a row are therefore straightened, the
//! more the straighter they are already: with fold angle θ the pull is scaled by
//! 1/(1 + (θ/θ₀)²), so that a crease, once it is one, is left alone.

use orime_creases::Folds;
use orime_geometry::SheetGrid;

/// Two nodes and the length between them at rest, metres.
type Link = ([u32; 2], f32);

/// Edges and cell diagonals with their rest lengths.
#[derive(Debug, Clone)]
pub(crate) struct Isometry {
    links: Vec<Link>,
    /// Nodes in a row at [`SPANS`] steps, the middle one second.
    rows: Vec<[u32; 3]>,
    /// The same on a sheet without creases.
    unfolded: (Vec<Link>, Vec<[u32; 3]>),
    /// 0 … 1.
    flatness: f32,
}

/// Steps between the nodes of a row: small wrinkles, and larger ones.
const SPANS: [usize; 2] = [1, 3];
/// sin²(θ₀/2) for θ₀ = 10°: half the pull is left at this fold angle.
const CREASE_SIN2: f32 = 0.0076;

impl Isometry {
    /// Links between neighbours along u, v and both diagonals, at the distances of `rest_m`.
    pub fn new(sheet: &SheetGrid, rest_m: &[[f32; 3]], flatness: f64) -> Self {
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
        let rows = rows(sheet);
        let unfolded = (links.clone(), rows.clone());
        Self { links, rows, unfolded, flatness: flatness as f32 }
    }

    /// Takes over other folds: no link and no row reaches across a crease.
    pub fn refold(&mut self, folds: &Folds) {
        let facets = folds.facets_of_node();
        let together = |nodes: &[u32]| {
            nodes.iter().fold(u32::MAX, |facet, node| facet & facets[*node as usize]) != 0
        };
        self.links.clear();
        self.links.extend(self.unfolded.0.iter().filter(|(ends, _)| together(ends)));
        self.rows.clear();
        self.rows.extend(self.unfolded.1.iter().filter(|row| together(&row[..])));
    }

    /// Moves the ends of every link half way to its rest length each, sweeping to and fro, and
    /// straightens rows of nodes between creases.
    pub fn project(&self, x: &mut [[f32; 3]], sweeps: u32) {
        for sweep in 0..sweeps {
            if sweep % 2 == 0 {
                self.links.iter().for_each(|link| relax(link, x));
            } else {
                self.links.iter().rev().for_each(|link| relax(link, x));
            }
            if self.flatness > 0.0 {
                self.rows.iter().for_each(|row| straighten(row, self.flatness, x));
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

#[inline(always)]
fn relax(([a, b], rest): &Link, x: &mut [[f32; 3]]) {
    let (a, b) = (*a as usize, *b as usize);
    let (xa, xb) = (x[a], x[b]);
    let d = sub(xb, xa);
    let length = norm(d);
    if length < 1e-9 {
        return;
    }
    let scale = 0.5 * (length - rest) / length;
    x[a] = add_scaled(xa, scale, d);
    x[b] = add_scaled(xb, -scale, d);
}

/// Three nodes in a row, along u and v, at every span.
fn rows(sheet: &SheetGrid) -> Vec<[u32; 3]> {
    let [n, m] = sheet.nodes;
    let mut rows = Vec::new();
    for span in SPANS {
        for i in 0..n {
            for j in 0..m {
                let row = |a: usize, b: usize| [a, sheet.index(i, j), b].map(|k| k as u32);
                if i >= span && i + span < n {
                    rows.push(row(sheet.index(i - span, j), sheet.index(i + span, j)));
                }
                if j >= span && j + span < m {
                    rows.push(row(sheet.index(i, j - span), sheet.index(i, j + span)));
                }
            }
        }
    }
    rows
}

#[inline(always)]
fn straighten([a, middle, b]: &[u32; 3], flatness: f32, x: &mut [[f32; 3]]) {
    let (a, middle, b) = (*a as usize, *middle as usize, *b as usize);
    let (xa, xm, xb) = (x[a], x[middle], x[b]);
    let offset = [
        0.5 * (xa[0] + xb[0]) - xm[0],
        0.5 * (xa[1] + xb[1]) - xm[1],
        0.5 * (xa[2] + xb[2]) - xm[2],
    ];
    let to_end = norm2(sub(xa, xm)).max(norm2(sub(xb, xm)));
    if to_end <= 0.0 {
        return;
    }
    let sin2 = norm2(offset) / to_end;
    let pull = flatness / (1.0 + sin2 / CREASE_SIN2);
    let (half, quarter) = (0.5 * pull, 0.25 * pull);
    x[middle] = add_scaled(xm, half, offset);
    x[a] = add_scaled(xa, -quarter, offset);
    x[b] = add_scaled(xb, -quarter, offset);
}

#[inline(always)]
fn add_scaled(x: [f32; 3], scale: f32, d: [f32; 3]) -> [f32; 3] {
    [x[0] + scale * d[0], x[1] + scale * d[1], x[2] + scale * d[2]]
}

#[inline(always)]
fn norm2(d: [f32; 3]) -> f32 {
    d[0] * d[0] + d[1] * d[1] + d[2] * d[2]
}

#[inline(always)]
fn sub(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

#[inline(always)]
fn norm(d: [f32; 3]) -> f32 {
    norm2(d).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stretched_sheet_comes_back_and_a_bent_one_stays() {
        let sheet = SheetGrid::new([0.15, 0.15], [13, 13]);
        let rest = sheet.flat_m();
        let isometry = Isometry::new(&sheet, &rest, 0.0);
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

    #[test]
    fn wrinkles_go_and_a_crease_stays() {
        let sheet = SheetGrid::new([0.15, 0.15], [25, 25]);
        let rest = sheet.flat_m();
        let isometry = Isometry::new(&sheet, &rest, 0.3);
        // Wrinkles of 1 mm over four grid steps; and a right angle along the middle line.
        let wrinkled = |p: &[f32; 3]| 0.001 * (p[1] * std::f32::consts::TAU / 0.025).sin();
        let mut x: Vec<[f32; 3]> = rest
            .iter()
            .map(|p| {
                let bump = wrinkled(p);
                if p[0] > 0.0 { [bump, p[1], p[0]] } else { [p[0], p[1], bump] }
            })
            .collect();
        isometry.project(&mut x, 60);
        // The last nodes of a row have nothing beyond them to be straightened against.
        let inner = |p: &[f32; 3]| p[0] < -0.03 && p[1].abs() < 0.06;
        let bumps = rest.iter().zip(&x).filter(|(p, _)| inner(p)).map(|(_, x)| x[2].abs());
        let bump = bumps.fold(0f32, f32::max);
        assert!(bump < 0.00033, "a third of a millimetre at most: wrinkles of {bump} m are left");
        let tip = x[sheet.index(24, 12)];
        assert!(tip[0].abs() < 0.004 && (tip[2] - 0.075).abs() < 0.002, "the flap moved: {tip:?}");
    }
}
