//! Holes of odd shapes, in odd places and odd units.

use super::*;

/// Fills the holes of up to so many edges in all ways: the results are surfaces that run through nothing and go about as far as the data,
/// by `share` of its size. Gives how many border edges are left.
fn check(mesh: &Mesh, max: usize, share: f64) -> usize {
    fn bounds(mesh: &Mesh) -> (Point3<f64>, Point3<f64>) {
        let points = mesh.positions().iter();
        points.fold((mesh.positions()[0], mesh.positions()[0]), |(low, high), p| {
            (low.inf(p), high.sup(p))
        })
    }
    let (low, high) = bounds(mesh);
    let allowed = share * (high - low).norm();
    let exemplar =
        FillMethod::Exemplar(ExemplarOptions { iterations: Some(2), ..Default::default() });
    let open = PLAIN.into_iter().chain([exemplar]).map(|method| {
        let filled = fill(mesh, HoleChoice::Edges { max }, method.clone()).unwrap();
        let told = filled.warnings.iter().find(|warning| warning.contains("run through others"));
        assert_eq!(told, None, "{method:?}");
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

fn off(p: &Point3<f64>, x: f64, y: f64) -> f64 {
    libm::hypot(p.x - x, p.y - y)
}

#[test]
fn long_and_winding_holes_are_filled() {
    let slit = without(&grid(40, 12, |x, y| 3.0 * libm::sin(0.15 * x) + 0.02 * y * y), |p| {
        (p.y - 5.0).abs() < 0.5 && (4.0..36.0).contains(&p.x)
    });
    assert_eq!(check(&slit, 90, 0.05), 2 * (39 + 11));
    let spiral = without(&grid(40, 40, |x, y| libm::sin(0.1 * x) * libm::cos(0.1 * y)), |p| {
        let turn = libm::atan2(p.y - 19.5, p.x - 19.5) / std::f64::consts::TAU;
        let radius = off(p, 19.5, 19.5);
        (3.0..17.0).contains(&radius) && (radius / 7.0 - turn).rem_euclid(1.0) < 0.3
    });
    assert_eq!(check(&spiral, 400, 0.05), 4 * 39);
}

#[test]
fn holes_in_sheets_close_together_stay_apart() {
    fn hills(x: f64, y: f64) -> f64 {
        0.3 * libm::sin(0.3 * x) + 0.01 * y
    }
    let lower = without(&grid(24, 24, hills), |p| off(p, 12.0, 12.0) < 6.0);
    let upper = grid(24, 24, |x, y| hills(x, y) + 0.1);
    let upper = without(&upper, |p| off(p, 13.0, 11.0) < 5.0);
    let data = lower.positions().len() as u32;
    let points = lower.positions().iter().chain(upper.positions().iter()).copied();
    let faces = lower.faces().as_triangles().unwrap().to_vec();
    let above = upper
        .faces()
        .as_triangles()
        .unwrap()
        .iter()
        .map(|face| [face[0], face[2], face[1]].map(|vertex| vertex + data));
    let both = of(points.collect(), faces.into_iter().chain(above).collect());
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
    let mesh = without(&uneven, |p| off(p, 0.35, 0.3) < 0.25);
    assert_eq!(check(&mesh, 150, 0.05), 4 * 39);
}

#[test]
fn units_do_not_matter() {
    let mesh = without(&sphere(3), |p| p.z > 0.75 || p.x > 0.95);
    for method in PLAIN {
        let filled = fill(&mesh, HoleChoice::All, method.clone()).unwrap().mesh;
        // Powers of two, about 1e-6, 1e-4 and 1e6, so that nothing is rounded otherwise.
        for power in [-20, -13, 20] {
            let unit = libm::ldexp(1.0, power);
            let in_unit =
                |mesh: &Mesh| mesh.positions().iter().map(|p| p * unit).collect::<Vec<_>>();
            let scaled = mesh.with_positions(in_unit(&mesh)).unwrap();
            let other = fill(&scaled, HoleChoice::All, method.clone()).unwrap().mesh;
            assert_eq!(filled.faces(), other.faces(), "{method:?} {unit}");
            assert_eq!(in_unit(&filled), other.positions()[..], "{method:?} {unit}");
        }
    }
}

#[test]
fn more_triangles_than_can_be_made_are_refused_with_numbers_before_they_are() {
    let mesh = without(&grid(40, 40, |x, y| libm::sin(0.2 * x) + 0.1 * y), |p| {
        [p.x, p.y].iter().all(|at| (15.5..24.5).contains(at))
    });
    for edge in [3e-3, 1e-9, 1e-300] {
        let options = ExemplarOptions { edges: vec![edge], ..Default::default() };
        let error = fill(&mesh, HoleChoice::All, FillMethod::Exemplar(options)).err();
        let told = error.map_or_else(|| "nothing".into(), |error| error.to_string());
        let is_refused = told.starts_with("what fills rim 1 would need about ")
            && told.contains(" triangles, at most 1 000 000 are made: ");
        assert!(is_refused, "{edge}: {told}");
    }
}

#[test]
fn the_number_of_triangles_is_known_before() {
    use crate::triangles::density::{estimate, refine};
    use crate::triangles::triangulation::Triangulation;

    let corners = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
    let corners = corners.map(|[x, y]| Point3::new(x, y, 0.0));
    for (size, divisions) in [(0.02, 0), (0.02, 5000), (0.005, 5000)] {
        // From fine on the left to three times as coarse on the right.
        let target = |p: Point3<f64>| if divisions == 0 { size } else { size * (1.0 + 2.0 * p.x) };
        let mut triangulation = Triangulation::new(corners.to_vec(), 4, &[[0, 1, 2], [0, 2, 3]]);
        let known = estimate(&triangulation, target, divisions);
        refine(&mut triangulation, target, &Progress::none()).unwrap();
        let ratio = known / triangulation.n_faces() as f64;
        assert!((0.5..2.5).contains(&ratio), "{size}: {known} for {}", triangulation.n_faces());
    }
}

#[test]
fn without_iterations_the_start_is_taken_and_nothing_is_looked_for() {
    let mesh = without(&sphere(4), |p| p.z > 0.88);
    let options = ExemplarOptions { iterations: Some(0), ..Default::default() };
    let started = fill(&mesh, HoleChoice::All, FillMethod::Exemplar(options)).unwrap();
    let plain = fill(&mesh, HoleChoice::All, FillMethod::ThinPlate).unwrap();
    assert_eq!(started.mesh, plain.mesh);
    assert_eq!(started.trace.steps(), []);
    assert_eq!(started.warnings, plain.warnings);
}
