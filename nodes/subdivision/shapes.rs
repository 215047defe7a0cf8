//! Closed meshes for tests.

use std::f64::consts::TAU;

use maquette_value::{Faces, Mesh};
use nalgebra::{Point3, Vector3};

pub(super) fn polygons(faces: Vec<Vec<u32>>, points: Vec<Point3<f64>>) -> Mesh {
    let sides: Vec<_> = faces.iter().map(Vec::len).collect();
    Mesh::new(points, Faces::polygons(&sides, faces.concat()).unwrap()).unwrap()
}

pub(super) fn triangles(faces: &[[u32; 3]], points: &[[f64; 3]]) -> Mesh {
    let points: Vec<_> = points.iter().map(|&point| Point3::from(point)).collect();
    Mesh::new(points, Faces::triangles(faces.to_vec())).unwrap()
}

pub(super) fn tetrahedron() -> Mesh {
    triangles(
        &[[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]],
        &[[1., 1., 1.], [-1., 1., -1.], [1., -1., -1.], [-1., -1., 1.]],
    )
}

pub(super) fn octahedron() -> Mesh {
    triangles(
        &[[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]],
        &[[1., 0., 0.], [-1., 0., 0.], [0., 1., 0.], [0., -1., 0.], [0., 0., 1.], [0., 0., -1.]],
    )
}

/// A cube from -1 to 1 along each axis.
pub(super) fn cube() -> Mesh {
    fn corner(k: u32) -> [f64; 3] {
        [k & 1, k >> 1 & 1, k >> 2].map(|bit| 2.0 * f64::from(bit) - 1.0)
    }
    let sides =
        [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let faces = sides.map(|side| side.to_vec()).to_vec();
    polygons(faces, (0..8).map(|k| Point3::from(corner(k))).collect())
}

/// Creates a prism whose base is a regular polygon with `n` corners.
pub(super) fn prism(n: u32) -> Mesh {
    let sides = (0..n).map(|i| vec![i, (i + 1) % n, n + (i + 1) % n, n + i]);
    let ends = [(0..n).rev().collect(), (n..2 * n).collect()];
    polygons(
        sides.chain(ends).collect(),
        (0..2 * n)
            .map(|k: u32| {
                let angle = TAU * f64::from(k % n) / f64::from(n);
                Point3::new(libm::cos(angle), libm::sin(angle), f64::from(k / n))
            })
            .collect(),
    )
}

/// Creates a unit sphere: an icosahedron whose faces are divided into four, `cuts` times.
pub(super) fn sphere(cuts: u32) -> Mesh {
    let golden = (1.0 + 5f64.sqrt()) / 2.0;
    let corners = (0..12).map(|k| {
        let [a, b] = [k & 1, k >> 1 & 1].map(|bit| 1.0 - 2.0 * f64::from(bit));
        let [a, b] = [a, b * golden];
        let position = [[a, b, 0.0], [0.0, a, b], [b, 0.0, a]][k as usize / 4];
        Point3::from(Vector3::from(position).normalize())
    });
    let mut points: Vec<_> = corners.collect();
    fn is_near(a: usize, b: usize, points: &[Point3<f64>]) -> bool {
        (points[a] - points[b]).norm() < 1.1
    }
    let mut faces = Vec::new();
    for a in 0..12 {
        for b in a + 1..12 {
            for c in b + 1..12 {
                if is_near(a, b, &points) && is_near(b, c, &points) && is_near(a, c, &points) {
                    let [p, q, r] = [a, b, c].map(|k| points[k].coords);
                    let outward = (q - p).cross(&(r - p)).dot(&p) > 0.0;
                    faces.push(if outward { [a, b, c] } else { [a, c, b] }.map(|k| k as u32));
                }
            }
        }
    }
    for _ in 0..cuts {
        let edges = Faces::triangles(faces.clone()).edges();
        let first = points.len() as u32;
        let middles: Vec<_> = edges
            .vertices
            .iter()
            .map(|ends| {
                let [a, b] = ends.map(|end| points[end as usize].coords);
                Point3::from((a + b).normalize())
            })
            .collect();
        points.extend(middles);
        faces = faces
            .iter()
            .zip(edges.of_corner.chunks(3))
            .flat_map(|(&[a, b, c], of): (&[u32; 3], &[u32])| {
                let [ab, bc, ca] = [0, 1, 2].map(|k| first + of[k]);
                [[a, ab, ca], [b, bc, ab], [c, ca, bc], [ab, bc, ca]]
            })
            .collect();
    }
    Mesh::new(points, Faces::triangles(faces)).unwrap()
}

/// Creates a torus of radii 2 and 0.7 from `n` by `m` quads. If `cut` is true, each quad is divided into two triangles.
pub(super) fn torus(n: u32, m: u32, cut: bool) -> Mesh {
    fn name(i: u32, j: u32, n: u32, m: u32) -> u32 {
        i % n + j % m * n
    }
    let quads = (0..n * m).map(|k| (k % n, k / n)).map(|(i, j)| {
        [name(i, j, n, m), name(i + 1, j, n, m), name(i + 1, j + 1, n, m), name(i, j + 1, n, m)]
    });
    let faces: Vec<Vec<u32>> = match cut {
        false => quads.map(|quad| quad.to_vec()).collect(),
        true => quads.flat_map(|[a, b, c, d]| [vec![a, b, c], vec![a, c, d]]).collect(),
    };
    polygons(
        faces,
        (0..n * m)
            .map(|k: u32| {
                let [u, v] = [f64::from(k % n) / f64::from(n), f64::from(k / n) / f64::from(m)];
                let [u, v] = [u, v].map(|t| t * TAU);
                let radius = 2.0 + 0.7 * libm::cos(v);
                Point3::new(radius * libm::cos(u), radius * libm::sin(u), 0.7 * libm::sin(v))
            })
            .collect(),
    )
}

/// Adds normally distributed noise with the standard deviation `deviation` to the coordinates of the vertices.
pub(super) fn add_noise(mesh: &Mesh, deviation: f64) -> Mesh {
    let mut state = 12_345u32;
    fn uniform(state: &mut u32) -> f64 {
        *state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (f64::from(*state >> 8) + 0.5) / f64::from(1 << 24)
    }
    // Converts uniform to normally distributed random numbers by the Box-Muller transform.
    fn normal(state: &mut u32, deviation: f64) -> f64 {
        let radius = (-2.0 * libm::log(uniform(state))).sqrt();
        radius * libm::cos(TAU * uniform(state)) * deviation
    }
    let moved = mesh.positions().iter().map(|p| {
        p + Vector3::new(
            normal(&mut state, deviation),
            normal(&mut state, deviation),
            normal(&mut state, deviation),
        )
    });
    mesh.with_positions(moved.collect()).unwrap()
}

/// Displaces each vertex radially by a smooth function of its position.
pub(super) fn add_bumps(mesh: &Mesh) -> Mesh {
    let bump =
        |p: &Point3<f64>| p * (1.0 + 0.15 * libm::sin(3.0 * p.x) * libm::cos(2.0 * p.y + p.z));
    mesh.with_positions(mesh.positions().iter().map(bump).collect()).unwrap()
}
