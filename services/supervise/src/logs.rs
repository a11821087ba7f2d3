//! `orime logs`: what the stages of a running set log.

use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::time::Duration;

use crate::args::Logs;
use crate::exit::{Exit, Failure};
use crate::runs::find;

/// Time between two looks for new lines.
const TICK: Duration = Duration::from_millis(100);
/// Most bytes that are read at once.
const CHUNK_BYTES: u64 = 1 << 20;

/// One stage's log, and what of it has been shown.
struct Log {
    stage: String,
    path: PathBuf,
    shown: u64,
    /// A line whose end has not come yet.
    part: Vec<u8>,
}

/// Shows the last lines, then what comes.
pub fn logs(args: &Logs) -> Result<Exit, Failure> {
    let entry = find(args.run.as_deref())?;
    let folder = entry.out.join("logs");
    let mut logs = found(&folder, args.stage.as_deref())
        .map_err(|error| Failure::machine(format!("reading `{}`: {error}", folder.display())))?;
    if logs.is_empty() {
        let which = args.stage.as_deref().unwrap_or("any stage");
        return Err(Failure::usage(format!("no log of {which} in `{}`", folder.display())));
    }
    let mut out = io::stdout().lock();
    let is_one = logs.len() == 1;
    for log in &mut logs {
        let lines = log.lines();
        let first = lines.len().saturating_sub(args.lines);
        // Whoever reads only the head of it has closed the pipe: that is no failure.
        if !log.show(&mut out, &lines[first..], is_one) {
            return Ok(Exit::Good);
        }
    }
    while args.follow && entry.is_alive() {
        std::thread::sleep(TICK);
        for log in &mut logs {
            let lines = log.lines();
            if !log.show(&mut out, &lines, is_one) {
                return Ok(Exit::Good);
            }
        }
    }
    Ok(Exit::Good)
}

fn found(folder: &Path, stage: Option<&str>) -> io::Result<Vec<Log>> {
    let mut logs = Vec::new();
    for entry in std::fs::read_dir(folder)? {
        let path = entry?.path();
        let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        if path.extension().is_some_and(|e| e == "log") && stage.is_none_or(|s| s == name) {
            logs.push(Log { stage: name, path, shown: 0, part: Vec::new() });
        }
    }
    logs.sort_by(|a, b| a.stage.cmp(&b.stage));
    Ok(logs)
}

impl Log {
    /// Whole lines that have come since the last call.
    fn lines(&mut self) -> Vec<String> {
        while self.read().is_ok_and(|read| read > 0) {}
        let end = self.part.iter().rposition(|byte| *byte == b'\n').map_or(0, |at| at + 1);
        let whole: Vec<u8> = self.part.drain(..end).collect();
        String::from_utf8_lossy(&whole).lines().map(str::to_owned).collect()
    }

    fn read(&mut self) -> io::Result<usize> {
        let mut file = File::open(&self.path)?;
        file.seek(SeekFrom::Start(self.shown))?;
        let read = file.take(CHUNK_BYTES).read_to_end(&mut self.part)?;
        self.shown += read as u64;
        Ok(read)
    }

    fn show(&self, out: &mut impl Write, lines: &[String], is_one: bool) -> bool {
        let mut good = true;
        for line in lines {
            good &= match is_one {
                true => writeln!(out, "{line}").is_ok(),
                false => writeln!(out, "{:9} {line}", self.stage).is_ok(),
            };
        }
        good && out.flush().is_ok()
    }
}
