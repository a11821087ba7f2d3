//! What is printed on the sheet's two sides.

use orime_geometry::SheetGrid;
use orime_markers::{SheetPrint, SheetSide};
use serde::{Deserialize, Serialize};

use crate::OpenError;

/// What is printed on the sheet.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Printed {
    /// Nothing.
    #[default]
    None,
    /// A grid of ArUco markers on each side, corners at every other node.
    Markers,
}

/// Texels between two lines of every other node: sixteen a module.
const TEXELS: usize = 96;

/// Share of the light that ink takes away.
const DARKNESS: f32 = 0.88;

/// The print as two tiles of texels.
#[derive(Debug)]
pub(super) struct Ink {
    texels: [usize; 2],
    texels_per_m: [f32; 2],
    /// Front and back, v first, 1 where there is ink.
    sides: [Vec<u8>; 2],
}

impl Ink {
    /// The markers of a sheet; an error where its nodes allow none.
    pub fn markers(sheet: &SheetGrid) -> Result<Self, OpenError> {
        let print = SheetPrint::new(sheet.nodes)
            .map_err(|problem| OpenError::Scene(format!("`rendered.printed`: sheet.{problem}")))?;
        let texels = sheet.nodes.map(|nodes| TEXELS * (nodes / 2));
        let share = |k: usize, axis: usize| (k as f64 + 0.5) / texels[axis] as f64;
        let side = |side: SheetSide| {
            let layout = print.side(side);
            (0..texels[0])
                .flat_map(|i| (0..texels[1]).map(move |j| [share(i, 0), share(j, 1)]))
                .map(|uv_share| u8::from(layout.is_black(uv_share)))
                .collect()
        };
        Ok(Self {
            texels_per_m: [0, 1].map(|k| (texels[k] as f64 / sheet.size_m[k]) as f32),
            sides: [side(SheetSide::Front), side(SheetSide::Back)],
            texels,
        })
    }

    /// Share of the light that a point of one side reflects, 1 where it is bare.
    #[inline]
    pub fn reflects(&self, is_back: bool, uv_m: [f32; 2]) -> f32 {
        let [i, j] = [0, 1].map(|k| {
            // A negative number casts to 0.
            ((uv_m[k] * self.texels_per_m[k]) as usize).min(self.texels[k] - 1)
        });
        let black = self.sides[usize::from(is_back)][i * self.texels[1] + j];
        1.0 - DARKNESS * f32::from(black)
    }
}
