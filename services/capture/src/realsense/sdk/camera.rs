//! One camera, or one recording played by the SDK: its pipeline and calibration.

use std::ffi::{CStr, c_int, c_void};
use std::os::unix::ffi::OsStrExt;
use std::path::PathBuf;
use std::ptr::null_mut;
use std::sync::Arc;
use std::time::Duration;

use orime_geometry::{CameraModel, RgbdCamera};
use orime_recording::realsense::{Extrinsics, forward_distortion};

use super::{
    DISTORTION_INVERSE, EXTENSION_DEPTH_SENSOR, FORMAT_RGB8, FORMAT_Z16, Frame, Handle,
    PLAYBACK_STOPPED, RawExtrinsics, RawIntrinsics, STREAM_COLOR, STREAM_DEPTH, Sdk, SdkError,
    c_text,
};

type Object = *mut c_void;

/// What to open.
#[derive(Debug, Clone, PartialEq)]
pub(in crate::realsense) struct Wanted {
    /// Name for people.
    pub name: String,
    /// Serial number; any camera if it is empty.
    pub serial: String,
    /// A recording to play instead of a camera.
    pub file: Option<PathBuf>,
    /// Whether a recording is played at its own pace, as a camera would send.
    pub real_time: bool,
    /// Width and height of depth and of colour.
    pub depth_px: [u32; 2],
    /// See `depth_px`.
    pub color_px: [u32; 2],
    /// Frames per second of both.
    pub fps: u32,
    /// Options by the SDK's names, set on whichever sensor has them.
    pub options: Vec<(String, f64)>,
}

/// A running pipeline.
pub(in crate::realsense) struct Opened {
    sdk: Arc<Sdk>,
    pipeline: Handle,
    profile: Handle,
    device: Handle,
    is_file: bool,
    /// The camera; it is the world.
    pub camera: RgbdCamera,
}

/// Most options that the SDK has.
const OPTIONS_MAX: c_int = 256;

impl Opened {
    /// Starts the pipeline.
    pub fn start(sdk: &Arc<Sdk>, wanted: &Wanted) -> Result<Self, SdkError> {
        let pipeline = call!(sdk, create_pipeline(sdk.context))?;
        let pipeline = sdk.handle(pipeline, sdk.api.delete_pipeline);
        let config = configure(sdk, wanted)?;
        let profile = call!(sdk, pipeline_start_with_config(pipeline.object, config.object))
            .map_err(|error| explain(sdk, wanted, error))?;
        let profile = sdk.handle(profile, sdk.api.delete_pipeline_profile);
        let device = call!(sdk, pipeline_profile_get_device(profile.object))?;
        let device = sdk.handle(device, sdk.api.delete_device);
        if wanted.file.is_some() {
            let real_time = c_int::from(wanted.real_time);
            call!(sdk, playback_device_set_real_time(device.object, real_time))?;
        }
        let mut unit_m = None;
        for sensor in sensors(sdk, &device)? {
            let is_depth =
                call!(sdk, is_sensor_extendable_to(sensor.object, EXTENSION_DEPTH_SENSOR))?;
            if is_depth != 0 {
                unit_m = Some(call!(sdk, get_depth_scale(sensor.object))?);
            }
            if wanted.file.is_none() {
                set_options(sdk, &sensor, &wanted.options)?;
            }
        }
        let camera = calibration(sdk, wanted, &profile, unit_m)?;
        let (sdk, is_file) = (Arc::clone(sdk), wanted.file.is_some());
        Ok(Self { sdk, pipeline, profile, device, is_file, camera })
    }

    /// Waits for frames of one instant; `None` if none came.
    pub fn wait(&self, longest: Duration) -> Result<Option<Vec<Frame>>, SdkError> {
        let mut set: Object = null_mut();
        let wait_ms = longest.as_millis() as u32;
        let came =
            call!(self.sdk, pipeline_try_wait_for_frames(self.pipeline.object, &mut set, wait_ms))?;
        if came == 0 || set.is_null() {
            return Ok(None);
        }
        let set = self.sdk.handle(set, self.sdk.api.release_frame);
        let mut frames = Vec::with_capacity(2);
        for k in 0..call!(self.sdk, embedded_frames_count(set.object))? {
            let frame = call!(self.sdk, extract_frame(set.object, k))?;
            frames.push(Frame::new(self.sdk.handle(frame, self.sdk.api.release_frame))?);
        }
        Ok(Some(frames))
    }

    /// Whether a recording has come to its end.
    pub fn is_at_end(&self) -> bool {
        let status = || call!(self.sdk, playback_device_get_current_status(self.device.object));
        self.is_file && matches!(status(), Ok(PLAYBACK_STOPPED))
    }
}

impl Drop for Opened {
    fn drop(&mut self) {
        // A camera that is gone cannot be stopped: nothing is left to do about that.
        let _ = call!(self.sdk, pipeline_stop(self.pipeline.object));
        let _ = &self.profile;
    }
}

fn configure(sdk: &Arc<Sdk>, wanted: &Wanted) -> Result<Handle, SdkError> {
    let config = call!(sdk, create_config())?;
    let config = sdk.handle(config, sdk.api.delete_config);
    if let Some(file) = &wanted.file {
        let path = std::ffi::CString::new(file.as_os_str().as_bytes())
            .map_err(|_| SdkError::NoCamera(format!("`{}` holds a zero byte", file.display())))?;
        call!(sdk, config_enable_device_from_file_repeat_option(config.object, path.as_ptr(), 0))?;
        return Ok(config);
    }
    if !wanted.serial.is_empty() {
        let serial = c_text(&wanted.serial)?;
        call!(sdk, config_enable_device(config.object, serial.as_ptr()))?;
    }
    let streams =
        [(STREAM_DEPTH, wanted.depth_px, FORMAT_Z16), (STREAM_COLOR, wanted.color_px, FORMAT_RGB8)];
    for (stream, [width, height], format) in streams {
        let [width, height, fps] = [width, height, wanted.fps].map(|n| n as c_int);
        call!(sdk, config_enable_stream(config.object, stream, -1, width, height, format, fps))?;
    }
    Ok(config)
}

/// Says what is there, where what was wanted is not.
fn explain(sdk: &Arc<Sdk>, wanted: &Wanted, error: SdkError) -> SdkError {
    if let Some(file) = &wanted.file {
        return SdkError::NoCamera(format!(
            "the SDK {} cannot play `{}`: {error}; .bag is of SDK 2.56 and before, .db3 of later \
             ones",
            sdk.version,
            file.display()
        ));
    }
    let present = sdk.cameras().unwrap_or_default();
    let list: Vec<String> =
        present.iter().map(|[name, serial]| format!("{serial} ({name})")).collect();
    let list = if list.is_empty() { "none".to_owned() } else { list.join(", ") };
    let Wanted { name, serial, depth_px, color_px, fps, .. } = wanted;
    SdkError::NoCamera(format!(
        "camera `{name}` (serial `{serial}`, depth {depth_px:?}, colour {color_px:?}, {fps} Hz) \
         cannot be started: {error}; plugged in are: {list}. Check the cable (USB 3), the udev \
         rules, whether another program has the camera, and whether it has such a profile \
         (`rs-enumerate-devices`)"
    ))
}

fn sensors(sdk: &Arc<Sdk>, device: &Handle) -> Result<Vec<Handle>, SdkError> {
    let list = call!(sdk, query_sensors(device.object))?;
    let list = sdk.handle(list, sdk.api.delete_sensor_list);
    let mut found = Vec::new();
    for k in 0..call!(sdk, get_sensors_count(list.object))? {
        let sensor = call!(sdk, create_sensor(list.object, k))?;
        found.push(sdk.handle(sensor, sdk.api.delete_sensor));
    }
    Ok(found)
}

/// Sets those of the options that this sensor has.
fn set_options(sdk: &Arc<Sdk>, sensor: &Handle, options: &[(String, f64)]) -> Result<(), SdkError> {
    for number in 0..OPTIONS_MAX {
        // SAFETY: the function takes any number, and gives a text that is never freed.
        let name = unsafe { (sdk.api.option_to_string)(number) };
        if name.is_null() {
            continue;
        }
        // SAFETY: as above.
        let name = unsafe { CStr::from_ptr(name) }.to_string_lossy();
        let Some((_, value)) = options.iter().find(|(key, _)| is_option(key, &name)) else {
            continue;
        };
        if call!(sdk, supports_option(sensor.object, number))? != 0 {
            call!(sdk, set_option(sensor.object, number, *value as f32))?;
        }
    }
    Ok(())
}

/// Whether a key of a set, as `laser_power`, is the SDK's `Laser Power`.
fn is_option(key: &str, name: &str) -> bool {
    name.len() == key.len() && name.to_lowercase().replace([' ', '-'], "_") == key
}

fn calibration(
    sdk: &Arc<Sdk>,
    wanted: &Wanted,
    profile: &Handle,
    unit_m: Option<f32>,
) -> Result<RgbdCamera, SdkError> {
    let list = call!(sdk, pipeline_profile_get_streams(profile.object))?;
    let list = sdk.handle(list, sdk.api.delete_stream_profiles_list);
    let (mut depth, mut color) = (None, None);
    for k in 0..call!(sdk, get_stream_profiles_count(list.object))? {
        let stream = call!(sdk, get_stream_profile(list.object, k))?;
        let [kind, ..] = super::frame::profile_data(sdk, stream)?;
        match kind {
            STREAM_DEPTH => depth = depth.or(Some(stream)),
            STREAM_COLOR => color = color.or(Some(stream)),
            _ => {}
        }
    }
    let (Some(depth), Some(color), Some(unit_m)) = (depth, color, unit_m) else {
        return Err(SdkError::NoCamera(format!(
            "camera `{}` has no depth and colour stream, or no depth unit",
            wanted.name
        )));
    };
    let mut extrinsics = RawExtrinsics::default();
    call!(sdk, get_extrinsics(depth, color, &mut extrinsics))?;
    let extrinsics =
        Extrinsics { rotation: extrinsics.rotation, translation_m: extrinsics.translation };
    Ok(RgbdCamera {
        name: wanted.name.clone(),
        color: lens(sdk, color)?,
        depth: lens(sdk, depth)?,
        color_from_depth: extrinsics.isometry(),
        world_from_color: Default::default(),
        depth_m_per_unit: f64::from(unit_m),
    })
}

fn lens(sdk: &Arc<Sdk>, stream: Object) -> Result<CameraModel, SdkError> {
    let mut raw = RawIntrinsics::default();
    call!(sdk, get_video_stream_intrinsics(stream, &mut raw))?;
    let lens = CameraModel {
        width: raw.width as u32,
        height: raw.height as u32,
        fx_px: f64::from(raw.fx),
        fy_px: f64::from(raw.fy),
        cx_px: f64::from(raw.ppx),
        cy_px: f64::from(raw.ppy),
        distortion: raw.coeffs.map(f64::from),
    };
    Ok(if raw.model == DISTORTION_INVERSE { forward_distortion(&lens) } else { lens })
}

#[cfg(test)]
mod tests {
    use super::is_option;

    #[test]
    fn options_are_found_by_plain_names() {
        assert!(is_option("laser_power", "Laser Power"));
        assert!(is_option("auto_exposure_limit", "Auto-Exposure Limit"));
        assert!(!is_option("exposure", "Enable Auto Exposure"));
    }
}
