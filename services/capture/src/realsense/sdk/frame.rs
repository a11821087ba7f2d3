//! One frame that the SDK holds.

use std::ffi::{c_int, c_void};
use std::sync::Arc;

use orime_geometry::CameraModel;

use super::{
    FORMAT_BGR8, FORMAT_RGB8, FORMAT_Z16, Handle, STREAM_COLOR, STREAM_DEPTH, Sdk, SdkError,
};

type Object = *mut c_void;

/// A frame; its pixels stay where the SDK wrote them until it is dropped.
pub(in crate::realsense) struct Frame {
    handle: Handle,
    stream: c_int,
    format: c_int,
    time_ms: f64,
}

/// Stream, format, index, unique number and rate of a stream profile.
pub(super) fn profile_data(sdk: &Arc<Sdk>, profile: Object) -> Result<[c_int; 5], SdkError> {
    let [mut stream, mut format, mut index, mut unique, mut fps] = [0; 5];
    call!(
        sdk,
        get_stream_profile_data(
            profile,
            &mut stream,
            &mut format,
            &mut index,
            &mut unique,
            &mut fps
        )
    )?;
    Ok([stream, format, index, unique, fps])
}

impl Frame {
    pub(super) fn new(handle: Handle) -> Result<Self, SdkError> {
        let sdk = &handle.sdk;
        let profile = call!(sdk, get_frame_stream_profile(handle.object))?;
        let [stream, format, ..] = profile_data(sdk, profile)?;
        let time_ms = call!(sdk, get_frame_timestamp(handle.object))?;
        Ok(Self { stream, format, time_ms, handle })
    }

    /// Time stamp of the frame's clock, nanoseconds.
    pub fn time_ns(&self) -> u64 {
        (self.time_ms * 1e6).round() as u64
    }

    pub fn is_depth(&self) -> bool {
        self.stream == STREAM_DEPTH
    }

    pub fn is_color(&self) -> bool {
        self.stream == STREAM_COLOR
    }

    /// The rows of the image, `bytes` used of each.
    fn rows(
        &self,
        lens: &CameraModel,
        bytes: usize,
    ) -> Result<impl Iterator<Item = &[u8]>, String> {
        let (sdk, object) = (&self.handle.sdk, self.handle.object);
        let text = |error: SdkError| error.to_string();
        let data = call!(sdk, get_frame_data(object)).map_err(text)?;
        let size = call!(sdk, get_frame_data_size(object)).map_err(text)? as usize;
        let stride = call!(sdk, get_frame_stride_in_bytes(object)).map_err(text)? as usize;
        let (used, height) = (lens.width as usize * bytes, lens.height as usize);
        if data.is_null() || stride < used || size < stride * height.saturating_sub(1) + used {
            return Err(format!("the frame has {size} bytes in rows of {stride}, not {used}"));
        }
        // SAFETY: the SDK states size and place, and keeps them while the handle lives.
        let all = unsafe { std::slice::from_raw_parts(data.cast::<u8>(), size) };
        Ok(all.chunks(stride).take(height).map(move |row| &row[..used]))
    }

    /// Writes depth.
    pub fn write_depth(&self, lens: &CameraModel, units: &mut [u16]) -> Result<(), String> {
        if self.format != FORMAT_Z16 {
            return Err(format!("depth has the SDK's format {}, not Z16", self.format));
        }
        let rows = self.rows(lens, 2)?;
        for (to, row) in units.chunks_exact_mut(lens.width as usize).zip(rows) {
            for (to, from) in to.iter_mut().zip(row.as_chunks::<2>().0) {
                *to = u16::from_le_bytes(*from);
            }
        }
        Ok(())
    }

    /// Writes colour.
    pub fn write_color(&self, lens: &CameraModel, rgb: &mut [u8]) -> Result<(), String> {
        if self.format != FORMAT_RGB8 && self.format != FORMAT_BGR8 {
            return Err(format!("colour has the SDK's format {}, not RGB8 or BGR8", self.format));
        }
        let rows = self.rows(lens, 3)?;
        for (to, row) in rgb.chunks_exact_mut(3 * lens.width as usize).zip(rows) {
            to.copy_from_slice(row);
            if self.format == FORMAT_BGR8 {
                to.as_chunks_mut::<3>().0.iter_mut().for_each(|pixel| pixel.reverse());
            }
        }
        Ok(())
    }
}
