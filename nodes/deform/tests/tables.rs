//! The tables of algorithms.md, 9.2 and 9.4.

use super::*;

/// Greatest displacement, its root mean square, and the greatest along each axis, of 4000 points when nothing is moved.
fn squeeze(sigma: [f64; 3]) -> (f64, f64, [f64; 3]) {
    let points = Random(7).points(4000);
    let there = moved(&points, &corners(sigma), how(Mode::Absolute));
    let steps: Vec<Vector3<f64>> = points.iter().zip(&there).map(|(a, b)| b - a).collect();
    let most = steps.iter().map(|step| step.norm()).fold(0.0, f64::max);
    let rms = (steps.iter().map(|step| step.norm_squared()).sum::<f64>() / 4000.0).sqrt();
    fn axis(axis: usize, steps: &[Vector3<f64>]) -> f64 {
        steps.iter().map(|step| step[axis].abs()).fold(0.0, f64::max)
    }
    (most, rms, [axis(0, &steps), axis(1, &steps), axis(2, &steps)])
}

/// Sampled maxima are the same within 2 percent; the last numbers of the table have one digit.
fn near(found: f64, expected: f64, digits: f64) -> bool {
    (found - expected).abs() <= f64::max(0.02 * expected, digits)
}

#[test]
fn unmoved_handles_squeeze_as_in_the_table_of_the_absolute_form() {
    for (sigma, cond, most, rms) in [
        (0.1, 1.000, 0.7579, 0.4716),
        (0.2, 1.000, 0.5752, 0.3821),
        (0.3, 1.023, 0.3544, 0.2486),
        (0.5, 2.264, 0.0929, 0.0665),
        (0.75, 13.76, 0.0211, 0.0151),
        (1.0, 68.07, 0.00685, 0.00492),
        (2.0, 4112.0, 0.00043, 0.00031),
        (4.0, 2.6e5, 3e-5, 2e-5),
    ] {
        let (found_most, found_rms, _) = squeeze([sigma; 3]);
        let found_cond = condition(&corners([sigma; 3]));
        assert!(near(found_cond, cond, 0.0), "{sigma}: condition {found_cond}");
        assert!(near(found_most, most, 5e-6), "{sigma}: max {found_most}");
        assert!(near(found_rms, rms, 5e-6), "{sigma}: rms {found_rms}");
    }
    let (_, _, axes) = squeeze([0.5, 0.25, 0.25]);
    for (found, expected) in axes.into_iter().zip([0.0537, 0.2687, 0.2687]) {
        assert!(near(found, expected, 0.0), "{axes:?}");
    }
}

/// The corners and a ninth handle so far from the first, moved by 0.1.
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
        let (_, report) = try_move(&[Point3::origin()], &handles, how(Mode::Displacement)).unwrap();
        let found = condition(&handles);
        assert!((found * distance * distance / 1.34 - 1.0).abs() <= 0.06, "{distance}: {found}");
        assert!((0.3..9.0).contains(&(report.condition / found)), "{distance}");
        assert!(report.residual <= most_error, "{distance}: {}", report.residual);
        if distance == 1e-3 {
            assert!((greatest / 6.7e4 - 1.0).abs() <= 0.05, "{greatest}");
        }
    }
    let error = try_move(&[Point3::origin()], &twin(1e-6), how(Mode::Displacement)).unwrap_err();
    assert!(matches!(error, FfdError::Singular { condition } if condition > 1e12), "{error}");
}

#[test]
fn random_handles_have_conditions_of_the_order_of_the_table() {
    for (count, table) in [(64, [1.5e2, 1.3e4, 3.9e8]), (256, [1.1e3, 2.3e6, 1.9e14])] {
        for (sigma, expected) in [0.1, 0.2, 0.5].into_iter().zip(table) {
            let places = Random(11).points(count);
            let handles: Vec<Handle> =
                places.into_iter().map(|at| handle(at, at, [sigma; 3])).collect();
            let found = condition(&handles);
            // Other random places, whose nearest pair decides.
            let ratio = libm::log10(found / expected).abs();
            assert!(ratio <= 1.5, "{count} {sigma}: {found:e} {expected:e}");
        }
    }
}
