//! The solver on a graphics processor, for many sheets or large ones.
//!
//! A sheet that one workgroup can carry is a single dispatch a frame ([`Path::OneWorkgroup`]), and
//! a batch is a workgroup per sheet; a large sheet is a dispatch per colour and substep
//! ([`Path::Apart`]). Every kernel has a CPU twin of the same name in `solver`, or in `grips.rs`.
//! What a scene does not name, or what sleeps, is not even compiled ([`Piece`]). Self-contact stays
//! on the CPU: it works on lists that grow and shrink from substep to substep, in the caller's
//! hands.

mod device;
mod kernels;
mod model;
mod pieces;
mod sheets;
mod slots;
mod traffic;

pub(crate) use model::{Frame, Model};
pub(crate) use pieces::Piece;
pub(crate) use sheets::Sheets;

/// Why the graphics processor is not used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum GpuError {
    /// There is none, or no driver for it.
    #[error("no Vulkan adapter: {0}; install a driver, or take `backend = \"cpu\"`")]
    NoAdapter(String),
    /// It does not do what is needed.
    #[error("adapter `{name}` refuses: {why}; take `backend = \"cpu\"`")]
    Refused {
        /// The adapter.
        name: String,
        /// What it said.
        why: String,
    },
    /// It failed in the middle of the work.
    #[error("adapter `{name}` failed: {why}")]
    Failed {
        /// The adapter.
        name: String,
        /// What it said.
        why: String,
    },
}

/// How a frame is cut into dispatches.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Path {
    /// One dispatch a frame, one workgroup a sheet.
    OneWorkgroup,
    /// A dispatch per pass, colour and facet of every substep; one sheet only.
    Apart,
}

#[cfg(test)]
mod tests;
