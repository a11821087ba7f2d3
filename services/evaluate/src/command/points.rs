//! Rows of numbers from text files.

use anyhow::Context;
use std::path::Path;

/// Reads rows of exactly `N` finite or non-finite numbers, separated by commas or blanks.
pub fn read_rows<const N: usize>(path: &Path) -> anyhow::Result<Vec<[f64; N]>> {
    let text = std::fs::read_to_string(path)
        .with_context(|| format!("reading points from `{}`", path.display()))?;
    let mut rows = Vec::new();
    for (number, line) in text.lines().enumerate() {
        let words = line.split([',', ' ', '\t']).filter(|word| !word.is_empty());
        let values: Result<Vec<f64>, _> = words.map(str::parse).collect();
        match values.as_deref().ok() {
            Some([]) => {}
            Some(values) if values.len() == N => {
                rows.push(std::array::from_fn(|k| values[k]));
            }
            _ => anyhow::bail!(
                "`{}`, line {}: expected {N} numbers, found `{line}`",
                path.display(),
                number + 1
            ),
        }
    }
    anyhow::ensure!(!rows.is_empty(), "`{}` holds no points", path.display());
    Ok(rows)
}
