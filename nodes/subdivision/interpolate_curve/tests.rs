use std::f64::consts::TAU;

use super::super::subdivide_curve::{CurveScheme, subdivide_curve};
use super::*;
use crate::solve::interpolation::{Direction, Norm, Solver};

fn ring(radius: impl Fn(usize) -> [f64; 2]) -> Curve {
    Curve::polyline(
        (0..12)
            .map(|k: usize| {
                let angle = TAU * k as f64 / 12.0;
                let [x, y] = radius(k);
                Point3::new(x * libm::cos(angle), y * libm::sin(angle), 0.0)
            })
            .collect::<Vec<_>>(),
        true,
    )
    .unwrap()
}

fn ellipse() -> Curve {
    ring(|_| [2.0, 1.0])
}

fn star() -> Curve {
    ring(|k| [if k % 2 == 0 { 1.3 } else { 0.7 }; 2])
}

/// Creates an open curve in space.
fn helix(count: u32) -> Curve {
    Curve::polyline(
        (0..count)
            .map(|k: u32| {
                let t = f64::from(k) * TAU / 6.0;
                Point3::new(5.0 * libm::cos(t), 5.0 * libm::sin(t), t)
            })
            .collect::<Vec<_>>(),
        false,
    )
    .unwrap()
}

fn plain(foot: Foot) -> Interpolation {
    Interpolation { foot, solver: Solver::Plain, ..Interpolation::default() }
}

fn interpolate_points(
    curve: &Curve,
    basis: CurveBasis,
    options: &Interpolation,
) -> InterpolationResult<Curve> {
    interpolate_curve(curve, basis, options, &Progress::silent()).unwrap()
}

/// Returns the numbers of iterations after which the largest distance is below 1e-3, 1e-4, 1e-5 and 1e-6 of the diagonal of the points'
/// bounding box.
fn counts(curve: &Curve, basis: CurveBasis, options: &Interpolation) -> [u64; 4] {
    let size = crate::solve::extent::diagonal(curve.points());
    let trace = interpolate_points(curve, basis, options).trace;
    [1e-3, 1e-4, 1e-5, 1e-6].map(|tolerance| {
        let under = trace.steps().iter().find(|step| step.max < tolerance * size);
        under.expect("the iteration settles").iteration
    })
}

#[test]
fn the_geometric_iteration_needs_the_reference_numbers_of_iterations() {
    fn check(curve: Curve, basis: CurveBasis, foot: Foot, expected: [u64; 4]) {
        for direction in [Direction::Residual, Direction::Normal] {
            // The step direction is the normal at the foot point. With `Foot::Vertex` the line to the foot point need not be perpendicular
            // to the curve, so this combination is not compared.
            if foot == Foot::Closest || direction == Direction::Residual {
                let how = Interpolation { direction, ..plain(foot) };
                assert_eq!(counts(&curve, basis, &how), expected, "{basis:?} {foot:?}");
            }
        }
    }
    check(ellipse(), CurveBasis::Chaikin, Foot::Vertex, [1, 2, 3, 3]);
    check(ellipse(), CurveBasis::Chaikin, Foot::Closest, [2, 3, 5, 8]);
    check(ellipse(), CurveBasis::Cubic, Foot::Vertex, [1, 2, 3, 4]);
    check(ellipse(), CurveBasis::Cubic, Foot::Closest, [2, 5, 8, 11]);
    for foot in [Foot::Vertex, Foot::Closest] {
        check(star(), CurveBasis::Chaikin, foot, [5, 8, 11, 14]);
        check(star(), CurveBasis::Cubic, foot, [9, 14, 19, 23]);
    }
}

#[test]
fn every_solver_finds_the_curve_through_the_points() {
    for curve in [ellipse(), star(), helix(19), helix(2), helix(3)] {
        for basis in [CurveBasis::Chaikin, CurveBasis::Cubic, CurveBasis::BSpline(1)] {
            let family = ControlCurve::new(basis, curve.points(), curve.is_closed()).unwrap();
            for solver in [Solver::Pcg, Solver::Plain, Solver::Direct] {
                let how = Interpolation { solver, tolerance: 1e-12, ..plain(Foot::Vertex) };
                let found = interpolate_points(&curve, basis, &how);
                assert!(found.settled, "{basis:?} {solver:?} {:?}", found.trace);
                let through = family.curve(found.shape.points()).unwrap();
                for (&t, point) in family.parameters().iter().zip(curve.points().iter()) {
                    assert!((through.point(t) - point).norm() <= 1e-10, "{basis:?} {solver:?}");
                }
            }
        }
    }
}

#[test]
fn b_splines_of_every_degree_pass_through_the_points() {
    for degree in 1..=9 {
        for curve in [star(), helix(19)] {
            for solver in [Solver::Pcg, Solver::Direct] {
                let how = Interpolation { solver, tolerance: 1e-10, ..plain(Foot::Vertex) };
                let how = Interpolation { iterations: 2000, ..how };
                let found = interpolate_points(&curve, CurveBasis::BSpline(degree), &how);
                assert!(found.settled, "{degree} {solver:?}");
                assert_eq!(found.shape.is_closed(), curve.is_closed());
                for &point in curve.points().iter() {
                    let distance = found.shape.closest(point).distance;
                    assert!(distance <= 1e-8, "{degree} {solver:?} {distance}");
                }
            }
        }
    }
}

#[test]
fn the_limit_of_the_subdivision_passes_through_the_points() {
    let schemes =
        [(CurveBasis::Chaikin, CurveScheme::Chaikin), (CurveBasis::Cubic, CurveScheme::Cubic)];
    for (basis, scheme) in schemes {
        for curve in [star(), helix(19)] {
            let how = Interpolation { tolerance: 1e-9, ..Interpolation::default() };
            let control = interpolate_points(&curve, basis, &how).shape;
            let refined = subdivide_curve(&control, scheme, 9).unwrap();
            for &point in curve.points().iter() {
                assert!(refined.closest(point).distance <= 2e-5, "{scheme:?}");
            }
        }
    }
}

#[test]
fn both_norms_stop_where_they_say() {
    for norm in [Norm::Max, Norm::Mean] {
        let how = Interpolation { norm, tolerance: 1e-4, ..plain(Foot::Vertex) };
        let trace = interpolate_points(&star(), CurveBasis::Cubic, &how).trace;
        let allowed = 1e-4 * crate::solve::extent::diagonal(star().points());
        let distances: Vec<_> = trace
            .steps()
            .iter()
            .map(|step| match norm {
                Norm::Max => step.max,
                Norm::Mean => step.rms,
            })
            .collect();
        let (last, before) = distances.split_last().unwrap();
        assert!(*last <= allowed && before.iter().all(|distance| *distance > allowed));
    }
}

#[test]
fn invalid_input_is_an_error() {
    fn interpolate_error(curve: &Curve, basis: CurveBasis, options: &Interpolation) -> String {
        interpolate_curve(curve, basis, options, &Progress::silent()).unwrap_err().to_string()
    }
    let closest = Interpolation { foot: Foot::Closest, ..Interpolation::default() };
    let not_linear = interpolate_error(&star(), CurveBasis::Cubic, &closest);
    assert!(not_linear.starts_with("solver Pcg solves only linear equations"), "{not_linear}");
    let spline =
        interpolate_points(&star(), CurveBasis::BSpline(3), &Interpolation::default()).shape;
    assert_eq!(
        interpolate_error(&spline, CurveBasis::Cubic, &Interpolation::default()),
        "the curve is a B-spline; only the points of a polyline are interpolated"
    );
    let few = interpolate_error(&helix(3), CurveBasis::BSpline(3), &Interpolation::default());
    assert_eq!(
        few,
        "`BSpline(3)` needs at least 4 points, the open polyline has 3; add points, or use `BSpline(2)`"
    );
}

#[test]
fn alternating_points_are_met_by_every_foot_and_direction() {
    for (closed, count, amplitude) in [false, true]
        .into_iter()
        .flat_map(|closed| [8, 13, 40].map(|count| (closed, count)))
        .flat_map(|(closed, count)| [0.1, 1.0, 10.0].map(|a| (closed, count, a)))
    {
        let curve = Curve::polyline(
            (0..count)
                .map(|k: u32| {
                    let sign = if k.is_multiple_of(2) { amplitude } else { -amplitude };
                    let angle = TAU * f64::from(k) / f64::from(count);
                    let radius = f64::from(count) / TAU;
                    match closed {
                        true => {
                            Point3::new(radius * libm::cos(angle), radius * libm::sin(angle), sign)
                        }
                        false => Point3::new(f64::from(k), sign, 0.0),
                    }
                })
                .collect::<Vec<_>>(),
            closed,
        )
        .unwrap();
        for basis in [CurveBasis::Chaikin, CurveBasis::Cubic, CurveBasis::BSpline(3)] {
            for (foot, direction) in [
                (Foot::Vertex, Direction::Residual),
                (Foot::Vertex, Direction::Normal),
                (Foot::Closest, Direction::Residual),
                (Foot::Closest, Direction::Normal),
            ] {
                let name = format!("{closed} {count} {amplitude} {basis:?} {foot:?} {direction:?}");
                let how = Interpolation { direction, ..plain(foot) };
                let found = interpolate_curve(&curve, basis, &how, &Progress::silent());
                let found = found.unwrap_or_else(|error| panic!("{name}: {error}"));
                assert!(found.settled, "{name}");
                let family = ControlCurve::new(basis, curve.points(), closed).unwrap();
                let through = match basis {
                    CurveBasis::BSpline(_) => found.shape,
                    _ => family.curve(found.shape.points()).unwrap(),
                };
                let allowed = 1.001e-6 * crate::solve::extent::diagonal(curve.points());
                for &point in curve.points().iter() {
                    let distance = through.closest(point).distance;
                    assert!(distance <= allowed, "{name}: {distance}");
                }
            }
        }
    }
}
