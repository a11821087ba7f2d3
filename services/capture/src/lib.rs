//! `capture`: sources of RGB-D frames behind one trait, each writing its pixels in place.

mod source;

pub use source::{FrameError, FrameReport, FrameSource};
