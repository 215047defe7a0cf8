//! Tests of the published method (Kawai, Sato and Yokoya, 2008) on surfaces with a known result.

use super::super::exemplar::{Start, Update};
use super::*;

fn published_method(radii: &[f64]) -> FillMethod {
    FillMethod::Exemplar(ExemplarOptions {
        levels: radii.len() as u32,
        start: Start::Flat,
        update: Update::Published,
        radii: radii.to_vec(),
        ..ExemplarOptions::default()
    })
}

/// Returns the root mean square over the vertices of the fill of `off`, the deviation of a point from the known surface.
fn rms(mesh: &Mesh, method: FillMethod, off: impl Fn(&Point3<f64>) -> f64) -> f64 {
    let filled = fill(mesh, HoleChoice::Edges { max: 60 }, method).unwrap().mesh;
    let new = &filled.positions()[mesh.positions().len()..];
    (new.iter().map(|point| off(point) * off(point)).sum::<f64>() / new.len() as f64).sqrt()
}

#[test]
fn a_flat_cap_becomes_round_again() {
    let limit = libm::cos(28.0_f64.to_radians());
    for axis in [[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.3, 0.5, 0.8], [-0.7, 0.3, 0.2]] {
        let axis = nalgebra::Vector3::from(axis).normalize();
        let mesh = remove_vertices(&sphere(3), |point| point.coords.dot(&axis) > limit);
        fn distance_from_sphere(point: &Point3<f64>) -> f64 {
            point.coords.norm() - 1.0
        }
        let start = rms(&mesh, FillMethod::Flat, distance_from_sphere);
        let end = rms(&mesh, published_method(&[0.75, 0.5, 0.32]), distance_from_sphere);
        assert!(0.06 < start && end <= 0.01, "{start} {end}");
    }
}

/// Returns the distance between the center of a lumpy ball and its surface, in a direction.
fn lump(direction: nalgebra::Vector3<f64>) -> f64 {
    let [x, y, z] = direction.into();
    1.0 + 0.12 * libm::sin(2.3 * x + 0.4) * libm::cos(1.9 * y - 0.3) + 0.08 * libm::sin(2.1 * z + x)
}

// The results document lists this as defect 7: a cone does not improve if its wrinkles survive the coarse levels.
#[test]
fn a_cone_becomes_as_smooth_as_a_plate() {
    let ball = sphere(4);
    let points =
        ball.positions().iter().map(|point| (point.coords * lump(point.coords)).into()).collect();
    let ball = ball.with_positions(points).unwrap();
    let axis = nalgebra::Vector3::new(0.48, 0.6, 0.64);
    let mesh = remove_vertices(&ball, |point| point.coords.normalize().dot(&axis) > 0.85);
    let published = FillMethod::Exemplar(ExemplarOptions {
        start: Start::Centroid,
        update: Update::Published,
        ..ExemplarOptions::default()
    });
    let [flat, plate, completed] =
        [FillMethod::Flat, FillMethod::ThinPlate, published].map(|method| {
            rms(&mesh, method, |point| point.coords.norm() - lump(point.coords.normalize()))
        });
    assert!(completed <= 1.2 * plate && plate < 0.2 * flat, "{flat} {plate} {completed}");
}
