//! Which line parts which facets: a binary tree of cuts, facets as its leaves.

use super::estimate::Estimate;
use crate::folds::Facet;
use orime_geometry::SheetGrid;

/// What lies on one side of a cut.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Side {
    /// A facet, by its number.
    Facet(usize),
    /// Another cut, by its number.
    Cut(usize),
}

/// A line that parts a convex piece of the sheet.
#[derive(Debug, Clone)]
pub(crate) struct Cut {
    /// What lies left and right of it.
    pub sides: [Side; 2],
    /// Where it is.
    pub estimate: Estimate,
    /// Sign of its fold angle when it was found.
    pub sign: f64,
    /// Greatest fold angle that was seen, radians.
    pub angle_max_rad: f64,
    /// Successive steps in which it looked unfolded.
    pub unfolded: u32,
}

/// All cuts of a sheet.
#[derive(Debug, Clone)]
pub(crate) struct Tree {
    pub root: Side,
    pub cuts: Vec<Cut>,
    whole: Facet,
    sliver_m: f64,
}

impl Tree {
    pub fn new(sheet: &SheetGrid) -> Self {
        let [a, b] = sheet.size_m;
        let whole = Facet { corners_m: vec![[0.0, 0.0], [a, 0.0], [a, b], [0.0, b]] };
        let [h_u, h_v] = sheet.spacing_m();
        let cuts = Vec::with_capacity(crate::folds::FACETS_MAX);
        Self { root: Side::Facet(0), cuts, whole, sliver_m: 0.5 * h_u.min(h_v) }
    }

    /// Forgets all cuts.
    pub fn clear(&mut self) {
        self.root = Side::Facet(0);
        self.cuts.clear();
    }

    /// The facets as the cuts' published lines make them; `None` where one would be a sliver.
    pub fn facets(&self) -> Option<Vec<Facet>> {
        let empty = Facet { corners_m: Vec::new() };
        let mut facets = vec![empty; self.cuts.len() + 1];
        self.fill(self.root, self.whole.clone(), &mut facets)?;
        Some(facets)
    }

    fn fill(&self, side: Side, piece: Facet, facets: &mut Vec<Facet>) -> Option<()> {
        match side {
            Side::Facet(facet) => facets[facet] = piece,
            Side::Cut(cut) => {
                let Cut { sides: [left, right], estimate, .. } = &self.cuts[cut];
                let [on_left, on_right] = piece.cut(&estimate.line, self.sliver_m)?;
                self.fill(*left, on_left, facets)?;
                self.fill(*right, on_right, facets)?;
            }
        }
        Some(())
    }

    /// The convex piece that a cut parts.
    pub fn piece(&self, cut: usize) -> Option<Facet> {
        self.find_piece(self.root, self.whole.clone(), cut)
    }

    fn find_piece(&self, side: Side, piece: Facet, wanted: usize) -> Option<Facet> {
        let Side::Cut(cut) = side else { return None };
        if cut == wanted {
            return Some(piece);
        }
        let Cut { sides: [left, right], estimate, .. } = &self.cuts[cut];
        let [on_left, on_right] = piece.cut(&estimate.line, self.sliver_m)?;
        let found = self.find_piece(*left, on_left, wanted);
        found.or_else(|| self.find_piece(*right, on_right, wanted))
    }

    /// Parts a facet: its left part keeps the number, the right one is `new`.
    pub fn split(&mut self, facet: usize, new: usize, mut cut: Cut) {
        cut.sides = [Side::Facet(facet), Side::Facet(new)];
        let number = self.cuts.len();
        self.replace(Side::Facet(facet), Side::Cut(number));
        self.cuts.push(cut);
    }

    /// Undoes a cut of which one side is a facet: what lies on the other side takes that over. Of
    /// two facets the left one's number stays; the last number takes the place of the one that is
    /// gone. Returns which facet each of the new ones was.
    pub fn join(&mut self, cut: usize) -> Option<Vec<usize>> {
        let (kept, gone) = match self.cuts[cut].sides {
            [kept, Side::Facet(gone)] | [Side::Facet(gone), kept] => (kept, gone),
            _ => return None,
        };
        let last = self.cuts.len();
        self.replace(Side::Cut(cut), kept);
        if gone != last {
            self.replace(Side::Facet(last), Side::Facet(gone));
        }
        self.cuts.swap_remove(cut);
        if cut != self.cuts.len() {
            self.replace(Side::Cut(self.cuts.len()), Side::Cut(cut));
        }
        let mut from: Vec<usize> = (0..last).collect();
        if gone != last {
            from[gone] = last;
        }
        Some(from)
    }

    /// The cut that parts two facets.
    pub fn between(&self, f: usize, g: usize) -> Option<usize> {
        let mut side = self.root;
        while let Side::Cut(cut) = side {
            let below = self.cuts[cut].sides.map(|s| [self.has(s, f), self.has(s, g)]);
            side = match below {
                [[true, true], _] => self.cuts[cut].sides[0],
                [_, [true, true]] => self.cuts[cut].sides[1],
                _ => return Some(cut),
            };
        }
        None
    }

    fn has(&self, side: Side, facet: usize) -> bool {
        match side {
            Side::Facet(f) => f == facet,
            Side::Cut(cut) => self.cuts[cut].sides.iter().any(|s| self.has(*s, facet)),
        }
    }

    fn replace(&mut self, old: Side, new: Side) {
        let sides = self.cuts.iter_mut().flat_map(|cut| &mut cut.sides);
        for side in sides.chain([&mut self.root]) {
            if *side == old {
                *side = new;
            }
        }
    }
}
