//! What may act on the sheet.

use serde::{Deserialize, Serialize};

/// Something that acts on the sheet. A scene names those that it wants.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Effect {
    /// Neighbours along u and v keep their distance.
    Stretch,
    /// Neighbours along the cells' diagonals keep theirs.
    Shear,
    /// The sheet resists bending.
    Bend,
    /// The links' own motion is damped.
    Damping,
    /// Weight.
    Gravity,
    /// The air slows the sheet.
    AirDrag,
    /// The sheet lies on a table.
    Table,
    /// The parts between creases are stiff.
    Facets,
    /// Grippers hold material points.
    Grippers,
    /// Targets pull the nodes.
    Track,
}

impl Effect {
    /// Every effect, in the order of the passes.
    pub const ALL: [Self; 10] = [
        Self::Gravity,
        Self::AirDrag,
        Self::Track,
        Self::Grippers,
        Self::Stretch,
        Self::Shear,
        Self::Bend,
        Self::Damping,
        Self::Facets,
        Self::Table,
    ];

    /// Its name in a set file.
    pub fn name(self) -> &'static str {
        match self {
            Self::Stretch => "stretch",
            Self::Shear => "shear",
            Self::Bend => "bend",
            Self::Damping => "damping",
            Self::Gravity => "gravity",
            Self::AirDrag => "air_drag",
            Self::Table => "table",
            Self::Facets => "facets",
            Self::Grippers => "grippers",
            Self::Track => "track",
        }
    }
}
