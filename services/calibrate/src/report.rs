//! The figures of a calibration: as text, JSON and Markdown.

use std::path::Path;

use orime_geometry::nalgebra::Isometry3;
use serde::Serialize;

use crate::agreement::{PARTS, PairAgreement};
use crate::border_shift::BorderShift;
use crate::bundle::Termination;
use crate::fit::Fit;
use crate::observe::Observations;
use crate::pictures::Picture;

/// Everything that is said about a calibration.
#[derive(Debug, Clone, Serialize)]
pub struct Report {
    set: String,
    /// Frame sets that were looked at.
    frame_sets: u64,
    /// Frames that could not be read.
    unreadable_frames: u64,
    /// Markers seen, over all images.
    markers_seen: usize,
    /// Agreement is measured on frame sets left out of the fit; there were so many fits.
    fits_with_parts_left_out: u64,
    termination: Termination,
    /// What the size of the markers was taken from.
    scale: Scale,
    /// How far borders between ink and paper were off; `null` where too few grids said it.
    border_shift: Option<BorderShift>,
    cameras: Vec<CameraFigures>,
    pairs: Vec<PairAgreement>,
    target: Vec<MarkerPlace>,
    warnings: Vec<String>,
}

/// What the size of the markers was taken from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
enum Scale {
    /// Their grids: squares moved back by the border shift.
    Grid,
    /// Their black squares as they look.
    Square,
}

#[derive(Debug, Clone, Serialize)]
struct CameraFigures {
    name: String,
    /// Median distance of corners from where the fit puts them, pixels.
    corner_px: f64,
    /// Median of measured − true depth at `depth_at_m`; `null` where too little depth was seen.
    depth_bias_mm: Option<f64>,
    /// What the border shift makes uncertain in it (one sigma); `null` where that is not known.
    depth_bias_sigma_mm: Option<f64>,
    depth_scale: Option<f64>,
    depth_at_m: Option<f64>,
    /// Median distance of corrected depth from the markers' planes.
    depth_spread_mm: Option<f64>,
    markers_with_depth: usize,
    /// How far the pose moved against the source's own.
    moved_mm: f64,
    turned_deg: f64,
}

#[derive(Debug, Clone, Serialize)]
struct MarkerPlace {
    id: u32,
    /// Its centre in the target, millimetres.
    centre_mm: [f64; 3],
}

const SQUARE_WARNING: &str = "the markers' grids could not be read (modules of 2.5 pixels and two \
    different markers are needed): their black squares are taken as they look, which a camera's \
    curve makes smaller, and depth then seems short by millimetres";

impl Report {
    /// The report of a fit.
    pub fn new(
        set: &Path,
        seen: &Observations,
        found: &Fit,
        pairs: Vec<PairAgreement>,
        mut warnings: Vec<String>,
    ) -> Self {
        let shift = seen.border_shift.as_ref();
        if shift.is_none() {
            warnings.push(SQUARE_WARNING.to_owned());
        }
        let sigma_share = shift.map(BorderShift::distance_sigma_share);
        let first = seen.cameras[0].world_from_color;
        let figures = seen.cameras.iter().enumerate().map(|(k, camera)| {
            let depth = found.depth[k];
            let new: Isometry3<f64> = first * found.first_from_camera[k];
            let moved = camera.world_from_color.inverse() * new;
            CameraFigures {
                name: camera.name.clone(),
                corner_px: found.corner_px[k],
                depth_bias_mm: depth.map(|d| d.offset_m * 1e3),
                depth_bias_sigma_mm: depth.zip(sigma_share).map(|(d, s)| d.at_m * s * 1e3),
                depth_scale: depth.map(|d| d.scale),
                depth_at_m: depth.map(|d| d.at_m),
                depth_spread_mm: depth.map(|d| d.spread_m * 1e3),
                markers_with_depth: depth.map_or(0, |d| d.views),
                moved_mm: moved.translation.vector.norm() * 1e3,
                turned_deg: moved.rotation.angle().to_degrees(),
            }
        });
        let place = |(id, pose): (&u32, &Isometry3<f64>)| MarkerPlace {
            id: *id,
            centre_mm: (pose.translation.vector * 1e3).into(),
        };
        Self {
            set: set.display().to_string(),
            frame_sets: seen.steps,
            unreadable_frames: seen.unreadable,
            markers_seen: seen.views.len(),
            fits_with_parts_left_out: PARTS,
            termination: found.termination,
            scale: if shift.is_some() { Scale::Grid } else { Scale::Square },
            border_shift: shift.cloned(),
            cameras: figures.collect(),
            pairs,
            target: found.target_from_marker.iter().map(place).collect(),
            warnings,
        }
    }

    /// As JSON.
    pub fn json(&self) -> String {
        // Numbers and texts always have a form in JSON.
        serde_json::to_string_pretty(self).unwrap_or_default() + "\n"
    }

    /// For the terminal.
    pub fn text(&self) -> String {
        let mut text = format!(
            "{} markers in {} frame sets of {} cameras\n",
            self.markers_seen,
            self.frame_sets,
            self.cameras.len()
        );
        text += &self.scale_text();
        for camera in &self.cameras {
            text += &format!(
                "  {}: corners {:.2} px, depth {} ± {} mm at {} m ({} markers)\n",
                camera.name,
                camera.corner_px,
                or_none(camera.depth_bias_mm, 2),
                or_none(camera.depth_bias_sigma_mm, 2),
                or_none(camera.depth_at_m, 2),
                camera.markers_with_depth
            );
        }
        for pair in &self.pairs {
            text += &format!(
                "  {} – {}: the same marker within {} mm (before {}), {} left-out markers\n",
                pair.cameras[0],
                pair.cameras[1],
                or_none(pair.marker_agreement_mm_median, 2),
                or_none(pair.source_agreement_mm_median, 2),
                pair.markers
            );
        }
        text += &self.warnings.iter().map(|w| format!("warning: {w}\n")).collect::<String>();
        text.trim_end().to_owned()
    }

    /// What the size of the markers was taken from, and what that leaves uncertain.
    fn scale_text(&self) -> String {
        let Some(shift) = &self.border_shift else {
            return "  scale: the markers' black squares as they look\n".to_owned();
        };
        let used = shift.used_px.iter().map(|px| format!("{px:.2}"));
        format!(
            "  scale: the markers' grids ({} read); borders lie {} px on the ink's side, ± {:.2}; \
             distances ± {:.2} %\n",
            shift.grids.iter().sum::<usize>(),
            used.collect::<Vec<_>>().join(" / "),
            shift.sigma_px,
            100.0 * shift.distance_sigma_share()
        )
    }

    /// With pictures.
    pub fn markdown(&self, pictures: &[Picture]) -> String {
        let mut text = format!("# Calibration of `{}`\n\n```\n{}\n```\n\n", self.set, self.text());
        text += "Agreement: where two cameras, each alone, see the centre of the same marker; \
                 median over frame sets that the fit has not seen. Depth: median of measured − \
                 true on the markers, the truth being their corners and their size; ± is what the \
                 scale leaves uncertain, one sigma. Scale: what the markers' size was taken from, \
                 their grids (borders between black and white in both directions, so that what the \
                 camera does to a border does not count) or their black squares.\n\n";
        text +=
            "| camera | moved mm | turned ° | depth bias mm | spread mm |\n|---|---|---|---|---|\n";
        for camera in &self.cameras {
            text += &format!(
                "| {} | {:.2} | {:.3} | {} | {} |\n",
                camera.name,
                camera.moved_mm,
                camera.turned_deg,
                or_none(camera.depth_bias_mm, 2),
                or_none(camera.depth_spread_mm, 2)
            );
        }
        text += "\nWhere the markers sit on the target, mm:\n\n";
        for marker in &self.target {
            let [x, y, z] = marker.centre_mm;
            text += &format!("- {}: {x:.2}, {y:.2}, {z:.2}\n", marker.id);
        }
        text += "\nThe cloud of one camera in the image of another: left by the source's own \
                 calibration, right by this one. Right, colours of edges lie on edges.\n\n";
        for picture in pictures {
            text += &format!("![{}]({})\n\n", picture.caption, picture.file);
        }
        text
    }
}

fn or_none(value: Option<f64>, digits: usize) -> String {
    value.map_or("–".to_owned(), |value| format!("{value:.digits$}"))
}
