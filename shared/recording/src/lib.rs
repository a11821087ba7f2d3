//! Recordings on disk: RGB-D folders, point clouds and meshes.
//!
//! * [`folder`]: RGB-D images in folders, described by a small layout file;
//! * [`image`]: JPEG and PNG files decoded straight into a frame's buffers;
//! * [`ply`]: point clouds and meshes as PLY;
//! * [`obj`] and [`grid`]: meshes as OBJ, and regular quad grids found in them.

pub mod folder;
pub mod image;

pub use folder::{FolderLayout, FolderRecording, LayoutError};
pub use image::{ImageError, ImageReader};
