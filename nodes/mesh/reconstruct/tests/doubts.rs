use super::*;

fn warnings(source: Scattered) -> Vec<String> {
    let options = Options::default();
    reconstruct_with_warnings(&[source], Poses::Auto, &options, &Progress::silent())
        .unwrap()
        .warnings
}

/// Checks that a reconstruction has one warning, which begins with `start`.
fn check_warning(source: Scattered, start: &str) {
    let found = warnings(source);
    assert!(found.len() == 1 && found[0].starts_with(start), "{found:?}");
}

#[test]
fn points_of_one_surface_have_no_warning() {
    assert_eq!(warnings(cloud(sphere(4000, 0.0))), Vec::<String>::new());
    assert_eq!(warnings(cloud(torus(4000, 0.3))), Vec::<String>::new());
}

#[test]
fn outliers_are_counted() {
    let mut points = sphere(4000, 0.0);
    let mut random = Random(5);
    points.extend((0..5).map(|_| Point3::from(random.noise(1.0).normalize() * 120.0)));
    let found = warnings(cloud(points));
    assert!(found[0].starts_with("5 points are more than"), "{found:?}");
}

#[test]
fn normals_with_random_signs_are_named() {
    let points = sphere(4000, 0.0);
    let mut random = Random(5);
    let normals: Vec<[f64; 3]> = points
        .iter()
        .map(|at| {
            let sign = if random.even() < 0.5 { -1.0 } else { 1.0 };
            (at.coords.normalize() * sign).into()
        })
        .collect();
    let points = Points::new(points).unwrap();
    let points = points.with_attribute("normal", Attribute::Vector(normals.into())).unwrap();
    let found = warnings(Scattered::Points(points));
    assert!(
        found[0].starts_with("the given normals of neighboring points are opposite"),
        "{found:?}"
    );
}

#[test]
fn parts_far_smaller_than_the_largest_are_named() {
    let mut points = sphere(4000, 0.0);
    let crumb: Vec<_> = points
        .iter()
        .step_by(20)
        .map(|point| point * 0.08 + Vector3::new(70.0, 0.0, 0.0))
        .collect();
    points.extend(crumb);
    check_warning(cloud(points), "1 part is smaller than a hundredth of the largest part");
}

#[test]
fn points_of_thin_parts_that_a_coarse_surface_misses_are_named() {
    let mut points = sphere(8000, 0.0);
    let mut random = Random(6);
    // A rod of 3 mm in a surface of edges of 12 mm.
    points.extend((0..1500).map(|_| {
        let angle = std::f64::consts::TAU * random.even();
        Point3::new(50.0 + 60.0 * random.even(), 1.5 * libm::cos(angle), 1.5 * libm::sin(angle))
    }));
    let options = Options { spacing: 12.0, ..Options::default() };
    let result =
        reconstruct_with_warnings(&[cloud(points)], Poses::Auto, &options, &Progress::silent());
    let found = result.unwrap().warnings;
    assert!(found.iter().any(|it| it.contains("farther than half of `spacing`")), "{found:?}");
}
