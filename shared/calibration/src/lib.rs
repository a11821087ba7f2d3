//! Calibration files.
