// Bending as a thin plate. CPU twin: `Flatten` in `solver/plate.rs`. Hinges and twists of one
// colour share no node.

struct StencilColour { factors: vec4<f32>, range: vec2<u32>, softness_s2: f32, unused: u32 }

// Their nodes; a hinge's last counts 0.
@group(0) @binding(12) var<storage, read> stencils: array<vec4<u32>>;
@group(0) @binding(13) var<storage, read> stencil_colours: array<StencilColour>;

fn give(n: u32, way_m: vec3<f32>) {
    x[n] = vec4(x[n].xyz + way_m * x[n].w, x[n].w);
}

fn flatten(base: u32, colour: u32, at: u32) {
    let nodes = stencils[at] + base;
    let f = stencil_colours[colour].factors;
    let a = x[nodes.x];
    let b = x[nodes.y];
    let c = x[nodes.z];
    let d = x[nodes.w];
    let bend = f.x * a.xyz + f.y * b.xyz + f.z * c.xyz + f.w * d.xyz;
    let alpha = stencil_colours[colour].softness_s2 * frame.per_s * frame.per_s;
    let sum = alpha + dot(f * f, vec4(a.w, b.w, c.w, d.w));
    // Where all are pinned and nothing gives, there is nothing to share.
    if sum <= 0.0 { return; }
    let share = f * (-1.0 / sum);
    give(nodes.x, bend * share.x);
    give(nodes.y, bend * share.y);
    give(nodes.z, bend * share.z);
    give(nodes.w, bend * share.w);
}

fn flatten_all(base: u32, lane: u32) {
    for (var colour = 0u; colour < frame.stencil_colours; colour++) {
        let range = stencil_colours[colour].range;
        for (var at = range.x + lane; at < range.y; at += WIDTH) { flatten(base, colour, at); }
        meet();
    }
}

@compute @workgroup_size(256)
fn flatten_colour(@builtin(global_invocation_id) id: vec3<u32>) {
    let range = stencil_colours[choice.index].range;
    if range.x + id.x < range.y { flatten(0u, choice.index, range.x + id.x); }
}
