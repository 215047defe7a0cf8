//! Tests of the wavelength of reliefs and of automatic rotations.

use super::super::wavelength::wavelength;
use super::*;

fn random(seed: u64) -> f64 {
    crate::shapes::random(seed)
}

/// Returns the height of a relief at a point: bumps on a triangular lattice, or rows of a checkerboard, with the given wavelength.
fn relief(kind: u64, length: f64, turn: f64, x: f64, y: f64) -> f64 {
    let wave = |angle: f64, length: f64| {
        let (sine, cosine) = libm::sincos(angle + turn);
        libm::cos(std::f64::consts::TAU * (x * cosine + y * sine) / length)
    };
    match kind {
        // The crests are `length` apart.
        0 => {
            let rows = length * 0.75_f64.sqrt();
            0.12 * length
                * (wave(0.0, rows)
                    + wave(std::f64::consts::FRAC_PI_3, rows)
                    + wave(2.0 * std::f64::consts::FRAC_PI_3, rows))
        }
        _ => 0.15 * length * (wave(0.0, length) + wave(std::f64::consts::FRAC_PI_2, length)),
    }
}

fn measure(side: u32, height: impl Fn(f64, f64) -> f64) -> Option<f64> {
    let filling = grid(side, |x, y| x * x + y * y < 0.16, height);
    let surface = Surface::new(filling.points.len(), &filling.faces);
    let hole = Hole::new(&surface, &filling.points, filling.n_data_vertices).unwrap();
    wavelength(&surface, &filling.points, filling.n_data_vertices, &hole)
}

#[test]
fn the_wavelength_does_not_depend_on_the_edges() {
    for seed in 0..6 {
        let (length, turn) = (0.22 + 0.16 * random(seed), 1.5 * random(100 + seed));
        let [coarse, fine] = [61, 121]
            .map(|side| measure(side, |x, y| relief(seed % 2, length, turn, x, y)).unwrap());
        assert!((fine / coarse - 1.0).abs() < 0.2, "{length}: {coarse} {fine}");
        assert!((fine / length - 1.0).abs() < 0.25, "{length}: {fine}");
    }
}

#[test]
fn noise_and_smooth_surfaces_have_no_wavelength() {
    fn noise(x: f64, y: f64) -> f64 {
        0.01 * random((x * 7919.0) as i64 as u64 ^ ((y * 104729.0) as i64 as u64) << 20)
    }
    fn smooth(x: f64, y: f64) -> f64 {
        0.2 * libm::sin(1.5 * x) * libm::cos(1.1 * y) + 0.3 * x * x
    }
    assert_eq!(measure(61, noise), None);
    assert_eq!(measure(61, smooth), None);
    assert_eq!(measure(61, |x, y| smooth(x, y) + noise(x, y)), None);
}
