//! Which depth and colour frame of one camera belong together, while they come.

use std::collections::VecDeque;

/// Pairs frames that are nearest to each other in time, as the reader of recordings does.
///
/// Of two streams each in order of time, the two heads are a pair unless one of them has a nearer
/// partner right behind the other's head. Where heads are nearer than half a period nobody can
/// be nearer, and nothing is waited for.
#[derive(Debug)]
pub(super) struct Pairing<T> {
    /// Depth, then colour.
    queues: [VecDeque<(u64, T)>; 2],
    period_ns: u64,
    /// Whether even nearer partners are waited for: stamps need not keep to the period.
    strict: bool,
    unmatched: u64,
}

/// Most frames of a stream that wait for partners: a stream without the other would fill memory.
const WAITING_MAX: usize = 4;

impl<T> Pairing<T> {
    /// For streams of this period.
    pub fn new(period_ns: u64, strict: bool) -> Self {
        Self { queues: [VecDeque::new(), VecDeque::new()], period_ns, strict, unmatched: 0 }
    }

    /// Adds a frame of a stream (0 depth, 1 colour); one not later than the last is left out, for
    /// the SDK gives some twice.
    pub fn push(&mut self, stream: usize, time_ns: u64, frame: T) {
        let queue = &mut self.queues[stream];
        if queue.back().is_some_and(|(last_ns, _)| time_ns <= *last_ns) {
            return;
        }
        queue.push_back((time_ns, frame));
        if queue.len() > WAITING_MAX {
            queue.pop_front();
            self.unmatched += 1;
        }
    }

    /// The next pair, if it is certain; at the end (`ended`) every pair is.
    pub fn pop(&mut self, ended: bool) -> Option<[(u64, T); 2]> {
        loop {
            let [depth, color] = &self.queues;
            let heads_ns = [depth.front()?.0, color.front()?.0];
            let apart_ns = heads_ns[0].abs_diff(heads_ns[1]);
            // Only what follows the earlier head can be nearer to the later one.
            let (early, late) = if heads_ns[0] <= heads_ns[1] { (0, 1) } else { (1, 0) };
            let next_ns = self.queues[early].get(1).map(|(time_ns, _)| *time_ns);
            let has_nearer = next_ns.is_some_and(|next| next.abs_diff(heads_ns[late]) < apart_ns);
            if apart_ns > self.period_ns || has_nearer {
                self.queues[early].pop_front();
                self.unmatched += 1;
                continue;
            }
            let is_near = !self.strict && apart_ns <= self.period_ns / 2;
            if apart_ns > 0 && next_ns.is_none() && !is_near && !ended {
                return None;
            }
            let [depth, color] = &mut self.queues;
            return Some([depth.pop_front()?, color.pop_front()?]);
        }
    }

    /// The stream of which a frame is needed next, if one is needed more than the other.
    pub fn needs(&self) -> Option<usize> {
        let [depth, color] = self.queues.each_ref().map(VecDeque::len);
        match depth.cmp(&color) {
            std::cmp::Ordering::Less => Some(0),
            std::cmp::Ordering::Greater => Some(1),
            std::cmp::Ordering::Equal => None,
        }
    }

    /// See [`Self::new`].
    pub fn period_ns(&self) -> u64 {
        self.period_ns
    }

    /// Frames that found no partner.
    pub fn unmatched(&self) -> u64 {
        self.unmatched
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Frames as (stream, time), in order of arrival; a period is 30.
    fn check(strict: bool, frames: &[(usize, u64)], expected: &[[u64; 2]], unmatched: u64) {
        let mut pairing = Pairing::new(30, strict);
        let mut pairs = Vec::new();
        for (stream, time) in frames {
            pairing.push(*stream, *time, ());
            pairs.extend(std::iter::from_fn(|| pairing.pop(false)));
        }
        pairs.extend(std::iter::from_fn(|| pairing.pop(true)));
        let times: Vec<[u64; 2]> = pairs.iter().map(|pair| pair.map(|(time, ())| time)).collect();
        assert_eq!((&times[..], pairing.unmatched()), (expected, unmatched));
    }

    #[test]
    fn nearest_frames_are_a_pair_whichever_comes_first() {
        for strict in [false, true] {
            let late = [(0, 100), (0, 130), (1, 102), (1, 131), (0, 160), (1, 161)];
            check(strict, &late, &[[100, 102], [130, 131], [160, 161]], 0);
            check(strict, &[(0, 100), (1, 125), (0, 130)], &[[130, 125]], 1);
            check(strict, &[(1, 100), (0, 170), (1, 171)], &[[170, 171]], 1);
            check(strict, &[(0, 100), (0, 100), (1, 100), (1, 100)], &[[100, 100]], 0);
        }
    }

    #[test]
    fn a_near_pair_is_given_at_once_unless_nothing_may_be_missed() {
        for strict in [false, true] {
            let mut pairing = Pairing::new(30, strict);
            pairing.push(0, 100, 'd');
            pairing.push(1, 110, 'c');
            assert_eq!(pairing.pop(false).is_none(), strict);
        }
    }

    #[test]
    fn a_stream_alone_does_not_pile_up() {
        let mut pairing = Pairing::new(30, true);
        (0..100).for_each(|k| pairing.push(0, k * 30, ()));
        assert_eq!((pairing.pop(true), pairing.unmatched()), (None, 96));
    }
}
