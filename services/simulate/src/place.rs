//! Where a sheet can be.

use crate::simulator::Pulls;

/// Farther from the origin than this is no place of a sheet, metres: squares of squares of such
/// distances are no numbers any more.
const PLACE_M_MAX: f32 = 1e5;

/// Whether a sheet can be drawn to a position.
pub(crate) fn is_place(position_m: &[f32; 3]) -> bool {
    position_m.iter().all(|c| c.abs() <= PLACE_M_MAX)
}

impl Pulls<'_> {
    /// Whether the targets are a pose that a sheet of so many nodes can be put into at once.
    pub(crate) fn is_pose_of(&self, nodes: usize) -> bool {
        self.targets_m.len() == nodes && self.targets_m.iter().all(is_place)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_no_number_or_far_away_is_no_place() {
        assert!(is_place(&[0.0, -1e3, 1e5]));
        for far in [f32::NAN, f32::INFINITY, -2e8] {
            assert!(!is_place(&[0.0, far, 0.0]));
        }
    }
}
