// Stiff facets. CPU twins: `hold_facets` in `solver/substep.rs`, `HoldFacet` in
// `solver/facets.rs`.

@group(0) @binding(9) var<storage, read> strengths: array<f32>; // share of the way, per facet

fn hold_facet(base: u32, facet: u32, strength: f32, lane: u32) {
    let pose = fit_facet(base, facet, lane);
    if pose.count < 3u { return; }
    let start = bitcast<u32>(facets[facet].x);
    for (var k = lane; k < pose.count; k += WIDTH) {
        let member = facets[start + k];
        let n = base + bitcast<u32>(member.x);
        let goal = pose.center_m + pose.u * member.y + pose.v * member.z;
        if x[n].w > 0.0 { x[n] = vec4(x[n].xyz + (goal - x[n].xyz) * strength, x[n].w); }
    }
}

// Forwards and backwards in turn.
fn hold_facets(sheet: u32, is_odd: u32, lane: u32) {
    for (var k = 0u; k < frame.facets; k++) {
        let facet = select(k, frame.facets - 1u - k, is_odd == 1u);
        hold_facet(sheet * frame.nodes, facet, strengths[sheet * frame.facets + facet], lane);
        meet();
    }
}

@compute @workgroup_size(256)
fn hold_all(@builtin(local_invocation_index) lane: u32) {
    hold_facets(0u, choice.index, lane);
}
