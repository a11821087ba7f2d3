//! ROS's camera_info: files of `camera_calibration_parsers`, and messages written as YAML.

use serde::Deserialize;

use crate::file::{Calibration, CameraEntry, LensEntry};

/// Both forms; keys that are not listed are of no use here.
#[derive(Debug, Deserialize)]
struct CameraInfo {
    #[serde(alias = "width")]
    image_width: u32,
    #[serde(alias = "height")]
    image_height: u32,
    camera_name: Option<String>,
    #[serde(alias = "K", alias = "k")]
    camera_matrix: Numbers,
    distortion_model: Option<String>,
    #[serde(alias = "D", alias = "d")]
    distortion_coefficients: Option<Numbers>,
}

/// A matrix with its size, or its numbers alone.
#[derive(Debug, Deserialize)]
#[serde(untagged)]
enum Numbers {
    Matrix { data: Vec<f64> },
    Plain(Vec<f64>),
}

impl Numbers {
    fn list(&self) -> &[f64] {
        match self {
            Self::Matrix { data } => data,
            Self::Plain(data) => data,
        }
    }
}

/// Whether a YAML text is a camera_info, by its keys.
pub(crate) fn is_camera_info(text: &str) -> bool {
    let keys = ["camera_matrix:", "K:", "k:"];
    text.lines().any(|line| keys.iter().any(|key| line.starts_with(key)))
}

/// The lens of one camera: its pose and depth stay the source's own, and so do other cameras.
pub(crate) fn import(text: &str, names: &[&str]) -> Result<Calibration, String> {
    let info: CameraInfo = serde_saphyr::from_str(text)
        .map_err(|error| format!("is no camera_info of ROS: {error}"))?;
    let name = match (&info.camera_name, names) {
        (Some(name), _) if names.contains(&name.as_str()) => name.clone(),
        // One camera and one file need no names.
        (_, [only]) => (*only).to_owned(),
        (name, _) => {
            return Err(format!(
                "`camera_name` is {name:?}, the source's cameras are {names:?}: name it alike"
            ));
        }
    };
    let [fx, _, cx, _, fy, cy, ..] = *info.camera_matrix.list() else {
        return Err("`camera_matrix` must hold nine numbers".to_owned());
    };
    let coefficients = info.distortion_coefficients.as_ref().map_or(&[][..], Numbers::list);
    let model = info.distortion_model.as_deref().unwrap_or("plumb_bob");
    let distortion = match (model, coefficients) {
        (_, []) => [0.0; 5],
        (_, all) if all.iter().all(|k| *k == 0.0) => [0.0; 5],
        ("plumb_bob", [k1, k2, p1, p2]) => [*k1, *k2, *p1, *p2, 0.0],
        ("plumb_bob", [k1, k2, p1, p2, k3]) => [*k1, *k2, *p1, *p2, *k3],
        (model, all) => {
            let n = all.len();
            return Err(format!(
                "`distortion_model` is `{model}` with {n} coefficients: only `plumb_bob` with 4 \
                 or 5 is known; calibrate with it, or give rectified images"
            ));
        }
    };
    let lens = LensEntry {
        size_px: [info.image_width, info.image_height],
        focal_px: [fx, fy],
        principal_px: [cx, cy],
        distortion,
    };
    let others = names.iter().filter(|other| **other != name);
    let mut camera =
        vec![CameraEntry { name: name.clone(), color_lens: Some(lens), ..CameraEntry::default() }];
    camera.extend(others.map(|n| CameraEntry { name: (*n).to_owned(), ..CameraEntry::default() }));
    Ok(Calibration { camera })
}

#[cfg(test)]
mod tests {
    use super::*;

    const FILE: &str = "\
image_width: 640
image_height: 480
camera_name: left
camera_matrix:
  rows: 3
  cols: 3
  data: [615.0, 0, 320.5, 0, 616.0, 241.5, 0, 0, 1]
distortion_model: plumb_bob
distortion_coefficients:
  rows: 1
  cols: 5
  data: [0.1, -0.2, 0.001, 0.002, 0.05]
";

    const MESSAGE: &str = "\
header: {seq: 0, frame_id: left}
height: 480
width: 640
distortion_model: plumb_bob
D: [0.1, -0.2, 0.001, 0.002, 0.05]
K: [615.0, 0.0, 320.5, 0.0, 616.0, 241.5, 0.0, 0.0, 1.0]
";

    #[test]
    fn files_and_messages_give_the_same_lens() {
        assert!(is_camera_info(FILE) && is_camera_info(MESSAGE));
        let file = import(FILE, &["left", "right"]).unwrap();
        let message = import(MESSAGE, &["left"]).unwrap();
        assert_eq!(file.camera[0], message.camera[0]);
        let lens = file.camera[0].color_lens.unwrap();
        assert_eq!((lens.focal_px, lens.principal_px), ([615.0, 616.0], [320.5, 241.5]));
        assert_eq!(lens.distortion, [0.1, -0.2, 0.001, 0.002, 0.05]);
        assert_eq!(file.camera[1].color_lens, None, "the other camera stays as it is");
    }

    #[test]
    fn what_cannot_be_used_is_named() {
        let error = |text: &str, names: &[&str]| import(text, names).unwrap_err();
        assert!(error(FILE, &["right", "third"]).contains("camera_name"));
        let fisheye = FILE.replace("plumb_bob", "rational_polynomial");
        assert!(error(&fisheye, &["left"]).contains("plumb_bob"));
    }
}
