//! Tests against the tables of algorithms.md, 9.2 and 9.4.

use super::*;

/// Returns the maximum displacement, the root mean square displacement, and the maximum along each axis, for 4000 random points. The
/// handles are at rest and deform in the absolute form.
fn contraction(sigma: [f64; 3]) -> (f64, f64, [f64; 3]) {
    let points = Random(7).points(4000);
    let result = move_points(&points, &corners(sigma), options_in_unit(Mode::Absolute));
    let steps: Vec<Vector3<f64>> = points.iter().zip(&result).map(|(a, b)| b - a).collect();
    let max = steps.iter().map(|step| step.norm()).fold(0.0, f64::max);
    let rms = (steps.iter().map(|step| step.norm_squared()).sum::<f64>() / 4000.0).sqrt();
    fn axis(axis: usize, steps: &[Vector3<f64>]) -> f64 {
        steps.iter().map(|step| step[axis].abs()).fold(0.0, f64::max)
    }
    (max, rms, [axis(0, &steps), axis(1, &steps), axis(2, &steps)])
}

/// Returns true if two numbers agree within 2 percent, or within the last digit of the table, whose smallest numbers have one digit.
fn is_near(found: f64, expected: f64, digits: f64) -> bool {
    (found - expected).abs() <= f64::max(0.02 * expected, digits)
}

#[test]
fn handles_at_rest_contract_as_in_the_table_of_the_absolute_form() {
    for (sigma, cond, max, rms) in [
        (0.1, 1.000, 0.7579, 0.4716),
        (0.2, 1.000, 0.5752, 0.3821),
        (0.3, 1.023, 0.3544, 0.2486),
        (0.5, 2.264, 0.0929, 0.0665),
        (0.75, 13.76, 0.0211, 0.0151),
        (1.0, 68.07, 0.00685, 0.00492),
        (2.0, 4112.0, 0.00043, 0.00031),
        (4.0, 2.6e5, 3e-5, 2e-5),
    ] {
        let (found_max, found_rms, _) = contraction([sigma; 3]);
        let found_cond = condition(&corners([sigma; 3]));
        assert!(is_near(found_cond, cond, 0.0), "{sigma}: condition {found_cond}");
        assert!(is_near(found_max, max, 5e-6), "{sigma}: max {found_max}");
        assert!(is_near(found_rms, rms, 5e-6), "{sigma}: rms {found_rms}");
    }
    let (_, _, axes) = contraction([0.5, 0.25, 0.25]);
    for (found, expected) in axes.into_iter().zip([0.0537, 0.2687, 0.2687]) {
        assert!(is_near(found, expected, 0.0), "{axes:?}");
    }
}

/// Returns handles at the corners of the unit cube, and a ninth handle at `distance` from the first one, moved by 0.1.
fn twin(distance: f64) -> Vec<Handle> {
    let mut handles = corners([0.5; 3]);
    let at = Point3::new(distance, 0.0, 0.0);
    handles.push(handle(at, at + Vector3::new(0.1, 0.0, 0.0), [0.5; 3]));
    handles
}

#[test]
fn a_handle_near_another_has_the_condition_of_the_table() {
    for (distance, most_error) in [(1e-1, 1e-14), (1e-2, 1e-12), (1e-3, 5e-11), (1e-4, 7e-9)] {
        let handles = twin(distance);
        let prepared = prepare(&in_world(&handles), UNIT, Mode::Displacement, 0.0, 0.0).unwrap();
        let system = solve(&handles, Mode::Displacement);
        let deformation = pull::deformation(&prepared, &system);
        let greatest = (0..9)
            .map(|k: usize| Vector3::from(deformation.terms[k].value).norm())
            .fold(0.0, f64::max);
        let (_, report) =
            try_move(&[Point3::origin()], &handles, options_in_unit(Mode::Displacement)).unwrap();
        let found = condition(&handles);
        assert!((found * distance * distance / 1.34 - 1.0).abs() <= 0.06, "{distance}: {found}");
        assert!((0.3..9.0).contains(&(report.condition / found)), "{distance}");
        assert!(report.residual <= most_error, "{distance}: {}", report.residual);
        if distance == 1e-3 {
            assert!((greatest / 6.7e4 - 1.0).abs() <= 0.05, "{greatest}");
        }
    }
    let error = try_move(&[Point3::origin()], &twin(1e-6), options_in_unit(Mode::Displacement))
        .unwrap_err();
    let error = error.to_string();
    assert!(error.starts_with("the handles cannot all reach their targets"), "{error}");
}

#[test]
fn random_handles_have_conditions_of_the_order_of_the_table() {
    for (count, table) in [(64, [1.5e2, 1.3e4, 3.9e8]), (256, [1.1e3, 2.3e6, 1.9e14])] {
        for (sigma, expected) in [0.1, 0.2, 0.5].into_iter().zip(table) {
            let positions = Random(11).points(count);
            let handles: Vec<Handle> =
                positions.into_iter().map(|at| handle(at, at, [sigma; 3])).collect();
            let found = condition(&handles);
            // The positions are random, and the nearest pair of handles determines the condition number, so allow a large difference.
            let ratio = libm::log10(found / expected).abs();
            assert!(ratio <= 1.5, "{count} {sigma}: {found:e} {expected:e}");
        }
    }
}
