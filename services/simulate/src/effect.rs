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
    /// Creases remember how far they were folded.
    Crease,
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
    /// The sheet does not pass through itself: room for it, see [`crate::ContactPass`].
    SelfContact,
}

impl Effect {
    /// Every effect, in the order of the passes.
    pub const ALL: [Self; 12] = [
        Self::Gravity,
        Self::AirDrag,
        Self::Track,
        Self::Grippers,
        Self::Stretch,
        Self::Shear,
        Self::Bend,
        Self::Damping,
        Self::Crease,
        Self::Facets,
        Self::SelfContact,
        Self::Table,
    ];

    /// Its name in a set file.
    pub fn name(self) -> &'static str {
        match self {
            Self::Stretch => "stretch",
            Self::Shear => "shear",
            Self::Bend => "bend",
            Self::Crease => "crease",
            Self::Damping => "damping",
            Self::Gravity => "gravity",
            Self::AirDrag => "air_drag",
            Self::Table => "table",
            Self::Facets => "facets",
            Self::Grippers => "grippers",
            Self::Track => "track",
            Self::SelfContact => "self_contact",
        }
    }
}

/// A set of effects.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Effects(u16);

impl Effects {
    /// Adds an effect.
    pub fn insert(&mut self, effect: Effect) {
        self.0 |= 1 << effect as u16;
    }

    /// Whether an effect is in it.
    pub fn contains(self, effect: Effect) -> bool {
        self.0 >> effect as u16 & 1 == 1
    }

    /// A bit per effect, by its number.
    pub fn bits(self) -> u32 {
        u32::from(self.0)
    }

    /// The effects in it, in the order of the passes.
    pub fn iter(self) -> impl Iterator<Item = Effect> {
        Effect::ALL.into_iter().filter(move |effect| self.contains(*effect))
    }
}

impl FromIterator<Effect> for Effects {
    fn from_iter<I: IntoIterator<Item = Effect>>(effects: I) -> Self {
        let mut all = Self::default();
        effects.into_iter().for_each(|effect| all.insert(effect));
        all
    }
}
