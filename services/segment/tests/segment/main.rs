//! Tests of segmentation on rendered scenes, and of what it does with senseless frames.

mod degenerate;
mod measured;
mod pictures;
mod scene;
mod several;
mod windows;
