//! Polygon meshes for tests.

use maquette_value::{Faces, Mesh};
use nalgebra::Point3;

/// A mesh with random positions, for tests of the topology or of properties that hold for any positions.
pub(super) fn scattered_polygons(faces: Vec<Vec<u32>>) -> Mesh {
    let vertices = faces.iter().flatten().max().map_or(0, |&vertex| vertex + 1);
    let mut state = 7u32;
    fn random(state: &mut u32) -> f64 {
        *state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        f64::from(*state >> 8) / f64::from(1 << 24) - 0.5
    }
    let positions: Vec<[f64; 3]> = (0..vertices)
        .map(|_| [random(&mut state), random(&mut state), random(&mut state)])
        .collect();
    polygons_at(faces, &positions)
}

pub(super) fn polygons_at(faces: Vec<Vec<u32>>, positions: &[[f64; 3]]) -> Mesh {
    let positions: Vec<Point3<f64>> = positions.iter().map(|&point| point.into()).collect();
    let sides: Vec<usize> = faces.iter().map(Vec::len).collect();
    Mesh::new(positions, Faces::polygons(&sides, faces.concat()).unwrap()).unwrap()
}

/// Creates the unit cube. Bits 0, 1 and 2 of a vertex's index are its x, y and z.
pub(super) fn cube() -> Mesh {
    polygons_at(
        cube_faces(),
        &(0..8).map(|i: u32| [i & 1, i >> 1 & 1, i >> 2].map(f64::from)).collect::<Vec<_>>(),
    )
}

pub(super) fn cube_faces() -> Vec<Vec<u32>> {
    let sides =
        [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    sides.map(|side| side.to_vec()).to_vec()
}

pub(super) fn tetrahedron() -> Vec<Vec<u32>> {
    [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]].map(|face| face.to_vec()).to_vec()
}

/// A bipyramid over a ring of `n` vertices.
pub(super) fn bipyramid(n: u32) -> Vec<Vec<u32>> {
    (0..n).flat_map(|i| [vec![i, (i + 1) % n, n], vec![(i + 1) % n, i, n + 1]]).collect()
}

pub(super) fn icosahedron() -> Vec<Vec<u32>> {
    let faces = (0..5)
        .map(|i: u32| [1 + i % 5, 1 + (i + 1) % 5, 6 + i % 5, 6 + (i + 1) % 5])
        .flat_map(|[a, b, c, d]| [[0, a, b], [a, c, b], [b, c, d], [11, d, c]]);
    faces.map(|face| face.to_vec()).collect()
}

/// A prism over a polygon of `n` corners.
pub(super) fn prism(n: u32) -> Vec<Vec<u32>> {
    let sides = (0..n).map(|i| vec![i, (i + 1) % n, n + (i + 1) % n, n + i]);
    let ends = [(0..n).rev().collect(), (n..2 * n).collect()];
    sides.chain(ends).collect()
}

/// A trapezohedron: `n` quads around each of the poles, which are the vertices 0 and 1.
pub(super) fn trapezohedron(n: u32) -> Vec<Vec<u32>> {
    fn ring(i: u32, n: u32) -> u32 {
        2 + i % (2 * n)
    }
    (0..n)
        .flat_map(|i| {
            let [a, b, c, d] = [0, 1, 2, 3].map(|k| ring(2 * i + k, n));
            [vec![0, a, b, c], vec![1, d, c, b]]
        })
        .collect()
}

/// Creates a sheet of `m` x `n` squares. If `around` is true, the sheet is closed to a torus.
pub(super) fn sheet(m: u32, n: u32, around: bool) -> Vec<Vec<u32>> {
    let (rows, columns) = if around { (m, n) } else { (m + 1, n + 1) };
    fn vertex_index(i: u32, j: u32, rows: u32, columns: u32) -> u32 {
        i % rows * columns + j % columns
    }
    let squares = (0..m * n).map(|k| (k / n, k % n));
    squares
        .map(|(i, j)| {
            vec![
                vertex_index(i, j, rows, columns),
                vertex_index(i, j + 1, rows, columns),
                vertex_index(i + 1, j + 1, rows, columns),
                vertex_index(i + 1, j, rows, columns),
            ]
        })
        .collect()
}

/// Creates a sheet of `n` x `n` squares on the unit lattice; `height` is a function of x and y.
pub(super) fn lattice(n: u32, height: impl Fn(f64, f64) -> f64) -> Mesh {
    let positions = (0..(n + 1) * (n + 1))
        .map(|k: u32| [f64::from(k % (n + 1)), f64::from(k / (n + 1))])
        .map(|[x, y]| [x, y, height(x, y)]);
    polygons_at(sheet(n, n, false), &positions.collect::<Vec<_>>())
}

/// Creates `n` polygons around vertex 0, each with `sides` corners.
pub(super) fn rosette(n: u32, sides: u32) -> Vec<Vec<u32>> {
    let step = sides - 2;
    fn rim(k: u32, step: u32, n: u32) -> u32 {
        1 + k % (step * n)
    }
    (0..n)
        .map(|i| [0].into_iter().chain((0..=step).map(|k| rim(step * i + k, step, n))).collect())
        .collect()
}

/// Half of a rosette: vertex 0 on the border of `n` polygons.
pub(super) fn fan(n: u32, sides: u32) -> Vec<Vec<u32>> {
    let step = sides - 2;
    (0..n).map(|i| [0].into_iter().chain((0..=step).map(|k| 1 + step * i + k)).collect()).collect()
}

/// Triangles, quads and larger faces at borders: a sheet with some squares divided, some merged, some removed.
pub(super) fn patchwork() -> Vec<Vec<u32>> {
    let mut faces = sheet(5, 5, false);
    faces.remove(12);
    let [a, b, c, d] = [faces[3][0], faces[3][1], faces[3][2], faces[3][3]];
    faces[3] = vec![a, b, c];
    faces.push(vec![a, c, d]);
    // Two neighbors are merged into a hexagon.
    let (left, right) = (faces[15].clone(), faces.remove(16));
    faces[15] = vec![left[0], left[1], right[1], right[2], left[2], left[3]];
    faces
}
