//! Isometry projection: paper bends but does not stretch; and between creases it stays flat.
//!
//! A sheet that is pushed from its sides by noisy or slightly too small data can only give way by
//! buckling, so lengths alone leave wrinkles. Three nodes in a row are therefore straightened, the
//! more the straighter they are already: with fold angle θ the pull is scaled by
//! 1/(1 + (θ/θ₀)²), so that a crease, once it is one, is left alone.

use orime_creases::Folds;
use orime_geometry::SheetGrid;
use orime_lanes::{
    Field, LANES, Lanes, Layout, Pass, Width, dot, gather, load_points, minus, plus, scatter,
    store_points, times,
};

/// The projection of one sheet.
#[derive(Debug, Clone)]
pub(crate) struct Isometry {
    layout: Layout,
    width: Width,
    colours: Vec<Colour>,
    rows: Vec<Rows>,
    /// Ends and rest lengths, metres, of the links that act.
    links: Vec<([u32; 2], f32)>,
    /// 0 … 1.
    flatness: f32,
    x: [Field; 3],
    moves: [Moves; 3],
}

/// Links of one direction that share no node: all go equally far through the padded rows.
#[derive(Debug, Clone)]
struct Colour {
    /// From first to second node, in numbers of a field.
    offset: usize,
    /// The links that start in each vector of nodes: those that are there, and those that act.
    bits: Vec<[u16; 2]>,
    /// Rest lengths, metres, of those that are there.
    rest_m: Field,
}

/// Rows of three nodes, equally far apart.
#[derive(Debug, Clone)]
struct Rows {
    /// From node to node, in numbers of a field.
    offset: usize,
    /// The rows whose middle is in each vector of nodes: those that are there, and those that act.
    bits: Vec<[u16; 2]>,
}

/// A number per node, with room for the longest offset on both sides that is always zero.
#[derive(Debug, Clone)]
struct Moves {
    numbers: Vec<f32>,
    room: usize,
}

/// Steps between the nodes of a row: small wrinkles, and larger ones.
const SPANS: [usize; 2] = [1, 3];
/// sin²(θ₀/2) for θ₀ = 10°: half the pull is left at this fold angle.
const CREASE_SIN2: f32 = 0.0076;
/// Squared length below which a link has no direction, m².
const COINCIDENT_M2: f32 = 1e-18;

impl Isometry {
    /// Links between neighbours along u, v and both diagonals, at the distances of `rest_m`.
    pub fn new(sheet: &SheetGrid, rest_m: &[[f32; 3]], flatness: f64) -> Self {
        let layout = Layout::new(sheet);
        let colour = |direction, parity| Colour::new(sheet, rest_m, direction, parity);
        let colours = [[1, 0], [0, 1], [1, 1], [1, -1]]
            .into_iter()
            .flat_map(|direction| [colour(direction, 0), colour(direction, 1)])
            .collect();
        let row = |span| [[span, 0], [0, span]].map(|step| Rows::new(sheet, step));
        let room = SPANS[1] * layout.stride;
        let numbers = vec![0.0; layout.size() + 2 * room];
        let mut isometry = Self {
            layout,
            width: Width::available()[0],
            colours,
            rows: SPANS.into_iter().flat_map(row).collect(),
            links: Vec::new(),
            flatness: flatness as f32,
            x: layout.fields(),
            moves: [(); 3].map(|()| Moves { numbers: numbers.clone(), room }),
        };
        isometry.refold(&Folds::flat(sheet));
        isometry
    }

    /// Takes over other folds: no link and no row reaches across a crease.
    pub fn refold(&mut self, folds: &Folds) {
        let facets = self.layout.by_place(folds.facets_of_node());
        self.links.clear();
        let node = |place: usize| {
            (place / self.layout.stride * self.layout.nodes[1] + place % self.layout.stride) as u32
        };
        for Colour { offset, bits, rest_m } in &mut self.colours {
            act(bits, |place| facets[place] & facets[place + *offset] != 0);
            for place in (0..facets.len()).filter(|p| bits[p / LANES][1] >> (p % LANES) & 1 == 1) {
                self.links.push(([node(place), node(place + *offset)], rest_m.rows()[place]));
            }
        }
        for Rows { offset, bits } in &mut self.rows {
            let [before, after] = [|p: usize, o: usize| p - o, |p: usize, o: usize| p + o];
            act(bits, |place| {
                facets[before(place, *offset)] & facets[place] & facets[after(place, *offset)] != 0
            });
        }
    }

    /// Moves the ends of every link half way to its rest length each, colour by colour, to and
    /// fro, and straightens rows of nodes between creases.
    pub fn project(&mut self, x: &mut [[f32; 3]], sweeps: u32) {
        scatter(self.layout, x, &mut self.x);
        self.width.run(Project {
            sweeps,
            colours: &self.colours,
            rows: if self.flatness > 0.0 { &self.rows } else { &[] },
            flatness: self.flatness,
            x: &mut self.x,
            moves: &mut self.moves,
        });
        gather(self.layout, &self.x, [0.0; 3], x);
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
        (largest, (sum / self.links.len().max(1) as f64) as f32)
    }
}

impl Colour {
    /// The links along a direction whose first row (column for those along v) is even or odd.
    fn new(sheet: &SheetGrid, rest_m: &[[f32; 3]], [di, dj]: [isize; 2], parity: usize) -> Self {
        let layout = Layout::new(sheet);
        let [n, m] = layout.nodes;
        let end = |i: usize, j: usize| {
            let (i, j) = (i.checked_add_signed(di)?, j.checked_add_signed(dj)?);
            (i < n && j < m).then_some([i, j])
        };
        let is_link = |i: usize, j: usize| {
            j < m && (if di == 1 { i } else { j }) % 2 == parity && end(i, j).is_some()
        };
        let mut rest = layout.field();
        rest.rows_mut().fill(1.0); // Where there is none.
        for (node, place) in layout.places().enumerate() {
            if let Some([i, j]) = end(node / m, node % m) {
                let length_m = norm(sub(rest_m[sheet.index(i, j)], rest_m[node]));
                rest.rows_mut()[place] = length_m;
            }
        }
        let offset = (di * layout.stride as isize + dj) as usize;
        Self { offset, bits: bits(layout, is_link), rest_m: rest }
    }
}

impl Rows {
    fn new(sheet: &SheetGrid, [di, dj]: [usize; 2]) -> Self {
        let layout = Layout::new(sheet);
        let [n, m] = layout.nodes;
        let is_middle = |i: usize, j: usize| di <= i && i + di < n && dj <= j && j + dj < m;
        Self { offset: di * layout.stride + dj, bits: bits(layout, is_middle) }
    }
}

/// A bit per node, and once more for those that act, which are none yet.
fn bits(layout: Layout, is_there: impl Fn(usize, usize) -> bool) -> Vec<[u16; 2]> {
    let vector = |first: usize| {
        let (i, j) = (first / layout.stride, first % layout.stride);
        [(0..LANES).fold(0, |bits, k| bits | u16::from(is_there(i, j + k)) << k), 0]
    };
    (0..layout.size()).step_by(LANES).map(vector).collect()
}

/// Chooses those that act.
fn act(bits: &mut [[u16; 2]], acts: impl Fn(usize) -> bool) {
    for (vector, [there, active]) in bits.iter_mut().enumerate() {
        let acts = |k: &usize| *there >> k & 1 == 1 && acts(vector * LANES + k);
        *active = (0..LANES).filter(acts).fold(0, |bits, k| bits | 1 << k);
    }
}

struct Project<'a> {
    sweeps: u32,
    colours: &'a [Colour],
    rows: &'a [Rows],
    flatness: f32,
    x: &'a mut [Field; 3],
    moves: &'a mut [Moves; 3],
}

impl Pass for Project<'_> {
    #[inline(always)]
    fn run<V: Lanes>(self) {
        let Self { sweeps, colours, rows, flatness, x, moves } = self;
        let len = LANES * colours[0].bits.len();
        assert!(x.iter().all(|x| x.rows().len() >= len + LANES));
        assert!(moves.iter().all(|moves| moves.numbers.len() == len + 2 * moves.room));
        assert!(rows.iter().all(|row| row.offset <= moves[0].room));
        let x = x.each_mut().map(|x| x.with_room_mut().as_mut_ptr().wrapping_add(LANES));
        let moves =
            moves.each_mut().map(|moves| moves.numbers.as_mut_ptr().wrapping_add(moves.room));
        // Loops, not closures: those would be compiled without the vectors.
        for sweep in 0..sweeps {
            for at in 0..colours.len() {
                let colour = if sweep % 2 == 0 { at } else { colours.len() - 1 - at };
                // SAFETY: the lengths were asserted above; a field has a vector of room before its
                // rows and after them, and a colour's bits are set only where its nodes are.
                unsafe { relax::<V>(&colours[colour], x, moves) };
            }
            for row in rows {
                // SAFETY: as above.
                unsafe { straighten::<V>(row, flatness, x, moves) };
            }
        }
    }
}

/// x ← x ± ½(|d| − rest)·d/|d| at the ends of every link.
///
/// # Safety
/// `x` points to the rows of fields of the colour's layout, `moves` to as many numbers with the
/// colour's offset of room on both sides.
#[inline(always)]
unsafe fn relax<V: Lanes>(colour: &Colour, x: [*mut f32; 3], moves: [*mut f32; 3]) {
    let now = x.map(<*mut f32>::cast_const);
    let rest_m = colour.rest_m.rows().as_ptr();
    // Both ends may lie in one vector: then all moves are found before any is made.
    let is_close = colour.offset < LANES;
    for (vector, [_, active]) in colour.bits.iter().enumerate() {
        let at = vector * LANES;
        // SAFETY: the caller's.
        unsafe {
            if *active == 0 {
                if is_close {
                    store_points([V::splat(0.0); 3], moves, at);
                }
                continue;
            }
            let (a, b) = (load_points::<V>(now, at), load_points::<V>(now, at + colour.offset));
            let d = minus(b, a);
            let squared = dot(d, d);
            let active = *active & squared.above(V::splat(COINCIDENT_M2));
            let ratio = V::load(rest_m.add(at)).mul(squared.inverse_sqrt());
            let share = V::splat(0.5).sub(V::splat(0.5).mul(ratio)).keep(active);
            let way = times(d, share);
            if is_close {
                store_points(way, moves, at);
            } else {
                store_points(plus(a, way), x, at);
                store_points(minus(b, way), x, at + colour.offset);
            }
        }
    }
    if is_close {
        for at in (0..colour.bits.len() * LANES).step_by(LANES) {
            for (x, moves) in x.into_iter().zip(moves) {
                // SAFETY: the caller's.
                unsafe {
                    let begins = V::load(moves.add(at));
                    let ends = V::load(moves.add(at).sub(colour.offset));
                    V::load(x.add(at)).add(begins).sub(ends).store(x.add(at));
                }
            }
        }
    }
}

/// Pulls the middle of every row half of the way to between its ends, and them a quarter of it to
/// the other side: all rows at once, which is stable for every flatness up to 1.
///
/// # Safety
/// As for [`relax`].
#[inline(always)]
unsafe fn straighten<V: Lanes>(row: &Rows, flatness: f32, x: [*mut f32; 3], moves: [*mut f32; 3]) {
    let now = x.map(<*mut f32>::cast_const);
    let (half, quarter) = (V::splat(0.5), V::splat(0.25));
    for (vector, [_, active]) in row.bits.iter().enumerate() {
        let at = vector * LANES;
        // SAFETY: the caller's.
        unsafe {
            if *active == 0 {
                store_points([V::splat(0.0); 3], moves, at);
                continue;
            }
            let middle = load_points::<V>(now, at);
            let before = now.map(|x| x.add(at).sub(row.offset));
            let a = minus(load_points::<V>(before, 0), middle);
            let b = minus(load_points::<V>(now, at + row.offset), middle);
            let way = times(plus(a, b), half);
            let to_end = dot(a, a).max(dot(b, b)).mul(V::splat(CREASE_SIN2));
            let active = *active & to_end.above(V::splat(0.0));
            let pull = V::splat(flatness).mul(to_end).div(to_end.add(dot(way, way)));
            store_points(times(way, pull.keep(active)), moves, at);
        }
    }
    for at in (0..row.bits.len() * LANES).step_by(LANES) {
        for (x, moves) in x.into_iter().zip(moves) {
            // SAFETY: the caller's.
            unsafe {
                let before = V::load(moves.add(at).sub(row.offset));
                let ends = before.add(V::load(moves.add(at + row.offset))).mul(quarter);
                let middle = V::load(moves.add(at)).mul(half);
                V::load(x.add(at)).add(middle).sub(ends).store(x.add(at));
            }
        }
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
        let mut isometry = Isometry::new(&sheet, &rest, 0.0);
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
        let mut isometry = Isometry::new(&sheet, &rest, 0.3);
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
