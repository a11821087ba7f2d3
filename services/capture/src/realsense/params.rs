//! The `[capture.realsense]` section of a set.

use std::path::PathBuf;
use std::time::Duration;

use orime_params::{Checker, Problem};
use serde::{Deserialize, Serialize};

use super::sdk::Wanted;

/// Live RealSense cameras, or recordings that the SDK plays as if they were.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RealsenseParams {
    /// The cameras; their order is the order of camera indices. Default: one, whichever is
    /// plugged in.
    pub camera: Vec<LiveCameraParams>,
    /// Width and height of the depth images, pixels. Default 640 × 480.
    pub depth_px: [u32; 2],
    /// Width and height of the colour images, pixels. Default 640 × 480.
    pub color_px: [u32; 2],
    /// Frames per second of depth and colour, 1 to 90; the camera must have such a profile.
    /// Default 30.
    pub fps: u32,
    /// How far frames of one set may be apart between cameras, seconds, 0.0001 to 1: half a
    /// period takes in cameras that nothing synchronises. Default 0.017.
    pub set_s: f64,
    /// How long a set waits for a camera that is late, seconds, 0.001 to 10: more loses fewer
    /// frames and delays all others. Default 0.05.
    pub wait_s: f64,
    /// Without a frame for so long a camera counts as gone and is opened again, seconds,
    /// 0.1 to 60. Default 1.
    pub stall_s: f64,
    /// Whether recordings are played at their own pace, as cameras send, newest frames winning
    /// (default), or as fast as the set takes them, every frame of them and with their own stamps.
    pub real_time: bool,
    /// Whether a recording that ends is opened again, as a camera that was unplugged. Default
    /// false: the source ends when all recordings have.
    pub reopen: bool,
    /// Path of librealsense2. Default: the installed one.
    pub library: Option<String>,
    /// Libraries to be loaded before it (the SDK inside PyPI's pyrealsense2 needs libpython and
    /// libusb). Default none.
    pub preload: Vec<String>,
}

/// One camera of `[capture.realsense]`.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct LiveCameraParams {
    /// Name for people and calibrations, unique. Default: the serial number, or `realsense`.
    pub name: String,
    /// Serial number, as on the camera's label; empty (default): any camera.
    pub serial: String,
    /// A recording that the SDK plays instead. Default: a camera.
    pub file: Option<String>,
    /// Options by the SDK's names in small letters with `_`, set on whichever sensor has them:
    /// `{ laser_power = 150, exposure = 8500, enable_auto_exposure = 0 }`. Default none.
    pub options: std::collections::BTreeMap<String, f64>,
}

impl Default for RealsenseParams {
    fn default() -> Self {
        Self {
            camera: vec![LiveCameraParams::default()],
            depth_px: [640, 480],
            color_px: [640, 480],
            fps: 30,
            set_s: 0.017,
            wait_s: 0.05,
            stall_s: 1.0,
            real_time: true,
            reopen: false,
            library: None,
            preload: Vec::new(),
        }
    }
}

/// A checked `[capture.realsense]` section.
#[derive(Debug, Clone, PartialEq)]
pub struct RealsenseConfig {
    pub(super) cameras: Vec<Wanted>,
    pub(super) set_ns: u64,
    pub(super) wait_ns: u64,
    pub(super) stall: Duration,
    /// Nothing may be lost: recordings as fast as they are taken.
    pub(super) lossless: bool,
    pub(super) reopen: bool,
    pub(super) library: Option<PathBuf>,
    pub(super) preload: Vec<PathBuf>,
}

impl RealsenseParams {
    /// Checks the section; every problem at once. Whether the cameras are there shows on opening.
    pub fn check(&self) -> Result<RealsenseConfig, Vec<Problem>> {
        let Self {
            camera,
            depth_px,
            color_px,
            fps,
            set_s,
            wait_s,
            stall_s,
            real_time,
            reopen,
            library,
            preload,
        } = self;
        let mut checker = Checker::new();
        checker.require((1..=8).contains(&camera.len()), "camera", camera.len(), "1 to 8 cameras");
        for (key, [width, height]) in [("depth_px", depth_px), ("color_px", color_px)] {
            let holds = (16..=4096).contains(width) && (16..=4096).contains(height);
            checker.require(holds, key, [width, height], "must be 16 to 4096 pixels");
        }
        checker.require((1..=90).contains(fps), "fps", fps, "must be 1 to 90");
        for (key, value, low, high) in [
            ("set_s", set_s, 0.0001, 1.0),
            ("wait_s", wait_s, 0.001, 10.0),
            ("stall_s", stall_s, 0.1, 60.0),
        ] {
            let range = format!("must be {low} to {high} seconds");
            checker.require(low <= *value && *value <= high, key, value, &range);
        }
        let any_live = camera.iter().any(|camera| camera.file.is_none());
        let holds = *real_time || !any_live;
        checker.require(holds, "real_time", real_time, "must be true with a live camera");
        let mut cameras: Vec<Wanted> = Vec::new();
        for (k, camera) in camera.iter().enumerate() {
            let wanted = self.wanted(camera);
            if cameras.iter().any(|other| other.name == wanted.name) {
                let text = format!("is `{}` for two cameras: give each its own", wanted.name);
                checker.problem(&format!("camera[{k}].name"), text);
            }
            let serial_twice =
                cameras.iter().any(|other| other.file.is_none() && other.serial == wanted.serial);
            if wanted.file.is_none() && serial_twice {
                let text = format!("is `{}` for two cameras: give each its own", wanted.serial);
                checker.problem(&format!("camera[{k}].serial"), text);
            }
            cameras.push(wanted);
        }
        checker.finish(|| RealsenseConfig {
            cameras,
            set_ns: (set_s * 1e9) as u64,
            wait_ns: (wait_s * 1e9) as u64,
            stall: Duration::from_secs_f64(*stall_s),
            lossless: !real_time,
            reopen: *reopen,
            library: library.as_ref().map(PathBuf::from),
            preload: preload.iter().map(PathBuf::from).collect(),
        })
    }

    fn wanted(&self, camera: &LiveCameraParams) -> Wanted {
        let LiveCameraParams { name, serial, file, options } = camera;
        let names = [name.as_str(), serial.as_str(), "realsense"];
        let name = names.into_iter().find(|name| !name.is_empty()).unwrap_or_default();
        Wanted {
            name: name.to_owned(),
            serial: serial.clone(),
            file: file.as_ref().map(PathBuf::from),
            real_time: self.real_time,
            depth_px: self.depth_px,
            color_px: self.color_px,
            fps: self.fps,
            options: options.iter().map(|(key, value)| (key.clone(), *value)).collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn documented_defaults_hold() {
        let params = RealsenseParams::default();
        assert_eq!((params.depth_px, params.color_px, params.fps), ([640, 480], [640, 480], 30));
        assert_eq!((params.set_s, params.wait_s, params.stall_s), (0.017, 0.05, 1.0));
        assert!(params.real_time && !params.reopen && params.library.is_none());
        assert_eq!(params.check().unwrap().cameras[0].name, "realsense");
    }

    #[test]
    fn bad_parameters_are_reported_whole() {
        let twice = LiveCameraParams { serial: "728612070259".into(), ..Default::default() };
        let params = RealsenseParams {
            camera: vec![twice.clone(), twice],
            depth_px: [0, 480],
            fps: 0,
            set_s: f64::NAN,
            real_time: false,
            ..RealsenseParams::default()
        };
        let keys: Vec<String> = params.check().unwrap_err().into_iter().map(|p| p.key).collect();
        let expected =
            ["depth_px", "fps", "set_s", "real_time", "camera[1].name", "camera[1].serial"];
        assert_eq!(keys, expected);
    }
}
