// A whole frame of one sheet in one workgroup; a workgroup per sheet of a batch.

fn meet() {
    storageBarrier();
    workgroupBarrier();
}

@compute @workgroup_size(256)
fn sheet_frame(
    @builtin(local_invocation_index) lane: u32,
    @builtin(workgroup_id) sheet: vec3<u32>,
) {
    let base = sheet.x * frame.nodes;
    for (var substep = 0u; substep < frame.substeps; substep++) {
        for (var n = lane; n < frame.nodes; n += WIDTH) {
            advance(base + n);
            pull(base + n);
        }
        meet();
        for (var colour = 0u; colour < frame.colours; colour++) {
            let range = ranges[colour];
            for (var at = range.x + lane; at < range.y; at += WIDTH) { project(base, at); }
            meet();
        }
        for (var k = 0u; k < frame.facets; k++) {
            let forward = (frame.first_substep + substep) % 2u == 0u;
            hold_facet(base, select(frame.facets - 1u - k, k, forward), lane);
            meet();
        }
        for (var n = lane; n < frame.nodes; n += WIDTH) { settle(base + n); }
        meet();
    }
}
