//! The net: the last write to the positions.

use super::pair::Pair;
use super::{GenericContact, is_usable, load, store};
use nalgebra::{Point3, Vector3};
use orime_geometry::fit;

/// Pairs that stay farther apart than this are no concern of the net, metres.
const REACH_M: f64 = 5e-6;
/// Times that pairs are sought anew.
const ROUNDS: usize = 3;
/// Passes over the pairs of a round. In the second half a pair keeps nothing of its own motion.
const PASSES: usize = 12;
/// Share of what is proven free that is used.
const USED: f64 = 0.9;

/// What [`GenericContact::truncate`] did.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NetReport {
    /// Whether the step began free of crossings. If not, nothing was done: untangle first.
    pub armed: bool,
    /// Pairs that were looked at in the last round.
    pub pairs: u32,
    /// Times that a pair was given its mean motion.
    pub blended: u32,
    /// Share of their ways that all nodes went; below 1 the net was needed to the last.
    pub share: f64,
}

impl GenericContact {
    /// Shortens the ways from `from_m` to `x_m` so that nothing passes through anything. Both in
    /// metres, one per node; `x_m` that is not finite becomes `from_m`.
    pub fn truncate(&mut self, from_m: &[[f32; 3]], x_m: &mut [[f32; 3]]) -> NetReport {
        assert_eq!(from_m.len(), x_m.len(), "one position per node");
        let mut report = NetReport { armed: true, pairs: 0, blended: 0, share: 1.0 };
        if self.proven_m != from_m && self.crossings(from_m) > 0 {
            return NetReport { armed: false, ..report };
        }
        if !is_usable(x_m, self.from.len()) {
            x_m.copy_from_slice(from_m);
            return NetReport { share: 0.0, ..report };
        }
        self.begin_step(from_m);
        load(&mut self.to, x_m, &self.origin_m);
        self.carry_along();
        let mut clear = false;
        for _ in 0..ROUNDS {
            self.list_pairs(REACH_M);
            report.pairs = self.pairs.len() as u32;
            let blended = self.blend();
            report.blended += blended;
            clear = blended == 0;
            if clear {
                break;
            }
        }
        if !clear {
            report.share = self.shorten_all();
        }
        if report.blended > 0 {
            store(x_m, &self.to, &self.origin_m);
        }
        self.proven_m.copy_from_slice(x_m);
        report
    }

    /// As [`GenericContact::truncate`], where `x_m` crosses itself; else nothing is to be done.
    pub fn catch(&mut self, from_m: &[[f32; 3]], x_m: &mut [[f32; 3]]) -> NetReport {
        if self.is_free(x_m) {
            return NetReport { armed: true, pairs: 0, blended: 0, share: 1.0 };
        }
        self.truncate(from_m, x_m)
    }

    /// Lets the sheet go along as a rigid body: on that way nothing meets, and what is shortened is
    /// only what each part goes beyond it. Where nodes are held, nothing else may be carried.
    fn carry_along(&mut self) {
        if self.mobility.iter().any(|mobility| *mobility <= 0.0) {
            return;
        }
        let [from, to] = &mut self.carried;
        for (points, x) in [(&mut *from, &self.from), (&mut *to, &self.to)] {
            points.clear();
            points.extend(x.iter().copied().map(Point3::from));
        }
        if let Some(motion) = fit::rigid(from, to, |_| 1.0) {
            for (carried, from) in self.from.iter_mut().zip(from) {
                *carried = (motion * *from).coords;
            }
        }
    }

    /// Gives pairs that would meet their mean motion; how often.
    fn blend(&mut self) -> u32 {
        let mut blended = 0;
        self.blended_at.fill(0);
        for pass in 0..PASSES {
            let before = blended;
            for at in 0..self.pairs.len() {
                let pair = self.pairs[at];
                // A pair that was free stays so until one of its nodes is moved: by a later pair
                // of the last pass or by an earlier one of this.
                let turn = (pass * self.pairs.len() + at) as u32 + 1;
                let last = turn.saturating_sub(self.pairs.len() as u32);
                if pass > 0 && pair.nodes.iter().all(|n| self.blended_at[*n as usize] < last) {
                    continue;
                }
                let (from, to) = self.way(&pair);
                let share = pair.free_share(&from, &to);
                if share < 1.0 {
                    blended += 1;
                    pair.nodes.iter().for_each(|n| self.blended_at[*n as usize] = turn);
                    let kept = if 2 * pass < PASSES { USED * share } else { 0.0 };
                    self.go_together(&pair, &from, &to, kept);
                }
            }
            if blended == before {
                break;
            }
        }
        blended
    }

    fn way(&self, pair: &Pair) -> ([Vector3<f64>; 4], [Vector3<f64>; 4]) {
        (pair.nodes.map(|n| self.from[n as usize]), pair.nodes.map(|n| self.to[n as usize]))
    }

    /// The mean motion, and a share of each node's own. Held nodes stay, and stop the others.
    fn go_together(
        &mut self,
        pair: &Pair,
        from: &[Vector3<f64>; 4],
        to: &[Vector3<f64>; 4],
        kept: f64,
    ) {
        let moves = [0, 1, 2, 3].map(|k| to[k] - from[k]);
        let held = pair.nodes.iter().any(|n| self.mobility[*n as usize] <= 0.0);
        let mean = if held { Vector3::zeros() } else { moves.iter().sum::<Vector3<f64>>() / 4.0 };
        for k in 0..4 {
            let node = pair.nodes[k] as usize;
            if self.mobility[node] > 0.0 {
                self.to[node] = from[k] + mean + (moves[k] - mean) * kept;
            }
        }
    }

    /// Everyone goes the share of the way that the worst pair may go.
    fn shorten_all(&mut self) -> f64 {
        self.list_pairs(REACH_M);
        let mut share = 1.0f64;
        for pair in &self.pairs {
            let (from, to) = self.way(pair);
            share = share.min(pair.free_share(&from, &to));
        }
        if share < 1.0 {
            share *= USED;
            for (from, to) in self.from.iter().zip(&mut self.to) {
                *to = from + (*to - from) * share;
            }
        }
        share
    }
}
