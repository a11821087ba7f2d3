use orime_geometry::*;
use orime_register::*;
fn load(p: &str) -> Vec<[f32; 3]> {
    std::fs::read_to_string(p)
        .unwrap()
        .lines()
        .map(|l| {
            let v: Vec<f32> = l.split(',').map(|x| x.parse().unwrap()).collect();
            [v[0], v[1], v[2]]
        })
        .collect()
}
fn main() {
    let a: Vec<String> = std::env::args().collect();
    let d = &a[1];
    let seed = load(&format!("{d}/seed.csv"));
    let cloud: Vec<ObservedPoint> = load(&format!("{d}/cloud.csv"))
        .into_iter()
        .map(|p| ObservedPoint { position_m: p, normal: [0.; 3], camera: 0, pixels: 1. })
        .collect();
    let k = (seed.len() as f64).sqrt() as usize;
    let sheet = SheetGrid::new([0.15, 0.15], [k, k]);
    let mut p = RegisterParams { targets_everywhere: true, ..Default::default() };
    for kv in &a[3..] {
        let (key, v) = kv.split_once('=').unwrap();
        let f: f64 = v.parse().unwrap();
        match key {
            "it" => p.iterations_max = f as u32,
            "kw" => p.kernel_width = f,
            "pe" => p.prediction_error = f,
            "t" => p.temper = f,
            "s0" => p.sigma_start[0] = f,
            "vp" => p.virtual_per_cell = f as usize,
            "iso" => p.isometry_sweeps = f as u32,
            "modes" => p.modes_max = f as usize,
            "pts" => p.points_max = f as usize,
            _ => panic!(),
        }
    }
    let c = p.check().unwrap();
    let mut t = vec![[0f32; 3]; seed.len()];
    let mut conf = vec![0f32; seed.len()];
    // second call carries the pose flag
    let mut ms = vec![];
    let mut rep = RegisterReport::default();
    for _ in 0..3 {
        let mut r = Registrar::new(&c, &sheet, Some(seed.clone()).filter(|_| false));
        r.assume_pose();
        let t0 = std::time::Instant::now();
        rep = r.register(&cloud, Some(&seed), &mut t, &mut conf);
        ms.push(t0.elapsed().as_secs_f64() * 1e3);
    }
    ms.sort_by(f64::total_cmp);
    eprintln!("{:?} ms {:.2}", rep, ms[0]);
    std::fs::write(
        &a[2],
        t.iter().map(|p| format!("{},{},{}\n", p[0], p[1], p[2])).collect::<String>(),
    )
    .unwrap();
}
