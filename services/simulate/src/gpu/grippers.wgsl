// Material points that are held. CPU twins: `Anchor::pull` and `Anchor::reach` in `grips.rs`.

struct Beside { ends: vec2<u32>, rest_m: f32, unused: u32 }
struct Anchor {
    nodes: vec4<u32>,
    weights: vec4<f32>,
    position_m: vec4<f32>,
    beside: array<Beside, BESIDE>,
}

@group(0) @binding(11) var<storage, read> anchors: array<Anchor>; // GRIPS_MAX per sheet

const GRIPS_MAX = 16u;
const BESIDE = 16u;
var<workgroup> reaches: array<f32, BESIDE>;

fn share_of(node: u32, nodes: vec4<u32>, shares: vec4<f32>) -> f32 {
    return dot(select(vec4(0.0), shares, nodes == vec4(node)), vec4(1.0));
}

// Share of a way, of which each node goes its own share, that stretches this link not too far.
fn reach(base: u32, at: u32, beside: u32, way_m: vec3<f32>, shares: vec4<f32>) -> f32 {
    let link = anchors[at].beside[beside];
    let nodes = anchors[at].nodes;
    let most_m = link.rest_m * (1.0 + frame.grip_strain_max);
    let d = x[base + link.ends.y].xyz - x[base + link.ends.x].xyz;
    let share = share_of(link.ends.y, nodes, shares) - share_of(link.ends.x, nodes, shares);
    let e = way_m * share;
    let ee = dot(e, e);
    let de = dot(d, e);
    let over_m2 = dot(d, d) - most_m * most_m;
    if ee + 2.0 * de + over_m2 > 0.0 && ee > 0.0 {
        return max((sqrt(max(de * de - ee * over_m2, 0.0)) - de) / ee, 0.0);
    }
    return 1.0;
}

fn pull_anchor(base: u32, at: u32, lane: u32) {
    let nodes = anchors[at].nodes;
    let weights = anchors[at].weights;
    let a = x[base + nodes.x];
    let b = x[base + nodes.y];
    let c = x[base + nodes.z];
    let d = x[base + nodes.w];
    let shares = min(vec4(a.w, b.w, c.w, d.w), vec4(1.0)) * weights;
    let sum = dot(shares, weights);
    let held_m = weights.x * a.xyz + weights.y * b.xyz + weights.z * c.xyz + weights.w * d.xyz;
    var way_m = vec3(0.0);
    if sum > 0.0 { way_m = frame.grip * (anchors[at].position_m.xyz - held_m) / sum; }
    if lane < BESIDE { reaches[lane] = reach(base, at, lane, way_m, shares); }
    meet();
    var least = 1.0;
    for (var k = 0u; k < BESIDE; k++) { least = min(least, reaches[k]); }
    if lane < 4u {
        let n = base + nodes[lane];
        x[n] = vec4(x[n].xyz + shares[lane] * least * way_m, x[n].w);
    }
    meet();
}

fn pull_anchors(sheet: u32, lane: u32) {
    for (var k = 0u; k < frame.anchors; k++) {
        pull_anchor(sheet * frame.nodes, sheet * GRIPS_MAX + k, lane);
    }
}

@compute @workgroup_size(256)
fn grip_all(@builtin(local_invocation_index) lane: u32) {
    pull_anchors(0u, lane);
}
