//! A named way of setting a set differently.

use anyhow::Context;
use toml::{Table, Value};

/// A named set of keys that differ from the set file.
#[derive(Debug, Clone, PartialEq)]
pub struct Variant {
    /// Name in tables and plots.
    pub name: String,
    /// Why this version cannot run it.
    pub missing: Option<&'static str>,
    /// Dotted keys and their values.
    keys: Vec<(String, Value)>,
}

impl Variant {
    /// One that sets these dotted keys.
    pub fn new(name: String, keys: Vec<(String, Value)>) -> Self {
        Self { name, missing: None, keys }
    }

    /// The dotted keys and their values.
    pub fn keys(&self) -> &[(String, Value)] {
        &self.keys
    }

    /// Parses a list as in `--variants`.
    pub fn parse_all(text: &str) -> anyhow::Result<Vec<Self>> {
        // A comma inside brackets belongs to an array.
        let mut depth = 0;
        let apart = |c: char| {
            depth += i32::from(c == '[') - i32::from(c == ']');
            c == ',' && depth == 0
        };
        text.split(apart).map(str::trim).filter(|one| !one.is_empty()).map(Self::parse).collect()
    }

    fn parse(text: &str) -> anyhow::Result<Self> {
        let variant = |missing, keys| Self { name: text.to_owned(), missing, keys };
        let set = |key: &str, value: &str| (key.to_owned(), Value::String(value.to_owned()));
        Ok(match text.split_once(':') {
            None => match text {
                "orime" => variant(None, Vec::new()),
                "cpd" => variant(None, vec![set("simulate.folds.mode", "off")]),
                "aruco" => variant(
                    None,
                    vec![
                        set("capture.rendered.printed", "markers"),
                        set("segment.markers", "sheet"),
                        set("register.mode", "markers"),
                    ],
                ),
                "cpd_clustering" => {
                    let effects = "stretch shear bend crease damping air_drag grippers track";
                    let effects = effects.split(' ').map(|e| Value::String(e.to_owned()));
                    variant(
                        None,
                        vec![
                            set("simulate.folds.mode", "paper"),
                            set("simulate.crease.kind", "paper"),
                            ("simulate.effects".to_owned(), Value::Array(effects.collect())),
                        ],
                    )
                }
                _ => anyhow::bail!(
                    "--variants: `{text}` is none of aruco, cpd, cpd_clustering, orime, and no \
                     NAME:KEY=VALUE"
                ),
            },
            Some((name, keys)) => {
                let keys = keys.split(';').filter(|key| !key.is_empty()).map(assignment);
                Self { name: name.to_owned(), missing: None, keys: keys.collect::<Result<_, _>>()? }
            }
        })
    }

    /// The set's text with this variant's keys in it.
    pub fn apply(&self, text: &str) -> anyhow::Result<String> {
        let mut table: Table = text.parse().context("the set file is no TOML")?;
        for (key, value) in &self.keys {
            let mut place = &mut table;
            let (path, last) = key.rsplit_once('.').unwrap_or(("", key));
            for part in path.split('.').filter(|part| !part.is_empty()) {
                let entry = place.entry(part).or_insert_with(|| Value::Table(Table::new()));
                place = entry
                    .as_table_mut()
                    .with_context(|| format!("`{part}` of `{key}` is no section of the set"))?;
            }
            place.insert(last.to_owned(), value.clone());
        }
        Ok(toml::to_string(&table)?)
    }
}

/// Parses `KEY=VALUE`.
pub fn assignment(text: &str) -> anyhow::Result<(String, Value)> {
    let (key, value) = text.split_once('=').with_context(|| format!("`{text}` is no KEY=VALUE"))?;
    // A value is TOML; a word without quotes is a text.
    let parsed = format!("value = {}", value.trim())
        .parse::<Table>()
        .ok()
        .and_then(|mut table| table.remove("value"))
        .unwrap_or_else(|| Value::String(value.trim().to_owned()));
    Ok((key.trim().to_owned(), parsed))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_are_set_and_unknown_names_refused() {
        let text = "name = \"x\"\n[register]\nflatness = 0.5\n";
        let variants =
            Variant::parse_all("orime, own:register.flatness=0;capture.rendered.faults=real")
                .unwrap();
        let unchanged: Table = variants[0].apply(text).unwrap().parse().unwrap();
        assert_eq!(unchanged, text.parse::<Table>().unwrap());
        let changed: Table = variants[1].apply(text).unwrap().parse().unwrap();
        assert_eq!(changed["register"]["flatness"].as_integer(), Some(0));
        assert_eq!(changed["capture"]["rendered"]["faults"].as_str(), Some("real"));
        assert_eq!(changed["name"].as_str(), Some("x"));
        let arrays = Variant::parse_all("a:x.y=[1, 2];x.z=3,b:x.y=[[4], [5, 6]]").unwrap();
        let array = |k: usize| arrays[k].keys()[0].1.to_string();
        assert_eq!((arrays.len(), array(0), arrays[0].keys().len()), (2, "[1, 2]".to_owned(), 2));
        assert_eq!(array(1), "[[4], [5, 6]]");
        assert!(Variant::parse_all("nonsense").is_err());
        assert!(Variant::parse_all("own:name.x=1").unwrap()[0].apply(text).is_err());
        let clustering = &Variant::parse_all("cpd_clustering").unwrap()[0];
        let set: Table = clustering.apply(text).unwrap().parse().unwrap();
        assert_eq!(set["simulate"]["folds"]["mode"].as_str(), Some("paper"));
    }
}
