//! One camera's segmentation: the pixels' story, from a frame to points and edgels.

mod first_sight;

use orime_geometry::{Edgel, Feature, ObservedPoint, RgbdCamera, RgbdFrame, SheetGrid};
use orime_lanes::Width;

use crate::color_model::{self, ColorTable};
use crate::components::Components;
use crate::contour::Contour;
use crate::depth::DepthMap;
use crate::features::FeatureFinder;
use crate::images::{ColorImages, DepthImages};
use crate::inner_edge;
use crate::learn::Learner;
use crate::mask::{Accepted, MaskBuilder};
use crate::occluders::Occluders;
use crate::parallax::Parallax;
use crate::params::{Markers, SegmentParams};
use crate::select::{Chosen, Evidence, IN_FRONT_M, Selector, SheetSize};
use crate::steps::Steps;
use crate::told::{Known, Told};
use crate::voxels::Voxels;
use crate::window::{Sighting, View, Watch, Window};

/// Neighbourhood of sheet-coloured pixels that is searched for steps in depth, pixels.
const REGION_PX: usize = 16;

/// Smallest part of the sheet that something in front cuts off, as a share of its area.
const PIECE_SHARE_MIN: f64 = 0.003;

/// What became of one camera's frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Outcome {
    /// No frame, or one of the wrong size.
    NoFrame,
    /// No sheet in the frame.
    NoSheet,
    /// The sheet was found.
    Sheet,
}

/// Segments one camera's frames.
#[derive(Debug)]
pub(crate) struct CameraSegmenter {
    index: u32,
    camera: RgbdCamera,
    params: SegmentParams,
    size: SheetSize,
    table: Option<ColorTable>,
    /// The sheet's own colour. `None` too where only that of its surroundings is known.
    known_color: Option<color_model::Feature>,
    learner: Learner,
    /// Frames since the sheet was seen.
    missed: u32,
    /// Frames from which a colour was to be learnt, since one was.
    attempts: u32,
    /// How many times the smallest area is needed to learn a colour.
    learn_factor: f32,
    watch: Watch,
    lanes: Width,
    /// What is looked at.
    view: View,
    /// What was found in it.
    chosen: Option<Chosen>,
    /// What [`DepthImages::sheet`] is a part of.
    sheet_at: Window,
    map: DepthMap,
    steps: Steps,
    selector: Selector,
    occluders: Occluders,
    finder: Option<FeatureFinder>,
    /// `None` where depth is registered to colour.
    parallax: Option<Parallax>,
    components: Components,
    builder: MaskBuilder,
    color: ColorImages,
    depth: DepthImages,
    voxels: Voxels,
    /// Averaged points of the last frame.
    pub points: Vec<ObservedPoint>,
    /// Edgels of the last frame.
    pub edgels: Vec<Edgel>,
    /// Edgels that found no room.
    pub edgels_left_out: u32,
}

impl CameraSegmenter {
    pub fn new(
        index: usize,
        camera: &RgbdCamera,
        params: &SegmentParams,
        sheet: &SheetGrid,
    ) -> Self {
        let [a_m, b_m] = sheet.size_m;
        let area_m2 = a_m * b_m;
        let (width, height) = (camera.color.width as usize, camera.color.height as usize);
        let map = DepthMap::new(camera, params);
        // A slanted surface passes through up to √3 cells per cell of its area.
        let cells = 2.0 * params.area_ratio_max * area_m2 / (params.voxel_m * params.voxel_m);
        let cells_max = (cells as usize + 1024).min(camera.depth.pixels());
        let outline_px = 4 * (width + height);
        let whole = View {
            color: Window::whole(width, height),
            depth: Window::whole(map.width, map.height),
        };
        Self {
            index: index as u32,
            camera: camera.clone(),
            params: params.clone(),
            size: SheetSize {
                area_m2_max: (params.area_ratio_max * area_m2) as f32,
                area_m2_min: (params.area_ratio_min * area_m2) as f32,
                piece_m2_min: (PIECE_SHARE_MIN * area_m2) as f32,
                diagonal_m: a_m.hypot(b_m) as f32,
            },
            table: None,
            known_color: None,
            learner: Learner::new(width, height, params.seed),
            missed: 0,
            attempts: 0,
            learn_factor: (params.learn_area_ratio_min / params.area_ratio_min) as f32,
            watch: Watch::new(index, whole, camera.depth_is_registered(), params),
            lanes: Width::available()[0],
            view: whole,
            chosen: None,
            sheet_at: whole.depth,
            steps: Steps::new(&map, params),
            selector: Selector::new(map.width, map.height),
            occluders: Occluders::new(map.width, map.height),
            finder: match params.markers {
                Markers::None => None,
                Markers::Sheet => Some(FeatureFinder::new(index as u32, camera, sheet)),
            },
            parallax: (!camera.depth_is_registered())
                .then(|| Parallax::new(width, height, camera.depth.pixels())),
            components: Components::new(width, height),
            builder: MaskBuilder::new(width, height),
            color: ColorImages::new(width, height),
            depth: DepthImages::new(map.width, map.height),
            points: Vec::with_capacity(cells_max),
            voxels: Voxels::new(params.voxel_m as f32, index as u32, cells_max, map.width),
            edgels: Vec::with_capacity(outline_px),
            edgels_left_out: 0,
            map,
        }
    }

    /// Depth pixels of the last frame that found no cell.
    pub fn pixels_left_out(&self) -> u32 {
        self.voxels.left_out()
    }

    /// Features of the last frame.
    pub fn features(&self) -> &[Feature] {
        self.finder.as_ref().map_or(&[], |finder| &finder.features)
    }

    /// The part of the colour image that was looked at last: corner and size.
    pub fn window(&self) -> [[usize; 2]; 2] {
        let Window { x, y, width, height } = self.view.color;
        [[x, y], [width, height]]
    }

    /// Whether a pixel of the colour image showed the sheet in the last frame.
    pub fn is_sheet(&self, x: usize, y: usize) -> bool {
        let Window { x: left, y: top, width, height } = self.view.color;
        let inside = (left..left + width).contains(&x) && (top..top + height).contains(&y);
        inside && self.color.mask.get(x - left, y - top)
    }

    /// What it knows of the sheet after a frame that showed it.
    pub fn known(&self) -> Option<Known> {
        Some(Known { color: self.known_color?, seen: self.chosen? })
    }

    /// Segments one frame; the results stay until the next. `told` is what other cameras know
    /// from the frame before.
    pub fn segment(&mut self, frame: Option<RgbdFrame<'_>>, told: &Told) -> Outcome {
        self.voxels.clear();
        self.points.clear();
        self.edgels.clear();
        self.edgels_left_out = 0;
        if let Some(finder) = &mut self.finder {
            finder.look_near(&self.color.mask);
        }
        self.color.mask.clear();
        self.chosen = None;
        if self.known_color.is_none() && told.known.is_some() {
            self.table = None;
        }
        let Some(frame) = frame.filter(|frame| frame.fits(&self.camera)) else {
            return Outcome::NoFrame;
        };
        let found = match self.table.take() {
            Some(table) => {
                let found = self.track(&frame, &table).is_some();
                self.table = Some(table);
                found
                    || (self.missed >= self.params.relearn_after_frames && self.learn(&frame, told))
            }
            None => {
                self.enter(&frame, self.watch.whole());
                self.learn(&frame, told)
            }
        };
        if !found {
            self.missed = self.missed.saturating_add(1);
            self.chosen = None;
            self.color.mask.clear();
            self.depth.sheet.clear();
            self.watch.saw(None);
            return Outcome::NoSheet;
        }
        self.missed = 0;
        self.attempts = 0;
        self.watch.saw(self.sighting());
        self.take_points();
        self.take_edgels(frame.color_rgb);
        if let Some(table) = &mut self.table {
            let width = self.camera.color.width as usize;
            table.follow(frame.color_rgb, width, &self.view.color, &self.color.mask);
        }
        Outcome::Sheet
    }

    /// Finds the sheet by a known colour: round where it was, and if that does not do, anywhere.
    fn track(&mut self, frame: &RgbdFrame<'_>, table: &ColorTable) -> Option<()> {
        if let Some(view) = self.watch.next_view() {
            self.enter(frame, view);
            self.find_sheet(frame.color_rgb, table);
            let held = self.sighting().is_some_and(|found| self.watch.holds(&view, &found));
            self.watch.judge(held);
            if held {
                return Some(());
            }
        }
        self.enter(frame, self.watch.whole());
        self.find_sheet(frame.color_rgb, table).map(|_| ())
    }

    /// Loads what is to be looked at.
    fn enter(&mut self, frame: &RgbdFrame<'_>, view: View) {
        let View { color, depth } = view;
        self.view = view;
        self.color.reshape(color.width, color.height);
        self.builder.reshape(color.width, color.height);
        if let Some(parallax) = &mut self.parallax {
            parallax.reshape(color.width, color.height);
        }
        self.depth.reshape(depth.width, depth.height);
        self.depth.before.copy_part(&depth, &self.depth.sheet, &self.sheet_at);
        self.steps.reshape(depth.width, depth.height);
        self.selector.reshape(depth.width, depth.height);
        self.occluders.reshape(depth.width, depth.height);
        self.map.enter(&view);
        self.map.load(frame.depth_units);
        if let Some(finder) = &mut self.finder {
            finder.find(frame.color_rgb, &self.map);
        }
    }

    /// From colours to the accepted patches of depth and the colour mask.
    fn find_sheet(&mut self, color_rgb: &[u8], table: &ColorTable) -> Option<Chosen> {
        self.chosen = None;
        let (color, depth, params) = (&mut self.color, &mut self.depth, &self.params);
        let width = self.camera.color.width as usize;
        table.classify(self.lanes, color_rgb, width, &self.view.color, &mut color.candidate);
        if let Some(finder) = &self.finder {
            finder.add_ink(&mut color.candidate);
        }
        color.candidate.erode(params.open_px, &mut color.scratch);
        color.candidate.dilate(params.open_px + params.close_px, &mut color.scratch);
        color.candidate.erode(params.close_px, &mut color.scratch);
        self.components.find(&color.candidate, true);

        self.map.look_up(&color.candidate, None, &mut depth.sheet_colored);
        depth.region.copy_from(&depth.sheet_colored);
        depth.region.dilate(REGION_PX, &mut depth.scratch);
        color.eroded.copy_from(&color.candidate);
        color.eroded.erode(params.mask_margin_px, &mut color.scratch);
        // What is left of the colours after erosion was set before.
        self.map.look_up(&color.eroded, Some(&depth.sheet_colored), &mut depth.surface);
        self.steps.find(&self.map, &depth.region);
        depth.surface.and_not(&self.steps.edge);
        let evidence = Evidence {
            map: &self.map,
            steps: &self.steps,
            sheet_colored: &depth.sheet_colored,
            surface: &depth.surface,
            colors: &self.components,
            before: &depth.before,
        };
        let (accepted, refused) = (&mut depth.accepted, &mut depth.refused);
        let chosen = self.selector.select(&evidence, &self.size, accepted, refused)?;
        let surface = Accepted {
            map: &self.map,
            colors: &self.components,
            selector: &self.selector,
            accepted: &depth.accepted,
            refused: &depth.refused,
        };
        let hole_ratio_max = self.params.hole_ratio_max;
        self.builder.build(&surface, hole_ratio_max, &mut color.mask, &mut color.around);
        self.chosen = Some(chosen);
        self.chosen
    }

    /// Where [`Self::find_sheet`] found the sheet, if it did.
    fn sighting(&self) -> Option<Sighting> {
        let whole =
            |inner: Window, at: Window| Window { x: at.x + inner.x, y: at.y + inner.y, ..inner };
        Some(Sighting {
            area_m2: self.chosen?.area_m2,
            mask: whole(self.color.mask.bounds()?, self.view.color),
            surface: whole(self.depth.accepted.bounds()?, self.view.depth),
        })
    }

    /// Averages the points of the mask's depth pixels that see the sheet and nothing else.
    fn take_points(&mut self) {
        let (color, depth, params) = (&mut self.color, &mut self.depth, &self.params);
        self.occluders.find(&self.steps, &depth.accepted);
        color.eroded.copy_from(&color.mask);
        color.eroded.erode(params.mask_margin_px, &mut color.scratch);
        depth.sheet.reshape(self.view.depth.width, self.view.depth.height);
        self.sheet_at = self.view.depth;
        self.map.look_up(&color.eroded, Some(&depth.region), &mut depth.sheet);
        depth.clear.copy_from(&depth.sheet);
        depth.clear.and_not(&self.steps.edge);
        depth.refused.dilate(1, &mut depth.scratch);
        depth.clear.and_not(&depth.refused);
        depth.surface.copy_from(&self.occluders.found);
        depth.surface.dilate(params.occluder_margin_px, &mut depth.scratch);
        depth.clear.and_not(&depth.surface);
        if let Some(parallax) = &mut self.parallax {
            parallax.drop_hidden(&self.map, params.step_m as f32, &mut depth.clear);
        }
        self.voxels.add(&self.map, &depth.clear);
        self.voxels.average(&self.map, &depth.clear, &mut self.points);
    }

    fn take_edgels(&mut self, color_rgb: &[u8]) {
        let Some(table) = &self.table else { return };
        let (color, depth, params) = (&mut self.color, &mut self.depth, &self.params);
        color.occluded.clear();
        if let (Some(chosen), Some(_)) = (&self.chosen, &self.parallax) {
            self.occluders.add_nearer(&self.map, chosen.nearest_m - IN_FRONT_M);
        }
        self.map.splat(&self.occluders.found, &mut color.occluded);
        self.map.splat(&self.occluders.unsure, &mut color.occluded);
        color.occluded.dilate(params.edgel_occluder_margin_px, &mut color.scratch);
        let contour = Contour {
            color_rgb,
            size: [self.camera.color.width as usize, self.camera.color.height as usize],
            window: self.view.color,
            table,
            mask: &color.mask,
            around: &color.around,
            occluded: &color.occluded,
            camera: self.index,
        };
        self.edgels_left_out += contour.trace(params, &mut color.scratch, &mut self.edgels);
        if params.inner_edgels {
            self.edgels_left_out += inner_edge::trace(
                &self.map,
                &self.steps,
                &depth.accepted,
                self.index,
                &mut self.edgels,
            );
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use orime_geometry::CameraModel;
    use orime_geometry::nalgebra::Isometry3;

    const SIZE: [usize; 2] = [330, 250];

    /// A white sheet with a flap on it before a dark table, with noise in colour and depth.
    fn frame(shift: usize) -> (Vec<u8>, Vec<u16>) {
        let (mut rgb, mut depth) = (Vec::new(), Vec::new());
        let mut state = 7_u32;
        for (x, y) in (0..SIZE[1]).flat_map(|y| (0..SIZE[0]).map(move |x| (x, y))) {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            let inside = |left: usize, right: usize| {
                (left + shift..right + shift).contains(&x) && (90..150).contains(&y)
            };
            let (sheet, flap) = (inside(80, 180), inside(120, 150));
            let level = if sheet { 225 } else { 40 } + (state >> 28) as u8;
            rgb.extend([level, level, level + 2]);
            let noise = (state >> 20 & 31) as u16;
            let plane = 6000 + 2 * x as u16 + noise;
            let far = if sheet { plane } else { plane + 300 };
            depth.push(match state >> 10 & 255 {
                0 => 0,
                _ if flap => plane - 150,
                _ => far,
            });
        }
        (rgb, depth)
    }

    /// The same, pleated: depth goes up and down by 30 mm every four columns.
    fn pleated(mut frame: (Vec<u8>, Vec<u16>)) -> (Vec<u8>, Vec<u16>) {
        for (k, (depth, rgb)) in frame.1.iter_mut().zip(frame.0.chunks_exact(3)).enumerate() {
            if rgb[0] > 200 && k % 8 < 4 {
                *depth = depth.saturating_sub(300);
            }
        }
        frame
    }

    fn camera() -> RgbdCamera {
        let lens = CameraModel {
            width: SIZE[0] as u32,
            height: SIZE[1] as u32,
            fx_px: 300.0,
            fy_px: 300.0,
            cx_px: 164.5,
            cy_px: 124.5,
            distortion: [0.02, -0.01, 0.001, 0.001, 0.0],
        };
        RgbdCamera {
            name: "front".into(),
            color: lens.clone(),
            depth: lens,
            color_from_depth: Isometry3::translation(0.01, 0.0, 0.0),
            world_from_color: Isometry3::rotation([0.1, 0.2, 0.3].into()),
            depth_m_per_unit: 1e-4,
        }
    }

    fn segmenter() -> CameraSegmenter {
        let sheet = SheetGrid::new([0.2, 0.12], [9, 7]);
        CameraSegmenter::new(0, &camera(), &SegmentParams::default(), &sheet)
    }

    fn look(
        segmenter: &mut CameraSegmenter,
        (color_rgb, depth_units): &(Vec<u8>, Vec<u16>),
    ) -> Outcome {
        let told = Told { alone: true, known: None };
        segmenter.segment(Some(RgbdFrame { color_rgb, depth_units }), &told)
    }

    #[test]
    fn pleats_too_steep_for_depth_keep_their_contour() {
        let mut camera = segmenter();
        assert_eq!(look(&mut camera, &frame(0)), Outcome::Sheet);
        let (points, edgels) = (camera.points.len(), camera.edgels.len());
        for shift in [2, 4, 6] {
            assert_eq!(look(&mut camera, &pleated(frame(shift))), Outcome::Sheet);
            assert!(camera.points.len() < points / 20, "{} of {points}", camera.points.len());
            assert!(camera.edgels.len() > edgels / 2, "{} of {edgels}", camera.edgels.len());
        }
        assert_eq!(look(&mut camera, &frame(6)), Outcome::Sheet);
        assert!(camera.points.len() > points * 9 / 10);
        // What was not there before is not known by its colour alone.
        assert_eq!(look(&mut camera, &pleated(frame(150))), Outcome::NoSheet);
        assert_eq!(look(&mut segmenter(), &pleated(frame(0))), Outcome::NoSheet);
    }

    #[test]
    fn the_width_of_vectors_changes_nothing() {
        let run = |lanes: Width| {
            let mut segmenter = segmenter();
            (segmenter.lanes, segmenter.map.lanes) = (lanes, lanes);
            (segmenter.steps.lanes, segmenter.voxels.lanes) = (lanes, lanes);
            let mut seen = Vec::new();
            for frame in [frame(0), frame(4), pleated(frame(4)), frame(9)] {
                look(&mut segmenter, &frame);
                seen.push((segmenter.points.clone(), segmenter.edgels.clone()));
            }
            seen
        };
        let portable = run(Width::Portable);
        assert!([0, 1, 3].iter().all(|k| portable[*k].0.len() > 500));
        assert!(portable.iter().all(|(_, edgels)| edgels.len() > 20));
        for lanes in Width::available() {
            assert!(run(lanes) == portable, "{lanes:?}");
        }
    }
}
