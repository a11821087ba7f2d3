//! How far a recording moves the borders between ink and paper, by its markers' grids.
//!
//! Each marker's grid says a shift of its own (`orime_markers::fit_grid`). On real ones these
//! scatter far more than the borders of each say, from marker to marker (prints are off by a
//! printer's dots) and from view to view. So views of one marker by one camera are one witness,
//! and the witnesses of all cameras are heard together: cameras of one make treat an image alike.

use std::collections::BTreeMap;

use crate::fit::median;

/// Fewer witnesses, each a marker seen by a camera, say nothing.
const WITNESSES_MIN: usize = 2;
/// A camera whose own witnesses differ from all by more than this is of another make: it is moved
/// by what they say, pixels.
const OWN_DIFFERENCE_PX: f64 = 0.1;

/// What one marker's grid says in one image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GridShift {
    /// Which camera.
    pub camera: usize,
    /// Which marker.
    pub id: u32,
    /// How far borders lie on the ink's side of the grid, pixels.
    pub shift_px: f64,
    /// Mean length of the grid's sides, pixels.
    pub side_px: f64,
}

/// How far borders lie on the ink's side.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct BorderShift {
    /// Median over all witnesses, pixels.
    pub shift_px: f64,
    /// Standard deviation of `shift_px`, by the scatter of the witnesses, pixels.
    pub sigma_px: f64,
    /// Per camera: median over its own witnesses, `None` where it has too few, pixels.
    pub own_px: Vec<Option<f64>>,
    /// Per camera: what its squares are moved by, pixels.
    pub used_px: Vec<f64>,
    /// Per camera: markers in images whose grid was read.
    pub grids: Vec<usize>,
    /// Median side of these markers, pixels.
    pub side_px: f64,
}

impl BorderShift {
    /// What `sigma_px` makes uncertain: distances, as a share of them.
    pub fn distance_sigma_share(&self) -> f64 {
        2.0 * self.sigma_px / self.side_px
    }
}

/// What all grids say together; `None` of too few. Medians of an even number are the lower one.
pub fn border_shift(grids: &[GridShift], cameras: usize) -> Option<BorderShift> {
    let mut shifts: BTreeMap<(usize, u32), Vec<f64>> = BTreeMap::new();
    for grid in grids {
        shifts.entry((grid.camera, grid.id)).or_default().push(grid.shift_px);
    }
    let witnesses: Vec<(usize, f64)> = shifts
        .into_iter()
        .filter_map(|((camera, _), mut shifts)| Some((camera, median(&mut shifts)?)))
        .collect();
    if witnesses.len() < WITNESSES_MIN {
        return None;
    }
    let mut all: Vec<f64> = witnesses.iter().map(|(_, shift_px)| *shift_px).collect();
    let shift_px = median(&mut all)?;
    let own = |camera: usize| {
        let of_camera = witnesses.iter().filter(|(c, _)| *c == camera);
        let mut of_camera: Vec<f64> = of_camera.map(|(_, shift_px)| *shift_px).collect();
        median(&mut of_camera).filter(|_| of_camera.len() >= WITNESSES_MIN)
    };
    let own_px: Vec<Option<f64>> = (0..cameras).map(own).collect();
    let differs = |own_px: &f64| (own_px - shift_px).abs() > OWN_DIFFERENCE_PX;
    let used_px: Vec<f64> =
        own_px.iter().map(|own_px| own_px.filter(differs).unwrap_or(shift_px)).collect();
    // Around what each one's camera is moved by: makes differ for a reason.
    let squares = witnesses.iter().map(|(camera, w)| (w - used_px[*camera]).powi(2));
    let count = witnesses.len() as f64;
    let sigma_px = (squares.sum::<f64>() / (count - 1.0) / count).sqrt();
    let mut sides: Vec<f64> = grids.iter().map(|grid| grid.side_px).collect();
    let grids = (0..cameras).map(|c| grids.iter().filter(|grid| grid.camera == c).count());
    let grids = grids.collect();
    Some(BorderShift { shift_px, sigma_px, own_px, used_px, grids, side_px: median(&mut sides)? })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A camera's markers 0, 1, …, each seen three times with this shift, once far off.
    fn grids(camera: usize, shifts_px: &[f64]) -> Vec<GridShift> {
        let ids = shifts_px.iter().zip(0..);
        let each = ids.flat_map(|(shift_px, id)| {
            [0.0, 0.0, 0.5].map(|off| GridShift {
                camera,
                id,
                shift_px: shift_px + off,
                side_px: 40.0,
            })
        });
        each.collect()
    }

    #[test]
    fn cameras_of_one_make_are_heard_together_and_others_for_themselves() {
        let alike = [grids(0, &[0.2, 0.14]), grids(1, &[0.16, 0.22]), grids(2, &[0.18])].concat();
        let shift = border_shift(&alike, 3).unwrap();
        assert_eq!((shift.shift_px, &shift.used_px[..]), (0.18, &[0.18; 3][..]));
        assert_eq!(shift.own_px, [Some(0.14), Some(0.16), None]);
        assert_eq!(shift.grids, [6, 6, 3]);
        assert!((shift.sigma_px - 0.01414).abs() < 1e-4, "{}", shift.sigma_px);
        let other = [alike, grids(3, &[0.0, -0.01, 0.01])].concat();
        let shift = border_shift(&other, 4).unwrap();
        assert_eq!(shift.used_px[3], 0.0);
        assert_eq!(shift.used_px[0], shift.shift_px);
    }

    #[test]
    fn one_marker_says_nothing() {
        assert_eq!(border_shift(&grids(0, &[0.2]), 1), None);
        assert_eq!(border_shift(&[], 3), None);
    }
}
