// The passes as dispatches of their own, for sheets too large for one workgroup.

struct Choice { index: u32, unused: vec3<u32> }
@group(1) @binding(0) var<uniform> choice: Choice; // the colour, or the facet

@compute @workgroup_size(256)
fn advance_all(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x < frame.nodes {
        advance(id.x);
        pull(id.x);
    }
}

@compute @workgroup_size(256)
fn project_colour(@builtin(global_invocation_id) id: vec3<u32>) {
    let range = ranges[choice.index];
    let at = range.x + id.x;
    if at < range.y { project(0u, at); }
}

@compute @workgroup_size(256)
fn hold_one_facet(@builtin(local_invocation_index) lane: u32) {
    hold_facet(0u, choice.index, lane);
}

@compute @workgroup_size(256)
fn settle_all(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x < frame.nodes { settle(id.x); }
}
