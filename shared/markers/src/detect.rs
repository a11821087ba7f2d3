//! From an image to markers: threshold, borders, quadrangles, edges, bits.

mod border;
mod decode;
mod edge;
mod line;
mod quad;
mod threshold;

use crate::Dictionary;
use crate::grey::{GreyImage, ImageSizeError, grey_from_rgb};
use crate::params::{DetectorConfig, DetectorParams};
use decode::Reader;
pub(crate) use line::Line;
use quad::Quad;
use threshold::{Binary, Cut, MeanThreshold};

/// A marker in an image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Marker {
    /// Its number in the dictionary.
    pub id: u32,
    /// Outer corners of its black border, clockwise in the image from the marker's own top-left;
    /// pixels, (0, 0) is the centre of the top-left pixel. They may lie outside the image.
    pub corners_px: [[f64; 2]; 4],
    /// Bits that differed from the dictionary and were corrected.
    pub corrected_bits: u32,
}

/// Most quadrangles of an image that are looked at; the largest ones are.
const CANDIDATES_MAX: usize = 4096;

/// How far an edge is looked for at first: as a share of a module, and in pixels.
const REACH_MODULES: f64 = 0.45;
const REACH_PX: std::ops::RangeInclusive<f64> = 1.0..=2.5;

/// How far it is looked for once the marker is known, pixels, at most and at least.
const FINAL_REACH_PX: std::ops::RangeInclusive<f64> = 0.75..=1.0;

/// Finds the markers of one dictionary; keeps its room between images.
///
/// 1. threshold at the mean of a window, for several windows, and at a share of it;
/// 2. outer borders of dark regions;
/// 3. Douglas–Peucker to four convex vertices;
/// 4. a line per side to the strongest edge;
/// 5. homography, samples in every module, Otsu, border check;
/// 6. dictionary in four turns.
///
/// Equal images give equal markers. O(pixels · windows); no allocation once the room is there.
#[derive(Debug)]
pub struct Detector {
    params: DetectorParams,
    dictionary: Dictionary,
    threshold: MeanThreshold,
    binary: Binary,
    border: Vec<[i32; 2]>,
    candidates: Vec<Quad>,
    found: Vec<Found>,
    markers: Vec<Marker>,
    grey: Vec<u8>,
}

/// A marker beside what it was made of.
#[derive(Debug, Clone, Copy)]
struct Found {
    marker: Marker,
    quad: Quad,
}

impl Detector {
    /// A detector without room yet.
    pub fn new(config: &DetectorConfig, dictionary: Dictionary) -> Self {
        Self {
            params: config.params().clone(),
            dictionary,
            threshold: MeanThreshold::default(),
            binary: Binary::default(),
            border: Vec::new(),
            candidates: Vec::new(),
            found: Vec::new(),
            markers: Vec::new(),
            grey: Vec::new(),
        }
    }

    /// The dictionary whose markers are found.
    pub fn dictionary(&self) -> &Dictionary {
        &self.dictionary
    }

    /// The markers of a colour image (row-major `r, g, b` bytes).
    pub fn detect_rgb(
        &mut self,
        width: usize,
        height: usize,
        rgb: &[u8],
    ) -> Result<&[Marker], ImageSizeError> {
        let mut grey = std::mem::take(&mut self.grey);
        let markers = grey_from_rgb(width, height, rgb, &mut grey)
            .and_then(|()| GreyImage::new(width, height, &grey))
            .map(|image| self.find(image));
        self.grey = grey;
        markers.map(|()| &self.markers[..])
    }

    /// The markers of a grey image, the largest first.
    pub fn detect(&mut self, image: GreyImage<'_>) -> &[Marker] {
        self.find(image);
        &self.markers
    }

    fn find(&mut self, image: GreyImage<'_>) {
        self.candidates.clear();
        self.found.clear();
        self.markers.clear();
        // A marker has at least a pixel a module; sampling needs 2 × 2.
        if image.width().min(image.height()) < self.dictionary.modules() {
            return;
        }
        for k in 0..self.params.threshold_windows_px.len() {
            let window_px = self.params.threshold_windows_px[k];
            let offset = self.params.threshold_offset as f32;
            self.threshold.apply(image, Cut { window_px, ratio: 1.0, offset }, &mut self.binary);
            self.collect_quads();
        }
        if self.params.ink_ratio > 0.0 {
            let cut = Cut {
                window_px: self.params.ink_window_px,
                ratio: self.params.ink_ratio as f32,
                offset: 0.0,
            };
            self.threshold.apply(image, cut, &mut self.binary);
            self.collect_quads();
        }
        self.candidates.sort_unstable_by(|a, b| b.area_px2.total_cmp(&a.area_px2));
        for k in 0..self.candidates.len().min(CANDIDATES_MAX) {
            let quad = self.candidates[k];
            // The same border under another threshold.
            if self.found.iter().any(|found| found.quad.is_near(&quad)) {
                continue;
            }
            if let Some(marker) = self.read(image, &quad) {
                self.keep(Found { marker, quad });
            }
        }
        self.markers.extend(self.found.iter().map(|found| found.marker));
    }

    /// Takes the quadrangles out of the thresholded image.
    fn collect_quads(&mut self) {
        let limits = quad::Limits {
            error_ratio: self.params.quad_error_ratio,
            side_px_min: self.dictionary.modules() as f64,
            area_px2_min: (self.params.module_px_min * self.dictionary.modules() as f64).powi(2),
        };
        let mut from = 0;
        while let Some(start) = self.binary.next_start(from) {
            let twice_area = border::trace(&mut self.binary, start, &mut self.border);
            let quad = quad::quadrangle(&self.border, twice_area, &limits);
            self.candidates.extend(quad);
            from = start + 1;
        }
    }

    /// Moves the quadrangle onto its edges and reads it.
    fn read(&self, image: GreyImage<'_>, quad: &Quad) -> Option<Marker> {
        let module_px = quad.side_px_min() / self.dictionary.modules() as f64;
        let (low, high) = (*REACH_PX.start(), *REACH_PX.end());
        let reach_px = (module_px * REACH_MODULES).clamp(low, high);
        let refined = edge::refine(image, &quad.corners_px, reach_px);
        let reader = Reader::new(&self.dictionary, &self.params);
        // Where an edge is half hidden, the border's own lines may still do.
        let (corners_px, known) = [refined, Some(quad.corners_px)]
            .into_iter()
            .flatten()
            .find_map(|corners| Some((corners, reader.read(image, &corners)?)))?;
        let (low, high) = (*FINAL_REACH_PX.start(), *FINAL_REACH_PX.end());
        let reach_px = (module_px * REACH_MODULES).clamp(low, high);
        let corners_px = edge::refine(image, &corners_px, reach_px).unwrap_or(corners_px);
        Some(Marker {
            id: known.id,
            corners_px: [0, 1, 2, 3].map(|k| corners_px[(k + known.turns) % 4]),
            corrected_bits: known.wrong_bits,
        })
    }

    /// Keeps the marker unless a better one lies in the same place.
    fn keep(&mut self, new: Found) {
        let same = self.found.iter_mut().find(|old| old.quad.overlaps(&new.quad));
        match same {
            Some(old) if new.marker.corrected_bits < old.marker.corrected_bits => *old = new,
            Some(_) => {}
            None => self.found.push(new),
        }
    }
}
