mod scene;
use nalgebra::Vector3;
use orime_contact::FacetContact;
use orime_origami::Sequence;
use scene::*;
type V = Vector3<f64>;
fn crosses(p: V, q: V, a: V, b: V, c: V) -> bool {
    let n = (b - a).cross(&(c - a)).normalize();
    let (hp, hq) = (n.dot(&(p - a)), n.dot(&(q - a)));
    if hp * hq >= 0.0 || hp.abs() < 1e-6 || hq.abs() < 1e-6 {
        return false;
    }
    let x = p + (q - p) * (hp / (hp - hq));
    let s = |u: V, v: V| n.dot(&(v - u).cross(&(x - u)));
    s(a, b) > 0.0 && s(b, c) > 0.0 && s(c, a) > 0.0
}
#[test]
fn diag() {
    let step: u64 = std::env::var("STEP").unwrap().parse().unwrap();
    let size: f64 = std::env::var("SIZE").unwrap().parse().unwrap();
    let seed: u64 = std::env::var("SEED").unwrap().parse().unwrap();
    let name = std::env::var("NAME").unwrap();
    let sequence = match name.as_str() {
        "square" => Sequence::square_base(paper()).unwrap(),
        "blintz" => Sequence::blintz(paper()).unwrap(),
        "oblique" => Sequence::half_fold(
            paper(),
            orime_origami::FoldLine { point_m: [0.08, 0.07], angle_rad: 1.1 },
            orime_origami::Timing::default(),
        )
        .unwrap(),
        "gate" => Sequence::gate_fold(paper()).unwrap(),
        _ => Sequence::accordion(paper()).unwrap(),
    };
    let mut scene = Scene::new(sequence);
    let mut truth = vec![];
    for s in 0..=step {
        truth = scene.truth_m(s);
    }
    let noisy = scene.noisy(&truth, size, seed * 1000 + step);
    let mut contact = FacetContact::new(&config(), &scene.sheet);
    let mut x = noisy.clone();
    println!("{:?}", contact.project(&mut x, &scene.folds));
    let f = &scene.folds;
    for (k, fa) in f.facets().iter().enumerate() {
        println!("facet {k} {:?}", fa.corners_m);
    }
    for (k, c) in f.creases().iter().enumerate() {
        println!("crease {k} {:?} angle {:.1} ", c.facets, c.angle_rad.to_degrees());
    }
    let fr: Vec<_> = (0..f.facets().len()).map(|k| f.frame(k, &x)).collect();
    let t = scene.sheet.triangles();
    let mut e: Vec<[u32; 2]> = t
        .iter()
        .flat_map(|[a, b, c]| [[*a, *b], [*b, *c], [*c, *a]])
        .map(|[a, b]| [a.min(b), a.max(b)])
        .collect();
    e.sort();
    e.dedup();
    let pt = |n: u32| V::from(x[n as usize].map(f64::from));
    let ij = |n: u32| (n / 25, n % 25);
    let own =
        |n: u32| (0..f.facets().len()).filter(|k| f.members(*k).contains(&n)).collect::<Vec<_>>();
    for t in &t {
        for e in &e {
            if t.iter().any(|n| e.contains(n)) {
                continue;
            }
            if crosses(pt(e[0]), pt(e[1]), pt(t[0]), pt(t[1]), pt(t[2])) {
                let mid = |ns: &[u32]| {
                    let mut s = [0.0; 2];
                    for n in ns {
                        let u = ij(*n);
                        s[0] += u.0 as f64 * SIDE_M / 24.0 / ns.len() as f64;
                        s[1] += u.1 as f64 * SIDE_M / 24.0 / ns.len() as f64;
                    }
                    s
                };
                let (a, b) = (f.facet_at(mid(e)), f.facet_at(mid(t)));
                let h: Vec<String> = e
                    .iter()
                    .map(|n| {
                        format!("{:.3}", (pt(*n) - fr[b].center_m.coords).dot(&fr[b].normal) * 1e3)
                    })
                    .collect();
                let ht: Vec<String> = t
                    .iter()
                    .map(|n| {
                        format!("{:.3}", (pt(*n) - fr[b].center_m.coords).dot(&fr[b].normal) * 1e3)
                    })
                    .collect();
                println!(
                    "edge {:?} of {:?} {:?} x tri {:?} of {:?}; facets {a} {b} order {} {} h {h:?} ht {ht:?} nn {:.2}",
                    e.map(ij),
                    own(e[0]),
                    own(e[1]),
                    t.map(ij),
                    t.map(own),
                    f.order(a, b),
                    f.order(b, a),
                    fr[a].normal.dot(&fr[b].normal)
                );
            }
        }
    }
}
