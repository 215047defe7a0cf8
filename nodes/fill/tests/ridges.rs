//! A family of ridges that are cut through: on balls, and ribs on boxes.

use maquette_value::TriangleTree;
use nalgebra::Vector3;

use super::*;

/// A ball with a ridge whose latitude is a wave, or a rounded box with ribs around it.
pub(super) struct Ridged {
    pub(super) mesh: Mesh,
    pub(super) at: Point3<f64>,
    pub(super) radius: f64,
}

pub(super) fn ridged(seed: u64) -> Ridged {
    fn draw(seed: u64, k: u64, low: f64, high: f64) -> f64 {
        low + (high - low) * random(seed << 8 | k)
    }
    let ball = sphere(5);
    let tilt = nalgebra::Rotation3::from_euler_angles(0.3, 0.5, 0.2);
    let radius = 17.0;
    let (height, width) = (draw(seed, 0, 1.2, 2.5), draw(seed, 1, 1.2, 2.2));
    let (waves, swing) = ((2.0 + 3.0 * random(seed << 8 | 2)).floor(), draw(seed, 3, 0.0, 0.35));
    let phase = draw(seed, 4, 0.0, 6.0);
    let is_box = seed % 3 == 2;
    let ridge_at = |longitude: f64| 0.1 + swing * libm::sin(waves * longitude + phase);
    let surface = |direction: Vector3<f64>| {
        let longitude = libm::atan2(direction.x, direction.z);
        let latitude = libm::asin(direction.y.clamp(-1.0, 1.0));
        let mut size = radius;
        if is_box {
            // A rounded box: a norm of degree 6.
            let sum: f64 = direction.iter().map(|x| libm::pow(x.abs(), 6.0)).sum();
            size = 14.0 / libm::pow(sum, 1.0 / 6.0);
            let mut ribs = 0.0;
            for k in -1..=1 {
                let off = direction.y * size - 6.0 * f64::from(k);
                ribs += libm::exp(-(off / width) * (off / width));
            }
            return Point3::from(direction * (size + height * ribs));
        }
        let off = (latitude - ridge_at(longitude)) * radius / width;
        Point3::from(direction * (size + height * libm::exp(-off * off)))
    };
    let points = ball.positions().iter().map(|p| surface(tilt * p.coords)).collect();
    let mesh = ball.clone().with_positions(points).unwrap();
    let longitude = draw(seed, 5, 0.0, 6.0);
    let latitude = if is_box { 0.4 } else { ridge_at(longitude) } + draw(seed, 6, -0.1, 0.1);
    let (sine, cosine) = libm::sincos(longitude);
    let (up, across) = libm::sincos(latitude);
    let at = surface(Vector3::new(across * sine, up, across * cosine));
    Ridged { mesh, at, radius: draw(seed, 7, 4.5, 9.0) }
}

/// Returns the root mean square distances of the thin plate and of the default fill from the true surface.
pub(super) fn ridge_errors(seed: u64) -> [f64; 2] {
    let Ridged { mesh, at, radius, .. } = ridged(seed);
    let cut = remove_vertices(&mesh, |p| (p - at).norm() < radius);
    let tree = TriangleTree::new(&mesh);
    [FillMethod::ThinPlate, FillMethod::default()].map(|method| {
        let filled = fill(&cut, HoleChoice::All, method).unwrap().mesh;
        let points = &filled.positions()[cut.positions().len()..];
        let nearest = tree.nearest_to_all(points).into_iter().flatten();
        let squares =
            nearest.zip(points).map(|(near, p)| (near.position(&mesh) - p).norm_squared());
        (squares.sum::<f64>() / points.len() as f64).sqrt()
    })
}

// The sides of the ridges 3, 9 and 11 fit spheres, cones or paraboloids, which were once extended as if they met in creases.
#[test]
fn ridges_go_on() {
    for seed in [3, 9, 11] {
        let [plate, own] = ridge_errors(seed);
        assert!(own <= 0.3 * plate, "{seed}: {own} beside {plate}");
    }
}
