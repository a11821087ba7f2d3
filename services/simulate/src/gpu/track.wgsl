// The pull of the targets. CPU twin: `Pull` in `solver/motion.rs`.

@group(0) @binding(7) var<storage, read> targets: array<vec4<f32>>; // w: share of the way

fn pull(n: u32) {
    let to = targets[n];
    let way = (to.xyz - x[n].xyz) * to.w;
    let cap = min(frame.way_max_m * inverseSqrt(max(dot(way, way), 1e-30)), 1.0);
    x[n] = vec4(x[n].xyz + way * cap, x[n].w);
}
