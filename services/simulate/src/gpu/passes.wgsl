// The passes of a substep. CPU twins of the same names: `solver/motion.rs`, `solver/project.rs`,
// `solver/facets.rs`. Links of one colour share no node, so invocations never write the same one.

struct Frame {
    nodes: u32, colours: u32, substeps: u32, facets: u32,
    dt_s: f32, keep: f32, fall_m_per_s: f32, way_max_m: f32,
    gamma: f32, strength: f32, table_m: f32, friction: f32,
    has_table: u32, first_substep: u32, close_m2: f32, per_s: f32,
}
struct Link { ends: vec2<u32>, rest_m: f32, softness_s2: f32 }

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<storage, read_write> x: array<vec4<f32>>; // w: inverse mass, without unit
@group(0) @binding(2) var<storage, read_write> v: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read_write> before: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read_write> ahead: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read> targets: array<vec4<f32>>; // w: share of the way
@group(0) @binding(6) var<storage, read> links: array<Link>;
@group(0) @binding(7) var<storage, read> ranges: array<vec2<u32>>; // links of each colour
// Per facet (bits of its first member's place here, bits of their number); then its members,
// (bits of the node, u - mean, v - mean).
@group(0) @binding(8) var<storage, read> facets: array<vec4<f32>>;

const WIDTH = 256u;
const SPEED_M_PER_S_MAX = 20.0;
var<workgroup> sums: array<array<vec3<f32>, 3>, WIDTH>;

fn advance(n: u32) {
    let old = x[n];
    var speed = (v[n].xyz - vec3(0.0, 0.0, frame.fall_m_per_s)) * frame.keep;
    if old.w == 0.0 { speed = vec3(0.0); }
    v[n] = vec4(speed, 0.0);
    before[n] = old;
    x[n] = vec4(old.xyz + speed * frame.dt_s, old.w);
    ahead[n] = x[n];
}

fn pull(n: u32) {
    let to = targets[n];
    let way = (to.xyz - x[n].xyz) * to.w;
    let cap = min(frame.way_max_m * inverseSqrt(max(dot(way, way), 1e-30)), 1.0);
    x[n] = vec4(x[n].xyz + way * cap, x[n].w);
}

fn project(base: u32, at: u32) {
    let link = links[at];
    let a = base + link.ends.x;
    let b = base + link.ends.y;
    let first = x[a];
    let second = x[b];
    let d = second.xyz - first.xyz;
    let squared = dot(d, d);
    if squared <= frame.close_m2 || first.w + second.w <= 0.0 { return; }
    // A rest length below zero marks a seam, which may become shorter and is not damped.
    let is_seam = link.rest_m < 0.0;
    if is_seam && squared <= link.rest_m * link.rest_m { return; }
    let gamma = select(frame.gamma, 0.0, is_seam);
    let inverse = inverseSqrt(squared);
    let moved = (second.xyz - before[b].xyz) - (first.xyz - before[a].xyz);
    let violation = 1.0 - abs(link.rest_m) * inverse + gamma * inverse * inverse * dot(d, moved);
    let alpha = link.softness_s2 * frame.per_s * frame.per_s;
    let s = violation / ((1.0 + gamma) * (first.w + second.w) + alpha);
    x[a] = vec4(first.xyz + d * (s * first.w), first.w);
    x[b] = vec4(second.xyz - d * (s * second.w), second.w);
}

// All invocations of the workgroup take part.
fn hold_facet(base: u32, facet: u32, lane: u32) {
    let start = bitcast<u32>(facets[facet].x);
    let count = bitcast<u32>(facets[facet].y);
    var sum = array<vec3<f32>, 3>();
    for (var k = lane; k < count; k += WIDTH) {
        let member = facets[start + k];
        let at = x[base + bitcast<u32>(member.x)].xyz;
        sum[0] += at;
        sum[1] += at * member.y;
        sum[2] += at * member.z;
    }
    sums[lane] = sum;
    workgroupBarrier();
    for (var half = WIDTH / 2u; half > 0u; half /= 2u) {
        if lane < half {
            for (var k = 0; k < 3; k++) { sums[lane][k] += sums[lane + half][k]; }
        }
        workgroupBarrier();
    }
    let center = sums[0][0] / f32(count);
    let a = sums[0][1];
    let b = sums[0][2];
    workgroupBarrier();
    let p = dot(a, a);
    let q = dot(a, b);
    let r = dot(b, b);
    // |a × b| is √(pr − q²) without the cancellation, which f32 does not forgive.
    let root_det = length(cross(a, b));
    if count < 3u || root_det <= 1e-6 * (p + r) { return; }
    let scale = 1.0 / (sqrt(p + r + 2.0 * root_det) * root_det);
    let along_u = (a * (r + root_det) - b * q) * scale;
    let along_v = (b * (p + root_det) - a * q) * scale;
    for (var k = lane; k < count; k += WIDTH) {
        let member = facets[start + k];
        let n = base + bitcast<u32>(member.x);
        let goal = center + along_u * member.y + along_v * member.z;
        if x[n].w > 0.0 { x[n] = vec4(x[n].xyz + (goal - x[n].xyz) * frame.strength, x[n].w); }
    }
}

fn rest_on_table(n: u32) {
    let depth = frame.table_m - x[n].z;
    if depth > 0.0 {
        let way = x[n].xy - before[n].xy;
        let share = min(frame.friction * depth * inverseSqrt(max(dot(way, way), 1e-30)), 1.0);
        x[n] = vec4(x[n].xy - way * share, frame.table_m, x[n].w);
    }
}

fn settle(n: u32) {
    if frame.has_table == 1u { rest_on_table(n); }
    let speed = v[n].xyz + (x[n].xyz - ahead[n].xyz) * frame.per_s;
    v[n] = vec4(clamp(speed, vec3(-SPEED_M_PER_S_MAX), vec3(SPEED_M_PER_S_MAX)), 0.0);
}
