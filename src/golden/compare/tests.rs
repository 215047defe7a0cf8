//! Pairs of values whose difference is known.

use maquette_value::{Attribute, Faces, Image, Trace, TraceStep};
use nalgebra::{Point3, Vector3};

use super::*;

/// A wavy sheet of quads split in two, `n` x `n` vertices.
fn sheet(n: u32) -> Mesh {
    let quads = (0..n - 1).flat_map(|row| (0..n - 1).map(move |column| row * n + column));
    let faces = quads.flat_map(|a| [[a, a + 1, a + n], [a + 1, a + n + 1, a + n]]);
    let positions: Vec<_> = (0..n * n)
        .map(|k: u32| {
            let (x, y) = (f64::from(k % n), f64::from(k / n));
            Point3::new(x, y, 2.0 * libm::sin(x * 0.3) + libm::cos(y * 0.2))
        })
        .collect();
    let uv: Vec<[f64; 2]> = positions.iter().map(|p| [p.x / 30.0, p.y / 30.0]).collect();
    let mesh = Mesh::new(positions, Faces::triangles(faces.collect())).unwrap();
    mesh.with_vertex("uv", Attribute::Pair(uv.into())).unwrap()
}

/// The same mesh with vertices and faces in reverse, and every face begun at its second corner.
fn reversed(mesh: &Mesh) -> Mesh {
    let last = mesh.positions().len() as u32 - 1;
    let faces = mesh.faces().iter().map(|f| [last - f[1], last - f[2], last - f[0]]);
    let mut faces: Vec<_> = faces.collect();
    faces.reverse();
    let places: Vec<u32> = (0..=last).rev().collect();
    let positions: Vec<_> = mesh.positions().iter().rev().copied().collect();
    let uv = mesh.vertex().get("uv").unwrap().select(&places);
    Mesh::new(positions, Faces::triangles(faces)).unwrap().with_vertex("uv", uv).unwrap()
}

fn moved(mesh: &Mesh, by: Vector3<f64>) -> Mesh {
    mesh.with_positions(mesh.positions().iter().map(|p| p + by).collect()).unwrap()
}

fn check(old: &Mesh, new: &Mesh, tolerance: &Tolerance) -> Comparison {
    compare(&AnyValue::new(old.clone()), &AnyValue::new(new.clone()), tolerance)
}

fn within(max: f64) -> Tolerance {
    // The nearest place of a lifted sheet is a little beside: there, texture coordinates are a little others.
    Tolerance {
        max: Some(max),
        attributes: [("uv".to_owned(), 0.1)].into(),
        ..Tolerance::default()
    }
}

#[test]
fn the_verdict_says_what_changed_at_most() {
    let mesh = sheet(30);
    fn verdict(new: &Mesh, max: f64, mesh: &Mesh) -> Verdict {
        check(mesh, new, &within(max)).verdict
    }
    assert_eq!(verdict(&mesh.clone(), 0.0, &mesh), Verdict::Identical);
    assert_eq!(verdict(&reversed(&mesh), 0.0, &mesh), Verdict::Reordered);
    let lifted = moved(&mesh, Vector3::new(0.0, 0.0, 0.01));
    assert_eq!(verdict(&lifted, 0.011, &mesh), Verdict::Within);
    assert_eq!(verdict(&lifted, 0.009, &mesh), Verdict::Different);
    assert_eq!(
        verdict(&moved(&reversed(&mesh), Vector3::new(0.0, 0.0, 0.01)), 0.011, &mesh),
        Verdict::Within
    );
}

#[test]
fn the_worst_place_is_named() {
    let mesh = sheet(30);
    let mut positions = mesh.positions().to_vec();
    positions[321].z += 0.5;
    let bent = mesh.with_positions(positions).unwrap();
    let comparison = check(&mesh, &bent, &within(0.1));
    assert_eq!(comparison.reasons.len(), 1);
    assert!(
        comparison.reasons[0].contains("differs by 0.5 mm, allowed is 0.1 mm; worst at entry 321"),
        "{comparison:?}"
    );
    let comparison = check(&mesh, &reversed(&bent), &within(0.1));
    assert!(comparison.reasons.iter().any(|why| why.contains("vertex 578 ")), "{comparison:?}");
}

#[test]
fn topology_comes_before_distances() {
    let mesh = sheet(10);
    let fewer = mesh.faces().as_triangles().unwrap()[1..].to_vec();
    let holed = Mesh::new(mesh.positions().to_vec(), Faces::triangles(fewer)).unwrap();
    let holed = holed.with_vertex("uv", mesh.vertex().get("uv").unwrap().clone()).unwrap();
    let comparison = check(&mesh, &holed, &within(100.0));
    assert_eq!(comparison.verdict, Verdict::Different);
    assert!(comparison.reasons.contains(&"faces: 162 -> 161".to_owned()), "{comparison:?}");
    let lax = Tolerance { remeshed: true, ..within(100.0) };
    assert_eq!(check(&mesh, &holed, &lax).verdict, Verdict::Within);
}

/// The mesh without some faces, and with its vertices.
fn without_faces(mesh: &Mesh, is_gone: impl Fn(usize) -> bool) -> Mesh {
    let faces: Vec<_> = mesh.faces().iter().map(<[u32]>::to_vec).collect();
    let kept = faces.iter().enumerate().filter(|(index, _)| !is_gone(*index));
    let (sizes, corners): (Vec<usize>, Vec<Vec<u32>>) =
        kept.map(|(_, face)| (face.len(), face.clone())).unzip();
    let faces = Faces::polygons(&sizes, corners.concat()).unwrap();
    Mesh::new(mesh.positions().to_vec(), faces).unwrap()
}

/// The same sheet of bent quads, each begun at its corner of this number.
fn quads(n: u32, first: usize) -> Mesh {
    let cells = (0..n - 1).flat_map(|row| (0..n - 1).map(move |column| row * n + column));
    let corners = cells.flat_map(|a| {
        let mut corners = [a, a + 1, a + n + 1, a + n];
        corners.rotate_left(first);
        corners
    });
    let faces = Faces::polygons(&vec![4; ((n - 1) * (n - 1)) as usize], corners.collect());
    Mesh::new(sheet(n).positions().to_vec(), faces.unwrap()).unwrap()
}

#[test]
fn a_face_that_one_mesh_lacks_is_measured_although_all_its_vertices_are_there() {
    for mesh in [sheet(12).without("uv"), quads(12, 0)] {
        let holed = without_faces(&mesh, |face| face % 9 == 4);
        for remeshed in [false, true] {
            let tolerance = Tolerance { remeshed, ..within(0.05) };
            for (old, new, seen) in [(&mesh, &holed, 0), (&holed, &mesh, 1)] {
                let comparison = check(old, new, &tolerance);
                assert_eq!(comparison.verdict, Verdict::Different);
                let measures = &comparison.measures[..2];
                assert!(
                    measures[seen].max > 0.2 && measures[1 - seen].max < 1e-9,
                    "{comparison:?}"
                );
                // Of other faces, the midpoints of edges are measured, too.
                let face = if remeshed { "" } else { "face " };
                assert!(measures[seen].worst.starts_with(face), "{comparison:?}");
                assert!(!measures[seen].worst.starts_with("vertex "), "{comparison:?}");
            }
        }
    }
}

#[test]
fn the_corner_at_which_a_bent_face_begins_is_no_distance() {
    let old = quads(12, 0);
    let new = moved(&quads(12, 1), Vector3::new(0.0, 0.0, 1e-7));
    let measures = check(&old, &new, &within(1e-6)).measures;
    assert!(measures.len() >= 2 && measures.iter().all(|it| it.max < 2e-7), "{measures:?}");
}

#[test]
fn the_same_surface_of_other_faces_is_another_mesh() {
    let mesh = sheet(10);
    fn with_faces(mesh: &Mesh, change: &dyn Fn(&mut Vec<[u32; 3]>)) -> Mesh {
        let mut faces = mesh.faces().as_triangles().unwrap().to_vec();
        change(&mut faces);
        let other = Mesh::new(mesh.positions().to_vec(), Faces::triangles(faces)).unwrap();
        other.with_vertex("uv", mesh.vertex().get("uv").unwrap().clone()).unwrap()
    }
    let flipped = with_faces(&mesh, &|faces| faces.iter_mut().for_each(|face| face.swap(1, 2)));
    let crossed = with_faces(&mesh, &|faces| {
        let ([a, b, d], [_, c, _]) = (faces[8], faces[9]);
        (faces[8], faces[9]) = ([a, b, c], [a, c, d]);
    });
    fn told(new: &Mesh, lax: bool, mesh: &Mesh) -> String {
        check(mesh, new, &Tolerance { remeshed: lax, ..within(1.0) }).reasons.join("; ")
    }
    assert_eq!(told(&flipped, false, &mesh), "162 faces join other vertices, or in another sense");
    assert_eq!(told(&crossed, false, &mesh), "2 faces join other vertices, or in another sense");
    let moved = moved(&reversed(&flipped), Vector3::new(0.0, 0.0, 0.01));
    assert_eq!(told(&moved, false, &mesh), "100 % of the faces look to the other side");
    assert_eq!([told(&flipped, true, &mesh), told(&moved, true, &mesh)], ["", ""]);
}

#[test]
fn a_lost_and_a_changed_attribute_are_seen() {
    let mesh = sheet(10);
    let comparison = check(&mesh, &mesh.clone().without("uv"), &Tolerance::default());
    assert_eq!(comparison.reasons, ["`uv` is gone"]);
    let shifted: Vec<_> =
        mesh.vertex().pairs("uv").unwrap().iter().map(|[u, v]| [*u, v + 0.01]).collect();
    let shifted = mesh.clone().with_vertex("uv", Attribute::Pair(shifted.into())).unwrap();
    let allowing =
        |uv| Tolerance { attributes: [("uv".to_owned(), uv)].into(), ..Tolerance::default() };
    assert_eq!(check(&mesh, &shifted, &allowing(0.02)).verdict, Verdict::Within);
    assert_eq!(check(&mesh, &shifted, &allowing(0.005)).verdict, Verdict::Different);
    assert_eq!(check(&mesh, &reversed(&shifted), &allowing(0.005)).verdict, Verdict::Different);
}

#[test]
fn attributes_of_corners_and_faces_are_compared_when_the_faces_are_others() {
    // A mesh whose corners and faces have numbers that only depend on their places; its faces in either order.
    fn numbered(turned: bool, off: f64) -> Mesh {
        let mesh = sheet(12).without("uv");
        let mut faces = mesh.faces().as_triangles().unwrap().to_vec();
        if turned {
            faces.reverse();
            faces.iter_mut().for_each(|face| face.rotate_left(1));
        }
        let corners = faces.as_flattened().iter().map(|&v| f64::from(v % 12)).collect::<Vec<_>>();
        let sums: Vec<f64> =
            faces.iter().map(|face| off + f64::from(face.iter().sum::<u32>())).collect();
        let mut corners: Vec<f64> = corners;
        corners[40] += off;
        let mesh = Mesh::new(mesh.positions().to_vec(), Faces::triangles(faces)).unwrap();
        let mesh = mesh.with_corner("tint", Attribute::Number(corners.into())).unwrap();
        mesh.with_face("sum", Attribute::Number(sums.into())).unwrap()
    }
    let old = numbered(false, 0.0);
    fn near(off: f64) -> Mesh {
        moved(&numbered(true, off), Vector3::new(0.0, 0.0, 1e-6))
    }
    let tolerance = Tolerance {
        attributes: [("tint".to_owned(), 1e-3), ("sum".to_owned(), 0.5)].into(),
        ..within(1e-4)
    };
    assert_eq!(check(&old, &near(0.0), &tolerance).verdict, Verdict::Within);
    let comparison = check(&old, &near(0.6), &tolerance);
    fn told(what: &str, comparison_reasons: &[String]) -> bool {
        comparison_reasons.iter().any(|why| why.contains(what))
    }
    assert!(
        told("`corner tint` differs by 0.2", &comparison.reasons)
            && told("`face sum` differs by 0.6", &comparison.reasons),
        "{comparison:?}"
    );
}

#[test]
fn distances_of_shifted_planes_are_their_shift() {
    fn flat(n: u32, z: f64) -> Mesh {
        let mesh = sheet(n);
        let scale = 29.0 / f64::from(n - 1);
        let flat =
            mesh.positions().iter().map(|p| Point3::new(p.x * scale, p.y * scale, z)).collect();
        mesh.with_positions(flat).unwrap().without("uv")
    }
    let lax = Tolerance { remeshed: true, ..within(0.3) };
    let comparison = check(&flat(30, 0.0), &flat(41, 0.25), &lax);
    assert_eq!(comparison.verdict, Verdict::Within);
    for measure in &comparison.measures {
        assert!(
            (measure.max - 0.25).abs() < 1e-9 && (measure.rms - 0.25).abs() < 1e-9,
            "{measure:?}"
        );
    }
}

#[test]
fn pixels_may_differ_in_a_share() {
    fn picture(changed: usize) -> AnyValue {
        let mut pixels = vec![[10, 20, 30]; 100];
        pixels[..changed].iter_mut().for_each(|pixel| pixel[1] = 25);
        AnyValue::new(Image::new(10, 10, pixels).unwrap())
    }
    let verdict =
        |changed, tolerance: &Tolerance| compare(&picture(0), &picture(changed), tolerance).verdict;
    let some = Tolerance { differing: 0.05, ..Tolerance::default() };
    assert_eq!(verdict(5, &some), Verdict::Within);
    assert_eq!(verdict(6, &some), Verdict::Different);
    assert_eq!(verdict(100, &Tolerance { level: 5.0, ..Tolerance::default() }), Verdict::Within);
    let comparison = compare(&picture(0), &picture(1), &Tolerance::default());
    assert!(comparison.reasons[0].contains("worst at column 0, row 0"), "{comparison:?}");
}

#[test]
fn one_pixel_that_is_far_off_fails_although_a_share_may_differ() {
    fn picture(level: u8) -> AnyValue {
        let mut pixels = vec![[100, 100, 100]; 1000];
        pixels[417][2] = level;
        AnyValue::new(Image::new(100, 10, pixels).unwrap())
    }
    fn check(level: u8, hard: Option<f64>, relative: f64) -> Comparison {
        let tolerance = Tolerance { differing: 0.1, hard, relative, ..Tolerance::default() };
        compare(&picture(100), &picture(level), &tolerance)
    }
    assert_eq!(check(193, None, 0.0).verdict, Verdict::Within);
    assert_eq!(check(120, Some(20.0), 0.0).verdict, Verdict::Within);
    for relative in [0.0, 1.0] {
        let reasons = check(193, Some(20.0), relative).reasons;
        let expected =
            "`color` differs by 93 levels, allowed is 20 (hard); worst at column 17, row 4: ";
        assert!(reasons.len() == 1 && reasons[0].starts_with(expected), "{reasons:?}");
    }
}

#[test]
fn a_difference_counts_from_a_fraction_of_the_mean_on() {
    fn picture(level: u8) -> AnyValue {
        AnyValue::new(Image::new(10, 10, vec![[level; 3]; 100]).unwrap())
    }
    fn check(old: u8, new: u8, relative: f64) -> (Verdict, f64) {
        let tolerance = Tolerance { relative, ..Tolerance::default() };
        let comparison = compare(&picture(old), &picture(new), &tolerance);
        (comparison.verdict, comparison.measures[0].differing)
    }
    assert_eq!(check(200, 210, 0.05), (Verdict::Within, 0.0));
    assert_eq!(check(20, 30, 0.05), (Verdict::Different, 1.0));
    assert_eq!(check(0, 1, 1.0), (Verdict::Different, 1.0));
    fn field(x: f32) -> AnyValue {
        AnyValue::new(maquette_value::Field::new(2, 1, vec![x, -1000.0]).unwrap())
    }
    fn tolerance(relative: f64) -> Tolerance {
        Tolerance { relative, ..Tolerance::default() }
    }
    fn verdict(relative: f64) -> Verdict {
        compare(&field(1000.0), &field(1010.0), &tolerance(relative)).verdict
    }
    assert_eq!([verdict(0.02), verdict(0.005)], [Verdict::Within, Verdict::Different]);
}

#[test]
fn values_of_other_kinds_and_lengths_are_different() {
    let trace =
        |max| AnyValue::new(Trace::new(vec![TraceStep { iteration: 0, max, rms: 0.1 }]).unwrap());
    let empty = AnyValue::new(Trace::default());
    assert_eq!(
        compare(&trace(1.0), &trace(1.0 + 1e-13), &Tolerance::default()).verdict,
        Verdict::Within
    );
    assert_eq!(
        compare(&trace(1.0), &trace(f64::INFINITY), &within(1e9)).verdict,
        Verdict::Different
    );
    assert_eq!(compare(&trace(1.0), &empty, &within(1e9)).reasons[0], "steps: 1 -> 0");
    let other = AnyValue::new(sheet(3));
    assert_eq!(compare(&empty, &other, &within(1e9)).reasons, ["a Trace became a Mesh"]);
}

#[test]
fn numbers_have_six_digits() {
    let cases = [
        (0.0, "0"),
        (1.0, "1"),
        (-12.345678, "-12.3457"),
        (1234567.0, "1234567"),
        (1e-9, "1.00000e-9"),
        (f64::NAN, "NaN"),
        (0.1 + 0.2, "0.3"),
    ];
    for (x, text) in cases {
        assert_eq!(six(x), text);
    }
}
