//! Tests comparisons with pairs of values whose difference is known.

use maquette_value::{Attribute, Faces, Image, Trace, TraceStep};
use nalgebra::{Point3, Vector3};

use super::*;

/// Creates a wavy sheet of `n` x `n` vertices, whose quads are split into two triangles.
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

/// Returns the mesh with its vertices and faces in reverse order. Every face begins at its second corner instead of its first.
fn reverse_order(mesh: &Mesh) -> Mesh {
    let last = mesh.positions().len() as u32 - 1;
    let faces = mesh.faces().iter().map(|f| [last - f[1], last - f[2], last - f[0]]);
    let mut faces: Vec<_> = faces.collect();
    faces.reverse();
    let places: Vec<u32> = (0..=last).rev().collect();
    let positions: Vec<_> = mesh.positions().iter().rev().copied().collect();
    let uv = mesh.vertex().get("uv").unwrap().select(&places);
    Mesh::new(positions, Faces::triangles(faces)).unwrap().with_vertex("uv", uv).unwrap()
}

fn translate(mesh: &Mesh, by: Vector3<f64>) -> Mesh {
    mesh.with_positions(mesh.positions().iter().map(|p| p + by).collect()).unwrap()
}

fn check(old: &Mesh, new: &Mesh, tolerance: &Tolerance) -> Comparison {
    compare(&AnyValue::new(old.clone()), &AnyValue::new(new.clone()), tolerance)
}

fn tolerance_of(max: f64) -> Tolerance {
    // On a wavy sheet that is lifted, the nearest point is slightly shifted, and so is its texture coordinate.
    Tolerance {
        max: Some(max),
        attributes: [("uv".to_owned(), 0.1)].into(),
        ..Tolerance::default()
    }
}

#[test]
fn the_verdict_depends_on_the_largest_difference() {
    let mesh = sheet(30);
    fn verdict(new: &Mesh, max: f64, mesh: &Mesh) -> Verdict {
        check(mesh, new, &tolerance_of(max)).verdict
    }
    assert_eq!(verdict(&mesh.clone(), 0.0, &mesh), Verdict::Identical);
    assert_eq!(verdict(&reverse_order(&mesh), 0.0, &mesh), Verdict::Reordered);
    let lifted = translate(&mesh, Vector3::new(0.0, 0.0, 0.01));
    assert_eq!(verdict(&lifted, 0.011, &mesh), Verdict::Within);
    assert_eq!(verdict(&lifted, 0.009, &mesh), Verdict::Different);
    assert_eq!(
        verdict(&translate(&reverse_order(&mesh), Vector3::new(0.0, 0.0, 0.01)), 0.011, &mesh),
        Verdict::Within
    );
}

#[test]
fn the_position_of_the_largest_difference_is_named() {
    let mesh = sheet(30);
    let mut positions = mesh.positions().to_vec();
    positions[321].z += 0.5;
    let bent = mesh.with_positions(positions).unwrap();
    let comparison = check(&mesh, &bent, &tolerance_of(0.1));
    assert_eq!(comparison.reasons.len(), 1);
    assert!(
        comparison.reasons[0].contains("differs by 0.5 mm, allowed is 0.1 mm; worst at entry 321"),
        "{comparison:?}"
    );
    let comparison = check(&mesh, &reverse_order(&bent), &tolerance_of(0.1));
    assert!(comparison.reasons.iter().any(|why| why.contains("vertex 578 ")), "{comparison:?}");
}

#[test]
fn topology_comes_before_distances() {
    let mesh = sheet(10);
    let fewer = mesh.faces().as_triangles().unwrap()[1..].to_vec();
    let holed = Mesh::new(mesh.positions().to_vec(), Faces::triangles(fewer)).unwrap();
    let holed = holed.with_vertex("uv", mesh.vertex().get("uv").unwrap().clone()).unwrap();
    let comparison = check(&mesh, &holed, &tolerance_of(100.0));
    assert_eq!(comparison.verdict, Verdict::Different);
    assert!(comparison.reasons.contains(&"faces: 162 -> 161".to_owned()), "{comparison:?}");
    let lax = Tolerance { remeshed: true, ..tolerance_of(100.0) };
    assert_eq!(check(&mesh, &holed, &lax).verdict, Verdict::Within);
}

/// Returns the mesh without the faces for which `is_gone` is true. All vertices are kept.
fn without_faces(mesh: &Mesh, is_gone: impl Fn(usize) -> bool) -> Mesh {
    let faces: Vec<_> = mesh.faces().iter().map(<[u32]>::to_vec).collect();
    let kept = faces.iter().enumerate().filter(|(index, _)| !is_gone(*index));
    let (sizes, corners): (Vec<usize>, Vec<Vec<u32>>) =
        kept.map(|(_, face)| (face.len(), face.clone())).unzip();
    let faces = Faces::polygons(&sizes, corners.concat()).unwrap();
    Mesh::new(mesh.positions().to_vec(), faces).unwrap()
}

/// Creates a wavy sheet of quads. The vertices of each quad are listed from its corner number `first`.
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
fn a_missing_face_is_measured_although_its_vertices_exist() {
    for mesh in [sheet(12).without_attribute("uv"), quads(12, 0)] {
        let holed = without_faces(&mesh, |face| face % 9 == 4);
        for remeshed in [false, true] {
            let tolerance = Tolerance { remeshed, ..tolerance_of(0.05) };
            for (old, new, seen) in [(&mesh, &holed, 0), (&holed, &mesh, 1)] {
                let comparison = check(old, new, &tolerance);
                assert_eq!(comparison.verdict, Verdict::Different);
                let measures = &comparison.measures[..2];
                assert!(
                    measures[seen].max > 0.2 && measures[1 - seen].max < 1e-9,
                    "{comparison:?}"
                );
                // If the tolerance allows other faces, edges are measured, too, and the largest difference may be at an edge.
                let face = if remeshed { "" } else { "face " };
                assert!(measures[seen].worst.starts_with(face), "{comparison:?}");
                assert!(!measures[seen].worst.starts_with("vertex "), "{comparison:?}");
            }
        }
    }
}

#[test]
fn the_first_corner_of_a_bent_face_does_not_matter() {
    let old = quads(12, 0);
    let new = translate(&quads(12, 1), Vector3::new(0.0, 0.0, 1e-7));
    let measures = check(&old, &new, &tolerance_of(1e-6)).measures;
    assert!(measures.len() >= 2 && measures.iter().all(|it| it.max < 2e-7), "{measures:?}");
}

#[test]
fn an_equal_surface_with_other_faces_is_a_different_mesh() {
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
    fn reasons(new: &Mesh, lax: bool, mesh: &Mesh) -> String {
        check(mesh, new, &Tolerance { remeshed: lax, ..tolerance_of(1.0) }).reasons.join("; ")
    }
    assert_eq!(
        reasons(&flipped, false, &mesh),
        "162 faces have other vertices or another orientation"
    );
    assert_eq!(
        reasons(&crossed, false, &mesh),
        "2 faces have other vertices or another orientation"
    );
    let moved = translate(&reverse_order(&flipped), Vector3::new(0.0, 0.0, 0.01));
    assert_eq!(reasons(&moved, false, &mesh), "100 % of the faces have the opposite orientation");
    assert_eq!([reasons(&flipped, true, &mesh), reasons(&moved, true, &mesh)], ["", ""]);
}

#[test]
fn missing_and_changed_attributes_are_reported() {
    let mesh = sheet(10);
    let comparison = check(&mesh, &mesh.clone().without_attribute("uv"), &Tolerance::default());
    assert_eq!(comparison.reasons, ["`uv` is gone"]);
    let shifted: Vec<_> =
        mesh.vertex().pairs("uv").unwrap().iter().map(|[u, v]| [*u, v + 0.01]).collect();
    let shifted = mesh.clone().with_vertex("uv", Attribute::Pair(shifted.into())).unwrap();
    let uv_tolerance =
        |uv| Tolerance { attributes: [("uv".to_owned(), uv)].into(), ..Tolerance::default() };
    assert_eq!(check(&mesh, &shifted, &uv_tolerance(0.02)).verdict, Verdict::Within);
    assert_eq!(check(&mesh, &shifted, &uv_tolerance(0.005)).verdict, Verdict::Different);
    assert_eq!(
        check(&mesh, &reverse_order(&shifted), &uv_tolerance(0.005)).verdict,
        Verdict::Different
    );
}

#[test]
fn corner_and_face_attributes_are_compared_across_different_faces() {
    // Creates a mesh with numbers at its corners and faces that depend only on their positions. If `turned` is true, the faces are in
    // reverse order.
    fn mesh_with_numbers(turned: bool, off: f64) -> Mesh {
        let mesh = sheet(12).without_attribute("uv");
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
    let old = mesh_with_numbers(false, 0.0);
    fn lifted_mesh(off: f64) -> Mesh {
        translate(&mesh_with_numbers(true, off), Vector3::new(0.0, 0.0, 1e-6))
    }
    let tolerance = Tolerance {
        attributes: [("tint".to_owned(), 1e-3), ("sum".to_owned(), 0.5)].into(),
        ..tolerance_of(1e-4)
    };
    assert_eq!(check(&old, &lifted_mesh(0.0), &tolerance).verdict, Verdict::Within);
    let comparison = check(&old, &lifted_mesh(0.6), &tolerance);
    fn has_reason(what: &str, reasons: &[String]) -> bool {
        reasons.iter().any(|why| why.contains(what))
    }
    assert!(
        has_reason("`corner tint` differs by 0.2", &comparison.reasons)
            && has_reason("`face sum` differs by 0.6", &comparison.reasons),
        "{comparison:?}"
    );
}

#[test]
fn the_distance_of_shifted_planes_is_the_shift() {
    fn flat(n: u32, z: f64) -> Mesh {
        let mesh = sheet(n);
        let scale = 29.0 / f64::from(n - 1);
        let flat =
            mesh.positions().iter().map(|p| Point3::new(p.x * scale, p.y * scale, z)).collect();
        mesh.with_positions(flat).unwrap().without_attribute("uv")
    }
    let lax = Tolerance { remeshed: true, ..tolerance_of(0.3) };
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
fn a_fraction_of_pixels_may_differ() {
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
fn a_single_large_difference_fails_the_hard_limit() {
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
fn relative_differences_within_the_limit_do_not_count() {
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
        compare(&trace(1.0), &trace(f64::INFINITY), &tolerance_of(1e9)).verdict,
        Verdict::Different
    );
    assert_eq!(compare(&trace(1.0), &empty, &tolerance_of(1e9)).reasons[0], "steps: 1 -> 0");
    let other = AnyValue::new(sheet(3));
    assert_eq!(compare(&empty, &other, &tolerance_of(1e9)).reasons, ["a Trace became a Mesh"]);
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
        assert_eq!(six_digits(x), text);
    }
}
