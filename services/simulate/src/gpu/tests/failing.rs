//! The comparison with the CPU can fail, for every pass.

use super::*;
use crate::gpu::pieces::Pieces;

/// What is spoiled: of the model, or of the state that is sent.
type Damage = fn(&mut Model, &mut Solver);

/// A scene, a damage, and what it is.
const DAMAGES: [(Scene, &str, Damage); 16] = [
    (Scene::Links, "a colour is left out", |model, _| model.ranges[9] = [0, 0]),
    (Scene::Links, "the last seams are left out", |model, _| {
        model.ranges.pop();
    }),
    (Scene::Links, "a link is longer", |model, _| model.links[700].rest_m *= 1.01),
    (Scene::Links, "no facet is held", |model, _| model.n_facets = 0),
    (Scene::Creases, "a hinge less", |model, _| model.n_hinges -= 1),
    (Scene::Creases, "another rest angle", |_, sent| sent.hinges[0].rest_rad += 1e-3),
    (Scene::Creases, "another way to harden", |_, sent| {
        sent.plastic.iter_mut().for_each(|plastic| plastic.hardening *= 1.01);
    }),
    (Scene::Creases, "stiffer", |_, sent| {
        sent.plastic.iter_mut().for_each(|plastic| plastic.stiffness *= 1.1);
    }),
    (Scene::Creases, "sides changed", |_, sent| sent.hinges[1].facets.swap(0, 1)),
    (Scene::Grippers, "another weight", |_, sent| sent.anchors[0].weights.swap(0, 1)),
    (Scene::Grippers, "no link beside it", |_, sent| {
        sent.anchors[1].beside.fill(([0; 2], f32::INFINITY));
    }),
    (Scene::Shares, "all facets alike", |_, sent| sent.facet_shares.clear()),
    (Scene::Plate, "other factors", |model, _| model.stencil_colours[7].factors[3] = 1.01),
    (Scene::Plate, "more rigid", |model, _| model.stencil_colours[0].softness_s2 *= 0.9),
    (Scene::Paper, "another elastic range", |_, sent| {
        sent.plastic.iter_mut().for_each(|plastic| plastic.yields_at *= 1.1);
    }),
    (Scene::Everywhere, "another link's rest length", |model, _| {
        let none = model.plastic_links.len() as u32;
        let last = model.rest_of_link.iter().rposition(|own| *own < none);
        model.rest_of_link.swap(0, last.expect("links yield"));
    }),
];

/// Pieces whose passes a scene cannot do without.
const NEEDED: [(Scene, &[Piece]); 9] = [
    (Scene::Links, &[Piece::Track]),
    (Scene::Links, &[Piece::Xpbd]),
    (Scene::Links, &[Piece::Table]),
    (Scene::Links, &[Piece::Facets, Piece::Fit]),
    (Scene::Creases, &[Piece::Crease]),
    (Scene::Grippers, &[Piece::Grippers]),
    (Scene::Plate, &[Piece::Plate]),
    (Scene::Paper, &[Piece::Paper]),
    (Scene::Everywhere, &[Piece::Plastic]),
];

/// Whether one substep with a damage is told from the CPU's without it, on both paths; `None`
/// without an adapter.
fn is_seen(scene: Scene, damage: &dyn Fn(&mut Model, &mut Solver)) -> Option<bool> {
    let (start, folds) = solver(25, scene);
    let mut twin = start.clone();
    on_cpu(&mut twin, &folds, 1);
    let mut seen = true;
    for path in PATHS {
        let (mut sent, mut model) = (start.clone(), model(&start));
        damage(&mut model, &mut sent);
        let mut sheets = unless_absent(Sheets::new(&model, 1, path))?;
        let mut found = [sent];
        on_gpu(&mut sheets, &model, &mut found, 1);
        seen &= !Apart::of(&found[0], &twin).is_rounding();
    }
    Some(seen)
}

#[test]
fn every_damage_is_seen() {
    for (scene, what, damage) in DAMAGES {
        let Some(seen) = is_seen(scene, &damage) else { return };
        assert!(seen, "{scene:?}: {what}");
    }
    assert_eq!(apart([f64::NAN].into_iter(), [0.0].into_iter()), f64::INFINITY, "so is poison");
}

#[test]
fn every_pass_that_is_left_out_is_missed() {
    for (scene, pieces) in NEEDED {
        let without = |model: &mut Model, _: &mut Solver| {
            pieces.iter().for_each(|piece| model.pieces.remove(*piece));
        };
        let Some(seen) = is_seen(scene, &without) else { return };
        assert!(seen, "{scene:?} without {pieces:?}");
        assert_eq!(is_seen(scene, &|_, _| {}), Some(false), "{scene:?} as it is");
    }
}

#[test]
fn a_scene_has_the_pieces_that_it_names_and_no_other() {
    use Piece::{Crease, Facets, Fit, Grippers, Paper, Plastic, Plate, Table, Track, Xpbd};
    let base = [Track, Facets, Fit, Table];
    assert_eq!(model(&solver(25, Scene::Bare).0).pieces, Pieces::default());
    let rows: [(Scene, &[Piece]); 7] = [
        (Scene::Links, &[Xpbd]),
        (Scene::Creases, &[Xpbd, Crease]),
        (Scene::Grippers, &[Xpbd, Crease, Grippers]),
        (Scene::Shares, &[Xpbd]),
        (Scene::Plate, &[Xpbd, Plate]),
        (Scene::Paper, &[Paper, Plastic]),
        (Scene::Everywhere, &[Xpbd, Plastic]),
    ];
    for (scene, own) in rows {
        let expected: Pieces = base.iter().chain(own).copied().collect();
        assert_eq!(model(&solver(25, scene).0).pieces, expected, "{scene:?}");
    }
    let (mut asleep, folds) = solver(25, Scene::Grippers);
    asleep.anchors.clear();
    asleep.hinges.clear();
    let pieces = model(&asleep).pieces;
    assert!(!pieces.contains(Grippers) && !pieces.contains(Crease), "they sleep");
    let flat = Folds::flat(folds.sheet());
    asleep.set_folds(&flat, false);
    assert!(!model(&asleep).pieces.contains(Fit), "one facet is left alone");
}
