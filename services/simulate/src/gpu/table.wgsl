// The table. CPU twin: `RestOnTable` in `solver/motion.rs`.

fn rest_on_table(n: u32) {
    let depth = frame.table_m - x[n].z;
    if depth > 0.0 {
        let way = x[n].xy - before[n].xy;
        let share = min(frame.friction * depth * inverseSqrt(max(dot(way, way), 1e-30)), 1.0);
        x[n] = vec4(x[n].xy - way * share, frame.table_m, x[n].w);
    }
}
