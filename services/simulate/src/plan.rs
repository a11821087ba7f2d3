//! What is said of lines that are about to be folded.

use orime_geometry::SheetGrid;
use std::collections::VecDeque;

/// Nearer than this two points make no line, metres.
const DISTINCT_M: f64 = 1e-4;
/// Most plans that wait for their exposure; the oldest goes where there are more.
const SAID_MAX: usize = 8;

/// A line that is about to be folded.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlannedLine {
    /// Two points of it, (u, v), metres.
    pub ends_uv_m: [[f64; 2]; 2],
    /// From which exposure on it may be folded, nanoseconds.
    pub valid_from_ns: u64,
}

impl PlannedLine {
    /// Whether it is a line and meets the sheet.
    fn is_on(&self, sheet: &SheetGrid) -> bool {
        let [a, b] = self.ends_uv_m;
        let d = [b[0] - a[0], b[1] - a[1]];
        let [u_m, v_m] = sheet.size_m;
        let corners = [[0.0, 0.0], [u_m, 0.0], [u_m, v_m], [0.0, v_m]];
        let side = |[u, v]: [f64; 2]| d[0] * (v - a[1]) - d[1] * (u - a[0]);
        let (low, high) = corners
            .map(side)
            .into_iter()
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), s| (l.min(s), h.max(s)));
        let is_finite = self.ends_uv_m.iter().flatten().all(|c| c.is_finite());
        is_finite && d[0].hypot(d[1]) > DISTINCT_M && low < 0.0 && high > 0.0
    }
}

/// Plans as they were said, and what holds at an instant.
///
/// A plan may come long before the exposure from which on it holds, so that a sender that runs
/// ahead changes nothing for the frames before; one that comes late holds from then on; one that
/// makes no sense is left out whole.
#[derive(Debug, Clone, Default)]
pub struct PlanLog {
    holds: Vec<PlannedLine>,
    said: VecDeque<(u64, Vec<PlannedLine>)>,
    lines: Vec<[[f64; 2]; 2]>,
}

impl PlanLog {
    /// Nothing was said.
    pub fn new() -> Self {
        Self::default()
    }

    /// Notes the plan that holds from an exposure on. `false` where a line misses the sheet or is
    /// none: then what was said before stays.
    pub fn note(&mut self, from_ns: u64, plan: &[PlannedLine], sheet: &SheetGrid) -> bool {
        if !plan.iter().all(|line| line.is_on(sheet)) {
            return false;
        }
        if self.said.len() >= SAID_MAX {
            self.said.pop_front();
        }
        let at = self.said.partition_point(|(said_ns, _)| *said_ns <= from_ns);
        self.said.insert(at, (from_ns, plan.to_vec()));
        true
    }

    /// The lines that may be folded at an exposure; exposures ascend.
    pub fn at(&mut self, exposure_ns: u64) -> &[[[f64; 2]; 2]] {
        while self.said.front().is_some_and(|(from_ns, _)| *from_ns <= exposure_ns) {
            self.holds = self.said.pop_front().map(|(_, plan)| plan).unwrap_or_default();
        }
        let open = self.holds.iter().filter(|line| line.valid_from_ns <= exposure_ns);
        self.lines.clear();
        self.lines.extend(open.map(|line| line.ends_uv_m));
        &self.lines
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const DIAGONAL: [[f64; 2]; 2] = [[0.0, 0.0], [0.1, 0.1]];
    const MIDDLE: [[f64; 2]; 2] = [[0.05, 0.0], [0.05, 0.1]];

    fn sheet() -> SheetGrid {
        SheetGrid::new([0.1, 0.1], [11, 11])
    }

    fn line(ends_uv_m: [[f64; 2]; 2], valid_from_ns: u64) -> PlannedLine {
        PlannedLine { ends_uv_m, valid_from_ns }
    }

    #[test]
    fn nothing_said_is_nothing_planned() {
        let nothing: &[[[f64; 2]; 2]] = &[];
        assert_eq!(PlanLog::new().at(5), nothing);
    }

    #[test]
    fn lines_hold_from_their_time_on_and_a_later_plan_replaces_them() {
        let mut log = PlanLog::new();
        assert!(log.note(10, &[line(DIAGONAL, 20), line(MIDDLE, 30)], &sheet()));
        // Said ahead of time: it changes nothing before.
        assert!(log.note(40, &[], &sheet()));
        let counts = [5, 10, 19, 20, 29, 30, 39, 40, 50].map(|at_ns| log.at(at_ns).len());
        assert_eq!(counts, [0, 0, 0, 1, 1, 2, 2, 0, 0]);
    }

    #[test]
    fn what_comes_late_holds_from_then_on_and_the_newest_of_several_wins() {
        let mut log = PlanLog::new();
        log.at(100);
        assert!(log.note(20, &[line(MIDDLE, 0)], &sheet()));
        assert!(log.note(10, &[line(DIAGONAL, 0)], &sheet()));
        assert_eq!(log.at(101), [MIDDLE]);
    }

    #[test]
    fn what_makes_no_sense_is_left_out_whole() {
        let mut log = PlanLog::new();
        assert!(log.note(0, &[line(DIAGONAL, 0)], &sheet()));
        let missing = [[0.2, 0.0], [0.2, 0.1]];
        let along_the_rim = [[0.0, 0.0], [0.0, 0.1]];
        let point = [[0.05, 0.05]; 2];
        for bad in [missing, along_the_rim, point, [[f64::NAN, 0.0], [0.1, 0.1]]] {
            assert!(!log.note(1, &[line(MIDDLE, 0), line(bad, 0)], &sheet()), "{bad:?}");
        }
        assert_eq!(log.at(2), [DIAGONAL]);
    }

    #[test]
    fn few_plans_wait() {
        let mut log = PlanLog::new();
        for from_ns in 0..100 {
            assert!(log.note(1000 + from_ns, &[line(MIDDLE, 0)], &sheet()));
        }
        assert_eq!(log.said.len(), SAID_MAX);
        assert_eq!(log.at(2000), [MIDDLE]);
    }
}
