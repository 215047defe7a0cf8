//! A family of reliefs with holes: dimples, weaves and waves with several wavelengths and directions.

use super::*;

/// Returns the height of a relief at a point.
fn relief(number: u64, x: f64, y: f64) -> f64 {
    fn draw(k: u64, low: f64, high: f64, number: u64) -> f64 {
        low + (high - low) * random(number << 8 | k)
    }
    let (length, turn) = (draw(0, 6.0, 10.0, number), draw(1, 0.0, 1.5, number));
    let height = length * draw(2, 0.04, 0.08, number);
    let wave = |angle: f64, length: f64| {
        let (sine, cosine) = libm::sincos(angle + turn);
        libm::cos(std::f64::consts::TAU * (x * cosine + y * sine) / length)
    };
    match number % 3 {
        0 => {
            height
                * (wave(0.0, length)
                    + wave(std::f64::consts::FRAC_PI_3, length)
                    + wave(2.0 * std::f64::consts::FRAC_PI_3, length))
        }
        1 => height * (wave(0.0, length) + wave(std::f64::consts::FRAC_PI_2, length)),
        _ => 2.0 * height * wave(0.0, length),
    }
}

/// Returns the root mean square errors of the thin plate and of the default method.
fn relief_errors(number: u64) -> [f64; 2] {
    let radius = 5.0 + 4.0 * random(number << 8 | 7);
    fn bent(x: f64, y: f64) -> f64 {
        0.004 * (x - 24.0) * (x - 24.0) - 0.003 * x * y
    }
    let mesh = grid(49, 49, |x, y| bent(x, y) + relief(number, x, y));
    let cut = remove_vertices(&mesh, |p| libm::hypot(p.x - 24.0, p.y - 23.0) < radius);
    [FillMethod::ThinPlate, FillMethod::default()].map(|method| {
        let filled = fill(&cut, HoleChoice::All, method).unwrap();
        let added = &filled.mesh.positions()[cut.positions().len()..];
        let squares = added.iter().map(|p| {
            let off = p.z - bent(p.x, p.y) - relief(number, p.x, p.y);
            off * off
        });
        (squares.sum::<f64>() / added.len() as f64).sqrt()
    })
}

#[test]
fn reliefs_go_on() {
    for number in 0..6 {
        let [plate, copied] = relief_errors(number);
        assert!(copied < 0.5 * plate, "{number}: plate {plate}, copied {copied}");
    }
}
