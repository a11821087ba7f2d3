//! A problem of a set file, at its place.

use std::fmt;
use std::ops::Range;
use std::path::{Path, PathBuf};

use serde::Serialize;

/// One thing that is wrong with a set file, where it is wrong.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct PlacedProblem {
    /// The set file.
    pub path: PathBuf,
    /// Line, from 1.
    pub line: usize,
    /// Column in characters, from 1.
    pub column: usize,
    /// Dotted path of the key from the top of the file; empty for the file as a whole.
    pub key: String,
    /// What is wrong and what would be right.
    pub message: String,
    /// Whether nothing is wrong with the file but that its recording is damaged.
    pub is_damage: bool,
    /// The line, and a mark under the place.
    #[serde(skip)]
    excerpt: String,
}

impl PlacedProblem {
    /// A problem at the bytes `span` of `text`.
    pub fn new(path: &Path, text: &str, span: Range<usize>, key: String, message: String) -> Self {
        let start = boundary_before(text, span.start);
        let before = &text[..start];
        let line_start = before.rfind('\n').map_or(0, |k| k + 1);
        let line = text[line_start..].lines().next().unwrap_or("");
        let column = text[line_start..start].chars().count() + 1;
        let end = span.end.min(line_start + line.len()).max(start);
        let end = boundary_before(text, end);
        let marked = text.get(start..end).map_or(1, |part| part.chars().count().max(1));
        let number = before.matches('\n').count() + 1;
        let gutter = " ".repeat(number.to_string().len());
        let excerpt = format!(
            "{gutter} |\n{number} | {line}\n{gutter} | {}{}",
            " ".repeat(column - 1),
            "^".repeat(marked)
        );
        let path = path.to_owned();
        Self { path, line: number, column, key, message, is_damage: false, excerpt }
    }
}

/// The last character boundary of `text` at or before byte `k`.
fn boundary_before(text: &str, k: usize) -> usize {
    let mut k = k.min(text.len());
    while !text.is_char_boundary(k) {
        k -= 1;
    }
    k
}

impl fmt::Display for PlacedProblem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { path, line, column, message, excerpt, .. } = self;
        write!(f, "{}:{line}:{column}: {message}\n{excerpt}", path.display())
    }
}
