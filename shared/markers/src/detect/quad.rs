//! Borders that are convex quadrangles.

use super::border::BORDER_PX_MAX;
use super::line::{Line, Weighted};

/// A quadrangle that may be a marker.
#[derive(Debug, Clone, Copy)]
pub(super) struct Quad {
    /// Clockwise in the image, pixels.
    pub corners_px: [[f64; 2]; 4],
    /// Area, pixels².
    pub area_px2: f64,
}

/// Which quadrangles are looked for.
#[derive(Debug, Clone, Copy)]
pub(super) struct Limits {
    /// Largest distance of the border from the quadrangle, as a share of the border's length.
    pub error_ratio: f64,
    /// Length of the shortest side, pixels: what is seen from its edge has short ones.
    pub side_px_min: f64,
    /// Area, pixels².
    pub area_px2_min: f64,
}

/// Least area of a quadrangle as a share of its squared border: that of a rectangle of 1 : 16.
const COMPACTNESS_MIN: f64 = 0.014;

/// Share of a side that is left out at each end when a line is laid through it.
const SIDE_END_SHARE: usize = 8;

/// Furthest that the lines' crossing may lie from the vertex it replaces, pixels.
const CORNER_MOVE_PX_MAX: f64 = 4.0;

/// Corners of two quadrangles closer than this share of the diagonal are the same.
const NEAR_SHARE: f64 = 0.12;

/// Most vertices that are followed: more make no quadrangle.
const VERTICES_MAX: usize = 8;

impl Quad {
    /// Length of the shortest side, pixels.
    pub(super) fn side_px_min(&self) -> f64 {
        let side = |k: usize| distance(self.corners_px[k], self.corners_px[(k + 1) % 4]);
        (0..4).map(side).fold(f64::INFINITY, f64::min)
    }

    fn diagonal_px(&self) -> f64 {
        distance(self.corners_px[0], self.corners_px[2])
    }

    fn centre(&self) -> [f64; 2] {
        [0, 1].map(|axis| self.corners_px.iter().map(|corner| corner[axis]).sum::<f64>() / 4.0)
    }

    /// Whether the other one is the same but for the noise of thresholds.
    pub(super) fn is_near(&self, other: &Self) -> bool {
        let limit_px = NEAR_SHARE * self.diagonal_px();
        let near = |turn: usize| {
            (0..4)
                .all(|k| distance(self.corners_px[k], other.corners_px[(k + turn) % 4]) < limit_px)
        };
        (0..4).any(near)
    }

    /// Whether the two cannot both be markers.
    pub(super) fn overlaps(&self, other: &Self) -> bool {
        let diagonal_px = self.diagonal_px().max(other.diagonal_px());
        distance(self.centre(), other.centre()) < 0.25 * diagonal_px
    }
}

/// The quadrangle that follows an outer border, if one does; `twice_area` is the border's,
/// positive if it is an outer one.
pub(super) fn quadrangle(border: &[[i32; 2]], twice_area: i64, limits: &Limits) -> Option<Quad> {
    let length = border.len() as f64;
    // The border runs through the centres of dark pixels, half a pixel inside the edge: what is
    // large enough has half its area inside the border at least.
    let possible = twice_area > 0
        && border.len() < BORDER_PX_MAX
        && twice_area as f64 >= limits.area_px2_min
        && twice_area as f64 >= 2.0 * COMPACTNESS_MIN * length * length;
    if !possible {
        return None;
    }
    let vertices = vertices(border, limits.error_ratio * length)?;
    let mut corners_px = vertices.map(|k| centre(border[k]));
    let mut lines = [None; 4];
    for side in 0..4 {
        lines[side] = Some(side_line(border, vertices[side], vertices[(side + 1) % 4])?);
    }
    for k in 0..4 {
        let crossing = lines[(k + 3) % 4]?.cross(&lines[k]?);
        corners_px[k] = crossing
            .filter(|crossing| distance(*crossing, corners_px[k]) < CORNER_MOVE_PX_MAX)
            .unwrap_or(corners_px[k]);
    }
    let turn = |k: usize| {
        let [a, b, c] = [0, 1, 2].map(|j| corners_px[(k + j) % 4]);
        (b[0] - a[0]) * (c[1] - b[1]) - (b[1] - a[1]) * (c[0] - b[0])
    };
    let [a, b, c, d] = corners_px;
    let area_px2 = 0.5 * ((c[0] - a[0]) * (d[1] - b[1]) - (d[0] - b[0]) * (c[1] - a[1]));
    let quad = Quad { corners_px, area_px2 };
    let large = area_px2 >= limits.area_px2_min && quad.side_px_min() >= limits.side_px_min;
    (large && (0..4).all(|k| turn(k) > 0.0)).then_some(quad)
}

/// A line along the edge outside a side's pixels.
///
/// A pixel is dark if its centre is; the outermost centres lie half a pixel inside the edge on
/// average, measured along the axis that the edge is steeper to.
fn side_line(border: &[[i32; 2]], start: usize, end: usize) -> Option<Line> {
    let count = border.len();
    let end = if end > start { end } else { end + count };
    let cut = (end - start) / SIDE_END_SHARE;
    let inner = start + cut..=end - cut;
    if inner.clone().count() < 3 {
        return None;
    }
    let mut line =
        Line::fit(inner.map(|k| Weighted { point: centre(border[k % count]), weight: 1.0 }))?;
    let ([ax, ay], [bx, by]) = (centre(border[start % count]), centre(border[end % count]));
    // The border is clockwise, so the outside is on its left.
    let outwards = line.normal[0] * (by - ay) - line.normal[1] * (bx - ax);
    let half_px = 0.5 * line.normal[0].abs().max(line.normal[1].abs());
    line.offset_px += half_px.copysign(outwards);
    Some(line)
}

/// Indices of the four vertices of a closed border that nowhere departs more than `error_px`
/// from the lines between them. Source: Douglas & Peucker, Cartographica 10, 1973.
fn vertices(border: &[[i32; 2]], error_px: f64) -> Option<[usize; 4]> {
    let count = border.len();
    let first = farthest(border, 0);
    let second = farthest(border, first);
    let (first, second) = (first.min(second), first.max(second));
    let mut kept = [0; VERTICES_MAX + 1];
    (kept[0], kept[1]) = (first, second);
    let mut kept_count = 2;
    let mut open = [(0, 0); VERTICES_MAX + 2];
    (open[0], open[1]) = ((first, second), (second, first + count));
    let mut open_count = 2;
    while open_count > 0 {
        open_count -= 1;
        let (start, end) = open[open_count];
        let (error, at) = largest_error(border, start, end);
        if error > error_px {
            if kept_count > VERTICES_MAX {
                return None;
            }
            kept[kept_count] = at % count;
            kept_count += 1;
            (open[open_count], open[open_count + 1]) = ((start, at), (at, end));
            open_count += 2;
        }
    }
    let kept = &mut kept[..kept_count];
    kept.sort_unstable();
    without_straight(border, kept, error_px)
}

/// The pixel farthest from pixel `from`; the first of several.
fn farthest(border: &[[i32; 2]], from: usize) -> usize {
    let [x, y] = border[from];
    let mut best = (0, from);
    for (k, point) in border.iter().enumerate() {
        let (dx, dy) = (i64::from(point[0] - x), i64::from(point[1] - y));
        let squared = dx * dx + dy * dy;
        if squared > best.0 {
            best = (squared, k);
        }
    }
    best.1
}

/// Largest distance from the chord `start`–`end`, and where; indices may pass the border's end.
fn largest_error(border: &[[i32; 2]], start: usize, end: usize) -> (f64, usize) {
    let count = border.len();
    let ([ax, ay], [bx, by]) = (border[start % count], border[end % count]);
    let (dx, dy) = (i64::from(bx - ax), i64::from(by - ay));
    let mut best = (0, start);
    let mut look = |points: &[[i32; 2]], first: usize| {
        for (k, point) in points.iter().enumerate() {
            let (px, py) = (i64::from(point[0] - ax), i64::from(point[1] - ay));
            let cross = (dx * py - dy * px).abs();
            if cross > best.0 {
                best = (cross, first + k);
            }
        }
    };
    look(&border[start.min(count)..end.min(count)], start);
    let wrapped = start.max(count)..end.max(count);
    look(&border[wrapped.start - count..wrapped.end - count], wrapped.start);
    (best.0 as f64 / ((dx * dx + dy * dy) as f64).sqrt().max(1.0), best.1)
}

/// The vertices without those on the line between their neighbours: an artefact of where the
/// closed border was cut first.
fn without_straight(border: &[[i32; 2]], kept: &mut [usize], error_px: f64) -> Option<[usize; 4]> {
    let mut count = kept.len();
    let mut k = 0;
    while k < count && count > 3 {
        let [a, b, c] = [kept[(k + count - 1) % count], kept[k], kept[(k + 1) % count]]
            .map(|index| centre(border[index]));
        let cross = (c[0] - a[0]) * (b[1] - a[1]) - (c[1] - a[1]) * (b[0] - a[0]);
        if cross.abs() / distance(a, c).max(1.0) <= error_px {
            kept[k..count].rotate_left(1);
            count -= 1;
            k = 0;
        } else {
            k += 1;
        }
    }
    kept[..count].try_into().ok()
}

fn centre(pixel: [i32; 2]) -> [f64; 2] {
    pixel.map(f64::from)
}

/// Distance of two points, pixels.
pub(super) fn distance(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

#[cfg(test)]
mod tests {
    use super::*;

    const LIMITS: Limits = Limits { error_ratio: 0.03, side_px_min: 8.0, area_px2_min: 100.0 };

    /// Pixels on the border of a convex polygon, clockwise, one a step along the longer axis.
    fn outline(corners: &[[i32; 2]]) -> (Vec<[i32; 2]>, i64) {
        let mut border = Vec::new();
        let mut twice_area = 0;
        for (k, [ax, ay]) in corners.iter().copied().enumerate() {
            let [bx, by] = corners[(k + 1) % corners.len()];
            let steps = (bx - ax).abs().max((by - ay).abs());
            for s in 0..steps {
                let at = |a: i32, b: i32| {
                    (f64::from(a) + f64::from((b - a) * s) / f64::from(steps)).round() as i32
                };
                border.push([at(ax, bx), at(ay, by)]);
            }
            twice_area += i64::from(ax * by - bx * ay);
        }
        (border, twice_area)
    }

    #[test]
    fn quadrangles_are_found_wherever_their_border_starts() {
        let corners = [[10, 20], [90, 5], [110, 80], [20, 70]];
        let (mut border, twice_area) = outline(&corners);
        for _ in 0..border.len() {
            border.rotate_left(1);
            let quad = quadrangle(&border, twice_area, &LIMITS).unwrap();
            for corner in corners {
                let near = quad.corners_px.iter().map(|c| distance(*c, corner.map(f64::from)));
                let near = near.fold(f64::INFINITY, f64::min);
                assert!(near < 1.6, "{corner:?} is {near} px away");
            }
            assert!(quad.area_px2 > 0.5 * twice_area as f64);
        }
    }

    #[test]
    fn other_shapes_are_not_quadrangles() {
        let refuse = |corners: &[[i32; 2]]| {
            let (border, twice_area) = outline(corners);
            assert!(quadrangle(&border, twice_area, &LIMITS).is_none(), "{corners:?}");
        };
        refuse(&[[0, 0], [80, 0], [40, 60]]);
        refuse(&[[20, 0], [60, 0], [80, 40], [40, 70], [0, 40]]);
        refuse(&[[0, 0], [100, 0], [100, 3], [0, 3]]);
        refuse(&[[0, 0], [80, 0], [30, 30], [0, 80]]);
        refuse(&[[0, 0], [6, 0], [6, 6], [0, 6]]);
        // A hole: the same border the other way round.
        let (border, twice_area) = outline(&[[0, 0], [80, 0], [80, 80], [0, 80]]);
        assert!(quadrangle(&border, twice_area, &LIMITS).is_some());
        assert!(quadrangle(&border, -twice_area, &LIMITS).is_none());
    }
}
