use maquette_value::{Attribute, Faces, Mesh, Topology};
use nalgebra::{Point3, Vector3};

use super::*;

fn mesh(points: Vec<Point3<f64>>, faces: Vec<[u32; 3]>) -> Mesh {
    Mesh::new(points, Faces::triangles(faces)).unwrap()
}

/// Returns an octahedron with its tips `radius` mm from `center`.
fn octahedron(center: [f64; 3], radius: f64) -> Mesh {
    let axes =
        [Vector3::x(), -Vector3::x(), Vector3::y(), -Vector3::y(), Vector3::z(), -Vector3::z()];
    let points = axes.map(|axis| Point3::from(center) + axis * radius).to_vec();
    let quarters = [[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4]];
    mesh(points, quarters.into_iter().flat_map(|[x, y, z]| [[x, y, z], [y, x, 5]]).collect())
}

/// Returns a box whose corners are `low` and `high`.
fn cuboid(low: [f64; 3], high: [f64; 3]) -> Mesh {
    let points = (0..8).map(|k: usize| {
        Point3::from(std::array::from_fn(
            |axis| if k >> axis & 1 == 0 { low[axis] } else { high[axis] },
        ))
    });
    let quads: [[u32; 4]; 6] =
        [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    Mesh::new(points.collect::<Vec<_>>(), Faces::uniform(4, quads.concat()).unwrap()).unwrap()
}

/// Returns the faces of some meshes, each with vertices of its own, moved by up to `jitter` mm.
fn soup(meshes: &[Mesh], jitter: f64) -> Mesh {
    let (mut points, mut sides) = (Vec::new(), Vec::new());
    for mesh in meshes {
        for face in mesh.faces().iter() {
            sides.push(face.len());
            for &vertex in face {
                let shift = [0, 1, 2].map(|k| 2.0 * random(3 * points.len() as u64 + k) - 1.0);
                points.push(mesh.positions()[vertex as usize] + Vector3::from(shift) * jitter);
            }
        }
    }
    let corners = (0..points.len() as u32).collect();
    Mesh::new(points, Faces::polygons(&sides, corners).unwrap()).unwrap()
}

/// Returns a pseudorandom number from 0 to 1.
fn random(seed: u64) -> f64 {
    let mut x = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15);
    x = (x ^ (x >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    x = (x ^ (x >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    ((x ^ (x >> 31)) >> 11) as f64 / (1u64 << 53) as f64
}

/// Welds a mesh, checks that welding again changes nothing, and returns the counts.
fn check(mesh: &Mesh, within: f64) -> Topology {
    let welded = weld(mesh, within).unwrap().mesh;
    assert_eq!(weld(&welded, within).unwrap().mesh, welded);
    Topology::from_mesh(&welded)
}

#[test]
fn separate_faces_become_closed_solids() {
    let ball = octahedron([0.0; 3], 2.0);
    for (jitter, within) in [(0.0, 0.0), (0.0, 0.01), (1e-3, 0.01)] {
        let counts = check(&soup(std::slice::from_ref(&ball), jitter), within);
        assert_eq!((counts.vertices, counts.boundary, counts.euler()), (6, 0, 2), "{jitter}");
    }
    let counts = check(&soup(&[cuboid([0.0; 3], [1.0; 3])], 0.0), 0.0);
    assert_eq!((counts.vertices, counts.boundary, counts.misoriented), (8, 0, 0));
}

#[test]
fn solids_that_touch_stay_apart() {
    // In a vertex, along an edge, and at a whole face.
    let vertex = [octahedron([0.0; 3], 1.0), octahedron([2.0, 0.0, 0.0], 1.0)];
    let edge = [cuboid([0.0; 3], [1.0; 3]), cuboid([1.0, 1.0, 0.0], [2.0, 2.0, 1.0])];
    let face = [cuboid([0.0; 3], [1.0; 3]), cuboid([1.0, 0.0, 0.0], [2.0, 1.0, 1.0])];
    for solids in [vertex, edge, face] {
        let counts = check(&soup(&solids, 0.0), 0.0);
        assert_eq!((counts.components, counts.boundary, counts.non_manifold), (2, 0, 0));
        assert_eq!(counts.euler(), 4);
    }
}

#[test]
fn a_closed_mesh_does_not_change() {
    let pair = soup(&[octahedron([0.0; 3], 1.0)], 0.0);
    let ball = weld(&pair, 0.0).unwrap().mesh;
    assert_eq!(weld(&ball, 0.1).unwrap().mesh, ball);
    // A waist of two cones that touch in one vertex.
    assert_eq!(weld(&octahedron([0.0; 3], 1.0), 0.0).unwrap().vertices, [0, 1, 2, 3, 4, 5]);
}

#[test]
fn equal_faces_are_left_out() {
    let ball = octahedron([0.0; 3], 1.0);
    let twice = soup(&[ball.clone(), ball], 0.0);
    let welded = weld(&twice, 0.0).unwrap();
    assert_eq!((welded.equal_faces, welded.mesh.faces().len()), (8, 8));
    let [a, b, c] = [[0., 0., 0.], [1., 0., 0.], [0., 1., 0.]].map(Point3::from);
    let shared = mesh(vec![a, b, c], vec![[0, 1, 2], [1, 2, 0], [2, 1, 0]]);
    // Without one of them the edges keep two faces.
    assert_eq!(weld(&shared, 0.0).unwrap().mesh.faces().len(), 2);
}

#[test]
fn corners_of_a_face_are_not_joined() {
    // The edges are shorter than the distance within which vertices are joined.
    let ball = octahedron([0.0; 3], 0.01);
    let counts = check(&soup(&[ball], 0.0), 0.05);
    assert_eq!(counts.faces, 8);
    let flat = mesh(vec![Point3::origin(); 3], vec![[0, 1, 2]]);
    assert_eq!(weld(&flat, 0.0).unwrap().mesh, flat);
}

#[test]
fn opposite_faces_are_joined_if_their_positions_are_equal() {
    let square =
        [[0., 0., 0.], [1., 0., 0.], [1., 1., 0.], [0., 0., 0.], [1., 1., 0.], [0., 1., 0.]];
    let square = square.map(Point3::from).to_vec();
    let counts = check(&mesh(square, vec![[0, 1, 2], [3, 5, 4]]), 0.0);
    assert_eq!((counts.vertices, counts.misoriented), (4, 1));
}

#[test]
fn attributes_that_differ_move_to_corners() {
    let ball = octahedron([0.0; 3], 1.0);
    let soup = soup(&[ball], 0.0);
    let uv = (0..24).map(|k| [f64::from(k), 0.0]).collect();
    let height = soup.positions().iter().map(|point| point.z).collect();
    let soup = soup.with_vertex("uv", Attribute::Pair(uv)).unwrap();
    let soup = soup.with_vertex("height", Attribute::Number(height)).unwrap();
    let soup = soup.with_creases([([0, 1], 2.0), ([4, 3], 3.0)]).unwrap();
    let welded = weld(&soup, 0.0).unwrap().mesh;
    assert_eq!(welded.corner().get("uv"), soup.vertex().get("uv"));
    assert!(welded.vertex().get("uv").is_none());
    assert_eq!(welded.vertex().get("height").map(Attribute::len), Some(6));
    // Both creases are on one edge.
    assert_eq!(welded.creases().collect::<Vec<_>>(), [([0, 1], 3.0)]);
}

#[test]
fn vertices_without_faces_join_each_other_and_borders() {
    let points =
        [[0., 0., 0.], [1., 0., 0.], [0., 1., 0.], [5., 5., 5.], [5., 5., 5.], [1., 0., 0.]];
    let loose = mesh(points.map(Point3::from).to_vec(), vec![[0, 1, 2]]);
    let welded = weld(&loose, 0.0).unwrap();
    assert_eq!(welded.vertices, [0, 1, 2, 3, 3, 1]);
}

/// Random soups of solids with jitter, holes and turned faces.
#[test]
fn welding_twice_is_welding_once() {
    for seed in 0..60 {
        fn number(k: u64, seed: u64) -> f64 {
            random(1000 * seed + k)
        }
        let solids: Vec<Mesh> = (0..2 + seed % 3)
            .map(|k| match k % 2 {
                0 => octahedron([number(k, seed).round(), number(k + 9, seed).round(), 0.0], 1.0),
                _ => cuboid([number(k + 5, seed).round(), 0.0, 0.0], [2.0, 1.0, 1.0]),
            })
            .collect();
        let jitter = [0.0, 1e-3, 0.02][seed as usize % 3];
        let all = soup(&solids, jitter);
        let kept: Vec<u32> = (0..all.faces().len() as u32)
            .filter(|&face| number(100 + u64::from(face), seed) > 0.1)
            .collect();
        let some = all.select(&kept);
        for within in [0.0, 0.01, 0.3, 1.5] {
            let counts = check(&some, within);
            assert_eq!(counts.non_manifold, 0, "{seed} {within}");
        }
    }
}
