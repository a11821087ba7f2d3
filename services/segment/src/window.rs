//! Where a camera is looked at: a window round what was the sheet, or the whole image.
//!
//! What is found in a window is what would be found in the whole image as long as it stays clear
//! of the window's border by the reach of all neighbourhoods (`Watch::guard_px`). Where it does
//! not, or where clearly less is found than in the frame before, the same frame is looked at as a
//! whole; and every so often it is anyway, for parts of the sheet that reappear elsewhere.

use crate::params::{Markers, SegmentParams};

/// Corners lie at multiples of this, so that words of pixels stay words of pixels, and blocks and
/// sampled rows stay where they are.
const ALIGN_PX: [usize; 2] = [64, 8];

/// How far gaps in depth reach beyond the sheet, pixels.
const GAP_REACH_PX: usize = 24;

/// How far a mask's support reaches, beside the opening and closing, pixels.
const SUPPORT_REACH_PX: usize = 16;

/// Room for a motion that begins, as a share of the image's width. At 640 pixels, 0.5 m and 60
/// frames a second these 20 pixels are 1 m/s; beyond, last frame's motion is carried on twice.
const SLACK_SHARE: f64 = 1.0 / 32.0;

/// Less than this share of the area in the frame before is a reason to look at the whole image.
const AREA_SHARE_MIN: f32 = 0.8;

/// Frames between two whole looks of cameras that follow each other in a set, so that they rarely
/// fall into one frame.
const STAGGER: u32 = 5;

/// Longest rest from windows that did not hold, frames.
const REST_MAX: u32 = 15;

/// A rectangle of an image's pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Window {
    pub x: usize,
    pub y: usize,
    pub width: usize,
    pub height: usize,
}

/// The parts of both images that are looked at.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct View {
    pub color: Window,
    pub depth: Window,
}

/// The sheet in one frame: its box in both images, and its visible area.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Sighting {
    pub mask: Window,
    pub surface: Window,
    pub area_m2: f32,
}

/// Chooses windows, and says whether they held.
#[derive(Debug)]
pub(crate) struct Watch {
    whole: View,
    registered: bool,
    /// Farthest that what lies beyond a window changes what is found in it, pixels.
    guard_px: usize,
    /// Frames from one look at the whole image to the next; 1 without windows.
    period: u32,
    frame: u32,
    /// The sheet in the last two frames, the newer first.
    seen: [Option<Sighting>; 2],
    /// Frames for which no window is tried, and how many it will be the next time.
    rest: u32,
    rest_next: u32,
}

impl Window {
    /// All of an image.
    pub fn whole(width: usize, height: usize) -> Self {
        Self { x: 0, y: 0, width, height }
    }

    /// First and last-but-one column and row.
    fn ranges(&self) -> [[usize; 2]; 2] {
        [[self.x, self.x + self.width], [self.y, self.y + self.height]]
    }

    /// The smallest window that holds both.
    fn joined(&self, other: &Self) -> Self {
        let (a, b) = (self.ranges(), other.ranges());
        let start = [0, 1].map(|k| a[k][0].min(b[k][0]));
        let end = [0, 1].map(|k| a[k][1].max(b[k][1]));
        Self { x: start[0], y: start[1], width: end[0] - start[0], height: end[1] - start[1] }
    }

    /// Whether a box keeps `guard_px` from those sides of the window that are not the image's.
    fn holds(&self, inner: &Self, image: &Self, guard_px: usize) -> bool {
        let (own, inner, image) = (self.ranges(), inner.ranges(), image.ranges());
        (0..2).all(|k| {
            (own[k][0] == image[k][0] || own[k][0] + guard_px <= inner[k][0])
                && (own[k][1] == image[k][1] || inner[k][1] + guard_px <= own[k][1])
        })
    }

    /// The window for a sheet whose box was `before` and is now this one.
    fn ahead(&self, before: &Self, image: &Self, margin_px: usize) -> Self {
        let (now, before, image) = (self.ranges(), before.ranges(), image.ranges());
        let (mut start, mut end) = ([0; 2], [0; 2]);
        for k in 0..2 {
            let moved =
                [before[k][0].saturating_sub(now[k][0]), now[k][1].saturating_sub(before[k][1])];
            let [low, high] = moved.map(|px| margin_px + 2 * px);
            start[k] = now[k][0].saturating_sub(low) / ALIGN_PX[k] * ALIGN_PX[k];
            end[k] = (now[k][1] + high).next_multiple_of(ALIGN_PX[k]).min(image[k][1]);
        }
        Self { x: start[0], y: start[1], width: end[0] - start[0], height: end[1] - start[1] }
    }
}

impl Watch {
    /// For camera `index` of a set, whose images are `whole`.
    pub fn new(index: usize, whole: View, registered: bool, params: &SegmentParams) -> Self {
        let reach = [
            GAP_REACH_PX,
            SUPPORT_REACH_PX + 2 * (params.open_px + params.close_px),
            params.mask_margin_px + params.occluder_margin_px,
            params.mask_margin_px + params.edgel_occluder_margin_px,
        ];
        let period = match params.markers {
            Markers::None => params.whole_image_every,
            Markers::Sheet => 1,
        };
        Self {
            whole,
            registered,
            guard_px: reach.into_iter().fold(0, usize::max),
            period,
            frame: (index as u32).wrapping_mul(STAGGER),
            seen: [None; 2],
            rest: 0,
            rest_next: 1,
        }
    }

    /// Both images as a whole.
    pub fn whole(&self) -> View {
        self.whole
    }

    /// Where the next frame is looked at first; `None` for the whole image.
    pub fn next_view(&mut self) -> Option<View> {
        self.frame = self.frame.wrapping_add(1);
        let seen = self.seen[0]?;
        if self.rest > 0 {
            self.rest -= 1;
            return None;
        }
        if self.frame.is_multiple_of(self.period) {
            return None;
        }
        let before = self.seen[1].unwrap_or(seen);
        let ahead = |now: &Window, before: &Window, image: &Window| {
            let slack_px = (SLACK_SHARE * image.width as f64).ceil() as usize;
            now.ahead(before, image, self.guard_px + slack_px)
        };
        let color = ahead(&seen.mask, &before.mask, &self.whole.color);
        let depth = ahead(&seen.surface, &before.surface, &self.whole.depth);
        let joined = color.joined(&depth);
        let view = match self.registered {
            true => View { color: joined, depth: joined },
            false => View { color, depth },
        };
        (view != self.whole).then_some(view)
    }

    /// Whether what was found in `view` can be relied upon.
    pub fn holds(&self, view: &View, found: &Sighting) -> bool {
        let whole = &self.whole;
        let usual_m2 = self.seen[0].map_or(0.0, |seen| seen.area_m2);
        found.area_m2 >= AREA_SHARE_MIN * usual_m2
            && view.color.holds(&found.mask, &whole.color, self.guard_px)
            && view.depth.holds(&found.surface, &whole.depth, self.guard_px)
    }

    /// A window did, or did not, hold: one that does not costs more than the whole image.
    pub fn judge(&mut self, held: bool) {
        if held {
            self.rest_next = 1;
        } else {
            self.rest = self.rest_next;
            self.rest_next = (2 * self.rest_next).min(REST_MAX);
        }
    }

    /// What the frame showed of the sheet in the end; `None` without a sheet.
    pub fn saw(&mut self, found: Option<Sighting>) {
        self.seen = [found, found.and(self.seen[0])];
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn watch(index: usize, every: u32) -> Watch {
        let whole = Window::whole(640, 480);
        let params = SegmentParams { whole_image_every: every, ..SegmentParams::default() };
        Watch::new(index, View { color: whole, depth: whole }, true, &params)
    }

    /// A sheet of 100 × 80 pixels with its corner here.
    fn sheet(x: usize, y: usize, area_m2: f32) -> Sighting {
        let mask = Window { x, y, width: 100, height: 80 };
        Sighting { mask, surface: Window { width: 90, ..mask }, area_m2 }
    }

    #[test]
    fn a_window_has_room_for_reach_and_motion() {
        let mut watch = watch(0, 1000);
        assert_eq!(watch.next_view(), None);
        watch.saw(Some(sheet(300, 200, 1.0)));
        // 26 + 20 pixels around 300..400 and 200..280, to words and eights.
        let view = watch.next_view().unwrap();
        assert_eq!(view.color, Window { x: 192, y: 152, width: 256, height: 176 });
        assert_eq!(view.depth, view.color);
        // 30 pixels to the right, 10 up: the borders on that side go twice as far.
        watch.saw(Some(sheet(330, 190, 1.0)));
        let view = watch.next_view().unwrap();
        assert_eq!(view.color, Window { x: 256, y: 120, width: 320, height: 200 });
        // The border of the image is no border of the window.
        let at_corner = sheet(0, 400, 1.0);
        watch.saw(Some(at_corner));
        watch.saw(Some(at_corner));
        let view = watch.next_view().unwrap();
        assert_eq!(view.color, Window { x: 0, y: 352, width: 192, height: 128 });
        assert!(watch.holds(&view, &at_corner));
        assert!(watch.holds(&view, &sheet(66, 378, 0.8)));
        assert!(!watch.holds(&view, &sheet(67, 378, 0.8)));
        assert!(!watch.holds(&view, &sheet(66, 377, 0.8)));
        assert!(!watch.holds(&view, &sheet(66, 378, 0.79)));
        watch.saw(None);
        assert_eq!(watch.next_view(), None);
    }

    #[test]
    fn the_whole_image_is_looked_at_in_turn_and_where_windows_do_not_hold() {
        let looks = |watch: &mut Watch, n: usize| -> Vec<usize> {
            watch.saw(Some(sheet(300, 200, 1.0)));
            (0..n).filter(|_| watch.next_view().is_none()).collect()
        };
        assert_eq!(looks(&mut watch(0, 16), 40), [15, 31]);
        assert_eq!(looks(&mut watch(1, 16), 40), [10, 26]);
        assert_eq!(looks(&mut watch(2, 1), 3), [0, 1, 2]);
        let mut watch = watch(0, 1000);
        watch.saw(Some(sheet(300, 200, 1.0)));
        let mut tried = Vec::new();
        for frame in 0..60 {
            if watch.next_view().is_some() {
                tried.push(frame);
                watch.judge(false);
            }
        }
        assert_eq!(tried, [0, 2, 5, 10, 19, 35, 51]);
    }
}
