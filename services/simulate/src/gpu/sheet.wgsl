// A whole frame of one sheet in one workgroup; a workgroup per sheet of a batch.

@compute @workgroup_size(256)
fn sheet_frame(
    @builtin(local_invocation_index) lane: u32,
    @builtin(workgroup_id) sheet: vec3<u32>,
) {
    let base = sheet.x * frame.nodes;
    yield_links(sheet.x, lane); // if plastic
    for (var substep = 0u; substep < frame.substeps; substep++) {
        for (var n = lane; n < frame.nodes; n += WIDTH) {
            advance(base + n);
            pull(base + n); // if track
        }
        meet();
        pull_anchors(sheet.x, lane); // if grippers
        flatten_all(base, lane); // if plate
        for (var colour = 0u; colour < frame.colours; colour++) {
            let range = ranges[colour];
            for (var at = range.x + lane; at < range.y; at += WIDTH) { project(sheet.x, at); }
            meet();
        }
        turn_hinges(sheet.x, lane); // if crease
        hold_facets(sheet.x, (frame.first_substep + substep) % 2u, lane); // if facets
        for (var n = lane; n < frame.nodes; n += WIDTH) { settle(base + n); }
        meet();
    }
}
