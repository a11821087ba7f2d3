//! Recordings on disk: MCAP files, RGB-D folders, point clouds and meshes.
//!
//! * [`mcap`]: recordings as MCAP files with Foxglove's schemas;
//! * [`folder`]: RGB-D images in folders, described by a small layout file;
//! * [`image`]: JPEG and PNG files decoded straight into a frame's buffers;
//! * [`ply`]: point clouds and meshes as PLY;
//! * [`obj`] and [`grid`]: meshes as OBJ, and regular quad grids found in them.
//! * [`realsense`]: recordings of RealSense cameras, `.bag` and `.db3`;
//! * [`template`]: the shape of a sheet that does not start flat.

pub mod folder;
pub mod grid;
pub mod image;
pub mod mcap;
pub mod obj;
pub mod ply;
pub mod realsense;
pub mod template;

pub use folder::{FolderLayout, FolderRecording, LayoutError};
pub use grid::{GridError, QuadGrid};
pub use image::{ImageError, ImageReader};
pub use mcap::{Loss, McapRecording, ReadError, RecordError, Recorded, Recorder, SheetState};
pub use obj::{Obj, ObjError};
pub use ply::PlyError;
pub use realsense::{RealsenseError, RealsenseRecording};
