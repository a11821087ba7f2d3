//! Point clouds and meshes as PLY.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

/// Why a PLY file could not be read or written; always names the file.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PlyError {
    /// The system refused.
    #[error("cloud `{path}`: {source}")]
    File {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// A line of the header, or of an ASCII body, is wrong.
    #[error("cloud `{path}`, line {line}: {message}")]
    Line {
        /// The file.
        path: PathBuf,
        /// Line number, from 1.
        line: usize,
        /// What is wrong with it.
        message: String,
    },
    /// The body is shorter than the header promises.
    #[error("cloud `{path}` is truncated: {found} of {promised} vertices are there")]
    Truncated {
        /// The file.
        path: PathBuf,
        /// Whole vertices found.
        found: usize,
        /// Vertices that the header counts.
        promised: usize,
    },
}

/// Writes a point cloud, binary little-endian, positions in metres.
pub fn write_cloud(path: &Path, points_m: &[[f32; 3]]) -> Result<(), PlyError> {
    write_mesh(path, points_m, &[])
}

/// Writes a triangle mesh, binary little-endian, positions in metres.
pub fn write_mesh(
    path: &Path,
    vertices_m: &[[f32; 3]],
    triangles: &[[u32; 3]],
) -> Result<(), PlyError> {
    let mut header = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex {}\n\
         property float x\nproperty float y\nproperty float z\n",
        vertices_m.len()
    );
    if !triangles.is_empty() {
        header +=
            &format!("element face {}\nproperty list uchar int vertex_indices\n", triangles.len());
    }
    header += "end_header\n";
    let mut bytes = header.into_bytes();
    bytes.reserve(12 * vertices_m.len() + 13 * triangles.len());
    vertices_m.iter().flatten().for_each(|x| bytes.extend(x.to_le_bytes()));
    for triangle in triangles {
        bytes.push(3);
        triangle.iter().for_each(|k| bytes.extend((*k as i32).to_le_bytes()));
    }
    fs::write(path, bytes).map_err(|source| PlyError::File { path: path.to_owned(), source })
}

/// Reads the vertices' `x y z` (float or double, ASCII or binary little-endian), metres; other
/// properties and elements are passed over.
pub fn read_points(path: &Path) -> Result<Vec<[f32; 3]>, PlyError> {
    let bytes =
        fs::read(path).map_err(|source| PlyError::File { path: path.to_owned(), source })?;
    let (header, body) = Header::parse(&bytes).map_err(|(line, message)| PlyError::Line {
        path: path.to_owned(),
        line,
        message,
    })?;
    let truncated =
        |found| PlyError::Truncated { path: path.to_owned(), found, promised: header.vertices };
    if header.ascii {
        let text = String::from_utf8_lossy(body);
        let mut points = Vec::new();
        for (k, line) in text.lines().take(header.vertices).enumerate() {
            let words: Vec<&str> = line.split_ascii_whitespace().collect();
            let point = header.xyz.map(|at| words.get(at.property)?.parse::<f32>().ok());
            let [Some(x), Some(y), Some(z)] = point else {
                let line = header.lines + k + 1;
                let message = "holds no x, y and z".into();
                return Err(PlyError::Line { path: path.to_owned(), line, message });
            };
            points.push([x, y, z]);
        }
        return if points.len() == header.vertices {
            Ok(points)
        } else {
            Err(truncated(points.len()))
        };
    }
    let points: Vec<[f32; 3]> = body
        .chunks_exact(header.stride)
        .take(header.vertices)
        .map(|vertex| header.xyz.map(|at| at.value(vertex)))
        .collect();
    if points.len() == header.vertices { Ok(points) } else { Err(truncated(points.len())) }
}

/// Where one coordinate stands in a vertex.
#[derive(Debug, Clone, Copy, Default)]
struct Coordinate {
    /// Number of the property.
    property: usize,
    /// Byte offset in a binary vertex.
    offset: usize,
    double: bool,
}

impl Coordinate {
    fn value(&self, vertex: &[u8]) -> f32 {
        let bytes = &vertex[self.offset..];
        match (self.double, bytes.first_chunk::<8>(), bytes.first_chunk::<4>()) {
            (true, Some(eight), _) => f64::from_le_bytes(*eight) as f32,
            (false, _, Some(four)) => f32::from_le_bytes(*four),
            // `Header::parse` lays coordinates inside the vertex.
            _ => f32::NAN,
        }
    }
}

#[derive(Debug)]
struct Header {
    ascii: bool,
    vertices: usize,
    xyz: [Coordinate; 3],
    /// Bytes of a binary vertex.
    stride: usize,
    /// Lines of the header.
    lines: usize,
}

impl Header {
    /// The header and the body behind it, or line number and message.
    fn parse(bytes: &[u8]) -> Result<(Self, &[u8]), (usize, String)> {
        let mut header =
            Self { ascii: false, vertices: 0, xyz: Default::default(), stride: 0, lines: 0 };
        let mut found = [false; 3];
        let (mut format, mut elements, mut properties) = (false, 0, 0);
        let mut rest = bytes;
        loop {
            header.lines += 1;
            let fail = |message: &str| Err((header.lines, message.to_owned()));
            let Some(end) = rest.iter().position(|byte| *byte == b'\n') else {
                return fail("the header has no `end_header`");
            };
            let Ok(line) = std::str::from_utf8(&rest[..end]) else {
                return fail("the header is no text");
            };
            rest = &rest[end + 1..];
            let words: Vec<&str> = line.split_ascii_whitespace().collect();
            match (header.lines, &words[..]) {
                (1, ["ply"]) => {}
                (1, _) => return fail("does not begin with `ply`"),
                (_, ["format", "ascii", _]) => (format, header.ascii) = (true, true),
                (_, ["format", "binary_little_endian", _]) => format = true,
                (_, ["format", ..]) => return fail("must be ASCII or binary little-endian"),
                (_, ["element", "vertex", count]) if elements == 0 => {
                    let Ok(count) = count.parse() else { return fail("counts no vertices") };
                    (header.vertices, elements) = (count, 1);
                }
                (_, ["element", ..]) if elements == 0 => {
                    return fail("the first element must be `vertex`");
                }
                (_, ["element", ..]) => elements += 1,
                (_, ["property", "list", ..]) if elements == 1 => {
                    return fail("vertices with lists are not supported");
                }
                (_, ["property", kind, name]) if elements == 1 => {
                    let Some(size) = size_of(kind) else { return fail("is of an unknown type") };
                    if let Some(axis) = ["x", "y", "z"].iter().position(|axis| axis == name) {
                        if !matches!(*kind, "float" | "float32" | "double" | "float64") {
                            return fail("coordinates must be float or double");
                        }
                        let (property, offset) = (properties, header.stride);
                        header.xyz[axis] = Coordinate { property, offset, double: size == 8 };
                        found[axis] = true;
                    }
                    properties += 1;
                    header.stride += size;
                }
                (_, ["end_header"]) if format && found == [true; 3] => return Ok((header, rest)),
                (_, ["end_header"]) => return fail("the header names no format, or no x, y and z"),
                _ => {}
            }
        }
    }
}

/// Bytes of a scalar type.
fn size_of(kind: &str) -> Option<usize> {
    Some(match kind {
        "char" | "uchar" | "int8" | "uint8" => 1,
        "short" | "ushort" | "int16" | "uint16" => 2,
        "int" | "uint" | "float" | "int32" | "uint32" | "float32" => 4,
        "double" | "float64" => 8,
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn with_file(test: &str, check: impl FnOnce(&Path)) {
        let path = std::env::temp_dir().join(format!("orime-{test}-{}.ply", std::process::id()));
        check(&path);
        fs::remove_file(path).unwrap();
    }

    #[test]
    fn clouds_and_meshes_read_back_as_written() {
        let points = [[0.1, -2.5e-7, 3.0], [f32::MAX, 0.0, -0.0], [1.0, 2.0, 3.0]];
        with_file("back", |path| {
            write_cloud(path, &points).unwrap();
            assert_eq!(read_points(path).unwrap(), points);
            write_mesh(path, &points, &[[0, 1, 2]]).unwrap();
            assert_eq!(read_points(path).unwrap(), points);
            let bytes = fs::read(path).unwrap();
            assert_eq!(bytes[bytes.len() - 13..], [3, 0, 0, 0, 0, 1, 0, 0, 0, 2, 0, 0, 0]);
        });
    }

    #[test]
    fn ascii_and_doubles_between_other_properties() {
        with_file("ascii", |path| {
            let header = "element vertex 2\nproperty uchar red\nproperty float z\n\
                          property double y\nproperty float x\nend_header\n";
            let text = format!("ply\nformat ascii 1.0\ncomment c\n{header}9 3 2 1\n9 6 5 4\n");
            fs::write(path, text).unwrap();
            assert_eq!(read_points(path).unwrap(), [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]);
            let mut bytes = format!("ply\nformat binary_little_endian 1.0\n{header}").into_bytes();
            for [x, y, z] in [[1.0f32, 2.0, 3.0], [4.0, 5.0, 6.0]] {
                bytes.push(9);
                bytes.extend(z.to_le_bytes());
                bytes.extend(f64::from(y).to_le_bytes());
                bytes.extend(x.to_le_bytes());
            }
            fs::write(path, bytes).unwrap();
            assert_eq!(read_points(path).unwrap(), [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]);
        });
    }

    #[test]
    fn broken_files_are_refused_with_their_place() {
        let refuse = |bytes: &[u8], part: &str| {
            with_file("broken", |path| {
                fs::write(path, bytes).unwrap();
                let message = read_points(path).unwrap_err().to_string();
                assert!(message.contains("orime-broken") && message.contains(part), "{message}");
            });
        };
        let head = "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\n";
        let whole = format!("{head}property float z\nend_header\n");
        refuse(b"", "line 1");
        refuse(b"PNG\n", "line 1");
        refuse(head.as_bytes(), "line 6");
        refuse(format!("{head}end_header\n").as_bytes(), "line 6");
        refuse(format!("{whole}1 2 3\n").as_bytes(), "1 of 2");
        refuse(format!("{whole}1 2 3\n1 2\n").as_bytes(), "line 9");
        let binary = whole.replace("ascii", "binary_little_endian");
        refuse([binary.as_bytes(), &[0; 23]].concat().as_slice(), "1 of 2");
        refuse(whole.replace("ascii", "binary_big_endian").as_bytes(), "line 2");
    }
}
