// What the kernels of every scene share, and the passes over nodes and links. CPU twins of the
// same names: `solver/motion.rs`, `solver/project.rs`. Links of one colour share no node, so
// invocations never write the same one. A line that ends in `// if NAME` is there only where the
// scene needs that piece, see `pieces.rs`.

struct Frame {
    nodes: u32, colours: u32, substeps: u32, first_substep: u32,
    dt_s: f32, per_s: f32, keep: f32, fall_m_per_s: f32,
    way_max_m: f32, close_m2: f32, gamma: f32, is_first: u32,
    table_m: f32, friction: f32, has_table: u32, facets: u32,
    anchors: u32, grip: f32, grip_strain_max: f32, stencil_colours: u32,
    hinges: u32, stiffness: f32, hardening: f32, plastic_links: u32,
    yields_at: f32,
}
struct Link { ends: vec2<u32>, rest_m: f32, softness_s2: f32 }
struct Choice { index: u32, unused: vec3<u32> }

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<storage, read_write> x: array<vec4<f32>>; // w: inverse mass, without unit
@group(0) @binding(2) var<storage, read_write> v: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read_write> before: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read_write> ahead: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read> links: array<Link>;
@group(0) @binding(6) var<storage, read> ranges: array<vec2<u32>>; // links of each colour
// What a dispatch of its own is for: a colour, or whether the substep is odd.
@group(1) @binding(0) var<uniform> choice: Choice;

const WIDTH = 256u;
const SPEED_M_PER_S_MAX = 20.0;

fn meet() {
    storageBarrier();
    workgroupBarrier();
}

fn advance(n: u32) {
    let old = x[n];
    var speed = (v[n].xyz - vec3(0.0, 0.0, frame.fall_m_per_s)) * frame.keep;
    if old.w == 0.0 { speed = vec3(0.0); }
    v[n] = vec4(speed, 0.0);
    before[n] = old;
    x[n] = vec4(old.xyz + speed * frame.dt_s, old.w);
    ahead[n] = x[n];
}

fn project(sheet: u32, at: u32) {
    let link = links[at];
    let a = sheet * frame.nodes + link.ends.x;
    let b = sheet * frame.nodes + link.ends.y;
    let first = x[a];
    let second = x[b];
    let d = second.xyz - first.xyz;
    let squared = dot(d, d);
    if squared <= frame.close_m2 || first.w + second.w <= 0.0 { return; }
    // A rest length below zero marks a seam, which may become shorter and is not damped.
    let is_seam = link.rest_m < 0.0;
    if is_seam && squared <= link.rest_m * link.rest_m { return; }
    var rest_m = abs(link.rest_m);
    rest_m = own_rest_m(sheet, at, rest_m); // if plastic
    let inverse = inverseSqrt(squared);
    let gamma = select(frame.gamma, 0.0, is_seam);
    let share = gamma * inverse * inverse;
    let way_a = first.xyz - before[a].xyz;
    let way_b = second.xyz - before[b].xyz;
    var s = vec2(1.0 - rest_m * inverse);
    s += share * dot(d, way_b - way_a); // if xpbd
    s += share * vec2(-dot(d, way_a), dot(d, way_b)); // if paper
    var damping = 1.0;
    damping += gamma; // if xpbd
    s /= damping * (first.w + second.w) + link.softness_s2 * frame.per_s * frame.per_s;
    x[a] = vec4(first.xyz + d * (s.x * first.w), first.w);
    x[b] = vec4(second.xyz - d * (s.y * second.w), second.w);
}

fn settle(n: u32) {
    if frame.has_table == 1u { rest_on_table(n); } // if table
    // Neither hinges nor the table move what is pinned: `keep_pinned` in `solver/substep.rs`.
    if x[n].w == 0.0 { x[n] = before[n]; }
    let speed = v[n].xyz + (x[n].xyz - ahead[n].xyz) * frame.per_s;
    v[n] = vec4(clamp(speed, vec3(-SPEED_M_PER_S_MAX), vec3(SPEED_M_PER_S_MAX)), 0.0);
}
