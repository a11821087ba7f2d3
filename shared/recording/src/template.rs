//! A sheet's template: its shape where it does not start flat.

use crate::{GridError, Obj, ObjError, QuadGrid};
use orime_geometry::{SheetGrid, SheetParams};
use std::path::{Path, PathBuf};

/// Why a template cannot be used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum TemplateError {
    /// The file is missing or is no OBJ.
    #[error(transparent)]
    Obj(#[from] ObjError),
    /// The mesh is no regular grid.
    #[error("template `{path}`")]
    Grid {
        /// The template.
        path: PathBuf,
        /// What is wrong with it.
        #[source]
        source: GridError,
    },
    /// The mesh and the set disagree about the sheet's size.
    #[error(
        "template `{path}` measures {found:.3?} m along its grid lines, but `sheet.size_m` is \
         {expected:.3?}: correct the set, or scale the template to metres"
    )]
    Size {
        /// The template.
        path: PathBuf,
        /// Length of the grid lines along u and v.
        found: [f64; 2],
        /// What the set says.
        expected: [f64; 2],
    },
}

/// Largest relative difference between the template's and the set's sides.
const SIZE_TOLERANCE: f64 = 0.1;

/// Node positions of `params.template` for `sheet`, metres, axes turned by the template's signs;
/// `None` where the set names no template.
pub fn load(
    params: &SheetParams,
    sheet: &SheetGrid,
) -> Result<Option<Vec<[f32; 3]>>, TemplateError> {
    let Some(path) = params.template.as_deref().map(Path::new) else { return Ok(None) };
    let grid = QuadGrid::from_obj(&Obj::read(path)?)
        .map_err(|source| TemplateError::Grid { path: path.to_owned(), source })?;
    // Which side is u is the set's word: the grid may have been found the other way round.
    let grid = [grid.clone(), grid.quarter_turned()]
        .into_iter()
        .min_by(|a, b| misfit(a, sheet).total_cmp(&misfit(b, sheet)))
        .unwrap_or(grid);
    if misfit(&grid, sheet) > SIZE_TOLERANCE {
        return Err(TemplateError::Size {
            path: path.to_owned(),
            found: grid.size_m(),
            expected: sheet.size_m,
        });
    }
    let signs = params.template_axis_signs.map(|sign| sign as f32);
    let mut nodes = grid.resampled(sheet.nodes);
    nodes.iter_mut().flatten().zip(signs.into_iter().cycle()).for_each(|(c, sign)| *c *= sign);
    Ok(Some(nodes))
}

/// Largest relative difference of a side.
fn misfit(grid: &QuadGrid, sheet: &SheetGrid) -> f64 {
    let size = grid.size_m();
    (0..2).map(|axis| (size[axis] / sheet.size_m[axis] - 1.0).abs()).fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fmt::Write as _;

    fn write_obj(name: &str, sheet: &SheetGrid) -> PathBuf {
        let mut text = String::new();
        for [u, v] in sheet.uv_m() {
            writeln!(text, "v {u} {v} 0.5").unwrap();
        }
        for i in 0..sheet.nodes[0] - 1 {
            for j in 0..sheet.nodes[1] - 1 {
                let corners = [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)];
                let [a, b, c, d] = corners.map(|(i, j)| sheet.index(i, j) + 1);
                writeln!(text, "f {a} {b} {c} {d}").unwrap();
            }
        }
        let path = std::env::temp_dir().join(format!("orime-{}-{name}.obj", std::process::id()));
        std::fs::write(&path, text).unwrap();
        path
    }

    #[test]
    fn the_longer_side_is_found_and_axes_are_turned() {
        let path = write_obj("turned", &SheetGrid::new([0.3, 0.2], [4, 3]));
        let params = SheetParams {
            template: Some(path.display().to_string()),
            template_axis_signs: [-1.0, 1.0, 1.0],
            ..SheetParams::default()
        };
        let sheet = SheetGrid::new([0.2, 0.3], [5, 7]);
        let nodes = load(&params, &sheet).unwrap().unwrap();
        let (first, last) = (nodes[0], nodes[sheet.index(0, 6)]);
        let length = (0..3).map(|k| (first[k] - last[k]).powi(2)).sum::<f32>().sqrt();
        assert!((length - 0.3).abs() < 1e-6, "v is the side of 0.3 m, not {length}");
        assert!(nodes.iter().all(|p| p[0] <= 0.0 && p[1] >= 0.0 && p[2] == 0.5));
        let wrong = load(&params, &SheetGrid::new([0.2, 0.4], [5, 7]));
        assert!(matches!(wrong, Err(TemplateError::Size { .. })));
        std::fs::remove_file(path).unwrap();
    }
}
