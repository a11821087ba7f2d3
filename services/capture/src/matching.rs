//! Frames of several cameras to frame sets, by time.

use std::collections::VecDeque;

/// Gathers frames to sets; frames of one camera come in order of time.
///
/// The earliest frame that is waiting opens a set, and frames of the other cameras within the
/// tolerance after it join. The set is complete when every camera has a frame in it or has sent
/// one that is later; a camera that has sent nothing for longer than the patience is not waited
/// for. So a slow or dead camera costs its own frames, and no others.
#[derive(Debug)]
pub(crate) struct SetMatcher<T> {
    tolerance_ns: u64,
    patience_ns: u64,
    queues: Vec<VecDeque<Waiting<T>>>,
    /// Opening time of the last set that was given away.
    given_ns: Option<u64>,
    unmatched: u64,
    /// Cameras from which no more frames come.
    ended: Vec<bool>,
}

#[derive(Debug)]
struct Waiting<T> {
    time_ns: u64,
    item: T,
}

/// A frame set: what each camera has in it, and when that was exposed.
pub(crate) type MatchedSet<T> = Vec<Option<(u64, T)>>;

impl<T> SetMatcher<T> {
    /// A matcher for `cameras` cameras: frames up to `tolerance_ns` apart belong together, and a
    /// set waits up to `patience_ns` (in the frames' clock) for a camera.
    pub fn new(cameras: usize, tolerance_ns: u64, patience_ns: u64) -> Self {
        Self {
            tolerance_ns,
            patience_ns,
            queues: (0..cameras).map(|_| VecDeque::new()).collect(),
            given_ns: None,
            unmatched: 0,
            ended: vec![false; cameras],
        }
    }

    /// Adds a frame; one whose set has gone without it is counted and dropped.
    pub fn push(&mut self, camera: usize, time_ns: u64, item: T) {
        if self.given_ns.is_some_and(|given| time_ns <= given + self.tolerance_ns) {
            self.unmatched += 1;
            return;
        }
        self.queues[camera].push_back(Waiting { time_ns, item });
    }

    /// Says that no more frames come from a camera (or that they do again): sets do not wait for
    /// it.
    pub fn set_ended(&mut self, camera: usize, ended: bool) {
        self.ended[camera] = ended;
    }

    /// Whether nothing is left and nothing comes.
    pub fn is_over(&self) -> bool {
        self.ended.iter().all(|ended| *ended) && self.queues.iter().all(VecDeque::is_empty)
    }

    /// Frames of a camera that wait for their set.
    pub fn waiting(&self, camera: usize) -> usize {
        self.queues[camera].len()
    }

    /// Drops the oldest waiting frame of a camera.
    pub fn drop_oldest(&mut self, camera: usize) {
        self.queues[camera].pop_front();
    }

    /// Frames that were dropped because their set had gone.
    pub fn unmatched(&self) -> u64 {
        self.unmatched
    }

    /// The next set, if it is there at `now_ns` of the frames' clock.
    pub fn pop(&mut self, now_ns: u64) -> Option<MatchedSet<T>> {
        let heads = self.queues.iter().filter_map(|queue| queue.front().map(|w| w.time_ns));
        let opened_ns = heads.min()?;
        let mut cameras = self.queues.iter().zip(&self.ended);
        let is_late = now_ns >= opened_ns.saturating_add(self.patience_ns);
        if !is_late && cameras.any(|(queue, ended)| queue.is_empty() && !ended) {
            return None;
        }
        self.given_ns = Some(opened_ns);
        let until_ns = opened_ns + self.tolerance_ns;
        let set = self.queues.iter_mut().map(|queue| {
            let is_in = queue.front().is_some_and(|head| head.time_ns <= until_ns);
            let head = if is_in { queue.pop_front() } else { None };
            // A second frame of the same camera within the tolerance has no set.
            while queue.front().is_some_and(|head| head.time_ns <= until_ns) {
                queue.pop_front();
                self.unmatched += 1;
            }
            head.map(|waiting| (waiting.time_ns, waiting.item))
        });
        Some(set.collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Frames as (camera, time in ms), sets as the times of their cameras, `0` for none.
    fn check(frames: &[(usize, u64)], expected: &[[u64; 2]], unmatched: u64) {
        let mut matcher = SetMatcher::new(2, 10, 100);
        let mut sets = Vec::new();
        for (camera, time) in frames {
            matcher.push(*camera, *time, ());
            while let Some(set) = matcher.pop(*time) {
                sets.push([0, 1].map(|k: usize| set[k].map_or(0, |(time, ())| time)));
            }
        }
        assert_eq!((&sets[..], matcher.unmatched()), (expected, unmatched));
    }

    #[test]
    fn frames_within_the_tolerance_are_a_set_whoever_comes_first() {
        check(&[(0, 100), (1, 107), (1, 133), (0, 135)], &[[100, 107], [135, 133]], 0);
    }

    #[test]
    fn a_camera_out_of_step_gets_sets_of_its_own() {
        check(&[(0, 100), (1, 120), (0, 140), (1, 160)], &[[100, 0], [0, 120], [140, 0]], 0);
    }

    #[test]
    fn a_dead_camera_is_waited_for_once_in_a_while_only() {
        let frames = [(0, 100), (1, 103), (0, 130), (0, 160), (0, 190), (0, 220), (0, 250)];
        // Patience of 100: the set of 130 is given at 230 or later.
        check(&frames, &[[100, 103], [130, 0]], 0);
    }

    #[test]
    fn a_late_frame_is_counted() {
        let frames = [(0, 100), (1, 101), (0, 130), (0, 240), (1, 131), (1, 241)];
        check(&frames, &[[100, 101], [130, 0], [240, 241]], 1);
    }

    #[test]
    fn a_camera_that_has_ended_is_not_waited_for() {
        let mut matcher = SetMatcher::new(2, 10, 100);
        matcher.push(0, 100, 'a');
        assert!(matcher.pop(100).is_none());
        matcher.set_ended(1, true);
        assert!(!matcher.is_over());
        assert_eq!(matcher.pop(100), Some(vec![Some((100, 'a')), None]));
        assert_eq!(matcher.pop(100), None);
        matcher.set_ended(0, true);
        assert!(matcher.is_over());
    }
}
