//! Tests of orientation.

use maquette_value::{CaptureFrame, Faces};
use nalgebra::Point3;

use super::*;

fn mesh(positions: Vec<[f64; 3]>, faces: Vec<[u32; 3]>) -> Mesh {
    let positions = positions.into_iter().map(Point3::from).collect::<Vec<_>>();
    Mesh::new(positions, Faces::triangles(faces)).unwrap()
}

/// Returns a tetrahedron at a position, with faces that look outward.
fn tetrahedron(at: f64, size: f64) -> Mesh {
    let (low, high) = (at, at + size);
    mesh(
        vec![[low, low, low], [high, low, low], [low, high, low], [low, low, high]],
        vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]],
    )
}

/// Returns one mesh that consists of several meshes.
fn concatenate(parts: &[Mesh]) -> Mesh {
    crate::merge(&Vec::from_iter(parts), crate::Poses::Ignore).unwrap()
}

fn flip(mesh: &Mesh, faces: &[usize]) -> Mesh {
    let flags: Vec<_> = (0..mesh.faces().len()).map(|face| faces.contains(&face)).collect();
    flip_faces(mesh, &flags).unwrap()
}

/// Returns a height field of triangles over the square from -1 to 1 along x and y.
fn net(height: impl Fn(f64, f64) -> f64) -> Mesh {
    let side = 9;
    fn coordinate(k: u32, side: u32) -> f64 {
        f64::from(k) / f64::from(side - 1) * 2.0 - 1.0
    }
    let places = (0..side * side).map(|k| [coordinate(k % side, side), coordinate(k / side, side)]);
    let positions = places.map(|[x, y]| [x, y, height(x, y)]).collect();
    let cells = (0..side * (side - 1)).filter(|k| k % side < side - 1);
    let faces = cells.flat_map(|k| [[k, k + 1, k + side + 1], [k, k + side + 1, k + side]]);
    mesh(positions, faces.collect())
}

fn with_frame(mesh: Mesh) -> Mesh {
    let frame =
        CaptureFrame { camera: None, picture: [2, 2], depth: 700.0, world_from_camera: None };
    mesh.with_frame(Some(frame))
}

#[track_caller]
fn check(start: &Mesh, outside: Outside, expected: &Mesh) {
    let found = orient(start, outside).unwrap();
    assert_eq!(found.mesh.faces(), expected.faces());
}

#[test]
fn whatever_faces_of_a_closed_part_look_inward_all_look_outward() {
    let right = tetrahedron(5.0, 1.0);
    for wrong in 0..16 {
        let wrong: Vec<_> = (0..4).filter(|face| wrong >> face & 1 == 1).collect();
        let found = orient(&flip(&right, &wrong), Outside::Outward).unwrap();
        let seen = found.mesh.faces().iter().map(|face| found.mesh.area_vector(face));
        let wanted: Vec<_> = right.faces().iter().map(|face| right.area_vector(face)).collect();
        seen.zip(&wanted).for_each(|(seen, wanted)| assert!((seen - wanted).norm() < 1e-12));
        assert_eq!((found.undecided, found.crowded), (0, None));
    }
}

#[test]
fn a_closed_part_within_another_is_a_cavity_and_one_within_that_is_solid() {
    let [outer, middle, inner] =
        [tetrahedron(0.0, 8.0), tetrahedron(0.5, 4.0), tetrahedron(0.75, 2.0)];
    let hollow = flip(&middle, &[0, 1, 2, 3]);
    let right = concatenate(&[outer.clone(), hollow, inner.clone()]);
    check(&concatenate(&[outer, middle, inner]), Outside::Outward, &right);
    check(&right, Outside::Outward, &right);
}

#[test]
fn an_open_part_faces_its_convex_side() {
    let dome = net(|x, y| 1.0 - 0.4 * (x * x + y * y));
    let all = Vec::from_iter(0..dome.faces().len());
    check(&dome, Outside::Outward, &dome);
    check(&flip(&dome, &all), Outside::Outward, &dome);
    let bowl = net(|x, y| 0.4 * (x * x + y * y));
    check(&bowl, Outside::Outward, &flip(&bowl, &all));
    check(&flip(&dome, &all[..50]), Outside::Outward, &dome);
}

#[test]
fn a_flat_part_stays_and_is_counted() {
    let flat = net(|_, _| 3.0);
    for start in [flat.clone(), flip(&flat, &Vec::from_iter(0..flat.faces().len()))] {
        let found = orient(&start, Outside::Outward).unwrap();
        assert_eq!((found.mesh.faces(), found.undecided), (start.faces(), 1));
    }
    let one = mesh(vec![[0.; 3], [1., 0., 0.], [0., 1., 0.]], vec![[0, 1, 2]]);
    assert_eq!(orient(&one, Outside::Outward).unwrap().undecided, 1);
}

#[test]
fn the_sensor_sees_the_outside_of_open_parts() {
    let seen = with_frame(net(|x, _| -5.0 + 0.2 * x * x));
    let all = Vec::from_iter(0..seen.faces().len());
    check(&flip(&seen, &all[..100]), Outside::Sensor, &seen);
    let error = orient(&net(|_, _| 0.0), Outside::Sensor).err().unwrap();
    assert_eq!(
        error.to_string(),
        "the mesh is not from a capture, so its sensor is unknown: use `outside: Outward`"
    );
    let closed = with_frame(tetrahedron(5.0, 1.0));
    check(&flip(&closed, &[0, 1, 2, 3]), Outside::Sensor, &closed);
}

#[test]
fn others_look_as_the_largest_part_does() {
    let (large, small) = (tetrahedron(0.0, 4.0), tetrahedron(9.0, 1.0));
    let all = [0, 1, 2, 3];
    let inward = [flip(&small, &all), flip(&large, &all)];
    check(
        &concatenate(&[small.clone(), flip(&large, &all)]),
        Outside::LargestPart,
        &concatenate(&inward),
    );
    let outward = concatenate(&[small.clone(), large.clone()]);
    check(&concatenate(&[flip(&small, &all), large]), Outside::LargestPart, &outward);
    let (flat, all) = (net(|_, _| 0.0), (0..128).collect::<Vec<_>>());
    fn with_flat(second: Mesh, flat: &Mesh) -> Mesh {
        concatenate(&[flat.clone(), second])
    }
    check(
        &with_flat(flip(&net(|_, _| 1.0), &all), &flat),
        Outside::LargestPart,
        &with_flat(net(|_, _| 1.0), &flat),
    );
}

#[test]
fn flipping_twice_changes_nothing() {
    let bowl = net(|x, y| x * y);
    let once = orient(&bowl, Outside::Flip).unwrap().mesh;
    assert_eq!(once.faces().face(0), [0, 10, 1]);
    assert_eq!(orient(&once, Outside::Flip).unwrap().mesh, bowl);
}

#[test]
fn normals_turn_with_their_faces() {
    let right = tetrahedron(0.0, 1.0);
    fn with_normals(mesh: &Mesh) -> Mesh {
        let normals = mesh.vertex_normals().into_iter().map(Into::into).collect();
        let corners = mesh.faces().iter().flat_map(|face| vec![mesh.area_vector(face).into(); 3]);
        let corners = corners.collect();
        let mesh = mesh.clone().with_vertex("normal", Attribute::Vector(normals)).unwrap();
        mesh.with_corner("normal", Attribute::Vector(corners)).unwrap()
    }
    let wanted = with_normals(&right);
    for wrong in [&[0][..], &[0, 1, 2, 3]] {
        let found = orient(&with_normals(&flip(&right, wrong)), Outside::Outward).unwrap().mesh;
        fn is_close(a: &[[f64; 3]], b: &[[f64; 3]]) -> bool {
            let mut pairs = a.iter().zip(b);
            pairs.all(|(a, b)| (Vector3::from(*a) - Vector3::from(*b)).norm() < 1e-12)
        }
        let vectors = [&wanted, &found].map(|mesh| mesh.vertex().vectors("normal").unwrap());
        assert!(is_close(vectors[0], vectors[1]), "{wrong:?}");
        let vectors = [&wanted, &found].map(|mesh| mesh.corner().vectors("normal").unwrap());
        assert!(is_close(vectors[0], vectors[1]), "{wrong:?}");
    }
}

#[test]
fn a_moebius_strip_is_refused_with_its_numbers() {
    let count = 12;
    let positions = (0..2 * count).map(|k| {
        let angle = f64::from(k / 2) / f64::from(count) * std::f64::consts::TAU;
        let aside = f64::from(k % 2) * 2.0 - 1.0;
        let out = 5.0 + aside * libm::cos(angle / 2.0);
        [out * libm::cos(angle), out * libm::sin(angle), aside * libm::sin(angle / 2.0)]
    });
    let faces = (0..count).flat_map(|k| {
        let [a, b] = [2 * k, 2 * k + 1];
        let [c, d] = if k + 1 < count { [a + 2, b + 2] } else { [1, 0] };
        [[a, c, b], [b, c, d]]
    });
    let strip = mesh(positions.collect(), faces.collect());
    let error = orient(&strip, Outside::Outward).err().unwrap().to_string();
    assert!(
        error.starts_with("a part of 24 faces has only one side, as a Moebius strip has: at 1 of its edges faces cannot agree, at "),
        "{error}"
    );
    assert!(orient(&strip, Outside::Flip).is_ok());
}

#[test]
fn an_edge_of_three_faces_joins_no_parts_and_is_reported() {
    let fan = mesh(
        vec![[0.; 3], [0., 0., 1.], [1., 0., 0.], [0., 1., 0.], [-1., -1., 0.]],
        vec![[0, 1, 2], [0, 1, 3], [0, 1, 4]],
    );
    let found = orient(&fan, Outside::Outward).unwrap();
    assert_eq!((found.undecided, found.crowded), (3, Some((1, [0, 1]))));
    assert_eq!(found.mesh.faces(), fan.faces());
}

#[test]
fn a_mesh_without_faces_and_one_without_area_stay() {
    let empty = mesh(vec![[0.; 3]], vec![]);
    assert_eq!(orient(&empty, Outside::Outward).unwrap().mesh, empty);
    let line = mesh(vec![[0.; 3], [1., 0., 0.], [2., 0., 0.]], vec![[0, 1, 2]]);
    let found = orient(&line, Outside::LargestPart).unwrap();
    assert_eq!(found.mesh, line);
    assert_eq!(orient(&line, Outside::Outward).unwrap().undecided, 1);
}
