//! The `[segment]` section of a set.

use orime_geometry::SheetGrid;
use orime_markers::SheetPrint;
use orime_params::{Checker, Problem};
use serde::{Deserialize, Serialize};

/// What is printed on the sheet.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Markers {
    /// Nothing that is looked for.
    #[default]
    None,
    /// The grid of ArUco markers that Orime prints on both sides.
    Sheet,
}

/// The `[segment]` section of a set.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SegmentParams {
    /// The sheet's colour, 8-bit `[r, g, b]` as the cameras show it. Without it the colour is
    /// learnt from the first frames that show most of the sheet clear of the image's border.
    /// Default none.
    pub color_hint_rgb: Option<[u8; 3]>,
    /// The colour of the sheet's other side, where it differs; needs `color_hint_rgb`.
    /// Default none.
    pub back_color_hint_rgb: Option<[u8; 3]>,
    /// Seed of the clustering of the surroundings' colours. Default 1.
    pub seed: u64,
    /// Depths below this are not the sheet, metres. Default 0.15.
    pub depth_min_m: f64,
    /// Depths above this are not the sheet, metres. Lower is safer against a similar background.
    /// Default 3.0.
    pub depth_max_m: f64,
    /// Corners `[[x, y, z], [x, y, z]]` of a box in the world, metres; points outside are not
    /// the sheet. Default none: everywhere.
    pub workspace_m: Option<[[f64; 3]; 2]>,
    /// Radius of the opening of the colour mask, pixels. More removes thicker bridges to other
    /// things of the sheet's colour, and the sheet's sharpest corners. Default 1.
    pub open_px: usize,
    /// Radius of the closing of the colour mask, pixels. More bridges broader print and pens,
    /// and blunts notches. Default 4.
    pub close_px: usize,
    /// Largest hole (print, markers) that is filled, as a share of the sheet's visible area.
    /// More fills larger print, and fingertips. Default 0.03.
    pub hole_ratio_max: f64,
    /// Largest visible area, as a share of the sheet's. Above 1 for depth noise and the pixels
    /// on the outline. Default 1.3.
    pub area_ratio_max: f64,
    /// Smallest visible area of a sheet that is tracked, as a share of the sheet's. Default 0.03.
    pub area_ratio_min: f64,
    /// Smallest visible area (as seen, so foreshortened) from which a colour is learnt, as a
    /// share of the sheet's. Lower learns from a sheet that hands cover, and sooner from
    /// something that is no sheet. Default 0.3.
    pub learn_area_ratio_min: f64,
    /// Frames without the sheet after which its colour is learnt anew, beside the colour that is
    /// known. Default 15.
    pub relearn_after_frames: u32,
    /// Depth within this of the colour mask's outline is dropped, pixels of the colour image.
    /// More is safer against depth and colour that disagree; it costs points at edges. Default 2.
    pub mask_margin_px: usize,
    /// Depth within this of something nearer than the sheet is dropped, pixels of the depth
    /// image. Default 5.
    pub occluder_margin_px: usize,
    /// Edgels within this of something nearer than the sheet are dropped, pixels of the colour
    /// image. Default 5.
    pub edgel_occluder_margin_px: usize,
    /// Smallest step in depth that separates surfaces, metres, for near things. Less separates
    /// flatter hands, and tears noisy depth apart. Default 0.004.
    pub step_m: f64,
    /// Growth of that step with the square of the distance, metres per square metre; depth noise
    /// of stereo and structured-light cameras grows like that. Default 0.006.
    pub step_growth_per_m: f64,
    /// Side of the cells over which points are averaged, metres. Less keeps finer shape and
    /// noise, at more points. Default 0.003.
    pub voxel_m: f64,
    /// Rough distance between edgels along the outline, pixels. Default 2.
    pub edgel_spacing_px: usize,
    /// Smallest contrast across the outline that makes an edgel, of 255. Default 24.0.
    pub contrast_min: f64,
    /// Whether steps in depth inside the mask (the edge of a flap) become edgels. Default true.
    pub inner_edgels: bool,
    /// Once the sheet is tracked, only a window round it is looked at; every so many frames the
    /// whole image is, so that parts of the sheet that reappear elsewhere are found. 1 looks at
    /// the whole image always, which costs about twice as much; more finds them later. Default 16.
    pub whole_image_every: u32,
    /// Which printed markers are looked for: `"none"`, or `"sheet"`, the ArUco grid with corners at
    /// every other node (both sides odd numbers of nodes). Their corners become features.
    /// Default none.
    pub markers: Markers,
}

impl Default for SegmentParams {
    fn default() -> Self {
        Self {
            color_hint_rgb: None,
            back_color_hint_rgb: None,
            seed: 1,
            depth_min_m: 0.15,
            depth_max_m: 3.0,
            workspace_m: None,
            open_px: 1,
            close_px: 4,
            hole_ratio_max: 0.03,
            area_ratio_max: 1.3,
            area_ratio_min: 0.03,
            learn_area_ratio_min: 0.3,
            relearn_after_frames: 15,
            mask_margin_px: 2,
            occluder_margin_px: 5,
            edgel_occluder_margin_px: 5,
            step_m: 0.004,
            step_growth_per_m: 0.006,
            voxel_m: 0.003,
            edgel_spacing_px: 2,
            contrast_min: 24.0,
            inner_edgels: true,
            whole_image_every: 16,
            markers: Markers::None,
        }
    }
}

impl SegmentParams {
    /// Checks the section; every problem at once.
    pub fn check(&self) -> Result<SegmentConfig, Vec<Problem>> {
        let Self {
            color_hint_rgb,
            back_color_hint_rgb,
            seed: _,
            depth_min_m,
            depth_max_m,
            workspace_m,
            open_px,
            close_px,
            hole_ratio_max,
            area_ratio_max,
            area_ratio_min,
            learn_area_ratio_min,
            relearn_after_frames: _,
            mask_margin_px,
            occluder_margin_px,
            edgel_occluder_margin_px,
            step_m,
            step_growth_per_m,
            voxel_m,
            edgel_spacing_px,
            contrast_min,
            inner_edgels: _,
            whole_image_every,
            markers: _,
        } = *self;
        let mut checker = Checker::new();
        let depths = [depth_min_m, depth_max_m];
        let holds = 0.0 < depths[0] && depths[0] < depths[1] && depths[1] <= 20.0;
        let requirement = "needs 0 < depth_min_m < depth_max_m <= 20 metres";
        checker.require(holds, "depth_min_m", depths, requirement);
        if let Some([low, high]) = workspace_m {
            let holds = (0..3).all(|k| low[k] < high[k] && (high[k] - low[k]).is_finite());
            let requirement = "each coordinate of the first corner must be below the second's";
            checker.require(holds, "workspace_m", [low, high], requirement);
        }
        let holds = back_color_hint_rgb.is_none() || color_hint_rgb.is_some();
        let requirement = "give `color_hint_rgb` too";
        checker.require(holds, "back_color_hint_rgb", back_color_hint_rgb, requirement);
        for (key, value, low, high, unit) in [
            ("hole_ratio_max", hole_ratio_max, 0.0, 0.5, ""),
            ("area_ratio_max", area_ratio_max, 1.0, 4.0, ""),
            ("step_m", step_m, 5e-4, 0.1, " metres"),
            ("step_growth_per_m", step_growth_per_m, 0.0, 0.1, " per metre"),
            ("voxel_m", voxel_m, 5e-4, 0.1, " metres"),
            ("contrast_min", contrast_min, 1.0, 255.0, ""),
        ] {
            let requirement = format!("must be {low} to {high}{unit}");
            checker.require(low <= value && value <= high, key, value, &requirement);
        }
        let areas = [area_ratio_min, learn_area_ratio_min];
        let holds = 0.0 < areas[0] && areas[0] <= areas[1] && areas[1] <= 1.0;
        let requirement = "needs 0 < area_ratio_min <= learn_area_ratio_min <= 1";
        checker.require(holds, "area_ratio_min", areas, requirement);
        for (key, value, low, high, unit) in [
            ("open_px", open_px, 0, 16, "pixels"),
            ("close_px", close_px, 0, 16, "pixels"),
            ("mask_margin_px", mask_margin_px, 0, 16, "pixels"),
            ("occluder_margin_px", occluder_margin_px, 0, 32, "pixels"),
            ("edgel_occluder_margin_px", edgel_occluder_margin_px, 0, 32, "pixels"),
            ("edgel_spacing_px", edgel_spacing_px, 1, 64, "pixels"),
            ("whole_image_every", whole_image_every as usize, 1, 1000, "frames"),
        ] {
            let requirement = format!("must be {low} to {high} {unit}");
            checker.require((low..=high).contains(&value), key, value, &requirement);
        }
        checker.finish(|| SegmentConfig { params: self.clone() })
    }
}

/// Checked [`SegmentParams`].
#[derive(Debug, Clone)]
pub struct SegmentConfig {
    pub(crate) params: SegmentParams,
}

impl SegmentConfig {
    /// Whether the markers of a printed sheet are looked for.
    pub fn finds_markers(&self) -> bool {
        self.params.markers != Markers::None
    }

    /// Whether the markers that are to be looked for can be on this sheet; if not, the problem is
    /// about the section `sheet`.
    pub fn check_sheet(&self, sheet: &SheetGrid) -> Result<(), Problem> {
        match self.params.markers {
            Markers::None => Ok(()),
            Markers::Sheet => SheetPrint::new(sheet.nodes).map(drop),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_defaults_are_a_config() {
        assert!(SegmentParams::default().check().is_ok());
    }

    #[test]
    fn every_problem_is_reported() {
        let params = SegmentParams {
            depth_min_m: f64::NAN,
            workspace_m: Some([[0.0; 3], [1.0, -1.0, 1.0]]),
            back_color_hint_rgb: Some([0; 3]),
            voxel_m: 3.0,
            area_ratio_min: 0.9,
            close_px: 400,
            edgel_spacing_px: 0,
            whole_image_every: 0,
            ..SegmentParams::default()
        };
        let keys: Vec<String> = params.check().unwrap_err().into_iter().map(|p| p.key).collect();
        assert_eq!(
            keys,
            [
                "depth_min_m",
                "workspace_m",
                "back_color_hint_rgb",
                "voxel_m",
                "area_ratio_min",
                "close_px",
                "edgel_spacing_px",
                "whole_image_every",
            ]
        );
    }

    /// "Default 5." in a field's documentation is the field's default.
    #[test]
    fn documented_defaults_are_the_defaults() {
        let source = include_str!("params.rs");
        let defaults = format!("{:#?}", SegmentParams::default());
        let fields = &source[..source.find("impl Default").unwrap()];
        let mut documented = None;
        let mut checked = 0;
        for line in fields.lines().map(str::trim) {
            if let Some((_, value)) = line.split_once("Default ") {
                documented = Some(value.strip_suffix('.').unwrap_or(value).to_owned());
            } else if let Some(field) = line.strip_prefix("pub ") {
                let Some((name, _)) = field.split_once(':') else { continue };
                let value = documented.take().unwrap_or_else(|| panic!("no default for {name}"));
                let value = if value.starts_with("none") { "None" } else { value.as_str() };
                assert!(defaults.contains(&format!("    {name}: {value},")), "{name}: {value}");
                checked += 1;
            }
        }
        assert_eq!(checked, 24);
    }
}
