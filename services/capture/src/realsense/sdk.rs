//! librealsense2, loaded at run time through its C API.
//!
//! Orime builds and runs where the SDK is not installed. What is called here has kept its form
//! since SDK 2.50; the library is told the API version that it states itself.

use std::ffi::{CStr, c_char, c_float, c_int, c_void};
use std::path::{Path, PathBuf};
use std::ptr::null_mut;
use std::sync::Arc;

use libloading::os::unix::{Library, RTLD_GLOBAL, RTLD_LAZY};

/// Names that the library has in packages, newest first.
const NAMES: [&str; 6] = [
    "librealsense2.so",
    "librealsense2.so.2.58",
    "librealsense2.so.2.57",
    "librealsense2.so.2.56",
    "librealsense2.so.2.55",
    "librealsense2.so.2.54",
];

/// Why the SDK cannot be used, or what it says of a camera.
#[derive(Debug, Clone, thiserror::Error)]
#[non_exhaustive]
pub enum SdkError {
    /// The library cannot be loaded.
    #[error(
        "the RealSense SDK is not there ({message}): install `librealsense2` (docs/cameras.md), \
         or name the library in `capture.realsense.library`; `deploy/fetch-realsense` fetches one"
    )]
    Library {
        /// What the loader said.
        message: String,
    },
    /// A call failed.
    #[error("{message} ({function})")]
    Call {
        /// What the SDK said.
        message: String,
        /// In which function.
        function: String,
    },
    /// No such camera.
    #[error("{0}")]
    NoCamera(String),
}

type Object = *mut c_void;
type ErrorOut = *mut Object;
type FrameCallback = unsafe extern "C" fn(Object, *mut c_void);

/// `rs2_intrinsics`.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct RawIntrinsics {
    pub width: c_int,
    pub height: c_int,
    pub ppx: c_float,
    pub ppy: c_float,
    pub fx: c_float,
    pub fy: c_float,
    pub model: c_int,
    pub coeffs: [c_float; 5],
}

/// `rs2_extrinsics`.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct RawExtrinsics {
    pub rotation: [c_float; 9],
    pub translation: [c_float; 3],
}

macro_rules! api {
    ($($name:ident($($arg:ty),*) $(-> $result:ty)?;)*) => {
        /// The functions that are used, by their names without `rs2_`.
        struct Api { $($name: unsafe extern "C" fn($($arg),*) $(-> $result)?,)* }

        impl Api {
            fn load(library: &Library) -> Result<Self, SdkError> {
                $(
                    // SAFETY: the signatures are those of the SDK's headers; the pointers live as
                    // long as the library, which `Sdk` keeps.
                    let $name = unsafe {
                        *library
                            .get(concat!("rs2_", stringify!($name), "\0").as_bytes())
                            .map_err(|error| not_loaded(&error))?
                    };
                )*
                Ok(Self { $($name,)* })
            }
        }
    };
}

api! {
    get_api_version(ErrorOut) -> c_int;
    get_error_message(Object) -> *const c_char;
    get_failed_function(Object) -> *const c_char;
    free_error(Object);
    create_context(c_int, ErrorOut) -> Object;
    delete_context(Object);
    query_devices(Object, ErrorOut) -> Object;
    get_device_count(Object, ErrorOut) -> c_int;
    create_device(Object, c_int, ErrorOut) -> Object;
    delete_device_list(Object);
    delete_device(Object);
    get_device_info(Object, c_int, ErrorOut) -> *const c_char;
    context_add_device(Object, *const c_char, ErrorOut) -> Object;
    context_remove_device(Object, *const c_char, ErrorOut);
    get_stream_profiles(Object, ErrorOut) -> Object;
    get_video_stream_resolution(Object, *mut c_int, *mut c_int, ErrorOut);
    open_multiple(Object, *mut Object, c_int, ErrorOut);
    start(Object, FrameCallback, *mut c_void, ErrorOut);
    stop(Object, ErrorOut);
    close(Object, ErrorOut);
    get_stream_profiles_count(Object, ErrorOut) -> c_int;
    get_stream_profile(Object, c_int, ErrorOut) -> Object;
    delete_stream_profiles_list(Object);
    get_stream_profile_data(
        Object, *mut c_int, *mut c_int, *mut c_int, *mut c_int, *mut c_int, ErrorOut
    );
    get_video_stream_intrinsics(Object, *mut RawIntrinsics, ErrorOut);
    get_extrinsics(Object, Object, *mut RawExtrinsics, ErrorOut);
    query_sensors(Object, ErrorOut) -> Object;
    get_sensors_count(Object, ErrorOut) -> c_int;
    create_sensor(Object, c_int, ErrorOut) -> Object;
    delete_sensor(Object);
    delete_sensor_list(Object);
    is_sensor_extendable_to(Object, c_int, ErrorOut) -> c_int;
    get_depth_scale(Object, ErrorOut) -> c_float;
    supports_option(Object, c_int, ErrorOut) -> c_int;
    set_option(Object, c_int, c_float, ErrorOut);
    option_to_string(c_int) -> *const c_char;
    playback_device_set_real_time(Object, c_int, ErrorOut);
    playback_device_pause(Object, ErrorOut);
    playback_device_resume(Object, ErrorOut);
    playback_device_get_current_status(Object, ErrorOut) -> c_int;
    release_frame(Object);
    get_frame_data(Object, ErrorOut) -> *const c_void;
    get_frame_data_size(Object, ErrorOut) -> c_int;
    get_frame_stride_in_bytes(Object, ErrorOut) -> c_int;
    get_frame_timestamp(Object, ErrorOut) -> f64;
    get_frame_stream_profile(Object, ErrorOut) -> Object;
}

/// The loaded SDK and its context.
pub(super) struct Sdk {
    api: Api,
    context: Object,
    /// Version of the library, as `2.59.1`.
    pub version: String,
    // Last, so that it outlives what points into it; never unloaded, for the SDK's own threads
    // may still run.
    _libraries: std::mem::ManuallyDrop<Vec<Library>>,
}

// SAFETY: the SDK's contexts, pipelines and frames may be used from any thread.
unsafe impl Send for Sdk {}
// SAFETY: as above; the SDK locks its own state.
unsafe impl Sync for Sdk {}

/// An object of the SDK, given back on drop.
pub(super) struct Handle {
    sdk: Arc<Sdk>,
    object: Object,
    give_back: unsafe extern "C" fn(Object),
}

// SAFETY: as for `Sdk`.
unsafe impl Send for Handle {}

impl Drop for Handle {
    fn drop(&mut self) {
        // SAFETY: the object is this handle's own, and is given back once.
        unsafe { (self.give_back)(self.object) }
    }
}

/// Calls a function of the SDK whose last argument takes its error.
macro_rules! call {
    ($sdk:expr, $name:ident($($arg:expr),*)) => {{
        let mut error: Object = std::ptr::null_mut();
        // SAFETY: objects are alive as long as their handles, texts as long as the call.
        let result = unsafe { ($sdk.api.$name)($($arg,)* &mut error) };
        $sdk.check(error).map(|()| result)
    }};
}

mod camera;
mod frame;
mod inbox;

pub(super) use camera::{Opened, Wanted};
pub(super) use frame::Frame;

impl Sdk {
    /// Loads the library; before it, globally, the libraries in `preload`.
    pub fn load(library: Option<&Path>, preload: &[PathBuf]) -> Result<Arc<Self>, SdkError> {
        let open = |path: &Path, flags| {
            // SAFETY: loading runs the library's initialisers; it is the one that the user named
            // or installed.
            unsafe { Library::open(Some(path), flags) }.map_err(|error| not_loaded(&error))
        };
        let mut libraries = Vec::new();
        for path in preload {
            libraries.push(open(path, RTLD_LAZY | RTLD_GLOBAL)?);
        }
        let main = match library {
            Some(path) => open(path, RTLD_LAZY)?,
            None => {
                let mut tries = NAMES.iter().map(|name| open(Path::new(name), RTLD_LAZY));
                let first = tries
                    .next()
                    .unwrap_or(Err(SdkError::Library { message: "no name is known".to_owned() }));
                first.or_else(|error| tries.find_map(Result::ok).ok_or(error))?
            }
        };
        let api = Api::load(&main)?;
        libraries.push(main);
        let libraries = std::mem::ManuallyDrop::new(libraries);
        let mut sdk =
            Self { api, context: null_mut(), version: String::new(), _libraries: libraries };
        let number = call!(sdk, get_api_version())?;
        sdk.version = format!("{}.{}.{}", number / 10_000, number / 100 % 100, number % 100);
        sdk.context = call!(sdk, create_context(number))?;
        Ok(Arc::new(sdk))
    }

    /// Turns the SDK's error into ours, and frees it.
    fn check(&self, error: Object) -> Result<(), SdkError> {
        if error.is_null() {
            return Ok(());
        }
        let text = |get: unsafe extern "C" fn(Object) -> *const c_char| {
            // SAFETY: the error is alive, and its texts with it.
            let text = unsafe { CStr::from_ptr(get(error)) };
            text.to_string_lossy().into_owned()
        };
        let message = text(self.api.get_error_message);
        let function = text(self.api.get_failed_function);
        // SAFETY: the error is not used again.
        unsafe { (self.api.free_error)(error) };
        Err(SdkError::Call { message, function })
    }

    fn handle(self: &Arc<Self>, object: Object, give_back: unsafe extern "C" fn(Object)) -> Handle {
        Handle { sdk: Arc::clone(self), object, give_back }
    }

    /// Name and serial number of every camera that is plugged in.
    pub fn cameras(self: &Arc<Self>) -> Result<Vec<[String; 2]>, SdkError> {
        let list = call!(self, query_devices(self.context))?;
        let list = self.handle(list, self.api.delete_device_list);
        let mut found = Vec::new();
        for k in 0..call!(self, get_device_count(list.object))? {
            let device = call!(self, create_device(list.object, k))?;
            let device = self.handle(device, self.api.delete_device);
            found.push([self.info(&device, INFO_NAME)?, self.info(&device, INFO_SERIAL)?]);
        }
        Ok(found)
    }
}

impl Sdk {
    fn info(&self, device: &Handle, which: c_int) -> Result<String, SdkError> {
        let text = call!(self, get_device_info(device.object, which))?;
        // SAFETY: the text lives as long as the device.
        Ok(unsafe { CStr::from_ptr(text) }.to_string_lossy().into_owned())
    }
}

impl Drop for Sdk {
    fn drop(&mut self) {
        if !self.context.is_null() {
            // SAFETY: every handle holds the SDK, so that none is left.
            unsafe { (self.api.delete_context)(self.context) }
        }
    }
}

/// The loader's error with its cause, which names the file.
fn not_loaded(error: &libloading::Error) -> SdkError {
    let cause = std::error::Error::source(error);
    let message = cause.map_or(error.to_string(), |cause| format!("{error}: {cause}"));
    SdkError::Library { message }
}

/// Numbers of the SDK's enumerations that are used.
const INFO_NAME: c_int = 0;
const INFO_SERIAL: c_int = 1;
const STREAM_DEPTH: c_int = 1;
const STREAM_COLOR: c_int = 2;
const FORMAT_Z16: c_int = 1;
const FORMAT_RGB8: c_int = 5;
const FORMAT_BGR8: c_int = 6;
const EXTENSION_DEPTH_SENSOR: c_int = 7;
const PLAYBACK_STOPPED: c_int = 3;
const DISTORTION_INVERSE: c_int = 2;
