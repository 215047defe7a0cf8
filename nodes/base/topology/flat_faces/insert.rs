//! Adds faces without area to meshes, for the tests of several packs.

use maquette_value::rng::Random;
use maquette_value::{Faces, Mesh};
use nalgebra::Vector3;

/// Adds up to `count` faces without area to a mesh of triangles: vertices in the middle of an edge, which belong only to one of its two
/// faces, and vertices that are there twice. New vertices are after the others, and off their places by `height` times the length of an
/// edge.
pub(crate) fn insert_flat_faces(mesh: &Mesh, count: usize, height: f64, seed: u64) -> Mesh {
    let mut random = Random(seed);
    let mut points = mesh.positions().to_vec();
    let mut faces = mesh.faces().as_triangles().unwrap().to_vec();
    let mut is_used = vec![false; points.len()];
    for _ in 0..count {
        let face = faces[random.next_below(faces.len())];
        let [a, b, _] = face;
        fn around(vertex: u32, faces: &[[u32; 3]]) -> Vec<usize> {
            (0..faces.len()).filter(|&face| faces[face].contains(&vertex)).collect::<Vec<_>>()
        }
        let near: Vec<usize> = face.into_iter().flat_map(|vertex| around(vertex, &faces)).collect();
        let vertices: Vec<u32> = near.iter().flat_map(|&face| faces[face]).collect();
        if vertices.iter().any(|&vertex| is_used.get(vertex as usize) != Some(&false)) {
            continue;
        }
        let [at, to] = [a, b].map(|vertex| points[vertex as usize]);
        let offset = Vector3::from_fn(|_, _| random.even() - 0.5).normalize();
        let offset = offset * (height * (to - at).norm());
        let new = points.len() as u32;
        if random.next_below(2) == 0 {
            let Some(beyond) = faces.iter().position(|face| side(*face, b, a).is_some()) else {
                continue;
            };
            let Some(d) = side(faces[beyond], b, a) else { continue };
            let fraction = 0.2 + 0.6 * random.even();
            points.push(at + (to - at) * fraction + offset);
            faces[beyond] = [b, new, d];
            faces.extend([[new, a, d], [b, a, new]]);
        } else {
            let Some(ring) = ring(&faces, a) else { continue };
            let half = 2 + random.next_below(ring.len() - 3);
            points.push(at + offset);
            for face in around(a, &faces) {
                let first = (0..3).find(|&k| faces[face][k] == a).unwrap();
                let start = faces[face][(first + 1) % 3];
                if ring[..half].contains(&start) {
                    faces[face][first] = new;
                }
            }
            faces.extend([[a, ring[0], new], [new, ring[half], a]]);
        }
        vertices.iter().for_each(|&vertex| is_used[vertex as usize] = true);
    }
    Mesh::new(points, Faces::triangles(faces)).unwrap()
}

/// Returns the third corner of a triangle that has the half-edge from `a` to `b`.
fn side(face: [u32; 3], a: u32, b: u32) -> Option<u32> {
    (0..3).find(|&k| face[k] == a && face[(k + 1) % 3] == b).map(|k| face[(k + 2) % 3])
}

/// Returns the neighbors of a vertex in order around it; `None` if it is at a border or has fewer than four.
fn ring(faces: &[[u32; 3]], vertex: u32) -> Option<Vec<u32>> {
    fn next(at: u32, vertex: u32, faces: &[[u32; 3]]) -> Option<u32> {
        faces.iter().find_map(|&face| side(face, vertex, at))
    }
    let first = faces
        .iter()
        .find_map(|face| (0..3).find(|&k| face[k] == vertex).map(|k| face[(k + 1) % 3]))?;
    let mut ring = vec![first];
    loop {
        match next(*ring.last()?, vertex, faces)? {
            vertex if vertex == first => break,
            vertex => ring.push(vertex),
        }
    }
    (ring.len() >= 4).then_some(ring)
}

/// The heights that tests use, as fractions of an edge.
pub(crate) const HEIGHTS: [f64; 5] = [0.0, 1e-16, 1e-12, 1e-7, 1e-5];
