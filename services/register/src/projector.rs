//! World points into a lens's image, sixteen at a time.

use nalgebra::Isometry3;
use orime_geometry::CameraModel;
use orime_lanes::{LANES, Lanes, Pass, Width, load_points};

/// A lens, and where it stands.
#[derive(Debug, Clone)]
pub(crate) struct Projector {
    /// Rows of the rotation from the world to the camera.
    rotation: [[f32; 3]; 3],
    translation_m: [f32; 3],
    /// Focal lengths and principal point, pixels of the image that is meant.
    focal_px: [f32; 2],
    centre_px: [f32; 2],
    distortion: [f32; 5],
    lanes: Width,
}

/// Points of one kind, in structures of arrays padded to whole vectors.
#[derive(Debug, Clone, Default)]
pub(crate) struct Coordinates {
    /// x, y, z.
    pub axes: [Vec<f32>; 3],
}

impl Coordinates {
    /// Takes over points; the padding repeats nothing but zeros.
    pub fn set(&mut self, points: impl Iterator<Item = [f32; 3]>) {
        self.axes.iter_mut().for_each(Vec::clear);
        for point in points {
            for (axis, value) in self.axes.iter_mut().zip(point) {
                axis.push(value);
            }
        }
        let padded = self.axes[0].len().next_multiple_of(LANES);
        self.axes.iter_mut().for_each(|axis| axis.resize(padded, 0.0));
    }

    /// The three numbers of one point.
    pub fn at(&self, index: usize) -> [f32; 3] {
        [self.axes[0][index], self.axes[1][index], self.axes[2][index]]
    }
}

impl Projector {
    /// For a lens; `scale` is the size of the image in pixels of the lens.
    pub fn new(lens: &CameraModel, world_from_camera: &Isometry3<f64>, scale: f64) -> Self {
        let mut projector = Self {
            rotation: [[0.0; 3]; 3],
            translation_m: [0.0; 3],
            focal_px: [lens.fx_px, lens.fy_px].map(|f| (f * scale) as f32),
            centre_px: [lens.cx_px, lens.cy_px].map(|c| (c * scale) as f32),
            distortion: lens.distortion.map(|k| k as f32),
            lanes: Width::available()[0],
        };
        projector.stand(world_from_camera);
        projector
    }

    /// Stands the lens elsewhere.
    pub fn stand(&mut self, world_from_camera: &Isometry3<f64>) {
        let camera_from_world = world_from_camera.inverse();
        let rotation = camera_from_world.rotation.to_rotation_matrix();
        let rotation = rotation.matrix();
        self.rotation = [0, 1, 2].map(|i| [0, 1, 2].map(|j| rotation[(i, j)] as f32));
        self.translation_m = camera_from_world.translation.vector.cast::<f32>().into();
    }

    /// Column, row and 1/z of world points, metres and 1/m, which lie in whole vectors; NaN behind
    /// the camera.
    pub fn project(&self, at_m: &[Vec<f32>; 3], projected: &mut Coordinates) {
        let len = at_m[0].len();
        assert!(len.is_multiple_of(LANES) && at_m.iter().all(|axis| axis.len() == len));
        projected.axes.iter_mut().for_each(|axis| axis.resize(len, 0.0));
        self.lanes.run(Project { projector: self, at_m, projected });
    }
}

struct Project<'a> {
    projector: &'a Projector,
    at_m: &'a [Vec<f32>; 3],
    projected: &'a mut Coordinates,
}

impl Pass for Project<'_> {
    #[inline(always)]
    fn run<V: Lanes>(self) {
        let Projector { rotation, translation_m, focal_px, centre_px, distortion, .. } =
            self.projector;
        let [k1, k2, p1, p2, k3] = *distortion;
        let (one, two) = (V::splat(1.0), V::splat(2.0));
        let from = [self.at_m[0].as_ptr(), self.at_m[1].as_ptr(), self.at_m[2].as_ptr()];
        let [columns, rows, inverses] = &mut self.projected.axes;
        let places = columns.chunks_exact_mut(LANES).zip(rows.chunks_exact_mut(LANES));
        let places = places.zip(inverses.chunks_exact_mut(LANES));
        for (k, ((columns, rows), inverses)) in places.enumerate() {
            // SAFETY: as many points are there as places, see `project`.
            let p = unsafe { load_points::<V>(from, k * LANES) };
            let [x, y, z] = [
                along::<V>(rotation[0], p, translation_m[0]),
                along::<V>(rotation[1], p, translation_m[1]),
                along::<V>(rotation[2], p, translation_m[2]),
            ];
            let inverse = one.div(z);
            let (x, y) = (x.mul(inverse), y.mul(inverse));
            let r2 = x.mul(x).add(y.mul(y));
            let radial = V::splat(k2).add(r2.mul(V::splat(k3)));
            let radial = one.add(r2.mul(V::splat(k1).add(r2.mul(radial))));
            let xy = two.mul(x).mul(y);
            let u = x.mul(radial).add(V::splat(p1).mul(xy));
            let u = u.add(V::splat(p2).mul(r2.add(two.mul(x).mul(x))));
            let v = y.mul(radial).add(V::splat(p2).mul(xy));
            let v = v.add(V::splat(p1).mul(r2.add(two.mul(y).mul(y))));
            let in_front = z.above(V::splat(1e-9));
            let nowhere = V::splat(f32::NAN);
            let u = V::splat(focal_px[0]).mul(u).add(V::splat(centre_px[0]));
            let v = V::splat(focal_px[1]).mul(v).add(V::splat(centre_px[1]));
            // SAFETY: the chunks have sixteen numbers.
            unsafe {
                u.select(nowhere, in_front).store(columns.as_mut_ptr());
                v.select(nowhere, in_front).store(rows.as_mut_ptr());
                inverse.select(nowhere, in_front).store(inverses.as_mut_ptr());
            }
        }
    }
}

/// One coordinate in the camera.
#[inline(always)]
fn along<V: Lanes>(row: [f32; 3], [x, y, z]: [V; 3], offset: f32) -> V {
    let sum = V::splat(row[0]).mul(x).add(V::splat(row[1]).mul(y));
    sum.add(V::splat(row[2]).mul(z)).add(V::splat(offset))
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Point3, Translation3, UnitQuaternion, Vector3};

    #[test]
    fn lanes_project_as_the_lens_does() {
        let lens = CameraModel {
            width: 640,
            height: 480,
            fx_px: 610.0,
            fy_px: 608.0,
            cx_px: 322.0,
            cy_px: 241.0,
            distortion: [0.1, -0.2, 0.001, -0.002, 0.05],
        };
        let world_from_camera = Isometry3::from_parts(
            Translation3::new(0.1, -0.3, 0.6),
            UnitQuaternion::from_scaled_axis(Vector3::new(2.6, 0.4, -0.2)),
        );
        let points: Vec<[f32; 3]> = (0..40)
            .map(|k| k as f32)
            .map(|k| [0.1 * k.sin(), 0.1 * (1.3 * k).cos(), 0.05 * k - 0.4])
            .collect();
        let mut at_m = Coordinates::default();
        at_m.set(points.iter().copied());
        let mut projector = Projector::new(&lens, &world_from_camera, 0.5);
        let mut portable = Coordinates::default();
        projector.lanes = Width::Portable;
        projector.project(&at_m.axes, &mut portable);
        let (mut behind, mut inside) = (0, 0);
        for (k, point) in points.iter().enumerate() {
            let point = world_from_camera.inverse() * Point3::from(*point).cast::<f64>();
            let found = portable.at(k);
            match lens.project(&point) {
                Some(pixel) if pixel.amax() > 2000.0 => assert!(!found[0].is_nan()),
                Some(pixel) => {
                    inside += 1;
                    assert!(
                        (f64::from(found[0]) - 0.5 * pixel.x).abs() < 2e-3,
                        "{found:?} {pixel}"
                    );
                    assert!((f64::from(found[1]) - 0.5 * pixel.y).abs() < 2e-3);
                    assert!((f64::from(found[2]) * point.z - 1.0).abs() < 1e-5);
                }
                None => {
                    behind += 1;
                    assert!(found.iter().all(|c| c.is_nan()));
                }
            }
        }
        assert!(behind > 3 && inside > 10, "{behind} and {inside}");
        let bits =
            |c: &Coordinates| c.axes.clone().map(|a| a.iter().map(|x| x.to_bits()).collect());
        let expected: [Vec<u32>; 3] = bits(&portable);
        for width in Width::available() {
            projector.lanes = width;
            let mut found = Coordinates::default();
            projector.project(&at_m.axes, &mut found);
            assert_eq!(bits(&found), expected, "{width:?}");
        }
    }
}
