//! One substep.

use super::facets::{FitFacet, Frame, HoldFacet};
use super::links::Seam;
use super::motion::{Advance, Pull, RestOnTable, Settle};
use super::plate::{Flatten, Stencils};
use super::project::{Damp, Project};
use super::{Solver, Targets};
use crate::contact::{ContactPass, Part};
use crate::effect::Effect;
use orime_creases::Folds;
use orime_lanes::{Field, gather, scatter};

/// Numbers that all substeps of a frame share.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Rates {
    /// Length of a substep, seconds.
    pub dt_s: f32,
    /// Share of the velocity that the air leaves.
    pub keep: f32,
    /// Longest way towards a target, metres; infinite where nodes are held.
    pub way_max_m: f32,
    /// Stretch beside a node that leaves nothing of its target's pull, where contact takes part.
    pub strain_max: f32,
    /// Share of the way to its gripper that a held point goes.
    pub grip: f32,
    /// Stretch beside a held point at which it slips.
    pub grip_strain_max: f32,
    /// γ where the paper's form would diverge at what is set.
    pub gamma_max: f32,
    /// Height of the table in the solver's frame, metres.
    pub table_m: f32,
    /// Whether nodes move on by themselves; not while a pose is predicted.
    pub inertia: bool,
    /// Whether the table can be reached in this frame.
    pub table_awake: bool,
    /// Whether layers may touch in this frame.
    pub contact_awake: bool,
}

/// What the caller takes part with.
pub(crate) struct Hooks<'a, 'b> {
    /// Runs where self-contact is due.
    pub contact: Option<&'a mut (dyn FnMut(ContactPass<'_>) + 'b)>,
    /// Is told after each pass what it was.
    pub watch: Option<&'a mut (dyn FnMut(Part) + 'b)>,
    /// Node positions as an array of points, for contact.
    pub room: &'a mut [Vec<[f32; 3]>; 2],
    /// The folds, for contact.
    pub folds: &'a Folds,
}

impl Hooks<'_, '_> {
    fn done(&mut self, part: Part) {
        if let Some(watch) = &mut self.watch {
            watch(part);
        }
    }
}

impl Solver {
    /// One substep; `held` pull where the solver's own targets do not. Whether it was made: contact
    /// may refuse it.
    pub fn substep(
        &mut self,
        rates: &Rates,
        held: Option<&Targets>,
        hooks: &mut Hooks<'_, '_>,
    ) -> bool {
        self.advance(rates);
        hooks.done(Part::Inertia);
        let touches = self.has_contact && rates.contact_awake && hooks.contact.is_some();
        if self.pull(rates, held, touches) {
            hooks.done(Part::Of(Effect::Track));
        }
        if !self.anchors.is_empty() {
            for anchor in &self.anchors {
                let weights = self.weights.as_ref();
                anchor.pull(&mut self.x, weights, rates.grip, rates.grip_strain_max);
            }
            hooks.done(Part::Of(Effect::Grippers));
        }
        self.flatten(rates, hooks);
        self.project(rates, hooks);
        if let (Some(plastic), Some(table)) = (&self.plastic, &self.facet_table) {
            for hinge in &mut self.hinges {
                hinge.turn(plastic, self.width, table, &mut self.x);
            }
            if !self.hinges.is_empty() {
                hooks.done(Part::Of(Effect::Crease));
            }
        }
        self.hold_facets(hooks);
        if touches {
            let holds = self.touch(rates, hooks);
            hooks.done(Part::Of(Effect::SelfContact));
            if !holds {
                self.substeps = self.substeps.wrapping_add(1);
                self.take_back();
                return false;
            }
        }
        if let (Some([_, friction]), true) = (self.table, rates.table_awake) {
            let (len, before) = (self.len(), &self.before);
            let x = &mut self.x;
            self.width.run(RestOnTable { len, height_m: rates.table_m, friction, x, before });
            hooks.done(Part::Of(Effect::Table));
        }
        self.keep_pinned();
        self.substeps = self.substeps.wrapping_add(1);
        if rates.inertia {
            let (len, per_s) = (self.len(), 1.0 / rates.dt_s);
            let (x, ahead, v) = (&self.x, &self.ahead, &mut self.v);
            self.width.run(Settle { len, per_s, x, ahead, v });
        }
        hooks.done(Part::Inertia);
        true
    }

    /// The sheet rests where the substep began.
    fn take_back(&mut self) {
        for (x, before) in self.x.iter_mut().zip(&self.before) {
            x.rows_mut().copy_from_slice(before.rows());
        }
        for v in &mut self.v {
            v.rows_mut().fill(0.0);
        }
    }

    fn advance(&mut self, rates: &Rates) {
        let fall_m_per_s = self.gravity_m_per_s2.unwrap_or(0.0) * rates.dt_s;
        let len = self.len();
        self.width.run(Advance {
            len,
            dt_s: if rates.inertia { rates.dt_s } else { 0.0 },
            keep: rates.keep,
            fall_m_per_s: if rates.inertia { fall_m_per_s } else { 0.0 },
            weights: self.weights.as_ref(),
            x: &mut self.x,
            v: &mut self.v,
            before: &mut self.before,
            ahead: &mut self.ahead,
        });
    }

    fn pull(&mut self, rates: &Rates, held: Option<&Targets>, fades: bool) -> bool {
        if fades {
            self.fade_targets(rates.strain_max);
        }
        let Some(targets) = held.or(self.targets.as_ref()).filter(|targets| targets.count > 0)
        else {
            return false;
        };
        self.width.run(Pull {
            len: self.layout.size(),
            way_max_m: rates.way_max_m,
            to: &targets.at_m,
            ratio: if fades { &targets.faded } else { &targets.ratio },
            x: &mut self.x,
        });
        true
    }

    /// Hinges and twists, colour by colour.
    fn flatten(&mut self, rates: &Rates, hooks: &mut Hooks<'_, '_>) {
        for stencils in &self.plate {
            let alpha = self.plate_alpha(stencils, rates.dt_s);
            let (weights, x) = (self.weights.as_ref(), &mut self.x);
            self.width.run(Flatten { stencils, alpha, weights, x });
            hooks.done(Part::Of(Effect::Bend));
        }
    }

    /// Links, colour by colour, then seams.
    fn project(&mut self, rates: &Rates, hooks: &mut Hooks<'_, '_>) {
        let (damp, time_s) = self.damping.unwrap_or((Damp::Off, 0.0));
        for colour in &self.colours {
            let gamma = time_s / rates.dt_s;
            self.width.run(Project {
                colour,
                alpha: self.alpha(colour.effect, rates.dt_s),
                gamma: if damp == Damp::Paper { gamma.min(rates.gamma_max) } else { gamma },
                damp,
                weights: self.weights.as_ref(),
                x: &mut self.x,
                before: &self.before,
                moves: &mut self.moves,
            });
            hooks.done(Part::Of(colour.effect));
        }
        if !self.seams.is_empty() {
            let alpha = self.alpha(Effect::Stretch, rates.dt_s);
            for seam in &self.seams {
                seam.project(alpha, self.weights.as_ref(), &mut self.x);
            }
            hooks.done(Part::Of(Effect::Stretch));
        }
    }

    /// α̃ in units of an ordinary node's inverse mass.
    pub fn alpha(&self, effect: Effect, dt_s: f32) -> f32 {
        let [stretch, shear, bend] = self.compliance_m_per_n;
        let compliance = match effect {
            Effect::Stretch => stretch,
            Effect::Shear => shear,
            _ => bend,
        };
        compliance / (dt_s * dt_s) / self.inverse_mass_per_kg
    }

    /// The same of the plate's hinges and twists.
    pub fn plate_alpha(&self, stencils: &Stencils, dt_s: f32) -> f32 {
        stencils.alpha(self.rigidity_n_m, self.inverse_mass_per_kg, dt_s)
    }

    fn hold_facets(&mut self, hooks: &mut Hooks<'_, '_>) {
        let (Some(strength), Some(table)) = (self.hold_facets, &self.facet_table) else { return };
        let count = table.facets.len();
        if count < 2 {
            return; // One facet is a sheet that bends.
        }
        for at in 0..count {
            let forward = self.substeps.is_multiple_of(2);
            let facet = if forward { at } else { count - 1 - at };
            let nodes = &table.facets[facet];
            let strength = strength * self.facet_shares.get(facet).copied().unwrap_or(1.0);
            if nodes.count < 3 {
                continue;
            }
            let mut frame = Frame { center_m: [0.0; 3], u: [0.0; 3], v: [0.0; 3] };
            let (uv_m, x) = (&table.uv_m, &self.x);
            self.width.run(FitFacet { nodes, uv_m, x, frame: &mut frame });
            let (weights, x) = (self.weights.as_ref(), &mut self.x);
            self.width.run(HoldFacet { nodes, uv_m, frame: &frame, strength, weights, x });
        }
        hooks.done(Part::Of(Effect::Facets));
    }

    /// Neither the table nor a caller's contact moves what is pinned.
    fn keep_pinned(&mut self) {
        let Some(weights) = &self.weights else { return };
        for place in self.layout.places().filter(|place| weights.rows()[*place] == 0.0) {
            for (x, before) in self.x.iter_mut().zip(&self.before) {
                x.rows_mut()[place] = before.rows()[place];
            }
        }
    }

    /// Whether the caller's contact holds.
    fn touch(&mut self, rates: &Rates, hooks: &mut Hooks<'_, '_>) -> bool {
        let Some(contact) = &mut hooks.contact else { return true };
        let [x_m, before_m] = &mut *hooks.room;
        gather(self.layout, &self.x, [0.0; 3], x_m);
        gather(self.layout, &self.before, [0.0; 3], before_m);
        let (dt_s, mut holds) = (f64::from(rates.dt_s), true);
        contact(ContactPass { x_m, before_m, folds: hooks.folds, dt_s, holds: &mut holds });
        scatter(self.layout, x_m, &mut self.x);
        holds
    }
}

impl Seam {
    /// Shortens the link if it is too long, and does nothing else.
    fn project(&self, alpha: f32, weights: Option<&Field>, x: &mut [Field; 3]) {
        let [a, b] = self.ends.map(|n| n as usize);
        let [wa, wb] = [a, b].map(|n| weights.map_or(1.0, |w| w.rows()[n]));
        let d = [0, 1, 2].map(|k| x[k].rows()[b] - x[k].rows()[a]);
        let length_m = (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).sqrt();
        if length_m > self.rest_m && wa + wb > 0.0 {
            let share = (1.0 - self.rest_m / length_m) / (wa + wb + alpha);
            for (x, d) in x.iter_mut().zip(d) {
                x.rows_mut()[a] += wa * share * d;
                x.rows_mut()[b] -= wb * share * d;
            }
        }
    }
}
