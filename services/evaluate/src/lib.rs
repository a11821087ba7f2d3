//! `evaluate`: the pipeline in one process, the judge of its results, and pictures of them.
//!
//! The same [`judge::Judge`] scores the service set from outside (`orime-evaluate watch`) and the
//! stages run in lockstep in this process (`orime-evaluate track`).

pub mod judge;
pub mod latency;
pub mod picture;
pub mod pipeline;
pub mod scores;
pub mod stability;
pub mod summary;
pub mod sweep;
