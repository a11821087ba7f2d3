// The paper's plastic links, which yield once a frame. CPU twin: `yield_links` in
// `solver/crease.rs`.

struct PlasticLink { ends: vec2<u32>, rest_m: f32, unused: u32 } // rest_m: of the uncreased sheet

@group(0) @binding(14) var<storage, read> rest_of_link: array<u32>; // beyond the last: its own
@group(0) @binding(15) var<storage, read> plastic_links: array<PlasticLink>;
@group(0) @binding(16) var<storage, read_write> rests_m: array<f32>; // sheet by sheet

// What a link that yields has come to, or else its rest length as it is.
fn own_rest_m(sheet: u32, at: u32, rest_m: f32) -> f32 {
    let own = rest_of_link[at];
    if own < frame.plastic_links { return rests_m[sheet * frame.plastic_links + own]; }
    return rest_m;
}

fn yield_link(sheet: u32, k: u32) {
    let link = plastic_links[k];
    let ends = link.ends + sheet * frame.nodes;
    let at = sheet * frame.plastic_links + k;
    let length_m = length(x[ends.y].xyz - x[ends.x].xyz);
    let strain = (length_m - rests_m[at]) / link.rest_m;
    if abs(strain) > frame.yields_at {
        rests_m[at] = max(length_m - sign(strain) * frame.yields_at * link.rest_m, 0.0);
    }
}

fn yield_links(sheet: u32, lane: u32) {
    if frame.is_first == 1u {
        for (var k = lane; k < frame.plastic_links; k += WIDTH) { yield_link(sheet, k); }
    }
    meet();
}

@compute @workgroup_size(256)
fn yield_all(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x < frame.plastic_links { yield_link(0u, id.x); }
}
