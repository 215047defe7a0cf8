//! Tests of holes with unusual shapes, positions and units.

use super::*;

/// Fills the holes of up to `max` edges with all methods. Checks that the results are manifold, intersect nothing and extend beyond the
/// bounding box of the input mesh by at most `fraction` of its size. Returns the number of remaining border edges.
fn check(mesh: &Mesh, max: usize, fraction: f64) -> usize {
    fn bounds(mesh: &Mesh) -> (Point3<f64>, Point3<f64>) {
        let points = mesh.positions().iter();
        points.fold((mesh.positions()[0], mesh.positions()[0]), |(low, high), p| {
            (low.inf(p), high.sup(p))
        })
    }
    let (low, high) = bounds(mesh);
    let allowed = fraction * (high - low).norm();
    let exemplar =
        FillMethod::Exemplar(ExemplarOptions { iterations: Some(2), ..Default::default() });
    let open = PLAIN.into_iter().chain([exemplar]).map(|method| {
        let filled = fill(mesh, HoleChoice::Edges { max }, method.clone()).unwrap();
        let warning = filled.warnings.iter().find(|warning| warning.contains("intersect others"));
        assert_eq!(warning, None, "{method:?}");
        let (lowest, highest) = bounds(&filled.mesh);
        let is_near =
            (0..3).all(|k| low[k] - allowed <= lowest[k] && highest[k] <= high[k] + allowed);
        assert!(is_near, "{method:?} goes from {lowest} to {highest}");
        check_kept(mesh, &filled.mesh)
    });
    let open: Vec<usize> = open.collect();
    assert!(open.iter().all(|&count| count == open[0]), "{open:?}");
    open[0]
}

fn distance_from(p: &Point3<f64>, x: f64, y: f64) -> f64 {
    libm::hypot(p.x - x, p.y - y)
}

#[test]
fn long_and_winding_holes_are_filled() {
    let slit =
        remove_vertices(&grid(40, 12, |x, y| 3.0 * libm::sin(0.15 * x) + 0.02 * y * y), |p| {
            (p.y - 5.0).abs() < 0.5 && (4.0..36.0).contains(&p.x)
        });
    assert_eq!(check(&slit, 90, 0.05), 2 * (39 + 11));
    let spiral =
        remove_vertices(&grid(40, 40, |x, y| libm::sin(0.1 * x) * libm::cos(0.1 * y)), |p| {
            let turn = libm::atan2(p.y - 19.5, p.x - 19.5) / std::f64::consts::TAU;
            let radius = distance_from(p, 19.5, 19.5);
            (3.0..17.0).contains(&radius) && (radius / 7.0 - turn).rem_euclid(1.0) < 0.3
        });
    assert_eq!(check(&spiral, 400, 0.05), 4 * 39);
}

#[test]
fn holes_in_close_sheets_are_filled_separately() {
    fn hills(x: f64, y: f64) -> f64 {
        0.3 * libm::sin(0.3 * x) + 0.01 * y
    }
    let lower = remove_vertices(&grid(24, 24, hills), |p| distance_from(p, 12.0, 12.0) < 6.0);
    let upper = grid(24, 24, |x, y| hills(x, y) + 0.1);
    let upper = remove_vertices(&upper, |p| distance_from(p, 13.0, 11.0) < 5.0);
    let data = lower.positions().len() as u32;
    let points = lower.positions().iter().chain(upper.positions().iter()).copied();
    let faces = lower.faces().as_triangles().unwrap().to_vec();
    let above = upper
        .faces()
        .as_triangles()
        .unwrap()
        .iter()
        .map(|face| [face[0], face[2], face[1]].map(|vertex| vertex + data));
    let both = triangle_mesh(points.collect(), faces.into_iter().chain(above).collect());
    assert_eq!(check(&both, 60, 0.02), 2 * 4 * 23);
}

#[test]
fn density_may_change_across_a_hole() {
    fn spread(t: f64) -> f64 {
        0.05 * (libm::exp(t / 13.0) - 1.0)
    }
    let even = grid(40, 40, |x, _| 0.2 * libm::sin(4.0 * spread(x)));
    let points = even.positions().iter().map(|p| Point3::new(spread(p.x), spread(p.y), p.z));
    let uneven = even.with_positions(points.collect()).unwrap();
    let mesh = remove_vertices(&uneven, |p| distance_from(p, 0.35, 0.3) < 0.25);
    assert_eq!(check(&mesh, 150, 0.05), 4 * 39);
}

#[test]
fn units_do_not_matter() {
    let mesh = remove_vertices(&sphere(3), |p| p.z > 0.75 || p.x > 0.95);
    for method in PLAIN {
        let filled = fill(&mesh, HoleChoice::All, method.clone()).unwrap().mesh;
        // Scale by powers of two (about 1e-6, 1e-4 and 1e6), because these do not change rounding.
        for power in [-20, -13, 20] {
            let unit = libm::ldexp(1.0, power);
            let [data, expected] = [&mesh, &filled].map(|mesh| -> Vec<Point3<f64>> {
                mesh.positions().iter().map(|p| p * unit).collect()
            });
            let scaled = mesh.with_positions(data).unwrap();
            let other = fill(&scaled, HoleChoice::All, method.clone()).unwrap().mesh;
            assert_eq!(filled.faces(), other.faces(), "{method:?} {unit}");
            assert_eq!(expected, other.positions()[..], "{method:?} {unit}");
        }
    }
}

#[test]
fn too_many_triangles_are_rejected_in_advance_with_numbers() {
    let mesh = remove_vertices(&grid(40, 40, |x, y| libm::sin(0.2 * x) + 0.1 * y), |p| {
        [p.x, p.y].iter().all(|at| (15.5..24.5).contains(at))
    });
    for edge in [3e-3, 1e-9, 1e-300] {
        let options = ExemplarOptions { edges: vec![edge], ..Default::default() };
        let error = fill(&mesh, HoleChoice::All, FillMethod::Exemplar(options)).err();
        let warning = error.map_or_else(|| "nothing".into(), |error| error.to_string());
        let is_refused = warning.starts_with("the fill of rim 1 would need about ")
            && warning.contains(" triangles, at most 1 000 000 are made: ");
        assert!(is_refused, "{edge}: {warning}");
    }
}

#[test]
fn the_number_of_triangles_is_estimated_in_advance() {
    use crate::triangles::density::{estimate, refine};
    use crate::triangles::triangulation::Triangulation;

    let corners = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
    let corners = corners.map(|[x, y]| Point3::new(x, y, 0.0));
    for (size, divisions) in [(0.02, 0), (0.02, 5000), (0.005, 5000)] {
        // The target edge length on the right is three times that on the left.
        let target = |p: Point3<f64>| if divisions == 0 { size } else { size * (1.0 + 2.0 * p.x) };
        let mut triangulation = Triangulation::new(corners.to_vec(), 4, &[[0, 1, 2], [0, 2, 3]]);
        let known = estimate(&triangulation, target, divisions);
        refine(&mut triangulation, target, &Progress::silent()).unwrap();
        let ratio = known / triangulation.n_faces() as f64;
        assert!((0.5..2.5).contains(&ratio), "{size}: {known} for {}", triangulation.n_faces());
    }
}

#[test]
fn without_iterations_the_fill_is_the_start() {
    let mesh = remove_vertices(&sphere(4), |p| p.z > 0.88);
    let options = ExemplarOptions { iterations: Some(0), ..Default::default() };
    let started = fill(&mesh, HoleChoice::All, FillMethod::Exemplar(options)).unwrap();
    let plain = fill(&mesh, HoleChoice::All, FillMethod::ThinPlate).unwrap();
    assert_eq!(started.mesh, plain.mesh);
    assert_eq!(started.trace.steps(), []);
    assert_eq!(started.warnings, plain.warnings);
}

#[test]
fn straight_rims_are_filled_without_faces_that_have_no_area() {
    let plane = grid(14, 13, |_, _| 0.0);
    for reach in [0.5, 1.5, 2.5] {
        for stretch in [0.5, 2.5] {
            let open = remove_vertices(&plane, |p| {
                (p.x - 6.0).abs() < reach + stretch && (p.y - 6.0).abs() < reach
            });
            for method in PLAIN {
                let filled = fill(&open, HoleChoice::Edges { max: 45 }, method.clone()).unwrap();
                let flat = filled.mesh.flat_faces();
                assert!(flat.is_empty(), "{method:?} {reach} {stretch}: {flat:?}");
                assert_eq!(check_kept(&open, &filled.mesh), 2 * (13 + 12));
            }
        }
    }
}
