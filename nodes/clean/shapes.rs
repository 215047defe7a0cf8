//! Meshes for tests.

use std::collections::BTreeMap;

use maquette_value::{Faces, Mesh};
use nalgebra::Point3;

/// Returns a cube of quads with edges of 10 mm around the origin.
pub(crate) fn cube() -> Mesh {
    let positions: Vec<_> = (0..8)
        .map(|k: u32| {
            Point3::from([0, 1, 2].map(|axis| if k >> axis & 1 == 1 { 5.0 } else { -5.0 }))
        })
        .collect();
    let quads =
        [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let corners = quads.concat();
    Mesh::new(positions, Faces::uniform(4, corners).unwrap()).unwrap()
}

/// Returns a sheet of `n` by `n` quads over a square with sides of 10 mm; `height` gives the heights of its vertices.
pub(crate) fn sheet(n: u32, height: impl Fn(f64, f64) -> f64) -> Mesh {
    let cells = (0..n * n).map(|k| k / n * (n + 1) + k % n);
    let faces = cells.flat_map(|a| [a, a + 1, a + n + 2, a + n + 1]);
    let places: Vec<_> = (0..(n + 1) * (n + 1))
        .map(|k: u32| {
            let [x, y] = [k % (n + 1), k / (n + 1)].map(|k| 10.0 * f64::from(k) / f64::from(n));
            Point3::new(x, y, height(x, y))
        })
        .collect();
    Mesh::new(places, Faces::uniform(4, Vec::from_iter(faces)).unwrap()).unwrap()
}

/// Returns a sphere of radius 10 mm whose triangles are smaller near the poles.
pub(crate) fn ball(n: u32) -> Mesh {
    let mut places = vec![Point3::new(0.0, 0.0, 10.0), Point3::new(0.0, 0.0, -10.0)];
    places.extend((1..n).flat_map(|row: u32| {
        (0..2 * n).map(move |k| {
            let [u, v] =
                [f64::from(k), f64::from(row)].map(|x| x * std::f64::consts::PI / f64::from(n));
            let radius = 10.0 * libm::sin(v);
            Point3::new(radius * libm::cos(u), radius * libm::sin(u), 10.0 * libm::cos(v))
        })
    }));
    fn name(row: u32, k: u32, n: u32) -> u32 {
        2 + (row - 1) * 2 * n + k % (2 * n)
    }
    let mut faces = Vec::new();
    for k in 0..2 * n {
        faces.push([0, name(1, k, n), name(1, k + 1, n)]);
        faces.push([1, name(n - 1, k + 1, n), name(n - 1, k, n)]);
        for row in 1..n - 1 {
            let [a, b, c, d] = [
                name(row, k, n),
                name(row + 1, k, n),
                name(row + 1, k + 1, n),
                name(row, k + 1, n),
            ];
            faces.extend([[a, b, c], [a, c, d]]);
        }
    }
    Mesh::new(places, Faces::triangles(faces)).unwrap()
}

/// Returns a mesh whose polygons are cut into triangles.
pub(crate) fn cut(mesh: &Mesh) -> Mesh {
    let triangles = Faces::triangles(mesh.triangles().into_owned());
    Mesh::new(mesh.positions().to_vec(), triangles).unwrap()
}

/// Returns the area of a mesh in mm^2.
pub(crate) fn area(mesh: &Mesh) -> f64 {
    mesh.faces().iter().map(|face| mesh.area_vector(face).norm()).sum()
}

/// Returns the volume of a closed mesh in mm^3.
pub(crate) fn volume(mesh: &Mesh) -> f64 {
    fn place(vertex: u32, mesh: &Mesh) -> nalgebra::Vector3<f64> {
        mesh.positions()[vertex as usize].coords
    }
    fn of_triangle([a, b, c]: [u32; 3], mesh: &Mesh) -> f64 {
        place(a, mesh).dot(&place(b, mesh).cross(&place(c, mesh))) / 6.0
    }
    let fans = mesh.faces().iter().flat_map(|face| {
        (1..face.len() - 1).map(|k| of_triangle([face[0], face[k], face[k + 1]], mesh))
    });
    fans.sum()
}

/// Returns a sphere of radius 10 mm with uniform triangles: an icosahedron whose edges are halved `steps` times.
pub(crate) fn even_ball(steps: u32) -> Mesh {
    let golden = (1.0 + 5.0_f64.sqrt()) / 2.0;
    let mut places = Vec::new();
    for axis in 0..3 {
        for (a, b) in [(1.0, golden), (-1.0, golden), (1.0, -golden), (-1.0, -golden)] {
            let mut place = [0.0; 3];
            (place[(axis + 1) % 3], place[(axis + 2) % 3]) = (a, b);
            places.push(Point3::from(place));
        }
    }
    fn is_near(a: usize, b: usize, places: &[Point3<f64>]) -> bool {
        (places[a] - places[b]).norm() < 2.1
    }
    let mut faces = Vec::new();
    for (a, b) in (0..12).flat_map(|a| (a + 1..12).map(move |b| (a, b))) {
        for c in (b + 1..12)
            .filter(|&c| is_near(a, b, &places) && is_near(b, c, &places) && is_near(c, a, &places))
        {
            let [p, q, r] = [a, b, c].map(|k| places[k].coords);
            let is_outside = p.dot(&q.cross(&r)) > 0.0;
            faces.push((if is_outside { [a, b, c] } else { [a, c, b] }).map(|k| k as u32));
        }
    }
    for _ in 0..steps {
        let mut middles = BTreeMap::new();
        fn middle(
            a: u32,
            b: u32,
            middles: &mut BTreeMap<[u32; 2], u32>,
            places: &mut Vec<Point3<f64>>,
        ) -> u32 {
            *middles.entry([a.min(b), a.max(b)]).or_insert_with(|| {
                places.push(nalgebra::center(&places[a as usize], &places[b as usize]));
                places.len() as u32 - 1
            })
        }
        faces = faces
            .into_iter()
            .flat_map(|[a, b, c]: [u32; 3]| {
                let [ab, bc, ca] = [
                    middle(a, b, &mut middles, &mut places),
                    middle(b, c, &mut middles, &mut places),
                    middle(c, a, &mut middles, &mut places),
                ];
                [[a, ab, ca], [b, bc, ab], [c, ca, bc], [ab, bc, ca]]
            })
            .collect();
        places.iter_mut().for_each(|place| *place = Point3::from(place.coords.normalize() * 10.0));
    }
    Mesh::new(places, Faces::triangles(faces)).unwrap()
}

/// Returns a cube with edges of 10 mm and `n` by `n` quads on each side.
pub(crate) fn fine_cube(n: u32) -> Mesh {
    let (mut names, mut places, mut corners) = (BTreeMap::new(), Vec::new(), Vec::new());
    let coarse = cube();
    for face in coarse.faces().iter() {
        let [a, b, _, d] = [0, 1, 2, 3].map(|k| coarse.positions()[face[k] as usize]);
        for (i, j) in (0..n * n).map(|k| (k % n, k / n)) {
            for (i, j) in [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)] {
                let [u, v] = [i, j].map(|x| f64::from(x) / f64::from(n));
                let place = a + (b - a) * u + (d - a) * v;
                let key = [0, 1, 2].map(|k| (place[k] * 1e6).round() as i64);
                corners.push(*names.entry(key).or_insert_with(|| {
                    places.push(place);
                    places.len() as u32 - 1
                }));
            }
        }
    }
    Mesh::new(places, Faces::uniform(4, corners).unwrap()).unwrap()
}
