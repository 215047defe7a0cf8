//! Test surfaces, a part of which is marked as a fill.

use std::collections::HashMap;

use super::super::spread::Plate;
use super::*;

/// Orders the vertices so that those of the fill (for which `missing` is true) follow the others.
fn split(
    points: Vec<Point3<f64>>,
    faces: Vec<[u32; 3]>,
    missing: impl Fn(&Point3<f64>) -> bool,
) -> Filling {
    let (mut kept, mut gone) = (Vec::new(), Vec::new());
    for (vertex, point) in (0u32..).zip(&points) {
        if missing(point) { &mut gone } else { &mut kept }.push(vertex);
    }
    let data = kept.len();
    let order: Vec<u32> = kept.into_iter().chain(gone).collect();
    let mut index_of = vec![0; points.len()];
    (0..).zip(&order).for_each(|(new, &old)| index_of[old as usize] = new);
    let faces: Vec<[u32; 3]> =
        faces.iter().map(|face| face.map(|v| index_of[v as usize])).collect();
    let (mut faces, filled): (Vec<_>, Vec<_>) =
        faces.into_iter().partition(|face| face.iter().all(|&vertex| (vertex as usize) < data));
    let kept = faces.len();
    faces.extend(filled);
    let points = order.iter().map(|&vertex| points[vertex as usize]).collect();
    Filling { points, faces, n_data_vertices: data, n_data_faces: kept }
}

/// Returns the square from -1 to 1 in x and y, with `side` x `side` vertices at the given heights.
pub(super) fn grid(
    side: u32,
    missing: impl Fn(f64, f64) -> bool,
    height: impl Fn(f64, f64) -> f64,
) -> Filling {
    fn coordinate(k: u32, side: u32) -> f64 {
        -1.0 + 2.0 * f64::from(k) / f64::from(side - 1)
    }
    let quads = (0..side - 1).flat_map(|row| (0..side - 1).map(move |column| row * side + column));
    let faces = quads.flat_map(|k| {
        let [a, b, c, d] = [k, k + 1, k + side, k + side + 1];
        if (k / side + k % side).is_multiple_of(2) {
            [[a, b, d], [a, d, c]]
        } else {
            [[a, b, c], [b, d, c]]
        }
    });
    let points = (0..side * side)
        .map(|k: u32| {
            let (x, y) = (coordinate(k % side, side), coordinate(k / side, side));
            Point3::new(x, y, height(x, y))
        })
        .collect();
    split(points, faces.collect(), |point| missing(point.x, point.y))
}

pub(super) fn ridge(x: f64) -> f64 {
    0.2 * libm::exp(-(x / 0.3) * (x / 0.3))
}

/// Returns the unit sphere: an icosahedron whose faces are divided into four, `times` times.
pub(super) fn sphere(times: usize, missing: impl Fn(&Point3<f64>) -> bool) -> Filling {
    let golden = (1.0 + 5.0_f64.sqrt()) / 2.0;
    let mut points = Vec::new();
    for [a, b] in [[-1.0, golden], [1.0, golden], [-1.0, -golden], [1.0, -golden]] {
        points.extend([[a, b, 0.0], [0.0, a, b], [b, 0.0, a]].map(Vector3::from));
    }
    fn are_neighbors(a: usize, b: usize, points: &[Vector3<f64>]) -> bool {
        (points[a] - points[b]).norm() < 2.1
    }
    let mut faces = Vec::new();
    for a in 0..12 {
        for b in a + 1..12 {
            for c in b + 1..12 {
                if are_neighbors(a, b, &points)
                    && are_neighbors(b, c, &points)
                    && are_neighbors(a, c, &points)
                {
                    let out =
                        (points[b] - points[a]).cross(&(points[c] - points[a])).dot(&points[a]);
                    faces.push(if out > 0.0 { [a, b, c] } else { [a, c, b] }.map(|v| v as u32));
                }
            }
        }
    }
    for _ in 0..times {
        let mut middles = HashMap::new();
        fn middle(
            a: u32,
            b: u32,
            middles: &mut HashMap<[u32; 2], u32>,
            points: &mut Vec<Vector3<f64>>,
        ) -> u32 {
            *middles.entry([a.min(b), a.max(b)]).or_insert_with(|| {
                points.push((points[a as usize] + points[b as usize]) / 2.0);
                points.len() as u32 - 1
            })
        }
        faces = (faces.iter())
            .flat_map(|&[a, b, c]| {
                let [d, e, f] = [
                    middle(a, b, &mut middles, &mut points),
                    middle(b, c, &mut middles, &mut points),
                    middle(c, a, &mut middles, &mut points),
                ];
                [[a, d, f], [d, b, e], [f, e, c], [d, e, f]]
            })
            .collect();
        points.iter_mut().for_each(|point| *point = point.normalize());
    }
    split(points.into_iter().map(Point3::from).collect(), faces, missing)
}

/// Moves the vertices of the fill to a thin plate.
pub(super) fn plate(filling: &mut Filling) {
    let Filling { points, faces, n_data_vertices: data, .. } = filling;
    let surface = Surface::new(points.len(), faces);
    let plate = Plate::new(&surface, points.len(), *data, |_| 0.0).unwrap();
    // Choose the displacement such that the Laplacians vanish.
    let rows: Vec<Vector3<f64>> = (0..points.len())
        .map(|vertex: usize| {
            let spokes = surface
                .ring(vertex as u32)
                .iter()
                .map(|&other| points[other as usize] - points[vertex]);
            spokes.sum::<Vector3<f64>>()
        })
        .collect();
    let axes: [Vec<[f64; 3]>; 3] = [0, 1, 2].map(|axis| {
        let wanted: Vec<f64> = rows.iter().map(|row| row[axis]).collect();
        plate.solve(plate.load(&wanted))
    });
    for (k, point) in points[*data..].iter_mut().enumerate() {
        *point += Vector3::new(axes[0][k][0], axes[1][k][0], axes[2][k][0]);
    }
}
