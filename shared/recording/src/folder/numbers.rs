//! Numbers that stand in the layout file, or in a JSON file it points to.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use serde::Deserialize;

/// Numbers given inline (a number, or arbitrarily nested arrays of them), or as
/// `{ file = "calib.json", pointer = "/rgb/K" }`.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(try_from = "toml::Value")]
pub enum Numbers {
    /// In row-major order.
    Inline(Vec<f64>),
    /// In a JSON file under the layout's root.
    Pointer {
        /// The file.
        file: PathBuf,
        /// JSON pointer (RFC 6901) to a number or nested arrays of numbers.
        pointer: String,
    },
}

impl TryFrom<toml::Value> for Numbers {
    type Error = String;

    fn try_from(value: toml::Value) -> Result<Self, String> {
        if let toml::Value::Table(table) = &value {
            let text = |key: &str| table.get(key).and_then(toml::Value::as_str);
            return match (text("file"), text("pointer"), table.len()) {
                (Some(file), Some(pointer), 2) => {
                    Ok(Self::Pointer { file: file.into(), pointer: pointer.to_owned() })
                }
                _ => Err("a pointer into JSON is { file = \"…\", pointer = \"/…\" }".into()),
            };
        }
        let mut numbers = Vec::new();
        flatten_toml(&value, &mut numbers)?;
        Ok(Self::Inline(numbers))
    }
}

fn flatten_toml(value: &toml::Value, numbers: &mut Vec<f64>) -> Result<(), String> {
    match value {
        toml::Value::Float(number) => numbers.push(*number),
        toml::Value::Integer(number) => numbers.push(*number as f64),
        toml::Value::Array(values) => {
            values.iter().try_for_each(|value| flatten_toml(value, numbers))?;
        }
        other => return Err(format!("expected numbers, found {}", other.type_str())),
    }
    Ok(())
}

/// The JSON files of one recording, each parsed once.
#[derive(Debug)]
pub struct JsonFiles {
    root: PathBuf,
    parsed: HashMap<PathBuf, Result<serde_json::Value, String>>,
}

impl JsonFiles {
    /// Files under `root`.
    pub fn new(root: PathBuf) -> Self {
        Self { root, parsed: HashMap::new() }
    }

    /// What `pointer` points to in `file`, or a message that names both.
    pub fn value(&mut self, file: &Path, pointer: &str) -> Result<&serde_json::Value, String> {
        let path = self.root.join(file);
        let parsed = self.parsed.entry(file.to_owned()).or_insert_with(|| {
            let text = std::fs::read_to_string(&path).map_err(|error| error.to_string())?;
            serde_json::from_str(&text).map_err(|error| format!("is no JSON: {error}"))
        });
        match parsed {
            Err(message) => Err(format!("needs `{}`: {message}", path.display())),
            Ok(value) => value
                .pointer(pointer)
                .ok_or_else(|| format!("finds no `{pointer}` in `{}`", path.display())),
        }
    }

    /// Exactly `N` finite numbers, or a message that says what was found and where.
    pub fn exactly<const N: usize>(&mut self, numbers: &Numbers) -> Result<[f64; N], String> {
        let found = self.numbers(numbers)?;
        let count = found.len();
        if !found.iter().all(|number| number.is_finite()) {
            return Err("holds a number that is not finite".into());
        }
        found.try_into().map_err(|_| format!("holds {count} numbers, {N} are needed"))
    }

    /// The numbers, flattened row by row.
    pub fn numbers(&mut self, numbers: &Numbers) -> Result<Vec<f64>, String> {
        match numbers {
            Numbers::Inline(numbers) => Ok(numbers.clone()),
            Numbers::Pointer { file, pointer } => {
                let value = self.value(file, pointer)?;
                let mut flat = Vec::new();
                if flatten_json(value, &mut flat) {
                    Ok(flat)
                } else {
                    let file = file.display();
                    Err(format!("finds something else than numbers at `{pointer}` in `{file}`"))
                }
            }
        }
    }
}

/// Whether the value holds nothing but numbers.
fn flatten_json(value: &serde_json::Value, numbers: &mut Vec<f64>) -> bool {
    match value {
        serde_json::Value::Number(number) => {
            numbers.extend(number.as_f64());
            true
        }
        serde_json::Value::Array(values) => values.iter().all(|v| flatten_json(v, numbers)),
        _ => false,
    }
}
