//! Folds along straight lines: each flap turns by 180° about its line onto the fixed part.
//!
//! Rigid plates of thickness t, hinged where their upper faces meet, so that the layers end face
//! to face. In the plane across a crease, with s the distance from it and θ the angle:
//!
//! fixed:   (−s, t/2)
//! moving:  (s cos θ + t/2 sin θ,  t + s sin θ − t/2 cos θ)
//!
//! For every θ in [0, π] the moving middle surface lies at or above z = t/2 and the moving plate
//! at or above z = t, so nothing ever intersects; the two middle surfaces part by t sin(θ/2) at
//! the crease. The real bend that closes this gap is not modelled. A flap's shadow on the table
//! shrinks and grows across its crease only, so flaps with disjoint ends never meet either.

use std::f64::consts::PI;

use nalgebra::{Isometry3, Translation3, Unit, UnitQuaternion, Vector3};

use crate::facet::{Facet, FacetPose, Sheet};
use crate::line::ON_LINE_M;
use crate::{FoldError, FoldLine, Timing};

/// One flap: what lies on its line's left.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Flap {
    pub line: FoldLine,
    /// Turns there, back, there, …; each after the one before it.
    pub moves: Vec<Timing>,
}

impl Flap {
    /// Angle of the flap, radians: 0 flat, π folded.
    fn angle_rad(&self, progress: f64) -> f64 {
        let turns = self.moves.iter().enumerate();
        let signed = turns.map(
            |(k, turn)| {
                if k % 2 == 0 { turn.done(progress) } else { -turn.done(progress) }
            },
        );
        PI * signed.sum::<f64>()
    }
}

/// A sheet whose flaps turn onto its fixed part.
#[derive(Debug, Clone)]
pub(crate) struct Flaps {
    flaps: Vec<Flap>,
    thickness_m: f64,
}

impl Flaps {
    /// The motion and the parts: the fixed one first, then the flaps in their order.
    pub fn new(sheet: &Sheet, flaps: Vec<Flap>) -> Result<(Self, Vec<Facet>), FoldError> {
        sheet.check()?;
        let corners = sheet.corners_uv_m();
        let mut fixed = corners.to_vec();
        let mut facets = vec![Facet { corners_uv_m: Vec::new() }];
        for Flap { line, .. } in &flaps {
            let missed = || FoldError::LineMissesSheet { line: *line, size_m: sheet.size_m };
            facets.push(crease_first(line, line.clip(&corners, 1.0)).ok_or_else(missed)?);
            fixed = line.clip(&fixed, -1.0);
        }
        let first = &flaps[0].line;
        let missed = || FoldError::LineMissesSheet { line: *first, size_m: sheet.size_m };
        facets[0] = crease_first(first, fixed).ok_or_else(missed)?;
        Ok((Self { flaps, thickness_m: sheet.thickness_m }, facets))
    }

    /// Maps (u, v, height over the middle surface of the flat sheet) of each part to where it is.
    pub fn pose(&self, progress: f64, poses: &mut [FacetPose]) {
        poses[0] = FacetPose::rigid(&Isometry3::identity());
        for (flap, pose) in self.flaps.iter().zip(&mut poses[1..]) {
            let [c, s] = flap.line.direction();
            // What lies on the line's left rises when it turns right-handedly about the line.
            let axis = Unit::new_unchecked(Vector3::new(c, s, 0.0));
            let turn = UnitQuaternion::from_axis_angle(&axis, flap.angle_rad(progress));
            let [u, v] = flap.line.point_m;
            let hinge = Vector3::new(u, v, self.thickness_m / 2.0);
            let lift = Isometry3::from_parts(Translation3::from(hinge - turn * hinge), turn);
            *pose = FacetPose::rigid(&lift);
        }
    }
}

/// The polygon with its edge along `line` first; `None` if it has none or no area.
fn crease_first(line: &FoldLine, mut corners: Vec<[f64; 2]>) -> Option<Facet> {
    let on_line = |uv: &[f64; 2]| line.side_m(*uv).abs() <= ON_LINE_M;
    let first = (0..corners.len())
        .find(|k| on_line(&corners[*k]) && on_line(&corners[(k + 1) % corners.len()]))?;
    corners.rotate_left(first);
    (corners.len() >= 3).then_some(Facet { corners_uv_m: corners })
}
