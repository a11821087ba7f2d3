//! ArUco markers: a grey or colour image in, ids and corners out; markers to print; the sheet
//! that carries a grid of them.
//!
//! Pixel (0, 0) is the *centre* of the top-left pixel, as in OpenCV and in the project's cameras.
//! A corner is where the marker's black border ends: the true edge, not the last dark pixel.

mod detect;
mod dictionary;
mod grey;
mod grid;
mod params;
mod render;
mod sheet_layout;
mod sheet_print;
mod unit_square;

pub use detect::{Detector, Marker};
pub use dictionary::{Dictionary, DictionaryError, predefined_names};
pub use grey::{GreyImage, ImageSizeError, grey_from_rgb};
pub use grid::{GridFit, GridRefusal, fit_grid, moved_outwards};
pub use params::{DetectorConfig, DetectorParams};
pub use render::Raster;
pub use sheet_layout::{CornerPlace, SheetLayout, SheetMarker, SheetSide};
pub use sheet_print::SheetPrint;
