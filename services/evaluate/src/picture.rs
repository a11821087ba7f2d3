//! Pictures of a step: colour image with contour, observed cloud, tracked sheet.

mod canvas;
mod panel;
mod plot;
mod sketch;
mod sweep;
mod view;

pub use canvas::Canvas;
pub use panel::{PanelInput, panel};
pub use plot::{Plot, Series};
pub use sketch::Sketch;
pub use sweep::{Landmark, knob_plots, over_time};
