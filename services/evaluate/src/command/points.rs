//! Rows of numbers from text files.

use anyhow::Context;
use std::ops::RangeInclusive;
use std::path::Path;

/// Reads rows of exactly `N` finite or non-finite numbers, separated by commas or blanks.
pub fn read_rows<const N: usize>(path: &Path) -> anyhow::Result<Vec<[f64; N]>> {
    let rows = read_table(path, N..=N)?;
    Ok(rows.iter().map(|row| std::array::from_fn(|k| row[k])).collect())
}

/// Reads rows of that many finite or non-finite numbers, separated by commas or blanks; empty
/// lines are none.
pub fn read_table(path: &Path, columns: RangeInclusive<usize>) -> anyhow::Result<Vec<Vec<f64>>> {
    let text = std::fs::read_to_string(path)
        .with_context(|| format!("reading points from `{}`", path.display()))?;
    let mut rows = Vec::new();
    for (number, line) in text.lines().enumerate() {
        let words = line.split([',', ' ', '\t']).filter(|word| !word.is_empty());
        let values: Result<Vec<f64>, _> = words.map(str::parse).collect();
        match values {
            Ok(values) if values.is_empty() => {}
            Ok(values) if columns.contains(&values.len()) => rows.push(values),
            _ => anyhow::bail!(
                "`{}`, line {}: expected {} numbers, found `{line}`",
                path.display(),
                number + 1,
                if columns.start() == columns.end() {
                    columns.start().to_string()
                } else {
                    format!("{} to {}", columns.start(), columns.end())
                }
            ),
        }
    }
    anyhow::ensure!(!rows.is_empty(), "`{}` holds no points", path.display());
    Ok(rows)
}
