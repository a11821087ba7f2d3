//! Targets against contact: their pull fades where it stretches links.

use super::{Solver, Targets};
use crate::effect::Effect;
use orime_lanes::LANES;

/// The pull fades from this share of the stretch on at which nothing of it is left.
const FROM: f32 = 1.0 / 3.0;

impl Solver {
    /// Fills `faded`: each node's share of the way, times 1 … 0 by the worst stretch of the links
    /// beside it, of which `strain_max` leaves nothing.
    pub fn fade_targets(&mut self, strain_max: f32) {
        let Self { targets: Some(targets), colours, x, .. } = self else { return };
        let Targets { ratio, faded, .. } = targets;
        faded.clone_from(ratio);
        let (ratio, faded) = (ratio.rows(), faded.rows_mut());
        let x = x.each_ref().map(|x| x.rows());
        for colour in colours.iter().filter(|colour| colour.effect == Effect::Stretch) {
            for (at, chunk) in colour.chunks.iter().enumerate() {
                for lane in (0..LANES).filter(|lane| chunk.bits >> lane & 1 == 1) {
                    let a = chunk.first as usize + lane;
                    let b = a + colour.offset;
                    let squared_m2: f32 = x.iter().map(|x| (x[b] - x[a]).powi(2)).sum();
                    let rest_m = colour.rest_m.of(at, lane);
                    // Most links are not stretched: their root is spared.
                    if squared_m2 <= rest_m * rest_m * (1.0 + 2.0 * FROM * strain_max) {
                        continue;
                    }
                    let strain = squared_m2.sqrt() / rest_m - 1.0;
                    let left = ((1.0 - strain / strain_max) / (1.0 - FROM)).clamp(0.0, 1.0);
                    for n in [a, b] {
                        faded[n] = faded[n].min(left * ratio[n]);
                    }
                }
            }
        }
    }
}
