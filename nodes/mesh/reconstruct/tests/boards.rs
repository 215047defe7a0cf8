use super::*;

/// Returns random points, one for each square mm, of the two large sides of a board of 50 x 30 mm, with noise.
fn board(thickness: f64, noise: f64, seed: u64) -> Vec<Point3<f64>> {
    let mut random = Random(seed);
    (0..3000)
        .map(|k: usize| {
            let z = thickness * (k % 2) as f64;
            let at = Vector3::new(50.0 * random.even(), 30.0 * random.even(), z);
            Point3::from(at + random.noise(noise))
        })
        .collect()
}

/// Checks that the closed surface of a board is within 1 mm, the spacing of its points, of its sides, and bends around its rim.
fn check_board(thickness: f64, noise: f64) {
    for seed in 0..2 {
        let mesh = skin(board(thickness, noise, seed), &Options::default());
        for at in mesh.positions().iter() {
            let out = [at.x - 50.0, -at.x, at.y - 30.0, -at.y].into_iter().fold(-9.0, f64::max);
            let side = at.z.abs().min((at.z - thickness).abs());
            let bulge = 1.5 + 0.5 * thickness;
            assert!(side < 1.0 || -2.0 < out, "{thickness} {noise}: {at}");
            assert!(out < bulge && side < bulge, "{thickness} {noise}: {at}");
        }
    }
}

#[test]
fn both_sides_of_a_board_make_a_board() {
    check_board(2.0, 0.1);
    check_board(2.0, 0.2);
    check_board(2.5, 0.3);
}

#[test]
fn both_sides_of_a_thick_board_make_a_board() {
    check_board(3.0, 0.2);
    check_board(4.0, 0.3);
    check_board(5.0, 0.1);
}

#[test]
fn both_sides_of_a_thin_board_make_a_board() {
    check_board(1.0, 0.1);
    check_board(1.25, 0.3);
    check_board(1.5, 0.2);
}

#[test]
fn sides_that_cannot_be_told_apart_are_named() {
    let source = cloud(board(1.0, 0.3, 1));
    let options = Options::default();
    let result =
        reconstruct_with_warnings(&[source], Poses::Auto, &options, &Progress::silent()).unwrap();
    let is_named = result.warnings.iter().any(|it| it.contains("is far from all points"));
    assert!(is_named, "{:?}", result.warnings);
}

/// Checks the closed surface of both sides of a bent and turned board: a third of a tube with a middle radius of 20 mm.
fn check_bent_board(thickness: f64, noise: f64, seed: u64) {
    let rotation = nalgebra::Rotation3::from_euler_angles(0.3 + seed as f64, 0.5, 0.7);
    let bent = board(thickness, noise, seed).into_iter().map(|at| {
        let radius = 20.0 + at.z - thickness / 2.0;
        let angle = at.x / 20.0;
        rotation * Point3::new(radius * libm::cos(angle), radius * libm::sin(angle), at.y)
    });
    let mesh = skin(bent.collect(), &Options::default());
    let mut most = 0.0_f64;
    for at in mesh.positions().iter().map(|at| rotation.inverse() * at) {
        let angle = libm::atan2(at.y, at.x);
        let height = (at.x * at.x + at.y * at.y).sqrt() - 20.0;
        if (0.2..2.3).contains(&angle) && (2.0..28.0).contains(&at.z) {
            most = most.max((height.abs() - thickness / 2.0).abs());
        }
    }
    assert!(most < 1.0, "{thickness} {noise} {seed}: {most}");
}

#[test]
fn both_sides_of_a_bent_board_make_a_board() {
    check_bent_board(1.25, 0.2, 0);
    check_bent_board(2.0, 0.1, 1);
    check_bent_board(3.0, 0.3, 2);
}

#[test]
fn points_far_from_the_origin_make_the_same_surface() {
    // Coordinates are multiples of 1/64 mm, so that they are exact far away.
    let points: Vec<_> =
        torus(3000, 0.1).iter().map(|at| (at * 64.0).map(f64::round) / 64.0).collect();
    let away = Vector3::new(134_217_728.0, -134_217_728.0, 67_108_864.0);
    for spacing in [0.0, 6.0] {
        let options = Options { spacing, ..Options::default() };
        let far = skin(points.iter().map(|at| at + away).collect(), &options);
        let near = skin(points.clone(), &options);
        assert_eq!(near.faces().len(), far.faces().len());
        for (a, b) in near.positions().iter().zip(far.positions().iter()) {
            assert!((a - (b - away)).norm() < 1e-6, "{a} {b}");
        }
    }
}
