mod scene;
use orime_contact::FacetContact;
use orime_evaluate::scores::folded::self_intersections;
use orime_evaluate::scores::{mean, strain, vertex_errors_m};
use orime_origami::{FoldLine, Sequence, Timing};
use scene::*;

fn run(name: &str, sequence: Sequence, stride: u64, size_m: f64, seed: u64) {
    let mut scene = Scene::new(sequence);
    let triangles = scene.sheet.triangles();
    let edges = scene.sheet.edges();
    let mut contact = FacetContact::new(&config(), &scene.sheet);
    let (mut truthbad, mut before, mut after, mut n) = (0, 0, 0, 0);
    let mut stretch0 = 0f64;
    let (mut moved, mut stretch, mut worst, mut unsettled) = (0.0f64, 0.0f64, 0usize, 0);
    let (mut rounds, mut maxms, mut totms, mut cons) = (0, 0f64, 0f64, 0);
    let mut bad = vec![];
    for step in 0..=scene.steps() {
        let truth = scene.truth_m(step);
        if step % stride != 0 {
            continue;
        }
        n += 1;
        truthbad += usize::from(self_intersections(&truth, &triangles) > 0);
        let noisy = scene.noisy(&truth, size_m, seed * 1000 + step);
        let b = self_intersections(&noisy, &triangles);
        before += usize::from(b > 0);
        let mut x = noisy.clone();
        let t = std::time::Instant::now();
        let report = contact.project(&mut x, &scene.folds);
        let ms = t.elapsed().as_secs_f64() * 1e3;
        maxms = maxms.max(ms);
        totms += ms;
        let a = self_intersections(&x, &triangles);
        if a > 0 {
            bad.push((step, b, a, report.rounds, report.settled));
        }
        after += usize::from(a > 0);
        worst = worst.max(a);
        unsettled += usize::from(!report.settled);
        rounds = rounds.max(report.rounds);
        cons = cons.max(report.constraints);
        stretch0 = stretch0.max(strain(&noisy, &edges).1);
        moved += mean(vertex_errors_m(&x, &noisy).into_iter()).unwrap();
        stretch = stretch.max(strain(&x, &edges).1);
    }
    println!(
        "{name} {size_m} seed {seed}: n {n} truth {truthbad} before {before} AFTER {after} (worst {worst}) unsettled {unsettled} moved {:.3} mm stretch {stretch0:.3} {:.3} rounds {rounds} cons {cons} ms mean {:.2} max {:.2}",
        moved / n as f64 * 1e3,
        stretch,
        totms / n as f64,
        maxms
    );
    println!("   {:?}", &bad[..bad.len().min(12)]);
}

#[test]
fn look() {
    let which = std::env::var("WHICH").unwrap_or_default();
    for size in [5e-4, 2e-3] {
        for seed in 1..3 {
            if which.contains('s') {
                run("square", Sequence::square_base(paper()).unwrap(), 5, size, seed);
            }
            if which.contains('h') {
                run(
                    "half",
                    Sequence::half_fold(paper(), FoldLine::book([SIDE_M; 2]), Timing::default())
                        .unwrap(),
                    3,
                    size,
                    seed,
                );
            }
            if which.contains('a') {
                run("accordion", Sequence::accordion(paper()).unwrap(), 3, size, seed);
            }
            if which.contains('b') {
                run("blintz", Sequence::blintz(paper()).unwrap(), 3, size, seed);
            }
            if which.contains('g') {
                run("gate", Sequence::gate_fold(paper()).unwrap(), 3, size, seed);
            }
            if which.contains('o') {
                run(
                    "oblique",
                    Sequence::half_fold(
                        paper(),
                        FoldLine { point_m: [0.08, 0.07], angle_rad: 1.1 },
                        Timing::default(),
                    )
                    .unwrap(),
                    3,
                    size,
                    seed,
                );
            }
        }
    }
}
