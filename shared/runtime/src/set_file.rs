//! Set files: one TOML file says what a set is.

use std::io;
use std::path::{Path, PathBuf};

use serde::de::DeserializeOwned;
use toml::{Table, Value};

use crate::channel::Pace;

/// The sections of a set file, one per stage and the sheet that they share.
pub const SECTIONS: [&str; 5] = ["sheet", "capture", "segment", "register", "simulate"];
/// What each profile sets, where the set file says nothing else.
const PROFILES: &str = include_str!("profiles.toml");
/// Stands for the folder of the recordings in any text of a set file.
pub const DATA_VARIABLE: &str = "${ORIME_DATA}";
/// Keys whose values are paths; relative ones are meant from the set file's folder.
const PATH_KEYS: [(&[&str], &str); 7] = [
    (&["sheet"], "template"),
    (&["capture", "folder"], "layout"),
    (&["capture", "folder"], "data_dir"),
    (&["capture", "recording"], "file"),
    (&["capture", "calibration"], "file"),
    (&["capture", "bag"], "files"),
    (&["capture", "db3"], "files"),
];

/// Why a set file cannot be used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SetError {
    /// The file itself.
    #[error("reading set file `{path}`: does it exist and may you read it?")]
    Read {
        /// The set file.
        path: PathBuf,
        /// Why not.
        #[source]
        source: io::Error,
    },
    /// Not TOML, or a value of the wrong kind.
    #[error("set file `{path}`, {place}: {message} (`orime check` shows every problem)")]
    Invalid {
        /// The set file.
        path: PathBuf,
        /// Section or key.
        place: String,
        /// What is wrong.
        message: String,
    },
}

/// A set file that was read: its parts are not checked yet.
#[derive(Debug, Clone)]
pub struct SetFile {
    /// Where it came from.
    pub path: PathBuf,
    /// Its text, as it is.
    pub text: String,
    /// Name for people: `name`, or the file's stem.
    pub name: String,
    /// `pace`, default `lockstep`.
    pub pace: Pace,
    /// `budget_ms`: from the last pixel of a frame set to its state, milliseconds.
    pub budget_ms: Option<f64>,
    sections: Table,
}

impl SetFile {
    /// Reads a set file, puts in the folder of the recordings and makes paths whole.
    pub fn load(path: &Path) -> Result<Self, SetError> {
        let text = std::fs::read_to_string(path)
            .map_err(|source| SetError::Read { path: path.to_owned(), source })?;
        Self::parse(path, text)
    }

    /// As [`SetFile::load`], for a text that lies, or would lie, at `path`.
    pub fn parse(path: &Path, text: String) -> Result<Self, SetError> {
        let invalid = |place: &str, message: String| SetError::Invalid {
            path: path.to_owned(),
            place: place.to_owned(),
            message,
        };
        let mut sections: Table =
            text.parse().map_err(|error: toml::de::Error| invalid("syntax", error.to_string()))?;
        expand(&mut sections, path);
        let name = match sections.remove("name") {
            None => path.file_stem().unwrap_or_default().to_string_lossy().into_owned(),
            Some(Value::String(name)) => name,
            Some(_) => return Err(invalid("`name`", "must be a text".to_owned())),
        };
        let pace = match sections.remove("pace") {
            None => Pace::Lockstep,
            Some(pace) => pace.try_into().map_err(|_| {
                invalid("`pace`", "must be \"lockstep\" or \"realtime\"".to_owned())
            })?,
        };
        let budget_ms = match sections.remove("budget_ms") {
            None => None,
            Some(Value::Float(ms)) if ms.is_finite() && ms > 0.0 => Some(ms),
            Some(Value::Integer(ms)) if ms > 0 => Some(ms as f64),
            Some(_) => {
                let message = "must be a number of milliseconds above 0".to_owned();
                return Err(invalid("`budget_ms`", message));
            }
        };
        let profile = sections.remove("profile").map(|profile| {
            let of = |name: &Value| profiles().remove(name.as_str()?)?.try_into::<Table>().ok();
            of(&profile).ok_or_else(|| {
                let known: Vec<String> = profiles().keys().map(|k| format!("\"{k}\"")).collect();
                invalid("`profile`", format!("must be one of {}", known.join(", ")))
            })
        });
        if let Some(profile) = profile.transpose()? {
            fill_in(&mut sections, profile);
        }
        if let Some(key) = sections.keys().find(|key| !SECTIONS.contains(&key.as_str())) {
            let known = SECTIONS.join("], [");
            return Err(invalid(
                key,
                format!("is not part of a set: name, pace, budget_ms, profile, [{known}] are"),
            ));
        }
        Ok(Self { path: path.to_owned(), text, name, pace, budget_ms, sections })
    }

    /// One section's parameters, not checked yet; the defaults where the file has no such section.
    pub fn section<P: DeserializeOwned>(&self, section: &str) -> Result<P, SetError> {
        let value = self.sections.get(section).cloned();
        value.unwrap_or_else(|| Value::Table(Table::new())).try_into().map_err(
            |error: toml::de::Error| SetError::Invalid {
                path: self.path.clone(),
                place: format!("[{section}]"),
                message: error.message().to_owned(),
            },
        )
    }

    /// One section's checked configuration; every problem of it in one error.
    pub fn checked<P: DeserializeOwned, C>(
        &self,
        section: &str,
        check: impl FnOnce(&P) -> Result<C, Vec<orime_params::Problem>>,
    ) -> Result<C, SetError> {
        let params: P = self.section(section)?;
        check(&params).map_err(|problems| SetError::Invalid {
            path: self.path.clone(),
            place: format!("[{section}]"),
            message: problems.iter().map(ToString::to_string).collect::<Vec<_>>().join("; "),
        })
    }
}

/// The profiles by name.
fn profiles() -> Table {
    PROFILES.parse().unwrap_or_default()
}

/// Puts in what is not there; what is there stays.
fn fill_in(table: &mut Table, defaults: Table) {
    for (key, default) in defaults {
        match (table.get_mut(&key), default) {
            (Some(Value::Table(inner)), Value::Table(default)) => fill_in(inner, default),
            (Some(_), _) => {}
            (None, default) => {
                table.insert(key, default);
            }
        }
    }
}

/// The folder of the recordings: the variable `ORIME_DATA`, else beside the repository.
pub fn data_dir() -> PathBuf {
    match std::env::var_os("ORIME_DATA") {
        Some(dir) if !dir.is_empty() => PathBuf::from(dir),
        _ => Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data"),
    }
}

/// Puts the folder of the recordings into every text of `table`, and makes the values of path
/// keys absolute, or relative to where the process runs.
pub fn expand(table: &mut Table, set_path: &Path) {
    let data = data_dir().to_string_lossy().into_owned();
    table.iter_mut().for_each(|(_, value)| expand_value(value, &data));
    let folder = set_path.parent().unwrap_or(Path::new(""));
    for (ancestors, key) in PATH_KEYS {
        let mut place = Some(&mut *table);
        for ancestor in ancestors {
            place = place.and_then(|table| table.get_mut(*ancestor)?.as_table_mut());
        }
        let paths = match place.and_then(|table| table.get_mut(key)) {
            Some(Value::Array(paths)) => paths.as_mut_slice(),
            Some(path) => std::slice::from_mut(path),
            None => &mut [],
        };
        for path in paths {
            if let Value::String(path) = path {
                *path = folder.join(&*path).to_string_lossy().into_owned();
            }
        }
    }
}

fn expand_value(value: &mut Value, data: &str) {
    match value {
        Value::String(text) => *text = text.replace(DATA_VARIABLE, data),
        Value::Array(values) => values.iter_mut().for_each(|value| expand_value(value, data)),
        Value::Table(table) => {
            table.iter_mut().for_each(|(_, value)| expand_value(value, data));
        }
        _ => {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> Result<SetFile, SetError> {
        SetFile::parse(Path::new("sets/desk.toml"), text.to_owned())
    }

    #[test]
    fn an_empty_set_has_defaults() {
        let set = parse("").unwrap();
        assert_eq!((set.name.as_str(), set.pace), ("desk", Pace::Lockstep));
        assert_eq!(set.section::<Table>("sheet").unwrap(), Table::new());
    }

    #[test]
    fn paths_are_meant_from_the_set_and_data_has_its_place() {
        let set = parse(
            "pace = \"realtime\"\n[sheet]\ntemplate = \"cloth.obj\"\n\
             [capture.folder]\nlayout = \"${ORIME_DATA}/desk/layout.toml\"\n\
             [capture.bag]\nfiles = [\"a.bag\", \"/b.bag\"]",
        )
        .unwrap();
        assert_eq!(set.pace, Pace::Realtime);
        let sheet: Table = set.section("sheet").unwrap();
        assert_eq!(sheet["template"].as_str(), Some("sets/cloth.obj"));
        let capture: Table = set.section("capture").unwrap();
        let layout = capture["folder"]["layout"].as_str().unwrap();
        assert!(Path::new(layout).is_absolute() && layout.ends_with("/desk/layout.toml"));
        assert!(!layout.contains('$'));
        let files = capture["bag"]["files"].as_array().unwrap();
        let files: Vec<_> = files.iter().filter_map(toml::Value::as_str).collect();
        assert_eq!(files, ["sets/a.bag", "/b.bag"]);
    }

    #[test]
    fn a_profile_fills_in_what_is_not_there() {
        let set =
            parse("profile = \"fast\"\nbudget_ms = 11\n[register]\npoints_max = 1234").unwrap();
        assert_eq!(set.budget_ms, Some(11.0));
        let register: Table = set.section("register").unwrap();
        assert_eq!(register["points_max"].as_integer(), Some(1234));
        assert!(register["iterations_max"].as_integer().is_some());
        let nodes = |set: &SetFile| set.section::<Table>("sheet").unwrap().remove("nodes");
        assert_eq!(nodes(&set).map(|nodes| nodes.to_string()), Some("[13, 13]".to_owned()));
        let own = parse("profile = \"fast\"\n[sheet]\nnodes = [9, 9]").unwrap();
        assert_eq!(nodes(&own).map(|nodes| nodes.to_string()), Some("[9, 9]".to_owned()));
        let balanced = parse("profile = \"balanced\"").unwrap();
        assert_eq!(balanced.section::<Table>("register").unwrap(), Table::new());
        assert!(profiles().contains_key("exact"));
    }

    #[test]
    fn what_is_wrong_is_named() {
        let message = |text| parse(text).unwrap_err().to_string();
        assert!(message("pace = \"fast\"").contains("lockstep"));
        assert!(message("[captrue]").contains("captrue"));
        assert!(message("name = ").contains("syntax"));
        assert!(message("profile = \"slow\"").contains("\"fast\""));
        assert!(message("profile = 3").contains("\"fast\""));
        assert!(message("budget_ms = -1").contains("budget_ms"));
    }
}
