//! Cameras, frames, points and the sheet: plain data and the mathematics on it.
//!
//! Conventions, everywhere in Orime: SI units, right-handed frames, optical frames +X right,
//! +Y down, +Z forward; pixel (0, 0) is the *centre* of the top-left pixel; `target_from_source`
//! maps coordinates of `source` into `target`.

pub mod camera;
pub mod fit;
pub mod frame;
pub mod point;
pub mod sheet;
pub mod surface;

pub use camera::{CameraModel, RgbdCamera};
pub use frame::{RgbdFrame, RgbdFrameMut};
pub use nalgebra;
pub use point::{Edgel, EdgelKind, Feature, ObservedPoint};
pub use sheet::{SheetGrid, SheetParams};
pub use surface::Surface;
