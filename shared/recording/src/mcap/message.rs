//! Foxglove's messages: from geometry and back.

use orime_geometry::nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion};
use orime_geometry::{CameraModel, ObservedPoint, SheetGrid};

use super::topic;
use super::wire::{Fields, Malformed, Value, fields};

/// How far a rotation's quaternion may be from unit length.
const UNIT_DEFECT_MAX: f64 = 1e-9;
/// `foxglove.PackedElementField.NumericType`.
const UINT32: u64 = 5;
const FLOAT32: u64 = 7;
/// The sheet's colour in viewers: red, green, blue, opacity.
const ESTIMATE_RGBA: [f64; 4] = [0.95, 0.65, 0.15, 0.9];
const TRUTH_RGBA: [f64; 4] = [0.2, 0.7, 0.3, 0.5];

fn timestamp(message: &mut Fields<'_>, tag: u32, time_ns: u64) {
    message.message(tag, |stamp| {
        stamp.integer(1, time_ns / 1_000_000_000);
        stamp.integer(2, time_ns % 1_000_000_000);
    });
}

fn numbers(message: &mut Fields<'_>, tag: u32, values: &[f64]) {
    message.message(tag, |nested| {
        (1..).zip(values).for_each(|(tag, value)| nested.double(tag, *value));
    });
}

fn identity_pose(message: &mut Fields<'_>, tag: u32) {
    message.message(tag, |pose| {
        numbers(pose, 1, &[0.0; 3]);
        numbers(pose, 2, &[0.0, 0.0, 0.0, 1.0]);
    });
}

/// Everything of a `foxglove.RawImage` up to the pixels' own bytes, which must follow at once:
/// `frame_id` stands before them though its number is higher (parsers take any order), so that
/// the pixels end the message.
pub(super) fn image_head(
    out: &mut Vec<u8>,
    time_ns: u64,
    frame_id: &str,
    [width, height]: [u32; 2],
    kind: PixelKind,
) {
    let mut message = Fields(out);
    timestamp(&mut message, 1, time_ns);
    message.string(7, frame_id);
    message.fixed32(2, width);
    message.fixed32(3, height);
    message.string(4, kind.encoding());
    message.fixed32(5, width * kind.bytes());
}

/// What a pixel of a `foxglove.RawImage` is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum PixelKind {
    Rgb8,
    /// Little-endian.
    Depth16,
}

impl PixelKind {
    pub(super) fn encoding(self) -> &'static str {
        match self {
            PixelKind::Rgb8 => "rgb8",
            PixelKind::Depth16 => "16UC1",
        }
    }

    pub(super) fn bytes(self) -> u32 {
        match self {
            PixelKind::Rgb8 => 3,
            PixelKind::Depth16 => 2,
        }
    }
}

/// The pixels of a `foxglove.RawImage`: its last field.
pub(super) fn image_pixels(out: &mut Vec<u8>, pixels: &[u8]) {
    Fields(out).bytes(6, pixels);
}

/// `foxglove.CameraCalibration`; `distortion` is stored as it is: `plumb_bob`'s order is ours.
pub(super) fn calibration(out: &mut Vec<u8>, time_ns: u64, frame_id: &str, lens: &CameraModel) {
    let CameraModel { width, height, fx_px, fy_px, cx_px, cy_px, distortion } = lens;
    let mut message = Fields(out);
    timestamp(&mut message, 1, time_ns);
    message.fixed32(2, *width);
    message.fixed32(3, *height);
    message.string(4, "plumb_bob");
    message.doubles(5, distortion);
    message.doubles(6, &[*fx_px, 0.0, *cx_px, 0.0, *fy_px, *cy_px, 0.0, 0.0, 1.0]);
    message.doubles(7, &[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]);
    #[rustfmt::skip]
    message.doubles(8, &[
        *fx_px, 0.0, *cx_px, 0.0,
        0.0, *fy_px, *cy_px, 0.0,
        0.0, 0.0, 1.0, 0.0,
    ]);
    message.string(9, frame_id);
}

/// Reads what [`calibration`] writes.
pub(super) fn read_calibration(message: &[u8]) -> Result<CameraModel, Malformed> {
    let (mut width, mut height, mut distortion, mut matrix) = (0, 0, [0.0; 5], [0.0; 9]);
    let mut model = "";
    for field in fields(message) {
        match field? {
            (2, value) => width = value.u32()?,
            (3, value) => height = value.u32()?,
            (4, value) => model = value.string()?,
            (5, value) => distortion = value.doubles()?,
            (6, value) => matrix = value.doubles()?,
            _ => {}
        }
    }
    let [fx_px, skew, cx_px, _, fy_px, cy_px, ..] = matrix;
    if model != "plumb_bob" || skew != 0.0 {
        return Err(Malformed("the lens is no plumb_bob model without skew"));
    }
    let positive = width > 0 && height > 0 && fx_px > 0.0 && fy_px > 0.0;
    let finite = matrix.iter().chain(&distortion).all(|number| number.is_finite());
    if !positive || !finite {
        return Err(Malformed("sizes and focal lengths must be positive, all numbers finite"));
    }
    Ok(CameraModel { width, height, fx_px, fy_px, cx_px, cy_px, distortion })
}

/// `foxglove.FrameTransform`: maps coordinates of `child` into `parent`, metres.
pub(super) fn transform(
    out: &mut Vec<u8>,
    time_ns: u64,
    [parent, child]: [&str; 2],
    parent_from_child: &Isometry3<f64>,
) {
    let mut message = Fields(out);
    timestamp(&mut message, 1, time_ns);
    message.string(2, parent);
    message.string(3, child);
    numbers(&mut message, 4, parent_from_child.translation.vector.as_slice());
    // nalgebra's order is Foxglove's: x, y, z, w.
    numbers(&mut message, 5, parent_from_child.rotation.coords.as_slice());
}

/// Reads what [`transform`] writes.
pub(super) fn read_transform(message: &[u8]) -> Result<Isometry3<f64>, Malformed> {
    let (mut translation, mut rotation) = ([0.0; 3], [0.0; 4]);
    for field in fields(message) {
        match field? {
            (4, value) => read_numbers(value, &mut translation)?,
            (5, value) => read_numbers(value, &mut rotation)?,
            _ => {}
        }
    }
    let [x, y, z, w] = rotation;
    let rotation = Quaternion::new(w, x, y, z);
    let unit = (rotation.norm() - 1.0).abs() <= UNIT_DEFECT_MAX;
    if !unit || !translation.iter().all(|number| number.is_finite()) {
        return Err(Malformed("the transform is not rigid"));
    }
    // Not normalised again: replay is bit for bit.
    let rotation = UnitQuaternion::new_unchecked(rotation);
    Ok(Isometry3::from_parts(Translation3::from(translation), rotation))
}

/// A nested message of doubles with the tags 1, 2, …; what is absent stays.
fn read_numbers(nested: Value<'_>, values: &mut [f64]) -> Result<(), Malformed> {
    for field in fields(nested.bytes()?) {
        let (tag, value) = field?;
        if let Some(number) = values.get_mut((tag as usize).wrapping_sub(1)) {
            *number = value.double()?;
        }
    }
    Ok(())
}

/// Name, byte offset and type of each field of an [`ObservedPoint`].
const POINT_FIELDS: [(&str, u64); 8] = [
    ("x", FLOAT32),
    ("y", FLOAT32),
    ("z", FLOAT32),
    ("normal_x", FLOAT32),
    ("normal_y", FLOAT32),
    ("normal_z", FLOAT32),
    ("camera", UINT32),
    ("pixels", FLOAT32),
];
const POINT_BYTES: usize = 4 * POINT_FIELDS.len();
// The points' own layout is the message's.
const _: () = assert!(size_of::<ObservedPoint>() == POINT_BYTES);
const _: () = assert!(std::mem::offset_of!(ObservedPoint, normal) == 12);
const _: () = assert!(std::mem::offset_of!(ObservedPoint, camera) == 24);
const _: () = assert!(std::mem::offset_of!(ObservedPoint, pixels) == 28);

/// `foxglove.PointCloud`, world frame.
pub(super) fn cloud(out: &mut Vec<u8>, time_ns: u64, points: &[ObservedPoint]) {
    let mut message = Fields(out);
    timestamp(&mut message, 1, time_ns);
    message.string(2, topic::WORLD);
    identity_pose(&mut message, 3);
    message.fixed32(4, POINT_BYTES as u32);
    for (k, (name, kind)) in (0..).zip(POINT_FIELDS) {
        message.message(5, |field| {
            field.string(1, name);
            field.fixed32(2, 4 * k);
            field.integer(3, kind);
        });
    }
    message.bytes(6, bytemuck::cast_slice(points));
}

/// Reads what [`cloud`] writes; `points` is cleared first.
pub(super) fn read_cloud(message: &[u8], points: &mut Vec<ObservedPoint>) -> Result<(), Malformed> {
    points.clear();
    let mut stride = 0;
    let mut data: &[u8] = &[];
    for field in fields(message) {
        match field? {
            (4, value) => stride = value.u32()?,
            (6, value) => data = value.bytes()?,
            _ => {}
        }
    }
    if stride as usize != POINT_BYTES || !data.len().is_multiple_of(POINT_BYTES) {
        return Err(Malformed("the cloud's points are not observed points"));
    }
    points
        .extend(data.chunks_exact(POINT_BYTES).map(bytemuck::pod_read_unaligned::<ObservedPoint>));
    Ok(())
}

/// `foxglove.SceneUpdate` with the sheet as one entity: a list of triangles, world frame.
pub(super) fn sheet(
    out: &mut Vec<u8>,
    time_ns: u64,
    role: topic::Role,
    grid: &SheetGrid,
    triangles: &[[u32; 3]],
    nodes_m: &[[f32; 3]],
) {
    let truth = role == topic::Role::Truth;
    let [nodes_u, nodes_v] = grid.nodes;
    let [size_u, size_v] = grid.size_m;
    Fields(out).message(2, |entity| {
        timestamp(entity, 1, time_ns);
        entity.string(2, topic::WORLD);
        entity.string(3, if truth { "sheet (truth)" } else { "sheet (estimate)" });
        for (key, value) in [
            (topic::NODES_KEY, format!("{nodes_u} {nodes_v}")),
            // Shortest text that reads back as the same number.
            (topic::SIZE_KEY, format!("{size_u:?} {size_v:?}")),
        ] {
            entity.message(6, |pair| {
                pair.string(1, key);
                pair.string(2, &value);
            });
        }
        entity.message(12, |list| {
            identity_pose(list, 1);
            for node in nodes_m {
                numbers(list, 2, &node.map(f64::from));
            }
            numbers(list, 3, if truth { &TRUTH_RGBA } else { &ESTIMATE_RGBA });
            list.bytes(5, bytemuck::cast_slice(triangles));
        });
    });
}

/// Reads what [`sheet`] writes; `nodes_m` is cleared first.
pub(super) fn read_sheet(
    message: &[u8],
    nodes_m: &mut Vec<[f32; 3]>,
) -> Result<SheetGrid, Malformed> {
    nodes_m.clear();
    let (mut size_m, mut nodes) = (None, None);
    let entity = fields(message).find_map(|field| match field {
        Ok((2, Value::Bytes(entity))) => Some(entity),
        _ => None,
    });
    for field in fields(entity.ok_or(Malformed("the scene holds no sheet"))?) {
        match field? {
            (6, value) => {
                let (key, value) = read_pair(value)?;
                match key {
                    topic::NODES_KEY => nodes = two::<usize>(value),
                    topic::SIZE_KEY => size_m = two::<f64>(value),
                    _ => {}
                }
            }
            (12, value) => {
                for field in fields(value.bytes()?) {
                    if let (2, point) = field? {
                        let mut xyz = [0.0; 3];
                        read_numbers(point, &mut xyz)?;
                        nodes_m.push(xyz.map(|x| x as f32));
                    }
                }
            }
            _ => {}
        }
    }
    match (size_m, nodes) {
        (Some(size_m), Some([u, v]))
            if u >= 2 && v >= 2 && u.checked_mul(v) == Some(nodes_m.len()) =>
        {
            Ok(SheetGrid::new(size_m, [u, v]))
        }
        _ => Err(Malformed("the scene's sheet is no grid of nodes")),
    }
}

fn read_pair(pair: Value<'_>) -> Result<(&str, &str), Malformed> {
    let (mut key, mut text) = ("", "");
    for field in fields(pair.bytes()?) {
        match field? {
            (1, value) => key = value.string()?,
            (2, value) => text = value.string()?,
            _ => {}
        }
    }
    Ok((key, text))
}

fn two<T: std::str::FromStr>(text: &str) -> Option<[T; 2]> {
    let (a, b) = text.split_once(' ')?;
    Some([a.parse().ok()?, b.parse().ok()?])
}
