// A facet's best rigid pose. CPU twins: `FitFacet` and `polar` in `solver/facets.rs`. All
// invocations of a workgroup take part, and all get the pose.

struct Pose { center_m: vec3<f32>, count: u32, u: vec3<f32>, v: vec3<f32> }

// Per facet (bits of its first member's place here, bits of their number); then its members,
// (bits of the node, u - mean, v - mean).
@group(0) @binding(8) var<storage, read> facets: array<vec4<f32>>;

var<workgroup> sums: array<array<vec3<f32>, 3>, WIDTH>;

fn fit_facet(base: u32, facet: u32, lane: u32) -> Pose {
    let start = bitcast<u32>(facets[facet].x);
    let count = bitcast<u32>(facets[facet].y);
    var sum = array<vec3<f32>, 3>();
    for (var k = lane; k < count; k += WIDTH) {
        let member = facets[start + k];
        let at = x[base + bitcast<u32>(member.x)].xyz;
        sum[0] += at;
        sum[1] += at * member.y;
        sum[2] += at * member.z;
    }
    sums[lane] = sum;
    workgroupBarrier();
    for (var half = WIDTH / 2u; half > 0u; half /= 2u) {
        if lane < half {
            sums[lane][0] += sums[lane + half][0];
            sums[lane][1] += sums[lane + half][1];
            sums[lane][2] += sums[lane + half][2];
        }
        workgroupBarrier();
    }
    let center_m = sums[0][0] / f32(max(count, 1u));
    let axes = polar(sums[0][1], sums[0][2]);
    workgroupBarrier();
    return Pose(center_m, count, axes[0], axes[1]);
}

// [U V] = M·S⁻¹: a(r + s) − b q = s(a + b × n), n = a × b/s, s = √det, and so for V. In f32 the
// left side cancels where a and b are nearly parallel, the right one does not.
fn polar(a: vec3<f32>, b: vec3<f32>) -> array<vec3<f32>, 2> {
    let normal = cross(a, b);
    let root_det = length(normal);
    let p = dot(a, a);
    let r = dot(b, b);
    if root_det <= 1e-12 * (p + r) {
        // All on a line or a point: any frame that holds the line.
        let along = select(b, a, p >= r);
        let size = length(along);
        var u = vec3(1.0, 0.0, 0.0);
        if size > 0.0 { u = along / size; }
        let away = select(vec3(0.0, 1.0, 0.0), vec3(1.0, 0.0, 0.0), abs(u.x) < 0.7);
        return array<vec3<f32>, 2>(u, normalize(away - dot(u, away) * u));
    }
    let n = normal / root_det;
    let scale = 1.0 / sqrt(p + r + 2.0 * root_det);
    return array<vec3<f32>, 2>((a + cross(b, n)) * scale, (b + cross(n, a)) * scale);
}
