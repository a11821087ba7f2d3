//! Exact folding scenes with noise, and what a finder makes of them.

mod noise;
mod scene;
mod score;
mod summary;

pub use noise::{Noise, Random};
pub use scene::{Scene, SceneKind, TrueCrease};
pub use score::{Score, score};
pub use summary::{Goals, Summary};
