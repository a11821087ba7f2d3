//! Where a sheet can be, and how heavy.

use crate::simulator::Pulls;

/// Farther from the origin than this is no place of a sheet, metres: squares of squares of such
/// distances are no numbers any more.
const PLACE_M_MAX: f32 = 1e5;

/// Inverse masses of nodes that move, in units of an ordinary one's: their sums and quotients stay
/// far from the ends of f32.
const INVERSE_MASS: std::ops::RangeInclusive<f32> = 1e-6..=1e6;

/// Whether a node can have an inverse mass; 0 pins it.
pub(crate) fn is_inverse_mass(weight: f32) -> bool {
    weight == 0.0 || INVERSE_MASS.contains(&weight)
}

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
