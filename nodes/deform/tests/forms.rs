//! Tests of the modes of a deformation: invariants, exact targets, and motions that must be reproduced.

use maquette_node::Error;

use super::*;

#[test]
fn handles_meet_their_targets_in_every_form() {
    let mut random = Random(1);
    for (sides, reach) in [(2, 0.6), (4, 0.6), (4, 0.9)] {
        let handles = scattered_handles(&mut random, sides, reach);
        let at: Vec<Point3<f64>> = handles.iter().map(|handle| handle.at.into()).collect();
        let to: Vec<Point3<f64>> = handles.iter().map(|handle| handle.to.unwrap().into()).collect();
        for mode in MODES {
            let (result, report) = try_move(&at, &handles, options_in_unit(mode)).unwrap();
            assert!(report.condition <= 1e6, "{}", report.condition);
            assert!(farthest(&result, &to) <= 1e-10, "{mode:?}: {}", farthest(&result, &to));
            assert!(report.residual <= 1e-10);
        }
        let with_background = (Mode::Displacement, DeformOptions { background: 0.1, ..in_unit() });
        assert!(farthest(&move_points(&at, &handles, with_background), &to) <= 1e-10);
    }
}

#[test]
fn handles_at_rest_change_no_bit() {
    let mut points = Random(2).points(1000);
    points.extend([Point3::new(-0.0, 1e300, -1e-310), Point3::new(0.0, -0.0, 1e9)]);
    fn bits(points: &[Point3<f64>]) -> Vec<u64> {
        points.iter().flat_map(|point| point.coords.iter().map(|x| x.to_bits())).collect::<Vec<_>>()
    }
    for mode in [Mode::Displacement, Mode::Affine] {
        let result = move_points(&points, &corners([0.5, 0.3, 2.0]), options_in_unit(mode));
        assert_eq!(bits(&result), bits(&points), "{mode:?}");
    }
    assert_eq!(bits(&move_points(&points, &[], options_in_unit(Mode::Absolute))), bits(&points));
}

#[test]
fn points_far_away_follow_the_nearest_handle() {
    let mut handles = corners([0.3, 0.4, 0.2]);
    handles[7].to = Some([1.0, 1.0, 1.25]);
    for far in [60.0, 1e6, 1e9] {
        let points = [Point3::new(far, far, far), Point3::new(-far, 0.0, 0.0)];
        let result = move_points(&points, &handles, options_in_unit(Mode::Displacement));
        let coefficient = result[0] - points[0];
        assert!((coefficient.z - 0.25).abs() <= 0.05, "{far}: {coefficient}");
        assert!(result.iter().all(|point| point.coords.iter().all(|x| x.is_finite())));
        let (_, jacobian) = deform_point(&handles, Mode::Displacement, points[0]);
        // The slopes of the Gaussians, about far / sigma^2, cancel each other, which amplifies rounding errors.
        let rounding = 1e-15 * far / 0.04;
        assert!((jacobian - Matrix3::identity()).norm() <= rounding, "{jacobian}");
    }
}

#[test]
fn vanishing_sums_are_continuous() {
    // The positions of the second point are on both sides of the distance at which the sums of the Gaussians underflow.
    let handles = vec![
        handle(Point3::origin(), Point3::new(0.1, 0.0, 0.0), [0.05; 3]),
        handle(Point3::new(0.1, 0.0, 0.0), Point3::new(0.1, 0.1, 0.0), [0.05; 3]),
    ];
    fn moved_at(x: f64, handles: &[Handle]) -> Point3<f64> {
        move_points(&[Point3::new(0.05, x, 0.0)], handles, options_in_unit(Mode::Displacement))[0]
    }
    let border = (2.0 * 150.0 * std::f64::consts::LN_10).sqrt() * 0.05;
    let steps = (0..200).map(|k| moved_at(border * (0.99 + 1e-4 * f64::from(k)), &handles));
    let steps: Vec<f64> = steps.map(|point| point.x).collect();
    assert!(steps.windows(2).all(|pair| (pair[0] - pair[1]).abs() <= 1e-13));
}

#[test]
fn an_affine_map_of_all_targets_maps_the_result() {
    let mut random = Random(5);
    let handles = scattered_handles(&mut random, 3, 0.8);
    let linear = Matrix3::new(1.1, 0.3, -0.2, 0.0, 0.7, 0.4, 0.5, -0.1, 1.3);
    let map = |point: Point3<f64>| Point3::from(linear * point.coords + Vector3::new(3., -1., 2.));
    let points = random.points(200);
    let mapped: Vec<Handle> = handles
        .iter()
        .map(|handle| Handle { to: Some(map(handle.to.unwrap().into()).into()), ..*handle })
        .collect();
    let first: Vec<_> = move_points(&points, &handles, options_in_unit(Mode::Absolute))
        .into_iter()
        .map(map)
        .collect();
    let off = farthest(&first, &move_points(&points, &mapped, options_in_unit(Mode::Absolute)));
    assert!(off <= 1e-12, "{off}");
}

#[test]
fn scaling_all_weights_changes_nothing() {
    let mut random = Random(6);
    let handles = scattered_handles(&mut random, 3, 0.8);
    let points = random.points(100);
    let scaled: Vec<Handle> =
        handles.iter().map(|handle| Handle { weight: 1024.0 * handle.weight, ..*handle }).collect();
    for mode in MODES {
        let off = farthest(
            &move_points(&points, &handles, options_in_unit(mode)),
            &move_points(&points, &scaled, options_in_unit(mode)),
        );
        assert!(off <= 1e-12, "{mode:?}: {off}");
    }
}

#[test]
fn a_single_handle_moves_everything_rigidly() {
    let step = Vector3::new(0.3, -2.0, 0.125);
    let at = Point3::new(0.5, 0.2, 0.9);
    let points = Random(7).points(100);
    let expected: Vec<_> = points.iter().map(|point| point + step).collect();
    for mode in [Mode::Displacement, Mode::Affine] {
        let result =
            move_points(&points, &[handle(at, at + step, [0.1; 3])], options_in_unit(mode));
        assert!(farthest(&result, &expected) <= 1e-14, "{mode:?}");
    }
}

#[test]
fn the_affine_form_reproduces_affine_motions_of_handles() {
    let linear = Matrix3::new(0.8, 0.3, -0.2, 0.1, 1.2, 0.4, 0.5, -0.1, 0.9);
    fn map(point: Point3<f64>, linear: &Matrix3<f64>) -> Point3<f64> {
        Point3::from(*linear * point.coords + Vector3::new(3., -1., 2.))
    }
    let mut random = Random(8);
    let points = random.points(100);
    let expected: Vec<_> = points.iter().map(|&point| map(point, &linear)).collect();
    for (count, regularize) in [(4, 0.0), (5, 0.0), (30, 0.0), (30, 0.01)] {
        let positions = random.points(count);
        let handles: Vec<_> =
            positions.iter().map(|&at| handle(at, map(at, &linear), [0.2; 3])).collect();
        let result = move_points(
            &points,
            &handles,
            (Mode::Affine, DeformOptions { regularize, ..in_unit() }),
        );
        assert!(farthest(&result, &expected) <= 1e-10, "{count}: {}", farthest(&result, &expected));
    }
}

#[test]
fn the_affine_form_uses_fewer_directions_for_flat_handles() {
    // The sets of handles are: several in a plane, several on a line, a single one, and two at the same height. Each set must reproduce a
    // class of motions.
    let plane = [[0., 0., 0.], [1., 0., 0.], [0., 1., 0.], [1., 1., 0.], [0.3, 0.6, 0.]];
    let line = [[0.; 3], [0.5, 0.25, 0.], [1., 0.5, 0.]];
    for positions in [&plane[..], &line, &plane[..1], &plane[..2]] {
        fn rotate(at: &[f64; 3]) -> Point3<f64> {
            Point3::new(-at[1], at[0], at[2] + 0.1)
        }
        let handles: Vec<_> =
            positions.iter().map(|at| handle(Point3::from(*at), rotate(at), [0.4; 3])).collect();
        let at: Vec<_> = positions.iter().map(|&at| Point3::from(at)).collect();
        let to: Vec<_> = positions.iter().map(rotate).collect();
        assert!(farthest(&move_points(&at, &handles, options_in_unit(Mode::Affine)), &to) <= 1e-12);
    }
}

#[test]
fn leaving_handles_out_changes_less_than_the_accuracy() {
    let mut random = Random(9);
    let mut points = random.points(20_000);
    // Add points so far away that the powers underflow and only their ratios count.
    points.extend(random.points(500).into_iter().map(|point| point * 40.0));
    for (mode, background) in [
        (Mode::Displacement, 0.0),
        (Mode::Displacement, 0.01),
        (Mode::Absolute, 0.0),
        (Mode::Affine, 0.0),
    ] {
        for reach in [0.2, 0.35, 0.7] {
            let handles = scattered_handles(&mut random, 4, reach);
            let exact = DeformOptions { background, ..in_unit() };
            let fast = DeformOptions { accuracy: 1e-7, ..exact };
            let off = farthest(
                &move_points(&points, &handles, (mode, exact)),
                &move_points(&points, &handles, (mode, fast)),
            );
            assert!(off <= 1e-7, "{mode:?} {background} {reach}: {off:e}");
        }
    }
}

#[test]
fn coincident_handles_are_merged_or_rejected() {
    let mut handles = corners([0.5; 3]);
    let near = Point3::new(4e-7, 0.0, 0.0);
    handles.push(handle(near, Point3::new(0.0, 0.0, 5e-10), [0.5; 3]));
    handles[3].to = Some([1.0, 1.5, 0.0]);
    let (_, report) = try_move(&[near], &handles, options_in_unit(Mode::Displacement)).unwrap();
    assert_eq!(report.merged, [[8, 0]]);
    handles[8].to = Some([0.0, 0.0, 0.1]);
    let error = try_move(&[near], &handles, options_in_unit(Mode::Displacement)).unwrap_err();
    let conflicting = "handles 0 and 8 have the same position but different targets; remove one of them, or give both the same target";
    assert_eq!(error.to_string(), conflicting);
}

#[test]
fn regularization_solves_singular_systems_and_reports_the_residual() {
    let mut handles = corners([4.0; 3]);
    handles[7].to = Some([1.0, 1.0, 1.3]);
    handles.push(handle(Point3::new(1e-5, 0.0, 0.0), Point3::new(0.0, 0.1, 0.0), [4.0; 3]));
    let points = Random(10).points(100);
    let singular = try_move(&points, &handles, options_in_unit(Mode::Displacement));
    let singular = singular.unwrap_err().to_string();
    assert!(singular.starts_with("the handles cannot all reach their targets"), "{singular}");
    let with = |regularize: f64| {
        try_move(&points, &handles, (Mode::Displacement, DeformOptions { regularize, ..in_unit() }))
            .unwrap()
    };
    let ((calm, some), (_, more)) = (with(0.01), with(1.0));
    assert!(0.0 < some.residual && some.residual < more.residual && more.residual < 0.3);
    assert!(farthest(&calm, &points) < 1.0, "{}", farthest(&calm, &points));
    // Compare the result with that of the normal equations, whose condition number is the square of the system's.
    let layout = layout(&handles, Mode::Displacement);
    let gaussians = layout.gaussians();
    let n = handles.len();
    let rows = layout.positions.iter().flat_map(|&at| gaussians.weights(at));
    let m = DMatrix::from_row_iterator(n, n, rows);
    let moves =
        DMatrix::from_fn(n, 3, |row, axis| handles[row].to.unwrap()[axis] - handles[row].at[axis]);
    let normal = m.transpose() * &m + DMatrix::identity(n, n) * 0.01 * 0.01;
    let values = normal.lu().solve(&(m.transpose() * moves)).unwrap();
    for (point, result) in points.iter().zip(&calm) {
        let weights = DMatrix::from_row_iterator(1, n, gaussians.weights(*point));
        let step = weights * &values;
        let off = (result - point - Vector3::new(step[0], step[1], step[2])).norm();
        assert!(off <= 1e-9, "{off}");
    }
}

#[test]
fn points_stay_in_the_hull_of_the_coefficients() {
    let mut random = Random(12);
    let handles = scattered_handles(&mut random, 3, 0.6);
    let prepared = prepare(&in_world(&handles), UNIT, Mode::Absolute, 0.0, 0.0).unwrap();
    let deformation = pull::deformation(&prepared, &solve(&handles, Mode::Absolute));
    let points: Vec<_> = random.points(2000).into_iter().map(|point| point * 3.0).collect();
    let result = move_points(&points, &handles, options_in_unit(Mode::Absolute));
    for _ in 0..100 {
        let direction = random.point() - Point3::new(0.5, 0.5, 0.5);
        fn reach(point: Vector3<f64>, direction: Vector3<f64>) -> f64 {
            point.dot(&direction)
        }
        let values = deformation.terms.iter().map(|term| reach(term.value.into(), direction));
        let hull = values.fold(f64::NEG_INFINITY, f64::max);
        let max = result
            .iter()
            .map(|point| reach(point.coords, direction))
            .fold(f64::NEG_INFINITY, f64::max);
        assert!(max <= hull + 1e-13, "{max} {hull}");
    }
}

#[test]
fn a_wider_ninth_handle_moves_more_points() {
    let points = Random(13).points(4000);
    let counts = [0.1, 0.2, 0.4].map(|sigma: f64| {
        let mut handles = corners([0.5; 3]);
        let at = Point3::new(0.5, 0.3, 0.9);
        handles.push(handle(at, at + Vector3::new(0.0, 0.0, 0.15), [sigma; 3]));
        let options = (Mode::Displacement, DeformOptions { background: 0.01, ..in_unit() });
        let result = move_points(&points, &handles, options);
        points.iter().zip(&result).filter(|(a, b)| (*b - *a).norm() > 0.0015).count()
    });
    assert!(counts[0] < counts[1] && counts[1] < counts[2], "{counts:?}");
}

#[test]
fn only_displacements_have_a_background_and_numbers_are_checked() {
    let base = in_unit();
    fn check(mode: Mode, options: DeformOptions) -> Result<(), Error> {
        try_move(&[Point3::origin()], &corners([1.0; 3]), (mode, options)).map(|_| ())
    }
    for mode in [Mode::Absolute, Mode::Affine] {
        let wrong = DeformOptions { background: 0.1, ..base };
        let error = check(mode, wrong).unwrap_err().to_string();
        assert!(error.starts_with("`background` is 0.1, but it must be 0 or more"), "{error}");
    }
    let mode = Mode::Displacement;
    assert!(check(mode, DeformOptions { background: -1.0, ..base }).is_err());
    assert!(check(mode, DeformOptions { regularize: f64::NAN, ..base }).is_err());
    assert!(check(mode, DeformOptions { accuracy: 1.0, ..base }).is_err());
    let many = vec![corners([1.0; 3])[0]; 2001];
    let error = try_move(&[Point3::origin()], &many, (mode, base)).unwrap_err();
    assert_eq!(error.to_string(), "expected at most 2000 handles, found 2001");
}

#[test]
fn omitted_deviations_are_chosen_from_the_distances() {
    let bare: Vec<Handle> =
        corners([1.0; 3]).into_iter().map(|handle| Handle { sigma: None, ..handle }).collect();
    // The three nearest corners are one side of the cube away.
    assert_eq!(layout(&bare, Mode::Displacement).sigma[0], [0.75; 3]);
    assert_eq!(layout(&bare, Mode::Absolute).sigma[0], [1.0; 3]);
    assert_eq!(layout(&bare[..1], Mode::Displacement).sigma[0], [1.0; 3]);
}
