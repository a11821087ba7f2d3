//! From a file's channels and calibrations to cameras.

use std::collections::BTreeMap;
use std::path::Path;

use orime_geometry::RgbdCamera;

use super::ReadError;
use super::scan::{Channel, Constant};
use super::topic::Role;

/// Puts the cameras together from their channels and calibrations.
pub(super) fn cameras(
    path: &Path,
    channels: &BTreeMap<u16, Channel>,
    constants: &BTreeMap<u16, Constant>,
) -> Result<Vec<RgbdCamera>, ReadError> {
    let find = |index: usize, role: Role| {
        channels.iter().find(|(_, channel)| {
            channel.role == role && channel.camera.as_ref().is_some_and(|(i, ..)| *i == index)
        })
    };
    let count = channels
        .values()
        .filter_map(|channel| channel.camera.as_ref().map(|(index, ..)| index.saturating_add(1)))
        .max()
        .unwrap_or(0);
    let mut cameras = Vec::new();
    for index in 0..count {
        let color = find(index, Role::ColorImage).and_then(|(_, channel)| channel.camera.as_ref());
        let (name, unit_m) = match color {
            Some((_, name, unit_m)) => (name.clone(), *unit_m),
            None => (format!("number {index}"), f64::NAN),
        };
        let wrong = |message: String| ReadError::Calibration {
            path: path.to_owned(),
            camera: name.clone(),
            message,
        };
        if !(unit_m > 0.0 && unit_m.is_finite()) {
            return Err(wrong("its metres per unit of depth are missing; record it again".into()));
        }
        let constant = |role: Role| match find(index, role).and_then(|(id, _)| constants.get(id)) {
            Some(Constant::Malformed(what)) => {
                Err(wrong(format!("its {} is wrong: {what}; record it again", role.name())))
            }
            Some(constant) => Ok(constant),
            None => Err(wrong(format!("its {} is missing; record it again", role.name()))),
        };
        let lens = |role: Role| match constant(role)? {
            Constant::Lens(lens) => Ok(lens.clone()),
            _ => Err(wrong(format!("its {} is no calibration", role.name()))),
        };
        let transform = |role: Role| match constant(role)? {
            Constant::Transform(transform) => Ok(*transform),
            _ => Err(wrong(format!("its {} is no transform", role.name()))),
        };
        cameras.push(RgbdCamera {
            color: lens(Role::ColorCalibration)?,
            depth: lens(Role::DepthCalibration)?,
            world_from_color: transform(Role::WorldFromColor)?,
            color_from_depth: transform(Role::ColorFromDepth)?,
            depth_m_per_unit: unit_m,
            name,
        });
    }
    Ok(cameras)
}
