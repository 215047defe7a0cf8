//! Tests of Boolean operations.

use maquette_value::{Attribute, CaptureFrame, Faces};
use nalgebra::{Point3, Rotation3, Vector3};

use super::*;

/// Returns a box of quads with its lowest corner at the given position.
pub(super) fn cuboid(low: [f64; 3], size: [f64; 3]) -> Mesh {
    let faces =
        [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let faces = Faces::uniform(4, faces.as_flattened().to_vec()).unwrap();
    Mesh::new(
        (0..8)
            .map(|k: usize| {
                Point3::from([0, 1, 2].map(|axis| low[axis] + size[axis] * (k >> axis & 1) as f64))
            })
            .collect::<Vec<_>>(),
        faces,
    )
    .unwrap()
}

fn cube(low: [f64; 3]) -> Mesh {
    cuboid(low, [10.0; 3])
}

/// Returns a sphere of triangles: an octahedron each of whose faces is divided into `steps` x `steps` triangles.
pub(super) fn ball(middle: [f64; 3], radius: f64, steps: u32) -> Mesh {
    fn octant(
        signs: u32,
        i: u32,
        j: u32,
        steps: u32,
        middle: [f64; 3],
        radius: f64,
    ) -> Point3<f64> {
        fn sign(axis: u32, signs: u32) -> f64 {
            if signs >> axis & 1 == 1 { -1.0 } else { 1.0 }
        }
        let k = steps - i - j;
        let at = Vector3::new(
            f64::from(i) * sign(0, signs),
            f64::from(j) * sign(1, signs),
            f64::from(k) * sign(2, signs),
        );
        Point3::from(Vector3::from(middle) + at.normalize() * radius)
    }
    let (mut places, mut corners) = (Vec::<Point3<f64>>::new(), Vec::new());
    fn number(at: Point3<f64>, places: &mut Vec<Point3<f64>>, radius: f64) -> u32 {
        let known = places.iter().position(|it| (it - at).norm() < 1e-9 * radius);
        known.unwrap_or_else(|| {
            places.push(at);
            places.len() - 1
        }) as u32
    }
    for signs in 0..8u32 {
        for i in 0..steps {
            for j in 0..steps - i {
                let lower = [(i, j), (i + 1, j), (i, j + 1)];
                let upper = [(i + 1, j), (i + 1, j + 1), (i, j + 1)];
                let both = [Some(lower), (i + j + 1 < steps).then_some(upper)];
                for triangle in both.into_iter().flatten() {
                    let mut own = triangle.map(|(i, j)| {
                        number(octant(signs, i, j, steps, middle, radius), &mut places, radius)
                    });
                    if signs.count_ones() % 2 == 1 {
                        own.reverse();
                    }
                    corners.push(own);
                }
            }
        }
    }
    Mesh::new(places, Faces::triangles(corners)).unwrap()
}

fn rotate(mesh: &Mesh, by: [f64; 3]) -> Mesh {
    let rotation = Rotation3::from_scaled_axis(Vector3::from(by));
    let places = mesh.positions().iter().map(|place| rotation * place);
    mesh.with_positions(places.collect()).unwrap()
}

pub(super) fn size(mesh: &Mesh) -> f64 {
    mesh.bounds().map_or(0.0, |(low, _)| volume(mesh, low))
}

/// Returns the volume and the mesh of the result of an operation. Checks that the result is a solid.
#[track_caller]
fn volume_and_mesh(first: &Mesh, second: &Mesh, how: Operation) -> (f64, Mesh) {
    let made = boolean(first, &[second], how, &Progress::silent());
    let made = made.unwrap_or_else(|why| {
        panic!(
            "{how:?}: {why}: {:?} {:?} {:?}",
            first.positions(),
            first.faces().corners(),
            second.bounds()
        )
    });
    let edges = made.edges();
    assert_eq!(edges.misoriented, 0);
    assert!(
        edges.faces.iter().all(|faces| *faces == 2),
        "{how:?} {:?} {:?} {:?} {:?}",
        first.bounds(),
        second.bounds(),
        made.positions(),
        made.faces().iter().collect::<Vec<_>>()
    );
    assert_eq!(
        made.flat_faces(),
        Vec::<u32>::new(),
        "{how:?} {:?} {:?}",
        first.bounds(),
        second.bounds()
    );
    (size(&made), made)
}

/// Checks the volume of the results of all three operations on two solids, in both orders; `common` is the expected volume of the
/// intersection.
#[track_caller]
fn check(first: &Mesh, second: &Mesh, common: f64) {
    use Operation::{Difference, Intersection, Union};
    let sizes = [first, second].map(size);
    let most = 1e-7 * (sizes[0] + sizes[1]);
    for ([a, b], own) in [([first, second], sizes[0]), ([second, first], sizes[1])] {
        for (how, wanted) in [
            (Union, sizes[0] + sizes[1] - common),
            (Difference, own - common),
            (Intersection, common),
        ] {
            let found = volume_and_mesh(a, b, how).0;
            assert!(
                (found - wanted).abs() <= most,
                "{how:?}: {found}, not {wanted}: {:?} {:?} {:?} {:?}",
                a.positions(),
                a.faces().iter().collect::<Vec<_>>(),
                b.positions(),
                b.faces().iter().collect::<Vec<_>>()
            );
        }
    }
}

#[test]
fn boxes_that_overlap() {
    check(&cube([0.; 3]), &cube([5., 6., 7.]), 5. * 4. * 3.);
    check(&cube([0.; 3]), &cuboid([2., 2., -5.], [3., 4., 20.]), 120.);
    check(&cube([0.; 3]), &cuboid([2., 3., 4.], [1., 2., 3.]), 6.);
    check(&cube([0.; 3]), &cube([20., 0., 0.]), 0.);
}

#[test]
fn boxes_with_coplanar_walls() {
    for (low, common) in [
        ([10., 0., 0.], 0.),
        ([10., 10., 0.], 0.),
        ([10., 10., 10.], 0.),
        ([5., 0., 0.], 500.),
        ([5., 5., 0.], 250.),
        ([0., 0., 0.], 1000.),
        ([10., 3., 4.], 0.),
        ([0., 3., 4.], 42. * 10.),
    ] {
        check(&cube([0.; 3]), &cube(low), common);
    }
    check(&cube([0.; 3]), &cuboid([2., 2., 5.], [3., 3., 5.]), 45.);
    check(&cube([0.; 3]), &cuboid([2., 2., 10.], [3., 3., 5.]), 0.);
    check(&cube([0.; 3]), &cuboid([0., 0., 5.], [10., 10., 5.]), 500.);
    // The diamond has one edge on the diagonal of a face of the box, and another edge that crosses edges of the box.
    let diamond = rotate(&cube([-5.; 3]), [0., 0., std::f64::consts::FRAC_PI_4]);
    check(&cube([-5.; 3]), &diamond, 10. * 200. * (2f64.sqrt() - 1.0) * 1.0);
}

#[test]
fn flush_boxes_leave_no_film_and_are_united() {
    let joined = volume_and_mesh(&cube([0.; 3]), &cube([10., 0., 0.]), Operation::Union).1;
    assert_eq!(joined.bounds(), Some((Point3::origin(), Point3::new(20., 10., 10.))));
    let least =
        joined.faces().iter().map(|face| joined.area_vector(face).norm()).fold(99., f64::min);
    assert!(least > 1.0, "{least}");
    assert_eq!((joined.positions().len(), joined.faces().len()), (12, 14));
    let slot = cuboid([2., 2., 5.], [3., 3., 5.]);
    let open = volume_and_mesh(&cube([0.; 3]), &slot, Operation::Difference).1;
    assert_eq!(
        (open.positions().len(), open.edges().faces.len()),
        (16, 16 + open.faces().len() - 2)
    );
}

#[test]
fn balls_of_many_sizes_and_places() {
    let first = ball([0.; 3], 10.0, 12);
    for (k, middle) in
        [[9., 2., 1.], [0.001, 0., 0.], [0., 0., 0.], [19.9, 0., 0.], [30., 0., 0.], [0., 0., 10.]]
            .into_iter()
            .enumerate()
    {
        for radius in [10.0, 4.0, 9.99] {
            let second = ball(middle, radius, 9 + k as u32);
            let common = volume_and_mesh(&first, &second, Operation::Intersection).0;
            assert!(common >= -1e-9 && common <= size(&second).min(size(&first)) * 1.0000001);
            check(&first, &second, common);
        }
    }
}

#[test]
fn random_solids_that_share_corners_of_a_coarse_grid() {
    // All coordinates are integers, so nearly all pairs of boxes have coincident edges and coplanar faces.
    let mut state = 7u32;
    fn next(below: u32, state: &mut u32) -> f64 {
        *state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        f64::from((*state >> 16) % below)
    }
    // Returns the expected surface area of the result of an operation, counted on unit cells.
    fn skin(boxes: [([f64; 3], [f64; 3]); 2], how: Operation) -> f64 {
        fn is_in(at: [f64; 3], boxes: &[([f64; 3], [f64; 3]); 2], how: &Operation) -> bool {
            let [a, b] = boxes
                .map(|(low, size)| (0..3).all(|k| low[k] <= at[k] && at[k] < low[k] + size[k]));
            match *how {
                Operation::Union => a || b,
                Operation::Difference => a && !b,
                Operation::Intersection => a && b,
            }
        }
        let cells = (0..512).map(|k| [k % 8, k / 8 % 8, k / 64].map(|k| f64::from(k) - 0.5));
        let sides = cells.flat_map(|cell| [0, 1, 2].map(|axis| (cell, axis)));
        let between = sides.filter(|&(cell, axis)| {
            let mut other = cell;
            other[axis] += 1.0;
            is_in(cell, &boxes, &how) != is_in(other, &boxes, &how)
        });
        between.count() as f64
    }
    for _ in 0..300 {
        fn solid(state: &mut u32) -> (Mesh, [f64; 3], [f64; 3]) {
            let low = [next(4, state), next(4, state), next(4, state)];
            let size = [1.0 + next(3, state), 1.0 + next(3, state), 1.0 + next(3, state)];
            (cuboid(low, size), low, size)
        }
        let [(a, low, size_a), (b, other, size_b)] = [solid(&mut state), solid(&mut state)];
        let common = [0, 1, 2].map(|k| {
            let high = (low[k] + size_a[k]).min(other[k] + size_b[k]);
            f64::max(high - low[k].max(other[k]), 0.0)
        });
        check(&a, &b, common.iter().product());
        for how in [Operation::Union, Operation::Difference, Operation::Intersection] {
            let made = volume_and_mesh(&a, &b, how).1;
            let found: f64 = made.faces().iter().map(|face| made.area_vector(face).norm()).sum();
            let wanted = skin([(low, size_a), (other, size_b)], how);
            assert!(
                (found - wanted).abs() < 1e-6,
                "{how:?}: {found}, not {wanted}: {low:?} {size_a:?} {other:?} {size_b:?}"
            );
        }
        // The result of one operation is the input of the next.
        let (c, ..) = solid(&mut state);
        let union = volume_and_mesh(&a, &b, Operation::Union).1;
        let with = volume_and_mesh(&union, &c, Operation::Intersection).0;
        check(&union, &c, with);
    }
}

#[test]
fn what_comes_out_does_not_run_through_itself() {
    let first = ball([0.; 3], 10.0, 10);
    let second = rotate(&cube([-7., -7., -7.]), [0.3, 0.2, 0.1]);
    for how in [Operation::Union, Operation::Difference, Operation::Intersection] {
        let made = volume_and_mesh(&first, &second, how).1;
        assert_eq!(made.crossings(|| Progress::silent().check()).unwrap(), Vec::<[u32; 2]>::new());
    }
}

#[test]
fn faces_away_from_the_cut_stay_and_attributes_are_mixed() {
    fn heights(mesh: &Mesh) -> Attribute {
        Attribute::Number(mesh.positions().iter().map(|it| it.z).collect())
    }
    fn corners(mesh: &Mesh) -> Attribute {
        Attribute::Pair(
            mesh.faces()
                .corners()
                .iter()
                .map(|&it| mesh.positions()[it as usize])
                .map(|it| [it.x, it.y])
                .collect(),
        )
    }
    fn with_attributes(mesh: Mesh, part: u32) -> Mesh {
        let (heights, corners) = (heights(&mesh), corners(&mesh));
        let parts = Attribute::Index(vec![part; mesh.faces().len()].into());
        let mesh = mesh.with_vertex("height", heights).unwrap().with_corner("at", corners).unwrap();
        mesh.with_face("part", parts).unwrap().with_creases([([0, 1], 3.0)]).unwrap()
    }
    let first = with_attributes(cube([0.; 3]), 1);
    let second = with_attributes(cuboid([4., -1., 5.], [3., 3., 9.]), 2);
    let union = volume_and_mesh(&first, &second, Operation::Union).1;
    assert_eq!(union.vertex().get("height"), Some(&heights(&union)));
    let (Some(Attribute::Pair(found)), Attribute::Pair(wanted)) =
        (union.corner().get("at"), corners(&union))
    else {
        panic!()
    };
    let differences =
        found.iter().zip(wanted.iter()).map(|(a, b)| (a[0] - b[0]).abs().max((a[1] - b[1]).abs()));
    assert!(differences.fold(0., f64::max) < 1e-9);
    let quads = union.faces().iter().filter(|face| face.len() == 4).count();
    assert_eq!(quads, 4 + 2);
    assert_eq!(Vec::from_iter(union.creases()), [([0, 1], 3.0), ([8, 9], 3.0)]);
}

#[test]
fn attributes_of_one_solid_are_transferred_to_both() {
    let solid = cube([0.; 3]);
    let colors = Attribute::Color((0..8).map(|k| [10 * k, 0, 0]).collect());
    let parts = Attribute::Index((0..6).collect());
    let solid = solid.with_vertex("color", colors).unwrap().with_face("part", parts).unwrap();
    let drill = cuboid([4., 4., -1.], [2., 2., 12.]);
    for (first, second) in [(&solid, &drill), (&drill, &solid)] {
        let made = volume_and_mesh(first, second, Operation::Union).1;
        assert!(made.vertex().colors("color").is_some());
        assert!(made.face().get("part").is_some());
    }
}

#[test]
fn meshes_that_are_not_solids_are_errors() {
    fn error(first: &Mesh, others: &[&Mesh]) -> String {
        boolean(first, others, Operation::Union, &Progress::silent()).unwrap_err().to_string()
    }
    let solid = cube([0.; 3]);
    let open = Faces::uniform(4, solid.faces().corners()[..20].to_vec()).unwrap();
    let open = Mesh::new(solid.positions().clone(), open).unwrap();
    assert_eq!(
        error(&solid, &[&open]),
        "`with` is not closed: 4 of its edges do not have two faces; use `Solid` to close it"
    );
    let mirrored = solid.positions().iter().map(|it| Point3::new(-it.x, it.y, it.z)).collect();
    let mirrored = solid.with_positions(mirrored).unwrap();
    assert_eq!(
        error(&mirrored, &[&solid]),
        "`mesh` is inside out; use `Orient` to turn it outward"
    );
    let small = cuboid([30.; 3], [5.; 3]);
    let small = maquette_mesh::orient(&small, maquette_mesh::Outside::Flip).unwrap().mesh;
    let turned = merge(&[&solid, &small], Poses::Ignore).unwrap();
    let text = error(&solid, &[&solid, &turned]);
    assert!(text.starts_with("mesh 2 of `with`: part 2 of 2 at (30.000, "), "{text}");
    let empty = Mesh::new(Vec::new(), Faces::triangles(Vec::new())).unwrap();
    assert_eq!(volume_and_mesh(&solid, &empty, Operation::Union).0, 1000.0);
    assert_eq!(volume_and_mesh(&solid, &empty, Operation::Intersection).0, 0.0);
}

#[test]
fn parts_of_a_solid_that_overlap_are_united_wherever_they_do() {
    use Operation::{Difference, Union};
    let twice = merge(&[&cube([2.; 3]), &cube([3.; 3])], Poses::Ignore).unwrap();
    // The other solid meets the overlap, or does not.
    for (other, union, difference) in [
        (cube([0.; 3]), 1759.0, 1271.0 - 512.0),
        (cuboid([-4., -4., -4.], [7., 7., 7.]), 1271.0 + 343.0 - 1.0, 1270.0),
        (cube([50.; 3]), 2271.0, 1271.0),
    ] {
        let found = volume_and_mesh(&twice, &other, Union).0;
        assert!((found - union).abs() < 1e-6, "{found}, not {union}");
        let found = volume_and_mesh(&twice, &other, Difference).0;
        assert!((found - difference).abs() < 1e-6, "{found}, not {difference}");
    }
    let nested = merge(&[&cube([0.; 3]), &cuboid([2.; 3], [3.; 3])], Poses::Ignore).unwrap();
    assert_eq!(volume_and_mesh(&nested, &cube([50.; 3]), Union).0, 2000.0);
    let alone = boolean(&twice, &[], Union, &Progress::silent()).unwrap();
    assert!((size(&alone) - 1271.0).abs() < 1e-6);
}

#[test]
fn halves_that_are_mirrored_at_their_cut_unite_to_the_whole() {
    for (steps, height) in [(8, 0.0), (8, 1.0), (12, 0.37), (13, -2.0), (20, 3.3)] {
        let block = cuboid([-20., -20., height - 20.0], [40., 40., 20.]);
        let whole = ball([0.; 3], 10.0, steps);
        for turn in [0.0, 0.3] {
            let half =
                volume_and_mesh(&rotate(&whole, [0., turn, 0.]), &block, Operation::Difference).1;
            let places =
                half.positions().iter().map(|it| Point3::new(it.x, it.y, 2.0 * height - it.z));
            let mirrored = half.with_positions(places.collect()).unwrap();
            let mirrored =
                maquette_mesh::orient(&mirrored, maquette_mesh::Outside::Flip).unwrap().mesh;
            check(&half, &mirrored, 0.0);
            let union = volume_and_mesh(&half, &mirrored, Operation::Union).1;
            let middle = union.faces().iter().filter(|face| {
                face.iter().all(|&it| (union.positions()[it as usize].z - height).abs() < 1e-9)
            });
            let areas: Vec<f64> = middle.map(|face| union.area_vector(face).norm()).collect();
            assert!(areas.iter().all(|area| *area < 1e-9), "{steps} {height} {turn} {areas:?}");
        }
    }
}

#[test]
fn the_same_for_any_number_of_threads() {
    let [first, second] = [ball([0.; 3], 10.0, 30), ball([3., 1., 2.], 9.0, 30)];
    fn difference(threads: usize, first: &Mesh, second: &Mesh) -> Mesh {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| volume_and_mesh(first, second, Operation::Difference).1)
    }
    assert_eq!(difference(1, &first, &second), difference(8, &first, &second));
}

#[test]
fn a_captured_solid_stays_upright_beside_one_of_no_capture() {
    let frame =
        CaptureFrame { camera: None, picture: [2, 2], depth: 20.0, world_from_camera: None };
    let (first, second) = (cube([0.0; 3]), cube([5.0; 3]));
    fn with_frame(mesh: &Mesh, frame: &CaptureFrame) -> Mesh {
        mesh.clone().with_frame(Some(*frame))
    }
    fn frame_of(mesh: &Mesh, other: &Mesh) -> Option<CaptureFrame> {
        let made = boolean(mesh, &[other], Operation::Difference, &Progress::silent()).unwrap();
        made.frame().copied()
    }
    assert_eq!(frame_of(&with_frame(&first, &frame), &second), Some(frame));
    assert_eq!(frame_of(&with_frame(&first, &frame), &with_frame(&second, &frame)), Some(frame));
    assert_eq!(frame_of(&first, &with_frame(&second, &frame)), None);
}
