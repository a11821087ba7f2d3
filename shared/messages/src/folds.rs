//! A sheet's facets, creases and layer order on their way between processes.

use orime_creases::{FACETS_MAX, Facet, Folds};
use orime_geometry::SheetGrid;

use crate::layout;

/// Most corners of all facets together: four, and four more for every cut.
pub const CORNERS_MAX: usize = 4 * FACETS_MAX;
/// Most creases.
pub const CREASES_MAX: usize = 96;

/// The facets of a sheet in material coordinates, its creases, and what lies on what.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
pub struct FoldsMeta {
    /// Used elements of `corners_of`.
    pub n_facets: u32,
    /// Used elements of `creases`.
    pub n_creases: u32,
    /// First corner and number of corners of each facet.
    pub corners_of: [[u32; 2]; FACETS_MAX],
    /// Corners (u, v), metres, counter-clockwise, facet after facet.
    pub corners_m: [[f64; 2]; CORNERS_MAX],
    /// The creases.
    pub creases: [CreaseMeta; CREASES_MAX],
    /// `order[f][g]`: on which side of facet `g` facet `f` lies: 1 where its normal (u × v) points
    /// to, -1 behind, 0 where that was never seen.
    pub order: [[i8; FACETS_MAX]; FACETS_MAX],
}
layout!(FoldsMeta {
    n_facets: u32,
    n_creases: u32,
    corners_of: [[u32; 2]; FACETS_MAX],
    corners_m: [[f64; 2]; CORNERS_MAX],
    creases: [CreaseMeta; CREASES_MAX],
    order: [[i8; FACETS_MAX]; FACETS_MAX],
});

/// Where two facets meet.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
pub struct CreaseMeta {
    /// The facets left and right of it, looking from the first end to the second.
    pub facets: [u32; 2],
    /// Its ends, (u, v), metres.
    pub ends_m: [[f64; 2]; 2],
    /// Signed fold angle, radians: 0 flat, see `orime_creases::Crease`.
    pub angle_rad: f64,
}
layout!(CreaseMeta { facets: [u32; 2], ends_m: [[f64; 2]; 2], angle_rad: f64 });

impl FoldsMeta {
    /// Takes over what is known. Returns `false`, and says that nothing is known, where it is more
    /// than a message holds.
    pub fn set(&mut self, folds: &Folds) -> bool {
        let corners: usize = folds.facets().iter().map(|facet| facet.corners_m.len()).sum();
        (self.n_facets, self.n_creases) = (0, 0);
        if folds.facets().len() > FACETS_MAX
            || corners > CORNERS_MAX
            || folds.creases().len() > CREASES_MAX
        {
            return false;
        }
        let mut first = 0;
        for (facet, range) in folds.facets().iter().zip(&mut self.corners_of) {
            *range = [first as u32, facet.corners_m.len() as u32];
            self.corners_m[first..first + facet.corners_m.len()].copy_from_slice(&facet.corners_m);
            first += facet.corners_m.len();
        }
        for (crease, meta) in folds.creases().iter().zip(&mut self.creases) {
            let facets = crease.facets.map(|facet| facet as u32);
            *meta = CreaseMeta { facets, ends_m: crease.ends_m, angle_rad: crease.angle_rad };
        }
        for (f, row) in self.order.iter_mut().enumerate() {
            for (g, side) in row.iter_mut().enumerate() {
                *side = folds.order(f, g);
            }
        }
        self.n_facets = folds.facets().len() as u32;
        self.n_creases = folds.creases().len() as u32;
        true
    }

    /// The creases.
    pub fn creases(&self) -> &[CreaseMeta] {
        &self.creases[..(self.n_creases as usize).min(CREASES_MAX)]
    }

    /// The corners of each facet, (u, v), metres; a range that leaves the message is empty.
    pub fn facets(&self) -> impl Iterator<Item = &[[f64; 2]]> {
        self.corners_of[..(self.n_facets as usize).min(FACETS_MAX)].iter().map(|[first, count]| {
            let range = *first as usize..(*first as usize).saturating_add(*count as usize);
            self.corners_m.get(range).unwrap_or(&[])
        })
    }

    /// Brings `folds` up to date; facets that are the same already are kept as they are. Returns
    /// `false`, and changes nothing, where the message holds no facets, or what is none.
    pub fn update(&self, folds: &mut Folds) -> bool {
        let sound = |corners: &[[f64; 2]]| {
            let next = corners.iter().cycle().skip(1);
            corners.len() >= 3
                && corners.iter().flatten().all(|c| c.is_finite())
                && corners.iter().zip(next).all(|(a, b)| a != b)
        };
        if self.n_facets == 0 || !self.facets().all(sound) {
            return false;
        }
        let same = self.facets().count() == folds.facets().len()
            && self.facets().zip(folds.facets()).all(|(corners, own)| corners == own.corners_m);
        if !same {
            let sheet: SheetGrid = folds.sheet().clone();
            let facet = |corners: &[[f64; 2]]| Facet { corners_m: corners.to_vec() };
            *folds = Folds::from_facets(&sheet, self.facets().map(facet).collect());
        }
        for f in 0..folds.facets().len() {
            for g in 0..folds.facets().len() {
                folds.set_order(f, g, self.order[f][g]);
            }
        }
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;
    use orime_creases::Line;

    #[test]
    fn folds_survive_the_way_through_a_message() {
        let sheet = SheetGrid::new([0.15, 0.21], [13, 17]);
        let mut folds = Folds::flat(&sheet);
        folds.split(0, &Line::through([0.0, 0.0], [0.15, 0.2]));
        folds.split(1, &Line::through([0.0, 0.1], [0.15, 0.1]));
        folds.set_order(0, 2, -1);
        let mut meta = FoldsMeta::zeroed();
        assert!(meta.set(&folds));
        let mut received = Folds::flat(&sheet);
        assert!(meta.update(&mut received));
        assert_eq!(received.facets(), folds.facets());
        assert_eq!((received.order(0, 2), received.order(2, 0)), (-1, 0));
        assert_eq!(meta.creases().len(), folds.creases().len());
        // Nonsense is refused whole: a side without a length, corners that are not there.
        let corner_m = meta.corners_m[1];
        meta.corners_m[1] = meta.corners_m[0];
        assert!(!meta.update(&mut received));
        meta.corners_m[1] = corner_m;
        meta.corners_of[1] = [u32::MAX, u32::MAX];
        assert!(!meta.update(&mut received));
        assert!(!FoldsMeta::zeroed().update(&mut received));
        assert_eq!(received.facets(), folds.facets());
    }
}
