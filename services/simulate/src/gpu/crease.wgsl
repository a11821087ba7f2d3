// Creases that remember how far they were folded. CPU twins: `Hinge::turn`, `follow`, `yield_to`
// and `Lean` in `solver/crease.rs`.

struct Hinge {
    facets: vec2<u32>,
    direction: vec2<f32>,
    center_m: vec2<f32>,
    inertia_m2: vec2<f32>,
    angle_rad: f32,
    rest_rad: f32,
    yields_at_rad: f32,
    unused: u32,
}

@group(0) @binding(10) var<storage, read_write> hinges: array<Hinge>;

const PI = 3.14159265;
var<workgroup> turn_rad: f32;

// The angle of (cosine, sine) to 3e-7: Vulkan lets `atan2` be off by 4096 units in the last place.
// Source: atanf of Moshier's Cephes library.
fn angle_of(sine: f32, cosine: f32) -> f32 {
    let high = max(abs(sine), abs(cosine));
    if high == 0.0 { return 0.0; }
    var t = min(abs(sine), abs(cosine)) / high;
    var angle = 0.0;
    if t > 0.41421356 { // tan(π/8)
        angle = 0.25 * PI;
        t = (t - 1.0) / (t + 1.0);
    }
    let z = t * t;
    let series = ((8.05374449538e-2 * z - 1.38776856032e-1) * z + 1.99777106478e-1) * z;
    angle += (series - 3.33329491539e-1) * z * t + t;
    if abs(sine) > abs(cosine) { angle = 0.5 * PI - angle; }
    if cosine < 0.0 { angle = PI - angle; }
    return select(angle, -angle, sine < 0.0);
}

fn follow(hinge: Hinge, left: Pose, right: Pose) -> f32 {
    let normal = cross(left.u, left.v);
    let other = cross(right.u, right.v);
    let axis = (left.u + right.u) * hinge.direction.x + (left.v + right.v) * hinge.direction.y;
    let size = length(axis);
    if size <= 0.0 { return hinge.angle_rad; }
    let angle_rad = angle_of(dot(cross(normal, other), axis) / size, dot(normal, other));
    // The nearest of all angles that look alike: a fold does not jump.
    let apart = (hinge.angle_rad - angle_rad) / (2.0 * PI);
    let turns = sign(apart) * floor(abs(apart) + 0.5);
    return clamp(angle_rad + 2.0 * PI * turns, -1.5 * PI, 1.5 * PI);
}

fn yield_to(at: u32, angle_rad: f32) {
    let elastic_rad = angle_rad - hinges[at].rest_rad;
    let yields_at_rad = hinges[at].yields_at_rad;
    hinges[at].angle_rad = angle_rad;
    if abs(elastic_rad) > yields_at_rad {
        let flow_rad = elastic_rad - sign(elastic_rad) * yields_at_rad;
        hinges[at].rest_rad += flow_rad;
        hinges[at].yields_at_rad = min(yields_at_rad + frame.hardening * abs(flow_rad), PI);
    }
}

// A small turn of a facet about a line of the sheet: x ← x + distance·turn + shift.
struct Lean { facet: u32, center_m: f32, across: vec2<f32>, turn: vec3<f32>, shift: vec3<f32> }

fn lean_facet(base: u32, lean: Lean, lane: u32) {
    let start = bitcast<u32>(facets[lean.facet].x);
    let count = bitcast<u32>(facets[lean.facet].y);
    for (var k = lane; k < count; k += WIDTH) {
        let member = facets[start + k];
        let n = base + bitcast<u32>(member.x);
        let distance_m = dot(member.yz, lean.across) + lean.center_m;
        x[n] = vec4(x[n].xyz + distance_m * lean.turn + lean.shift, x[n].w);
    }
}

fn turn(base: u32, at: u32, lane: u32) {
    let hinge = hinges[at];
    let left = fit_facet(base, hinge.facets.x, lane);
    let right = fit_facet(base, hinge.facets.y, lane);
    let acts = min(left.count, right.count) >= 3u
        && min(hinge.inertia_m2.x, hinge.inertia_m2.y) > 0.0;
    meet(); // Everyone knows the hinge as it was.
    if acts && lane == 0u {
        yield_to(at, follow(hinge, left, right));
        turn_rad = frame.stiffness * (hinges[at].rest_rad - hinges[at].angle_rad);
    }
    meet();
    let turns = turn_rad * hinge.inertia_m2.yx / (hinge.inertia_m2.x + hinge.inertia_m2.y);
    let normal = cross(left.u, left.v);
    let other = cross(right.u, right.v);
    let counts = vec2(f32(left.count), f32(right.count));
    // What the turns move in all is taken back from everyone.
    let moved = turns * hinge.center_m * counts;
    let shift = (moved.x * normal + moved.y * other) / (counts.x + counts.y);
    let across = vec2(-hinge.direction.y, hinge.direction.x);
    let first = Lean(hinge.facets.x, hinge.center_m.x, across, -turns.x * normal, shift);
    let second = Lean(hinge.facets.y, hinge.center_m.y, -across, -turns.y * other, shift);
    if acts { lean_facet(base, first, lane); }
    meet();
    if acts { lean_facet(base, second, lane); }
    meet();
}

fn turn_hinges(sheet: u32, lane: u32) {
    for (var k = 0u; k < frame.hinges; k++) {
        turn(sheet * frame.nodes, sheet * frame.hinges + k, lane);
    }
}

@compute @workgroup_size(256)
fn turn_all(@builtin(local_invocation_index) lane: u32) {
    turn_hinges(0u, lane);
}
