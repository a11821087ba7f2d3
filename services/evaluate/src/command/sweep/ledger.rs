//! The rows of a sweep on disk: one line per finished run, so that a second call goes on.

use std::fs::{self, File, OpenOptions};
use std::io::Write as _;
use std::path::{Path, PathBuf};

use anyhow::Context;
use orime_evaluate::sweep::Row;

/// The file of rows, open for more.
pub struct Ledger {
    path: PathBuf,
    file: File,
    rows: Vec<Row>,
}

impl Ledger {
    /// Opens `DIR/runs.jsonl`. A last line without its end is of a run that was cut off: it is
    /// taken away.
    pub fn open(folder: &Path) -> anyhow::Result<Self> {
        fs::create_dir_all(folder)
            .with_context(|| format!("making the folder `{}`", folder.display()))?;
        let path = folder.join("runs.jsonl");
        let text = match fs::read_to_string(&path) {
            Ok(text) => text,
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => String::new(),
            Err(error) => {
                return Err(error).with_context(|| format!("reading `{}`", path.display()));
            }
        };
        let whole = text.rfind('\n').map_or(0, |end| end + 1);
        let row = |(k, line): (usize, &str)| {
            serde_json::from_str(line).with_context(|| {
                format!(
                    "`{}:{}` is no row of a sweep: remove that line, or give another --out",
                    path.display(),
                    k + 1
                )
            })
        };
        let rows = text[..whole].lines().enumerate().map(row).collect::<anyhow::Result<_>>()?;
        let file = OpenOptions::new().create(true).append(true).open(&path);
        let file = file.with_context(|| format!("writing `{}`", path.display()))?;
        if whole < text.len() {
            file.set_len(whole as u64)
                .with_context(|| format!("shortening `{}`", path.display()))?;
        }
        Ok(Self { path, file, rows })
    }

    /// The row of a run that this program made before.
    pub fn row(&self, key: &str, program: &str) -> Option<&Row> {
        self.rows.iter().find(|row| row.key == key && row.program == program)
    }

    /// … or, where it made none, the newest that another one made.
    pub fn row_of_any(&self, key: &str, program: &str) -> Option<&Row> {
        let of_any = || self.rows.iter().rev().find(|row| row.key == key);
        self.row(key, program).or_else(of_any)
    }

    /// Rows of any program and set.
    pub fn len(&self) -> usize {
        self.rows.len()
    }

    /// Adds a finished run, on disk at once.
    pub fn add(&mut self, row: Row) -> anyhow::Result<()> {
        let line = serde_json::to_string(&row)? + "\n";
        self.file
            .write_all(line.as_bytes())
            .and_then(|()| self.file.flush())
            .with_context(|| format!("writing `{}`", self.path.display()))?;
        self.rows.push(row);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(key: &str) -> Row {
        Row {
            key: key.into(),
            program: "p".into(),
            knob: "grid".into(),
            value: "13".into(),
            seed: 1,
            figures: orime_evaluate::sweep::RunFigures::default(),
        }
    }

    #[test]
    fn rows_are_found_again_and_a_torn_one_is_run_again() {
        let name = format!("orime-ledger-{}", std::process::id());
        let folder = std::env::temp_dir().join(name);
        let mut ledger = Ledger::open(&folder).unwrap();
        ledger.add(row("a")).unwrap();
        ledger.add(row("b")).unwrap();
        let path = folder.join("runs.jsonl");
        let text = fs::read_to_string(&path).unwrap();
        fs::write(&path, &text[..text.len() - 5]).unwrap();
        let mut ledger = Ledger::open(&folder).unwrap();
        assert_eq!((ledger.row("a", "p"), ledger.row("b", "p")), (Some(&row("a")), None));
        assert_eq!((ledger.row("a", "q"), ledger.row_of_any("a", "q")), (None, Some(&row("a"))));
        ledger.add(row("c")).unwrap();
        let ledger = Ledger::open(&folder).unwrap();
        assert_eq!((ledger.len(), ledger.row("c", "p")), (2, Some(&row("c"))));
        fs::write(&path, "nonsense\n").unwrap();
        let error = format!("{:#}", Ledger::open(&folder).err().unwrap());
        assert!(error.contains("runs.jsonl:1"), "{error}");
        fs::remove_dir_all(&folder).unwrap();
    }
}
