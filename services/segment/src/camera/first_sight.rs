//! A camera's first sight of the sheet: which colour it is, here and in this light.

use orime_geometry::RgbdFrame;

use super::CameraSegmenter;
use crate::color_model;
use crate::learn::Proposal;
use crate::told::Told;

/// In this many frames all colours that may be the sheet's are tried; then one a frame, in turn,
/// so that waiting for the sheet is not dearer than tracking it.
const EAGER_ATTEMPTS: u32 = 3;

/// Of the area from which a colour is learnt, the share that is enough where others see it.
const TOLD_SHARE: f32 = 1.0 / 3.0;

/// A colour worth trying.
struct Attempt {
    proposal: Proposal,
    /// Least area that it must find, m².
    least_m2: f32,
    /// Whether what it finds may reach the image's border.
    anywhere: bool,
}

impl CameraSegmenter {
    /// Finds a colour with which this frame shows the sheet, and the sheet with it.
    pub(super) fn learn(&mut self, frame: &RgbdFrame<'_>, told: &Told) -> bool {
        let attempts = self.attempts(frame.color_rgb, told);
        let turn =
            self.attempts.checked_sub(EAGER_ATTEMPTS).map(|n| n as usize % attempts.len().max(1));
        self.attempts = self.attempts.saturating_add(1);
        for (k, Attempt { proposal, least_m2, anywhere }) in attempts.into_iter().enumerate() {
            if turn.is_some_and(|turn| turn != k) {
                continue;
            }
            let Some(found) = self.find_sheet(frame.color_rgb, &proposal.table) else { continue };
            let mask = &self.color.mask;
            if found.area_m2 >= least_m2
                && (anywhere || !mask.touches_border())
                && told.agrees(&found, self.size.diagonal_m)
                && self.learner.resembles(frame.color_rgb, &proposal.seeds, mask)
            {
                return self.settle(frame, proposal);
            }
        }
        false
    }

    /// Colours worth trying, best first.
    fn attempts(&mut self, color_rgb: &[u8], told: &Told) -> Vec<Attempt> {
        let of = |rgb: [u8; 3]| color_model::feature(rgb.map(f32::from));
        let hint = self.params.color_hint_rgb.map(of);
        let back = self.params.back_color_hint_rgb.map(of);
        let learner = &mut self.learner;
        learner.look(color_rgb);
        let least_m2 = self.size.area_m2_min;
        let learn_m2 = self.learn_factor * least_m2;
        if let Some(front) = hint {
            let near = learner.near(color_rgb, front, back).into_iter();
            return near.map(|proposal| Attempt { proposal, least_m2, anywhere: true }).collect();
        }
        let mut attempts = Vec::new();
        // A colour of its own is better than that of others, even after a while without the sheet.
        if let (Some(known), None) = (told.known, self.known_color) {
            let least_m2 = least_m2.max(TOLD_SHARE * learn_m2);
            let near = learner.near(color_rgb, known.color, None).into_iter();
            attempts.extend(near.map(|proposal| Attempt { proposal, least_m2, anywhere: true }));
        }
        let mut others = learner.plain(color_rgb);
        // A hand before a plain border is unlike it, too: first, any camera may find a plain sheet.
        if told.known.is_none() && (told.alone || self.attempts > 0) {
            others.extend(learner.unlike_border());
        }
        let other = |proposal| Attempt { proposal, least_m2: learn_m2, anywhere: false };
        attempts.extend(others.into_iter().map(other));
        attempts
    }

    /// Takes over a proposal that found the sheet, told apart from what lies next to the sheet.
    fn settle(&mut self, frame: &RgbdFrame<'_>, proposal: Proposal) -> bool {
        let Proposal { table, seeds } = proposal;
        self.known_color = seeds.first().copied();
        if !seeds.is_empty() {
            let mask = &self.color.mask;
            let table = self.learner.refine(frame.color_rgb, &seeds, mask);
            if self.find_sheet(frame.color_rgb, &table).is_some() {
                self.table = Some(table);
                return true;
            }
        }
        let found = self.find_sheet(frame.color_rgb, &table).is_some();
        self.table = Some(table);
        found
    }
}
