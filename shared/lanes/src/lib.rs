//! Sixteen numbers at a time, over fields of one number per node of a grid.

mod field;
mod lanes;

pub use field::{Chunk, Field, Layout, gather, scatter};
pub use lanes::{
    LANES, Lanes, Pass, Points, ROUND, Width, dot, fused_dot, load_points, minus, plus,
    store_points, times,
};
