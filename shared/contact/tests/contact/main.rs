//! Layers that were pressed into each other come apart, in order and without stretching.

mod generic;
mod poses;
mod scene;
