//! Building blocks of edge cases, values at the limits of what their types allow: see [`Value::edge_cases`](super::Value::edge_cases).

use nalgebra::{Point3, Vector3};

/// Picture sizes for which loops often have bugs: no pixel, one pixel, one row, one column.
pub(super) const SIZES: [[usize; 2]; 5] = [[0, 0], [1, 1], [7, 1], [1, 7], [3, 0]];

/// Pictures of all [`SIZES`], each with equal pixels.
pub(super) fn uniform_pictures<T, P: Clone, E>(
    pixels: &[P],
    new: impl Fn(usize, usize, Vec<P>) -> Result<T, E>,
) -> Vec<T> {
    let cases = SIZES.into_iter().flat_map(|size| pixels.iter().map(move |pixel| (size, pixel)));
    cases.flat_map(|([w, h], pixel)| new(w, h, vec![pixel.clone(); w * h])).collect()
}

/// Sets of points: coincident, collinear, enormous, tiny, behind the sensor, at the sensor's position, and missing points.
pub(super) fn point_sets(count: usize) -> Vec<Vec<Point3<f64>>> {
    fn points(point: fn(f64) -> Point3<f64>, count: usize) -> Vec<Point3<f64>> {
        (0..count).map(|k| point(k as f64)).collect()
    }
    vec![
        points(|_| Point3::new(1.0, 2.0, 3.0), count),
        points(|k| Point3::new(k, 0.0, 100.0), count),
        points(|k| Point3::new(1e300 * (k - 1.0), 1e300, 1e300), count),
        points(|k| Point3::new(k, k * k, -5.0), count),
        points(|_| Point3::origin(), count),
        points(|k| Point3::new(k * 1e-300, 1e-300, 1e-300), count),
        points(|_| Point3::new(f64::NAN, 0.0, 0.0), count),
        points(
            |k| {
                if k % 2.0 == 0.0 {
                    Point3::new(k, 1.0, 50.0)
                } else {
                    Point3::new(f64::NAN, 0.0, 0.0)
                }
            },
            count,
        ),
    ]
}

/// Points and triangles of a mesh.
type Triangles = (Vec<Point3<f64>>, Vec<[u32; 3]>);

/// Small solids as scans and other programs make them: with faces without area, with vertices that are there twice, of separate faces, of
/// two parts, with a face that is there twice and a vertex without faces, open, far from the origin, tiny and huge.
pub(super) fn odd_solids() -> Vec<Triangles> {
    let solid = octahedron();
    // A vertex in the edge from vertex 0 to vertex 2, which belongs to the first face only, exactly and nearly.
    let middle = nalgebra::center(&solid.0[0], &solid.0[2]);
    let in_edge = [[0, 6, 4], [6, 2, 4], [0, 2, 6]];
    let exact = replace_first_face(&solid, middle, in_edge);
    let near = replace_first_face(&solid, middle + Vector3::new(1e-9, 0.0, 2e-9), in_edge);
    // Vertex 4 twice: the first face has a vertex of its own.
    let doubled = replace_first_face(&solid, solid.0[4], [[0, 2, 6], [4, 0, 6], [6, 2, 4]]);
    let apart = solid.1.iter().flatten().map(|&vertex| solid.0[vertex as usize]).collect();
    let apart = (apart, (0..8).map(|k| [3 * k, 3 * k + 1, 3 * k + 2]).collect());
    let mut two = solid.clone();
    two.0.extend(solid.0.iter().map(|point| point + Vector3::new(50.0, 0.0, 0.0)));
    two.1.extend(solid.1.iter().map(|face| face.map(|vertex| vertex + 6)));
    let mut twice = solid.clone();
    twice.0.push(Point3::origin());
    twice.1.push(solid.1[0]);
    let mut open = exact.clone();
    open.1.drain(6..8);
    let mut far = solid.clone();
    far.0.iter_mut().for_each(|point| *point += Vector3::new(1e7, -1e7, 1e7));
    let [tiny, huge] = [1e-7, 1e7].map(|factor| {
        let points = solid.0.iter().map(|point| point * factor);
        (points.collect(), solid.1.clone())
    });
    vec![exact, near, doubled, apart, two, twice, open, far, tiny, huge]
}

/// Replaces the first face of an octahedron by three others. `point` becomes vertex 6.
fn replace_first_face(solid: &Triangles, point: Point3<f64>, by: [[u32; 3]; 3]) -> Triangles {
    let points = solid.0.iter().copied().chain([point]).collect();
    let [first, others @ ..] = by;
    let faces = [first].into_iter().chain(solid.1[1..].iter().copied()).chain(others).collect();
    (points, faces)
}

/// Returns a closed octahedron with vertices 10 mm from its middle.
fn octahedron() -> Triangles {
    let points = (0..6).map(|k| {
        let mut point = Point3::new(1.0, 2.0, 100.0);
        point[k / 2] += if k % 2 == 0 { 10.0 } else { -10.0 };
        point
    });
    let faces = (0..8).map(|k: u32| {
        let [x, y, z] = [k & 1, 2 + (k >> 1 & 1), 4 + (k >> 2)];
        // An odd number of negative coordinates mirrors the face.
        if k.count_ones().is_multiple_of(2) { [x, y, z] } else { [y, x, z] }
    });
    (points.collect(), faces.collect())
}
