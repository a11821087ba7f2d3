//! Every problem of a set file at once, each at its place, before any process starts.

use std::io::Write;
use std::ops::Range;
use std::path::Path;

use orime_capture::CaptureParams;
use orime_geometry::{RgbdCamera, SheetParams};
use orime_params::Problem;
use orime_register::{RegisterMode, RegisterParams};
use orime_runtime::{Pace, SECTIONS, SetFile};
use orime_segment::SegmentParams;
use orime_simulate::SimulateParams;
use serde::Deserialize;
use serde::de::DeserializeOwned;

use crate::exit::{Exit, Failure};
use crate::open::open;
use crate::places::{Place, is_within, nearest, places};
use crate::problem::PlacedProblem;

/// Most problems of spelling and kind that are reported of one file.
const PROBLEMS_MAX: usize = 100;

/// A set that was checked and can be started.
#[derive(Debug)]
pub struct CheckedSet {
    /// The file.
    pub file: SetFile,
    /// The cameras of its source.
    pub cameras: Vec<RgbdCamera>,
    /// Frame sets, or `None` for an endless source.
    pub steps: Option<u64>,
}

/// The shape of a set file; only its spelling and kinds are looked at.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
#[expect(dead_code, reason = "the fields are the file's shape; nobody reads them here")]
struct SetShape {
    name: Option<String>,
    pace: Option<Pace>,
    budget_ms: Option<f64>,
    profile: Option<String>,
    #[serde(default)]
    sheet: SheetParams,
    #[serde(default)]
    capture: CaptureParams,
    #[serde(default)]
    segment: SegmentParams,
    #[serde(default)]
    register: RegisterParams,
    #[serde(default)]
    simulate: SimulateParams,
}

/// Checks the text of a set file that lies at `path`.
pub fn check(path: &Path, text: &str) -> Result<CheckedSet, Vec<PlacedProblem>> {
    let mut check =
        Check { path, text, places: places(text), problems: Vec::new(), wrong: Vec::new() };
    let Some(rest) = check.spelling() else { return Err(check.problems) };
    let set = match SetFile::parse(path, rest) {
        Ok(set) => set,
        Err(error) => {
            check.report("", error.to_string());
            return Err(check.problems);
        }
    };
    check.ranges(&set);
    check.agreement(&set);
    if check.problems.is_empty() {
        match open(&set) {
            // The text as it is, not as it was blanked for the check.
            Ok((cameras, steps)) => {
                let mut file = set;
                file.text = text.to_owned();
                return Ok(CheckedSet { file, cameras, steps });
            }
            Err(fault) => {
                check.report(fault.key, fault.message);
                if let Some(problem) = check.problems.last_mut() {
                    problem.is_damage = fault.is_damage;
                }
            }
        }
    }
    check.problems.sort_by_key(|problem| (problem.line, problem.column));
    Err(check.problems)
}

/// `orime check`: prints every problem, or that there is none.
pub fn command(path: &Path, json: bool) -> Result<Exit, Failure> {
    let text = std::fs::read_to_string(path).map_err(|error| {
        Failure::usage(format!("reading set file `{}`: {error}", path.display()))
    })?;
    let problems = match check(path, &text) {
        Ok(set) => {
            crate::doubts::of(&set).iter().for_each(|doubt| eprintln!("warning: {doubt}"));
            Vec::new()
        }
        Err(problems) => problems,
    };
    let text = if json {
        serde_json::to_string_pretty(&problems)
            .map_err(|error| Failure::machine(error.to_string()))?
    } else if problems.is_empty() {
        format!("{}: good", path.display())
    } else {
        let list: String = problems.iter().map(|problem| format!("{problem}\n\n")).collect();
        format!("{list}{} problem(s)", problems.len())
    };
    // Whoever reads only the head of it has closed the pipe: that is no failure.
    let _ = writeln!(std::io::stdout(), "{text}");
    Ok(if problems.is_empty() { Exit::Good } else { exit_of(&problems) })
}

/// How a command ends that met these problems.
pub fn exit_of(problems: &[PlacedProblem]) -> Exit {
    let damage_only = problems.iter().all(|problem| problem.is_damage);
    if damage_only { Exit::Damaged } else { Exit::Usage }
}

struct Check<'t> {
    path: &'t Path,
    text: &'t str,
    places: Vec<Place>,
    problems: Vec<PlacedProblem>,
    /// Keys whose spelling or kind is wrong: nothing else is said about them.
    wrong: Vec<String>,
}

impl Check<'_> {
    /// Finds unknown keys and values of the wrong kind; gives the text without them, or `None`
    /// if it is not TOML at all.
    ///
    /// The parser stops at the first problem. So each one is noted and blanked out, byte for
    /// byte, and the rest is parsed again.
    fn spelling(&mut self) -> Option<String> {
        let mut rest = self.text.to_owned();
        let is_toml = toml_edit::Document::parse(self.text).is_ok();
        for _ in 0..PROBLEMS_MAX {
            let Err(error) = toml::from_str::<SetShape>(&rest) else { return Some(rest) };
            let span = error.span().unwrap_or(0..0);
            let message = error.message().trim().replace('\n', "; ");
            let culprit = is_toml.then(|| self.innermost(&span)).flatten().cloned();
            let Some(culprit) = culprit else {
                self.report_at(span, String::new(), message);
                return None;
            };
            self.report_at(span, culprit.key.clone(), message);
            if self.wrong.contains(&culprit.key) {
                return None;
            }
            self.blank(&culprit, &mut rest);
            self.wrong.push(culprit.key);
        }
        None
    }

    /// The deepest key that is, or whose value contains, these bytes.
    fn innermost(&self, span: &Range<usize>) -> Option<&Place> {
        let holds = |outer: &Range<usize>| outer.start <= span.start && span.end <= outer.end;
        let holding = |place: &&Place| holds(&place.key_span) || holds(&place.value_span);
        let found = self.places.iter().filter(holding).max_by_key(|place| place.key.len())?;
        // An element of an array cannot be taken out alone: its array goes.
        let mut key = found.key.as_str();
        while let Some((parent, last)) = key.rsplit_once('.') {
            if last.parse::<usize>().is_err() {
                break;
            }
            key = parent;
        }
        self.places.iter().find(|place| place.key == key)
    }

    /// Blanks a key and all within it out of `text`, which keeps its length and lines.
    fn blank(&self, culprit: &Place, text: &mut String) {
        let mut bytes = std::mem::take(text).into_bytes();
        for place in self.places.iter().filter(|place| is_within(&place.key, &culprit.key)) {
            let span = if place.is_table {
                place.value_span.clone()
            } else {
                place.key_span.start..place.value_span.end.max(place.key_span.end)
            };
            for byte in &mut bytes[span] {
                if *byte != b'\n' {
                    *byte = b' ';
                }
            }
        }
        *text = String::from_utf8_lossy(&bytes).into_owned();
    }

    /// Finds values out of range in every section.
    fn ranges(&mut self, set: &SetFile) {
        fn section<P: DeserializeOwned, C>(
            set: &SetFile,
            section: &str,
            check: impl FnOnce(&P) -> Result<C, Vec<Problem>>,
        ) -> Vec<Problem> {
            match set.section::<P>(section) {
                Ok(params) => check(&params).err().unwrap_or_default(),
                Err(error) => {
                    vec![Problem { key: String::new(), message: error.to_string() }]
                }
            }
        }
        let found = [
            section(set, "sheet", SheetParams::check),
            section(set, "capture", CaptureParams::check),
            section(set, "segment", SegmentParams::check),
            section(set, "register", RegisterParams::check),
            section(set, "simulate", SimulateParams::check),
        ];
        for (section, problems) in SECTIONS.iter().zip(found) {
            for Problem { key, message } in problems {
                let path = key.replace('[', ".").replace(']', "");
                let full = format!("{section}.{path}");
                let known = |wrong: &String| is_within(&full, wrong) || is_within(wrong, &full);
                if !self.wrong.iter().any(known) {
                    self.report(full.trim_end_matches('.'), format!("`{key}` {message}"));
                }
            }
        }
    }

    /// Finds sections that do not fit together, where each alone is sound.
    fn agreement(&mut self, set: &SetFile) {
        let (Ok(sheet), Ok(segment), Ok(register)) = (
            set.checked("sheet", SheetParams::check),
            set.checked("segment", SegmentParams::check),
            set.section::<RegisterParams>("register"),
        ) else {
            return;
        };
        if let Err(problem) = segment.check_sheet(&sheet) {
            let key = format!("sheet.{}", problem.key);
            self.report(&key, format!("`{}` {}", problem.key, problem.message));
        }
        if register.mode == RegisterMode::Markers && !segment.finds_markers() {
            let message = "`mode` \"markers\" needs `markers = \"sheet\"` under [segment]";
            self.report("register.mode", message.to_owned());
        }
    }

    /// Reports a problem of `key`, at the place of it or of what would hold it.
    fn report(&mut self, key: &str, message: String) {
        let span = nearest(&self.places, key).map_or(0..0, |place| place.key_span.clone());
        self.report_at(span, key.to_owned(), message);
    }

    fn report_at(&mut self, span: Range<usize>, key: String, message: String) {
        self.problems.push(PlacedProblem::new(self.path, self.text, span, key, message));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn problems(text: &str) -> Vec<(usize, usize, String)> {
        let problems = check(Path::new("sets/test.toml"), text).err().unwrap_or_default();
        problems.into_iter().map(|p| (p.line, p.column, p.key)).collect()
    }

    #[test]
    fn the_embedded_set_is_good() {
        let set = check(Path::new("half_fold.toml"), crate::up::DEFAULT_SET).unwrap();
        assert_eq!((set.file.name.as_str(), set.file.pace), ("half_fold", Pace::Lockstep));
        assert!(set.steps.is_some());
    }

    #[test]
    fn a_budget_and_a_profile_are_parts_of_a_set() {
        let set = |more: &str| crate::up::DEFAULT_SET.replace("\npace", &format!("\n{more}\npace"));
        let path = Path::new("half_fold.toml");
        let checked = check(path, &set("budget_ms = 11\nprofile = \"fast\"")).unwrap();
        assert_eq!(checked.file.budget_ms, Some(11.0));
        for wrong in ["budget_ms = -1.0", "budget_ms = \"11\"", "profile = \"slow\""] {
            assert!(check(path, &set(wrong)).is_err(), "{wrong}");
        }
    }

    #[test]
    fn sections_must_fit_together() {
        let text = "[sheet]\nnodes = [24, 24]\n[capture]\nsource = \"rendered\"\n\
                    [segment]\nmarkers = \"sheet\"\n";
        assert_eq!(problems(text), [(2, 1, "sheet.nodes".to_owned())]);
        let text = "[register]\nmode = \"markers\"\n";
        assert_eq!(problems(text), [(2, 1, "register.mode".to_owned())]);
    }

    #[test]
    fn every_problem_comes_at_once_at_its_place() {
        let text = "\
name = \"bad\"
pace = \"fast\"

[sheet]
size_m = [210.0, 0.1]
nodes = \"many\"

[captrue]
fps = 3

[capture]
fps = -1.0
  fsp = 30
[capture.rendered]
steps = 1
";
        let key = |line, column, key: &str| (line, column, key.to_owned());
        assert_eq!(
            problems(text),
            [
                key(2, 8, "pace"),
                key(5, 1, "sheet.size_m"),
                key(6, 9, "sheet.nodes"),
                key(8, 2, "captrue"),
                key(12, 1, "capture.fps"),
                key(13, 3, "capture.fsp"),
                key(15, 1, "capture.rendered.steps"),
            ]
        );
    }

    #[test]
    fn what_is_missing_is_shown_where_it_belongs() {
        assert_eq!(
            problems("[sheet]\n[capture]\nsource = \"folder\"\n"),
            [(2, 2, "capture.folder.layout".to_owned())]
        );
    }

    #[test]
    fn a_text_that_is_not_toml_is_one_problem() {
        let problems = problems("[sheet]\nsize_m = [0.1, \n[capture]\n");
        assert_eq!(problems.len(), 1, "{problems:?}");
    }

    #[test]
    fn problems_are_printed_with_their_line() {
        let text = "[sheet]\nnodes = \"ü\" # twenty-five\n";
        let problems = check(Path::new("a.toml"), text).unwrap_err();
        let text = problems[0].to_string();
        assert!(text.starts_with("a.toml:2:9: "), "{text}");
        assert!(text.ends_with("2 | nodes = \"ü\" # twenty-five\n  |         ^^^"), "{text}");
    }
}
