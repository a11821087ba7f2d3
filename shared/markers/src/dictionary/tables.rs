//! The bits of the predefined dictionaries, written by `shared/markers/generate_tables.py`.

pub(super) mod apriltag;
pub(super) mod aruco;
pub(super) mod aruco_other;
