//! What cameras tell each other: the sheet has one colour, and is in one place.
//!
//! A camera that sees little of the sheet would learn a wrong colour, or none: it takes one near to
//! what the others see, and only where the sheet can be.

use crate::color_model::{Feature, brightness};
use crate::select::{Chosen, distance_m};

/// What one camera knows of the sheet and others may want to know.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Known {
    /// The sheet's own colour.
    pub color: Feature,
    /// Its visible area, m², and the middle of that, world, metres, in the last frame.
    pub seen: Chosen,
}

/// What a camera is told about the others.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Told {
    /// Whether there are none.
    pub alone: bool,
    /// What they know together, from the frame before.
    pub known: Option<Known>,
}

impl Known {
    /// What two cameras know: the colour of the one that sees the sheet brighter, for in the shade
    /// it is like other things, and the place of the one that sees more of it.
    pub fn or(self, other: Self) -> Self {
        let brighter = brightness(&other.color) > brightness(&self.color);
        let larger = other.seen.area_m2 > self.seen.area_m2;
        Self {
            color: if brighter { other.color } else { self.color },
            seen: if larger { other.seen } else { self.seen },
        }
    }
}

impl Told {
    /// Whether what was found may be the same sheet.
    pub fn agrees(&self, found: &Chosen, diagonal_m: f32) -> bool {
        let near = |known: Known| distance_m(&known.seen.centre_m, &found.centre_m) < diagonal_m;
        self.known.is_none_or(near)
    }
}
