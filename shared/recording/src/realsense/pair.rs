//! Which colour frame belongs to which depth frame.

use super::FrameRef;

/// Depth and colour frames that belong together.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Paired {
    pub pairs: Vec<[FrameRef; 2]>,
    /// Frames of either stream without a partner.
    pub unpaired: u64,
    /// Median time between depth frames, nanoseconds.
    pub period_ns: u64,
}

/// Period of a stream of one frame, nanoseconds.
const PERIOD_NS: u64 = 33_333_333;

/// Pairs each depth frame with the colour frame nearest in time, at most `pair_ns` (default one
/// period) apart; a colour frame belongs to the depth frame nearest to it. Times increase.
pub(super) fn pair(depth: &[FrameRef], color: &[FrameRef], pair_ns: Option<u64>) -> Paired {
    let (mut depth, mut color) = (depth.to_vec(), color.to_vec());
    for frames in [&mut depth, &mut color] {
        frames.sort_by_key(|frame| frame.time_ns);
        frames.dedup_by_key(|frame| frame.time_ns);
    }
    let period_ns = period_ns(&depth);
    let most_ns = pair_ns.unwrap_or(period_ns.max(self::period_ns(&color)));
    let mut pairs = Vec::new();
    for depth_frame in &depth {
        let Some(nearest) = nearest(&color, depth_frame.time_ns) else { continue };
        let is_mutual = self::nearest(&depth, nearest.time_ns) == Some(*depth_frame);
        if is_mutual && nearest.time_ns.abs_diff(depth_frame.time_ns) <= most_ns {
            pairs.push([*depth_frame, nearest]);
        }
    }
    let unpaired = (depth.len() + color.len() - 2 * pairs.len()) as u64;
    Paired { pairs, unpaired, period_ns }
}

/// The frame nearest to a time, of two the earlier one. Frames are in order of time.
fn nearest(frames: &[FrameRef], time_ns: u64) -> Option<FrameRef> {
    let after = frames.partition_point(|frame| frame.time_ns < time_ns);
    let around = frames[after.saturating_sub(1)..].iter().take(2);
    around.min_by_key(|frame| frame.time_ns.abs_diff(time_ns)).copied()
}

fn period_ns(frames: &[FrameRef]) -> u64 {
    let mut gaps: Vec<u64> = frames.windows(2).map(|w| w[1].time_ns - w[0].time_ns).collect();
    gaps.sort_unstable();
    gaps.get(gaps.len() / 2).copied().unwrap_or(PERIOD_NS)
}

#[cfg(test)]
mod tests {
    use super::super::Place;
    use super::*;

    fn frames(times_ms: &[u64]) -> Vec<FrameRef> {
        let frame = |t: &u64| FrameRef {
            time_ns: t * 1_000_000,
            number: *t,
            place: Place::Db3 { row: *t as i64 },
        };
        times_ms.iter().map(frame).collect()
    }

    fn check(depth: &[u64], color: &[u64], expected: &[[u64; 2]], unpaired: u64) {
        let found = pair(&frames(depth), &frames(color), Some(20_000_000));
        let numbers: Vec<[u64; 2]> = found.pairs.iter().map(|p| p.map(|f| f.number)).collect();
        assert_eq!((&numbers[..], found.unpaired), (expected, unpaired));
    }

    #[test]
    fn nearest_frames_belong_together_and_the_rest_is_counted() {
        check(&[0, 33, 66], &[5, 38, 71], &[[0, 5], [33, 38], [66, 71]], 0);
        // A colour frame is lost: its depth frame stays alone.
        check(&[0, 33, 66], &[5, 71], &[[0, 5], [66, 71]], 1);
        // Two depth frames, one colour frame between them.
        check(&[100, 130], &[118], &[[130, 118]], 1);
        check(&[0], &[30], &[], 2);
        check(&[], &[30], &[], 1);
    }
}
