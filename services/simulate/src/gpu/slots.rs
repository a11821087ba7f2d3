//! The buffers of the kernels.

use super::pieces::{Piece, Pieces};
use wgpu::BufferBindingType;

/// A buffer; its number is that of its binding.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Slot {
    Frame,
    X,
    V,
    Before,
    Ahead,
    Links,
    Ranges,
    Targets,
    Facets,
    Strengths,
    Hinges,
    Anchors,
    Stencils,
    StencilColours,
    RestOfLink,
    PlasticLinks,
    Rests,
}

impl Slot {
    /// All, by their numbers.
    const ALL: [Self; 17] = [
        Self::Frame,
        Self::X,
        Self::V,
        Self::Before,
        Self::Ahead,
        Self::Links,
        Self::Ranges,
        Self::Targets,
        Self::Facets,
        Self::Strengths,
        Self::Hinges,
        Self::Anchors,
        Self::Stencils,
        Self::StencilColours,
        Self::RestOfLink,
        Self::PlasticLinks,
        Self::Rests,
    ];
    /// What comes back after a frame.
    pub const BACK: [Self; 4] = [Self::X, Self::V, Self::Hinges, Self::Rests];

    /// Those that these pieces need.
    pub fn of(pieces: Pieces) -> impl Iterator<Item = Self> {
        let needed = move |slot: &Self| slot.piece().is_none_or(|piece| pieces.contains(piece));
        Self::ALL.into_iter().filter(needed)
    }

    /// The piece that needs it; `None` where all do.
    fn piece(self) -> Option<Piece> {
        match self {
            Self::Frame | Self::X | Self::V | Self::Before | Self::Ahead => None,
            Self::Links | Self::Ranges => None,
            Self::Targets => Some(Piece::Track),
            Self::Facets => Some(Piece::Fit),
            Self::Strengths => Some(Piece::Facets),
            Self::Hinges => Some(Piece::Crease),
            Self::Anchors => Some(Piece::Grippers),
            Self::Stencils | Self::StencilColours => Some(Piece::Plate),
            Self::RestOfLink | Self::PlasticLinks | Self::Rests => Some(Piece::Plastic),
        }
    }

    /// How the kernels use it.
    pub fn kind(self) -> BufferBindingType {
        let written = matches!(
            self,
            Self::X | Self::V | Self::Before | Self::Ahead | Self::Hinges | Self::Rests
        );
        match self {
            Self::Frame => BufferBindingType::Uniform,
            _ => BufferBindingType::Storage { read_only: !written },
        }
    }
}
