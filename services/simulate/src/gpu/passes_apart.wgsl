// The passes as dispatches of their own, for sheets too large for one workgroup; those of the
// pieces are beside their functions.

@compute @workgroup_size(256)
fn advance_all(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x < frame.nodes {
        advance(id.x);
        pull(id.x); // if track
    }
}

@compute @workgroup_size(256)
fn project_colour(@builtin(global_invocation_id) id: vec3<u32>) {
    let range = ranges[choice.index];
    if range.x + id.x < range.y { project(0u, range.x + id.x); }
}

@compute @workgroup_size(256)
fn settle_all(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x < frame.nodes { settle(id.x); }
}
