//! Inertia, the pull of targets, the table: passes over nodes. GPU twins: `advance` and `settle`
//! in `gpu/passes.wgsl`, `pull` in `gpu/track.wgsl`, `rest_on_table` in `gpu/table.wgsl`.

use orime_lanes::Field;
use orime_lanes::{LANES, Lanes, Pass, dot, load_points, minus, plus, store_points, times};

/// Notes x° = x, then v ← (v − fall)·keep and x ← x + v·dt; what has no inverse mass stays.
pub(crate) struct Advance<'a> {
    /// Numbers of a field to go through.
    pub len: usize,
    /// Length of the substep, seconds.
    pub dt_s: f32,
    /// Share of the velocity that is left.
    pub keep: f32,
    /// Velocity that gravity adds along −z, m/s.
    pub fall_m_per_s: f32,
    /// Inverse masses, where not all are 1.
    pub weights: Option<&'a Field>,
    /// Positions, metres.
    pub x: &'a mut [Field; 3],
    /// Velocities, m/s.
    pub v: &'a mut [Field; 3],
    /// Positions at the substep's start, metres.
    pub before: &'a mut [Field; 3],
    /// Positions after it, metres.
    pub ahead: &'a mut [Field; 3],
}

impl Pass for Advance<'_> {
    #[inline(always)]
    fn run<V: Lanes>(self) {
        let Self { len, weights, .. } = self;
        let weights = weights.map(|w| &w.rows()[..len]);
        for axis in 0..3 {
            let x = &mut self.x[axis].rows_mut()[..len];
            let v = &mut self.v[axis].rows_mut()[..len];
            let before = &mut self.before[axis].rows_mut()[..len];
            let ahead = &mut self.ahead[axis].rows_mut()[..len];
            let fall = V::splat(if axis == 2 { self.fall_m_per_s } else { 0.0 });
            let (keep, dt_s) = (V::splat(self.keep), V::splat(self.dt_s));
            for at in (0..len).step_by(LANES) {
                // SAFETY: all have `len` numbers, a multiple of the lanes.
                unsafe {
                    let old = V::load(x.as_ptr().add(at));
                    let mut speed = V::load(v.as_ptr().add(at)).sub(fall).mul(keep);
                    if let Some(weights) = weights {
                        let weight = V::load(weights.as_ptr().add(at));
                        speed = speed.keep(weight.above(V::splat(0.0)));
                    }
                    old.store(before.as_mut_ptr().add(at));
                    speed.store(v.as_mut_ptr().add(at));
                    let new = old.add(speed.mul(dt_s));
                    new.store(x.as_mut_ptr().add(at));
                    new.store(ahead.as_mut_ptr().add(at));
                }
            }
        }
    }
}

/// Most that any component of a node's velocity becomes, m/s: far beyond what a robot does to
/// paper, and little enough that a pose that no sheet can have does not throw it out of the cell.
pub(crate) const SPEED_M_PER_S_MAX: f32 = 20.0;

/// v ← v + (x − x̂)/dt, x̂ being where inertia alone had led: the same as (x − x°)/dt, but the
/// rounding of x̂ does not become velocity. No component exceeds [`SPEED_M_PER_S_MAX`].
pub(crate) struct Settle<'a> {
    /// Numbers of a field to go through.
    pub len: usize,
    /// 1/dt, 1/s.
    pub per_s: f32,
    /// Positions, metres.
    pub x: &'a [Field; 3],
    /// Positions after inertia, metres.
    pub ahead: &'a [Field; 3],
    /// Velocities, m/s.
    pub v: &'a mut [Field; 3],
}

impl Pass for Settle<'_> {
    #[inline(always)]
    fn run<V: Lanes>(self) {
        let len = self.len;
        let (most, least) = (V::splat(SPEED_M_PER_S_MAX), V::splat(-SPEED_M_PER_S_MAX));
        for axis in 0..3 {
            let (x, ahead) = (&self.x[axis].rows()[..len], &self.ahead[axis].rows()[..len]);
            let v = &mut self.v[axis].rows_mut()[..len];
            for at in (0..len).step_by(LANES) {
                // SAFETY: all have `len` numbers, a multiple of the lanes.
                unsafe {
                    let way = V::load(x.as_ptr().add(at)).sub(V::load(ahead.as_ptr().add(at)));
                    let speed = V::load(v.as_ptr().add(at));
                    let speed = speed.add(way.mul(V::splat(self.per_s)));
                    speed.min(most).max(least).store(v.as_mut_ptr().add(at));
                }
            }
        }
    }
}

/// x ← x + (t − x)·r, no further than `way_max_m`.
pub(crate) struct Pull<'a> {
    /// Numbers of a field to go through.
    pub len: usize,
    /// Longest way, metres.
    pub way_max_m: f32,
    /// Where each node is pulled to, metres.
    pub to: &'a [Field; 3],
    /// Share of the way that each node goes; 0 for none.
    pub ratio: &'a Field,
    /// Positions, metres.
    pub x: &'a mut [Field; 3],
}

impl Pass for Pull<'_> {
    #[inline(always)]
    fn run<V: Lanes>(self) {
        let len = self.len;
        let ratio = &self.ratio.rows()[..len];
        let to = self.to.each_ref().map(|field| field.rows()[..len].as_ptr());
        let x = self.x.each_mut().map(|field| field.rows_mut()[..len].as_mut_ptr());
        let now = [x[0].cast_const(), x[1].cast_const(), x[2].cast_const()];
        let (way_max, one) = (V::splat(self.way_max_m), V::splat(1.0));
        for at in (0..len).step_by(LANES) {
            // SAFETY: all have `len` numbers, a multiple of the lanes.
            unsafe {
                let ratio = V::load(ratio.as_ptr().add(at));
                let from = load_points::<V>(now, at);
                let way = times(minus(load_points::<V>(to, at), from), ratio);
                let squared = dot(way, way).max(V::splat(1e-30));
                let cap = way_max.mul(squared.inverse_sqrt()).min(one);
                store_points(plus(from, times(way, cap)), x, at);
            }
        }
    }
}

/// Lifts nodes out of the table and shortens their way along it, no further than back to where
/// they were.
pub(crate) struct RestOnTable<'a> {
    /// Numbers of a field to go through.
    pub len: usize,
    /// Height of the table, metres.
    pub height_m: f32,
    /// Coulomb's coefficient.
    pub friction: f32,
    /// Positions, metres.
    pub x: &'a mut [Field; 3],
    /// Positions at the substep's start, metres.
    pub before: &'a [Field; 3],
}

impl Pass for RestOnTable<'_> {
    #[inline(always)]
    fn run<V: Lanes>(self) {
        let len = self.len;
        let [x, y, z] = self.x.each_mut().map(|field| field.rows_mut()[..len].as_mut_ptr());
        let [old_x, old_y, _] = self.before.each_ref().map(|field| field.rows()[..len].as_ptr());
        let (height, one) = (V::splat(self.height_m), V::splat(1.0));
        for at in (0..len).step_by(LANES) {
            // SAFETY: all have `len` numbers, a multiple of the lanes.
            unsafe {
                let high = V::load(z.add(at));
                let depth = height.sub(high);
                let below = depth.above(V::splat(0.0));
                if below == 0 {
                    continue;
                }
                high.max(height).store(z.add(at));
                let (to_x, to_y) = (V::load(x.add(at)), V::load(y.add(at)));
                let way_x = to_x.sub(V::load(old_x.add(at)));
                let way_y = to_y.sub(V::load(old_y.add(at)));
                let squared = way_x.mul(way_x).add(way_y.mul(way_y)).max(V::splat(1e-30));
                let share = V::splat(self.friction).mul(depth).mul(squared.inverse_sqrt());
                let share = share.min(one).keep(below);
                to_x.sub(way_x.mul(share)).store(x.add(at));
                to_y.sub(way_y.mul(share)).store(y.add(at));
            }
        }
    }
}

/// Finds the lowest that any of these come, in the solver's frame. The rows' padding counts as
/// nodes: at worst, something is thought to be lower than it is.
pub(crate) struct Lowest<'a> {
    /// Numbers of a field to go through.
    pub len: usize,
    /// Heights, metres.
    pub z: &'a Field,
    /// Upward velocities, m/s.
    pub v_z: &'a Field,
    /// How long they go on, seconds.
    pub ahead_s: f32,
    /// Heights of targets, and their confidences, where there are any.
    pub targets: Option<(&'a Field, &'a Field)>,
    /// Lowest height, metres.
    pub lowest_m: &'a mut f32,
}

impl Pass for Lowest<'_> {
    #[inline(always)]
    fn run<V: Lanes>(self) {
        let len = self.len;
        let (z, v_z) = (&self.z.rows()[..len], &self.v_z.rows()[..len]);
        let targets = self.targets.map(|(z, trust)| (&z.rows()[..len], &trust.rows()[..len]));
        let (zero, mut lowest) = (V::splat(0.0), V::splat(*self.lowest_m));
        for at in (0..len).step_by(LANES) {
            // SAFETY: all have `len` numbers, a multiple of the lanes.
            unsafe {
                let height = V::load(z.as_ptr().add(at));
                let fall = V::load(v_z.as_ptr().add(at)).min(zero).mul(V::splat(self.ahead_s));
                lowest = height.add(fall).min(lowest);
                if let Some((z, trust)) = targets {
                    let trusted = V::load(trust.as_ptr().add(at)).above(zero);
                    // Where there is no target, the node's own height once more.
                    let way = V::load(z.as_ptr().add(at)).sub(height).keep(trusted);
                    lowest = height.add(way).min(lowest);
                }
            }
        }
        let mut each = [0f32; LANES];
        // SAFETY: the array has sixteen numbers.
        unsafe { lowest.store(each.as_mut_ptr()) };
        *self.lowest_m = each.into_iter().fold(f32::INFINITY, f32::min);
    }
}
