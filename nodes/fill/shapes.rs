//! Meshes with and without holes, for tests.

use std::collections::BTreeMap;

use maquette_value::{Faces, Mesh};
use nalgebra::{Point3, Vector3};

pub(super) mod nut;

pub(super) fn triangle_mesh(points: Vec<Point3<f64>>, faces: Vec<[u32; 3]>) -> Mesh {
    Mesh::new(points, Faces::triangles(faces)).unwrap()
}

/// Returns the mesh without the vertices for which `is_lost` is true and without their faces. The remaining vertices and faces keep their
/// order.
pub(super) fn remove_vertices(mesh: &Mesh, is_lost: impl Fn(&Point3<f64>) -> bool) -> Mesh {
    let lost: Vec<bool> = mesh.positions().iter().map(is_lost).collect();
    super::border::regions::cut(mesh, &lost).unwrap().0
}

/// Returns the unit sphere: an octahedron whose faces are divided into four, `times` times.
pub(super) fn sphere(times: u32) -> Mesh {
    let mut points: Vec<Vector3<f64>> = [Vector3::x(), Vector3::y(), Vector3::z()]
        .into_iter()
        .flat_map(|axis| [axis, -axis])
        .collect();
    let mut faces: Vec<[u32; 3]> = Vec::new();
    for [x, y, z] in [[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4]] {
        faces.extend([[x, y, z], [y, x, 5]]);
    }
    for _ in 0..times {
        let mut middles = BTreeMap::new();
        fn middle(
            a: u32,
            b: u32,
            middles: &mut BTreeMap<[u32; 2], u32>,
            points: &mut Vec<Vector3<f64>>,
        ) -> u32 {
            *middles.entry([a.min(b), a.max(b)]).or_insert_with(|| {
                points.push((points[a as usize] + points[b as usize]).normalize());
                points.len() as u32 - 1
            })
        }
        faces = faces
            .into_iter()
            .flat_map(|[a, b, c]| {
                let [ab, bc, ca] = [
                    middle(a, b, &mut middles, &mut points),
                    middle(b, c, &mut middles, &mut points),
                    middle(c, a, &mut middles, &mut points),
                ];
                [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
            })
            .collect();
    }
    triangle_mesh(points.into_iter().map(Point3::from).collect(), faces)
}

/// Returns a grid of unit squares, each divided into two triangles. `height` gives the z coordinate for a column and row.
pub(super) fn grid(columns: u32, rows: u32, height: impl Fn(f64, f64) -> f64) -> Mesh {
    let points = (0..columns * rows)
        .map(|k: u32| (f64::from(k % columns), f64::from(k / columns)))
        .map(|(x, y)| Point3::new(x, y, height(x, y)));
    let faces = (0..rows - 1).flat_map(|row| {
        (0..columns - 1).flat_map(move |column| {
            let a = row * columns + column;
            [[a, a + 1, a + columns + 1], [a, a + columns + 1, a + columns]]
        })
    });
    triangle_mesh(points.collect(), faces.collect())
}

/// Returns a pseudorandom number from 0 to 1.
pub(super) fn random(seed: u64) -> f64 {
    let mut x = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15);
    x = (x ^ (x >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    x = (x ^ (x >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    ((x ^ (x >> 31)) >> 11) as f64 / (1u64 << 53) as f64
}
