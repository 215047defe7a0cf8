//! Tests of self-intersections.

use std::convert::Infallible;

use nalgebra::{Rotation3, Unit, Vector3};

use super::*;
use crate::Faces;
use crate::rng::Random;

fn crossings(positions: Vec<Point3<f64>>, faces: &[[u32; 3]]) -> Vec<[u32; 2]> {
    let mesh = Mesh::new(positions, Faces::triangles(faces.to_vec())).unwrap();
    mesh.crossings(|| Ok::<_, Infallible>(())).unwrap()
}

#[test]
fn crossing_triangles_are_found_and_neighbors_are_not() {
    let flat = [
        Point3::new(0., 0., 0.),
        Point3::new(4., 0., 0.),
        Point3::new(0., 4., 0.),
        Point3::new(4., 4., 0.),
    ];
    let spike = [Point3::new(1., 1., -1.), Point3::new(1., 1.2, 1.), Point3::new(1.3, 1., 1.)];
    let faces = [[0, 1, 2], [1, 3, 2], [4, 5, 6]];
    fn corners_at(
        height: f64,
        spike: [Point3<f64>; 3],
        flat: [Point3<f64>; 4],
    ) -> Vec<Point3<f64>> {
        let moved = spike.map(|p| p + Vector3::z() * height);
        flat.into_iter().chain(moved).collect()
    }
    assert_eq!(crossings(corners_at(0.0, spike, flat), &faces), [[0, 2]]);
    assert!(crossings(corners_at(2.0, spike, flat), &faces).is_empty());
    // The tip of the spike only touches the other triangle.
    assert!(crossings(corners_at(1.0, spike, flat), &faces).is_empty());
}

#[test]
fn faces_with_a_vertex_in_common_may_cross() {
    let positions = vec![
        Point3::new(0., 0., 0.),
        Point3::new(4., 0., 0.),
        Point3::new(0., 4., 0.),
        Point3::new(2., 1., -1.),
        Point3::new(1., 2., 1.),
    ];
    assert_eq!(crossings(positions, &[[0, 1, 2], [0, 3, 4]]), [[0, 1]]);
}

/// Reference implementation for vertices of a small lattice: returns true if the interiors of two triangles in different planes have a line
/// in common. All numbers are fractions of small integers.
fn have_common_line(mesh: &Mesh, a: Corners, b: Corners) -> bool {
    fn at(mesh: &Mesh, vertex: u32) -> Vector3<i64> {
        mesh.positions()[vertex as usize].coords.map(|x| x as i64)
    }
    let [first, second] = [a, b].map(|it| it.map(|vertex| at(mesh, vertex)));
    fn normal([a, b, c]: [Vector3<i64>; 3]) -> Vector3<i64> {
        (b - a).cross(&(c - a))
    }
    let line = normal(first).cross(&normal(second));
    // The interval of the common line inside of a triangle, as two fractions (numerator, positive denominator).
    fn interval(
        own: [Vector3<i64>; 3],
        other: [Vector3<i64>; 3],
        line: &nalgebra::Matrix<
            i64,
            nalgebra::Const<3>,
            nalgebra::Const<1>,
            nalgebra::ArrayStorage<i64, 3, 1>,
        >,
    ) -> Option<[(i64, i64); 2]> {
        let heights = own.map(|it| normal(other).dot(&(it - other[0])));
        let is_crossed = heights.iter().any(|it| *it < 0) && heights.iter().any(|it| 0 < *it);
        let mut ends: Vec<(i64, i64)> = Vec::new();
        for k in 0..3 {
            let next = (k + 1) % 3;
            let (low, high) = (heights[k], heights[next]);
            if low == 0 {
                ends.push((line.dot(&own[k]), 1));
            } else if (low < 0) != (high < 0) && high != 0 {
                let sign = (high - low).signum();
                let along = line.dot(&own[k]) * high - line.dot(&own[next]) * low;
                ends.push((sign * along, sign * (high - low)));
            }
        }
        ends.sort_by(|p, q| (p.0 * q.1).cmp(&(q.0 * p.1)));
        is_crossed.then(|| [ends[0], ends[ends.len() - 1]])
    }
    fn is_less(p: (i64, i64), q: (i64, i64)) -> bool {
        p.0 * q.1 < q.0 * p.1
    }
    interval(first, second, &line).zip(interval(second, first, &line)).is_some_and(
        |([i, j], [k, l])| is_less(i, l) && is_less(k, j) && is_less(i, j) && is_less(k, l),
    )
}

#[test]
fn triangles_of_a_lattice_cross_where_their_interiors_have_a_common_line() {
    // Many of the random triangles are coplanar, touch, or have no area.
    let positions = (0..27).map(|k| [k % 3, k / 3 % 3, k / 9].map(f64::from));
    let positions: Vec<_> = positions.map(Point3::from).collect();
    let mesh = Mesh::new(positions, Faces::triangles(Vec::new())).unwrap();
    let triangles =
        (0..27 * 27 * 27).step_by(61).map(|k| [k % 27, k / 27 % 27, k / 729]).collect::<Vec<_>>();
    let has_area = |it: &&[u32; 3]| {
        let [a, b, c] = it.map(|vertex| mesh.positions()[vertex as usize]);
        (b - a).cross(&(c - a)).norm() > 0.0
    };
    let predicates = Predicates { mesh: &mesh, tolerance: 1e-12, clear: 1e-11 };
    let mut found = 0;
    for &a in triangles.iter().filter(has_area) {
        for &b in triangles.iter().filter(has_area) {
            let is_neighbor = 2 <= a.iter().filter(|corner| b.contains(corner)).count();
            let wanted = !is_neighbor && have_common_line(&mesh, a, b);
            assert_eq!(predicates.meet(a, b) == Meeting::Cross, wanted, "{a:?} {b:?}");
            found += usize::from(wanted);
        }
    }
    assert!(1000 < found, "{found}");
}

#[test]
fn a_triangle_without_area_crosses_what_its_edge_pierces() {
    let positions =
        [[0., 0., 0.], [4., 0., 0.], [0., 4., 0.], [1., 1., -1.], [1., 1., 0.5], [1., 1., 2.]];
    assert_eq!(crossings(positions.map(Point3::from).to_vec(), &[[0, 1, 2], [3, 4, 5]]), [[0, 1]]);
}

type Solid = (Vec<Vector3<f64>>, Vec<[u32; 3]>);

/// A tetrahedron with corners of a lattice, oriented outward; `None` if it is flat.
fn tetrahedron(random: &mut Random) -> Option<Solid> {
    let mut corners = Vec::from_iter(
        (0..4).map(|_| Vector3::from([(); 3].map(|()| (random.even() * 4.0).floor()))),
    );
    let volume =
        (corners[1] - corners[0]).cross(&(corners[2] - corners[0])).dot(&(corners[3] - corners[0]));
    if volume < 0.0 {
        corners.swap(0, 1);
    }
    let faces = vec![[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]];
    (volume != 0.0).then_some((corners, faces))
}

/// A box with corners of a lattice, whose faces are divided along random diagonals.
fn cuboid(random: &mut Random) -> Option<Solid> {
    fn number(random: &mut Random) -> f64 {
        (random.even() * 4.0).floor()
    }
    let low = Vector3::new(number(random), number(random), number(random));
    let size = Vector3::new(1.0 + number(random), 1.0 + number(random), 1.0 + number(random));
    let corners = (0..8).map(|k: usize| {
        low + Vector3::from([0, 1, 2].map(|axis| size[axis] * (k >> axis & 1) as f64))
    });
    let corners = Vec::from_iter(corners);
    let sides =
        [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let faces = sides.iter().flat_map(|&[a, b, c, d]| match number(random) < 2.0 {
        true => [[a, b, c], [a, c, d]],
        false => [[a, b, d], [b, c, d]],
    });
    Some((corners, faces.collect()))
}

/// Compares two convex solids. Returns `None` if they are apart, else true if their surfaces cross: their interiors overlap, and neither
/// contains the other.
fn do_surfaces_cross(a: &Solid, b: &Solid) -> Option<bool> {
    fn edges((corners, faces): &Solid) -> Vec<Vector3<f64>> {
        let edges = faces.iter().flat_map(|face| edges_of(*face));
        edges.map(|[p, q]| corners[q as usize] - corners[p as usize]).collect()
    }
    fn normals((corners, faces): &Solid) -> Vec<Vector3<f64>> {
        fn corner(vertex: u32, corners: &[Vector3<f64>]) -> Vector3<f64> {
            corners[vertex as usize]
        }
        faces
            .iter()
            .map(|&[a, b, c]| {
                (corner(b, corners) - corner(a, corners))
                    .cross(&(corner(c, corners) - corner(a, corners)))
            })
            .collect()
    }
    let mut axes = [normals(a), normals(b)].concat();
    axes.extend(edges(a).iter().flat_map(|p| edges(b).into_iter().map(move |q| p.cross(&q))));
    fn range(axis: &Vector3<f64>, (corners, _): &Solid) -> [f64; 2] {
        let along = corners.iter().map(|it| axis.dot(it));
        [along.clone().fold(f64::INFINITY, f64::min), along.fold(f64::NEG_INFINITY, f64::max)]
    }
    let gaps = axes.iter().filter(|axis| axis.norm() > 0.0).map(|axis| {
        let [[a, b], [c, d]] = [range(axis, a), range(axis, b)];
        f64::max(c - b, a - d)
    });
    let gap = gaps.fold(f64::NEG_INFINITY, f64::max);
    fn contains(outer: &Solid, inner: &Solid) -> bool {
        outer.1.iter().zip(normals(outer)).all(|(face, normal)| {
            inner.0.iter().all(|it| normal.dot(&(it - outer.0[face[0] as usize])) <= 0.0)
        })
    }
    match gap {
        _ if 0.0 < gap => None,
        _ if gap == 0.0 || contains(a, b) || contains(b, a) => Some(false),
        _ => Some(true),
    }
}

/// The matrix of a rotation times the squared length of its quaternion, all integers, so that lattice points are moved without rounding.
fn rotate(at: &Vector3<f64>, [w, x, y, z]: [f64; 4]) -> Point3<f64> {
    let axis = Vector3::new(x, y, z);
    let moved =
        at * (w * w - axis.dot(&axis)) + axis * (2.0 * axis.dot(at)) + axis.cross(at) * (2.0 * w);
    Point3::from(moved)
}

/// A random rotation with a scale, that moves lattice points without rounding.
fn exact_rotation(random: &mut Random) -> impl Fn(&Vector3<f64>) -> Point3<f64> + use<> {
    let mut quaternion = [0.0; 4];
    while quaternion == [0.0; 4] {
        quaternion = [(); 4].map(|()| (random.even() * 7.0).floor() - 3.0);
    }
    move |at| rotate(at, quaternion)
}

/// A random rotation, whose results are rounded.
fn rotation(random: &mut Random) -> impl Fn(&Vector3<f64>) -> Point3<f64> + use<> {
    let [x, y, z, angle] = [(); 4].map(|()| random.even() * 2.0 - 1.0);
    let axis = Unit::new_normalize(Vector3::new(x, y, z + 1e-3));
    let turn = Rotation3::from_axis_angle(&axis, 3.0 * angle);
    move |at| Point3::from(turn * (at * (0.37 + x * x)) + Vector3::new(y, angle, x))
}

/// Moves two solids, and renumbers their vertices and faces at random. Returns the pairs of crossing faces, with their old numbers.
fn crossings_after_motion(
    solids: [&Solid; 2],
    motion: impl Fn(&Vector3<f64>) -> Point3<f64>,
    random: &mut Random,
) -> Vec<[u32; 2]> {
    fn below(limit: usize, random: &mut Random) -> usize {
        (random.even() * limit as f64) as usize
    }
    let mut shuffle = |count: usize| {
        let mut order = Vec::from_iter(0..count);
        (1..count).for_each(|k| order.swap(k, below(k + 1, random)));
        order
    };
    let first = solids[0].0.len();
    let corners: Vec<_> = solids.iter().flat_map(|it| &it.0).map(&motion).collect();
    let faces: Vec<[u32; 3]> = solids[0]
        .1
        .iter()
        .copied()
        .chain(solids[1].1.iter().map(|it| it.map(|vertex| vertex + first as u32)))
        .collect();
    let (vertex_order, face_order) = (shuffle(corners.len()), shuffle(faces.len()));
    let mut places = vec![0; corners.len()];
    (0..).zip(&vertex_order).for_each(|(place, &vertex)| places[vertex] = place);
    let positions = vertex_order.iter().map(|&vertex| corners[vertex]).collect();
    let moved: Vec<_> = face_order
        .iter()
        .map(|&face| {
            let [a, b, c] = faces[face].map(|vertex| places[vertex as usize]);
            [[a, b, c], [b, c, a], [c, a, b]][face % 3]
        })
        .collect();
    let pairs = crossings(positions, &moved).into_iter();
    let mut pairs: Vec<_> = pairs
        .map(|pair| {
            let [a, b] = pair.map(|face| face_order[face as usize] as u32);
            [a.min(b), a.max(b)]
        })
        .collect();
    pairs.sort_unstable();
    pairs
}

#[test]
fn exact_contacts_get_one_verdict_in_all_positions_and_numberings() {
    let mut random = Random(11);
    let (mut crossing, mut touching) = (0, 0);
    while crossing + touching < 240 {
        let kinds = [tetrahedron, cuboid];
        let mut solid = || kinds[usize::from(random.even() < 0.5)](&mut random);
        let (Some(a), Some(b)) = (solid(), solid()) else { continue };
        let Some(wanted) = do_surfaces_cross(&a, &b) else { continue };
        if *(if wanted { &crossing } else { &touching }) == 120 {
            continue;
        }
        *(if wanted { &mut crossing } else { &mut touching }) += 1;
        let motion = exact_rotation(&mut random);
        let first = crossings_after_motion([&a, &b], motion, &mut random);
        assert_eq!(!first.is_empty(), wanted, "{a:?} {b:?}");
        for _ in 0..10 {
            let motion = exact_rotation(&mut random);
            let found = crossings_after_motion([&a, &b], motion, &mut random);
            assert_eq!(found, first, "{a:?} {b:?}");
            let motion = rotation(&mut random);
            let found = crossings_after_motion([&a, &b], motion, &mut random);
            assert_eq!(found, first, "{a:?} {b:?}");
        }
    }
}

#[test]
fn boxes_of_equal_height_that_overlap_cross_and_those_side_by_side_touch() {
    fn boxes(shift: f64) -> Vec<[u32; 2]> {
        let (corners, faces) = cuboid(&mut Random(5)).unwrap();
        let size = corners[7] - corners[0];
        let moved = corners.iter().map(|it| it + Vector3::x() * (shift * size.x));
        let positions = corners.iter().copied().chain(moved).map(Point3::from).collect();
        let other = faces.iter().map(|it| it.map(|vertex| vertex + 8));
        crossings(positions, &faces.iter().copied().chain(other).collect::<Vec<_>>())
    }
    assert!(!boxes(0.5).is_empty());
    assert!(boxes(1.0).is_empty());
    assert!(boxes(0.0).is_empty());
}
