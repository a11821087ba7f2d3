//! `register`: observed cloud and predicted sheet in, soft targets out. Knows no process, clock
//! or file.
//!
//! The story: [`Registrar::register`] predicts where the sheet is, lets [`track`] bend it onto the
//! cloud by Coherent Point Drift, judges the result ([`score`]) and, where it does not explain
//! what is seen, tries a pose found from the cloud alone ([`first_pose`]). A printed sheet can be
//! registered by its recognised points instead ([`features`]).

mod align;
mod basis;
mod bias;
mod blend;
mod blocks;
mod carry;
mod cloud;
mod expectation;
mod features;
mod first_pose;
mod isometry;
mod mixture;
mod outline;
mod params;
mod projector;
mod refine;
mod registrar;
mod rig;
mod score;
pub mod textbook;
mod track;
mod visibility;
mod whole;
mod zbuffer;

pub use params::{RegisterConfig, RegisterMode, RegisterParams};
pub use registrar::{Observation, RegisterReport, Registrar, Tracking};
pub use track::{Effort, Termination, TrackReport};
