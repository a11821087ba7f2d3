//! One camera, or one recording played by the SDK: its sensors, profiles and calibration.
//!
//! Sensors are started one by one, not through the SDK's pipeline: its synchroniser gives frames
//! twice and loses the first ones of a recording (SDK 2.56).

use std::collections::BTreeMap;
use std::ffi::{CStr, CString, c_int, c_void};
use std::os::unix::ffi::OsStrExt;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use orime_geometry::{CameraModel, RgbdCamera};
use orime_recording::realsense::{Extrinsics, forward_distortion};

use super::inbox::{Inbox, on_frame};
use super::{
    DISTORTION_INVERSE, EXTENSION_DEPTH_SENSOR, FORMAT_RGB8, FORMAT_Z16, Frame, Handle,
    INFO_SERIAL, PLAYBACK_STOPPED, RawExtrinsics, RawIntrinsics, STREAM_COLOR, STREAM_DEPTH, Sdk,
    SdkError,
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

/// A camera that sends.
pub(in crate::realsense) struct Opened {
    sdk: Arc<Sdk>,
    device: Handle,
    /// Sensors that were opened.
    sensors: Vec<Handle>,
    /// The profiles' owners.
    _profiles: Vec<Handle>,
    file: Option<CString>,
    inbox: Arc<Inbox>,
    /// The camera; it is the world.
    pub camera: RgbdCamera,
    /// Time between two frames of the slower stream, nanoseconds.
    pub period_ns: u64,
}

/// Most options that the SDK has.
const OPTIONS_MAX: c_int = 256;

/// The profile of a stream, and the sensor that has it.
#[derive(Debug, Clone, Copy)]
struct Chosen {
    sensor: usize,
    profile: Object,
    fps: c_int,
}

impl Opened {
    /// Finds the camera and starts its depth and colour stream.
    pub fn start(sdk: &Arc<Sdk>, wanted: &Wanted) -> Result<Self, SdkError> {
        let explain = |error| explain(sdk, wanted, error);
        let (device, file) = match &wanted.file {
            Some(file) => {
                let (device, path) = play(sdk, file, wanted.real_time).map_err(explain)?;
                (device, Some(path))
            }
            None => (plugged_in(sdk, &wanted.serial).map_err(explain)?, None),
        };
        let mut sensors = sensors(sdk, &device)?;
        let mut unit_m = None;
        for sensor in &sensors {
            let is_depth =
                call!(sdk, is_sensor_extendable_to(sensor.object, EXTENSION_DEPTH_SENSOR))?;
            if is_depth != 0 {
                unit_m = Some(call!(sdk, get_depth_scale(sensor.object))?);
            }
            if file.is_none() {
                set_options(sdk, sensor, &wanted.options).map_err(explain)?;
            }
        }
        let (chosen, profiles) = choose(sdk, wanted, &sensors).map_err(explain)?;
        let camera = calibration(sdk, wanted, chosen, unit_m)?;
        let fps = chosen.map(|stream| stream.fps.max(1)).into_iter().min().unwrap_or(1);
        let used = chosen.map(|stream| stream.sensor);
        let mut number = 0;
        sensors.retain(|_| {
            number += 1;
            used.contains(&(number - 1))
        });
        let mut by_sensor: BTreeMap<usize, Vec<Object>> = BTreeMap::new();
        for Chosen { sensor, profile, .. } in chosen {
            by_sensor.entry(sensor).or_default().push(profile);
        }
        let mut opened = Self {
            inbox: Inbox::new(sdk, file.is_some() && !wanted.real_time),
            sdk: Arc::clone(sdk),
            device,
            sensors: Vec::new(),
            _profiles: profiles,
            file,
            camera,
            period_ns: 1_000_000_000 / fps as u64,
        };
        for (sensor, mut profiles) in sensors.into_iter().zip(by_sensor.into_values()) {
            let count = profiles.len() as c_int;
            call!(sdk, open_multiple(sensor.object, profiles.as_mut_ptr(), count))
                .map_err(explain)?;
            opened.sensors.push(sensor);
        }
        if opened.file.is_some() {
            // Or the first frames are gone before the second sensor listens.
            call!(sdk, playback_device_pause(opened.device.object)).map_err(explain)?;
        }
        let inbox = Arc::as_ptr(&opened.inbox).cast_mut().cast::<c_void>();
        for sensor in &opened.sensors {
            call!(sdk, start(sensor.object, on_frame, inbox)).map_err(explain)?;
        }
        if opened.file.is_some() {
            call!(sdk, playback_device_resume(opened.device.object)).map_err(explain)?;
        }
        Ok(opened)
    }

    /// Waits for a frame, of the wanted stream (0 depth, 1 colour) first; `None` if none came.
    pub fn wait(&self, wanted: Option<usize>, longest: Duration) -> Option<Frame> {
        self.inbox.take(wanted, longest)
    }

    /// Whether a recording has come to its end.
    pub fn is_at_end(&self) -> bool {
        let status = || call!(self.sdk, playback_device_get_current_status(self.device.object));
        self.file.is_some() && matches!(status(), Ok(PLAYBACK_STOPPED))
    }
}

impl Drop for Opened {
    fn drop(&mut self) {
        self.inbox.close();
        // A camera that is gone cannot be stopped: nothing is left to do about that.
        for sensor in &self.sensors {
            let _ = call!(self.sdk, stop(sensor.object));
            let _ = call!(self.sdk, close(sensor.object));
        }
        if let Some(file) = &self.file {
            let _ = call!(self.sdk, context_remove_device(self.sdk.context, file.as_ptr()));
        }
    }
}

/// Opens a recording as a device.
fn play(
    sdk: &Arc<Sdk>,
    file: &std::path::Path,
    real_time: bool,
) -> Result<(Handle, CString), SdkError> {
    let path = CString::new(file.as_os_str().as_bytes())
        .map_err(|_| SdkError::NoCamera(format!("`{}` holds a zero byte", file.display())))?;
    let device = call!(sdk, context_add_device(sdk.context, path.as_ptr()))?;
    let device = sdk.handle(device, sdk.api.delete_device);
    call!(sdk, playback_device_set_real_time(device.object, c_int::from(real_time)))?;
    Ok((device, path))
}

/// The camera with this serial number, or any.
fn plugged_in(sdk: &Arc<Sdk>, serial: &str) -> Result<Handle, SdkError> {
    let list = call!(sdk, query_devices(sdk.context))?;
    let list = sdk.handle(list, sdk.api.delete_device_list);
    for k in 0..call!(sdk, get_device_count(list.object))? {
        let device = call!(sdk, create_device(list.object, k))?;
        let device = sdk.handle(device, sdk.api.delete_device);
        if serial.is_empty() || sdk.info(&device, INFO_SERIAL)? == serial {
            return Ok(device);
        }
    }
    Err(SdkError::NoCamera("no such camera is plugged in".to_owned()))
}

/// Says what is there, where what was wanted is not.
fn explain(sdk: &Arc<Sdk>, wanted: &Wanted, error: SdkError) -> SdkError {
    if let Some(file) = &wanted.file {
        return SdkError::NoCamera(format!(
            "the SDK {} cannot play `{}`: {error}; is the file there? .db3 needs SDK 2.57 or later",
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

/// The profiles of depth and colour that are wanted; of a recording, those that it has. With
/// them, the lists that own them.
fn choose(
    sdk: &Arc<Sdk>,
    wanted: &Wanted,
    sensors: &[Handle],
) -> Result<([Chosen; 2], Vec<Handle>), SdkError> {
    let mut lists = Vec::new();
    let mut chosen = [None; 2];
    for (sensor, handle) in sensors.iter().enumerate() {
        let list = call!(sdk, get_stream_profiles(handle.object))?;
        let list = sdk.handle(list, sdk.api.delete_stream_profiles_list);
        for k in 0..call!(sdk, get_stream_profiles_count(list.object))? {
            let profile = call!(sdk, get_stream_profile(list.object, k))?;
            let [stream, format, _, _, fps] = super::frame::profile_data(sdk, profile)?;
            let (place, right_format, size) = match stream {
                STREAM_DEPTH => (0, FORMAT_Z16, wanted.depth_px),
                STREAM_COLOR => (1, FORMAT_RGB8, wanted.color_px),
                _ => continue,
            };
            let [mut width, mut height] = [0, 0];
            call!(sdk, get_video_stream_resolution(profile, &mut width, &mut height))?;
            let fits = format == right_format
                && [width, height] == size.map(|n| n as c_int)
                && fps == wanted.fps as c_int;
            if chosen[place].is_none() && (fits || wanted.file.is_some()) {
                chosen[place] = Some(Chosen { sensor, profile, fps });
            }
        }
        lists.push(list);
    }
    match chosen {
        [Some(depth), Some(color)] => Ok(([depth, color], lists)),
        [depth, _] => {
            let which = if depth.is_none() { "depth" } else { "colour" };
            Err(SdkError::NoCamera(format!("it has no such {which} stream")))
        }
    }
}

fn calibration(
    sdk: &Arc<Sdk>,
    wanted: &Wanted,
    [depth, color]: [Chosen; 2],
    unit_m: Option<f32>,
) -> Result<RgbdCamera, SdkError> {
    let Some(unit_m) = unit_m else {
        let name = &wanted.name;
        return Err(SdkError::NoCamera(format!("camera `{name}` says no depth unit")));
    };
    let mut extrinsics = RawExtrinsics::default();
    call!(sdk, get_extrinsics(depth.profile, color.profile, &mut extrinsics))?;
    let extrinsics =
        Extrinsics { rotation: extrinsics.rotation, translation_m: extrinsics.translation };
    Ok(RgbdCamera {
        name: wanted.name.clone(),
        color: lens(sdk, color.profile)?,
        depth: lens(sdk, depth.profile)?,
        color_from_depth: extrinsics.isometry(),
        world_from_color: Default::default(),
        depth_m_per_unit: f64::from(unit_m),
    })
}

fn lens(sdk: &Arc<Sdk>, profile: Object) -> Result<CameraModel, SdkError> {
    let mut raw = RawIntrinsics::default();
    call!(sdk, get_video_stream_intrinsics(profile, &mut raw))?;
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
