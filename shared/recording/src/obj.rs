//! Meshes as Wavefront OBJ: vertices and faces; everything else in a file is passed over.

use std::fmt::Write as _;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

/// Why an OBJ file could not be read or written; always names the file.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ObjError {
    /// The system refused.
    #[error("mesh `{path}`: {source}")]
    File {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// A line is not what OBJ allows.
    #[error("mesh `{path}`, line {line}: {message}")]
    Line {
        /// The file.
        path: PathBuf,
        /// Line number, from 1.
        line: usize,
        /// What is wrong with it.
        message: String,
    },
}

/// A mesh of polygons.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Obj {
    /// Vertices in the file's order, metres.
    pub vertices_m: Vec<[f32; 3]>,
    /// Faces: indices of three or more vertices, from 0, in the file's winding.
    pub faces: Vec<Vec<u32>>,
}

impl Obj {
    /// Reads a file.
    pub fn read(path: &Path) -> Result<Self, ObjError> {
        let text = fs::read_to_string(path)
            .map_err(|source| ObjError::File { path: path.to_owned(), source })?;
        let mut obj = Self::default();
        for (k, line) in text.lines().enumerate() {
            obj.take_line(line).map_err(|message| ObjError::Line {
                path: path.to_owned(),
                line: k + 1,
                message,
            })?;
        }
        Ok(obj)
    }

    fn take_line(&mut self, line: &str) -> Result<(), String> {
        let mut words = line.split_ascii_whitespace();
        match words.next() {
            Some("v") => {
                let mut vertex = [0.0f32; 3];
                for x in &mut vertex {
                    let word = words.next().ok_or("a vertex needs three coordinates")?;
                    let finite = word.parse().ok().filter(|x: &f32| x.is_finite());
                    *x = finite.ok_or_else(|| format!("`{word}` is no finite number"))?;
                }
                self.vertices_m.push(vertex);
            }
            Some("f") => {
                let face: Vec<u32> =
                    words.map(|word| self.vertex_of(word)).collect::<Result<_, _>>()?;
                if face.len() < 3 {
                    return Err("a face needs at least three vertices".into());
                }
                self.faces.push(face);
            }
            _ => {}
        }
        Ok(())
    }

    /// Index of the vertex that `7`, `7/2/3` or `-1` (the latest) names.
    fn vertex_of(&self, word: &str) -> Result<u32, String> {
        let number = word.split('/').next().unwrap_or(word);
        let count = self.vertices_m.len() as i64;
        let index = number.parse::<i64>().ok().map(|n| if n < 0 { count + n } else { n - 1 });
        index
            .filter(|index| (0..count).contains(index))
            .map(|index| index as u32)
            .ok_or_else(|| format!("`{word}` names none of the {count} vertices before it"))
    }
}

/// Writes a triangle mesh, positions in metres.
pub fn write_mesh(
    path: &Path,
    vertices_m: &[[f32; 3]],
    triangles: &[[u32; 3]],
) -> Result<(), ObjError> {
    let mut text = String::with_capacity(40 * vertices_m.len() + 20 * triangles.len());
    for [x, y, z] in vertices_m {
        // Writing to a string cannot fail. `{}` is the shortest text that reads back equal.
        let _ = writeln!(text, "v {x} {y} {z}");
    }
    for [a, b, c] in triangles.iter().map(|t| t.map(|k| k + 1)) {
        let _ = writeln!(text, "f {a} {b} {c}");
    }
    fs::write(path, text).map_err(|source| ObjError::File { path: path.to_owned(), source })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> Result<Obj, String> {
        let mut obj = Obj::default();
        text.lines().try_for_each(|line| obj.take_line(line))?;
        Ok(obj)
    }

    #[test]
    fn indices_come_in_three_forms() {
        let obj =
            parse("# a\nv 0 0 0\nv 1 0 0\nvt 0 1\nv 1 1 0\nf 1 2/1 3/1/1\nf -3 -2 -1").unwrap();
        assert_eq!(obj.vertices_m.len(), 3);
        assert_eq!(obj.faces, [[0, 1, 2], [0, 1, 2]]);
    }

    #[test]
    fn wrong_lines_are_refused() {
        for text in ["v 1 2", "v 1 2 nan", "f 1 2 3", "v 0 0 0\nf 1 1", "v 0 0 0\nf 0 1 1"] {
            assert!(parse(text).is_err(), "{text}");
        }
    }

    #[test]
    fn what_is_written_reads_back_and_errors_name_file_and_line() {
        let path = std::env::temp_dir().join(format!("orime-obj-{}.obj", std::process::id()));
        let vertices = [[0.1, -2.0e-7, 3.0], [1.0, 0.0, 0.333_333_34], [0.0, 1.0, 0.0]];
        write_mesh(&path, &vertices, &[[0, 1, 2]]).unwrap();
        let obj = Obj::read(&path).unwrap();
        assert_eq!((obj.vertices_m, obj.faces), (vertices.to_vec(), vec![vec![0, 1, 2]]));
        fs::write(&path, "v 0 0 0\nf 1 2 3\n").unwrap();
        let message = Obj::read(&path).unwrap_err().to_string();
        assert!(message.contains("orime-obj") && message.contains("line 2"), "{message}");
        fs::remove_file(path).unwrap();
    }
}
