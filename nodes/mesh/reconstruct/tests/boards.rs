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
