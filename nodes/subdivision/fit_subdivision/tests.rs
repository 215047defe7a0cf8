use nalgebra::Vector3;

use super::super::shapes::sphere;
use super::super::simplify::simplify;
use super::*;

fn fitted(mesh: &Mesh, points: &[Point3<f64>]) -> FittedSubdivision {
    fit_subdivision(mesh, points, 1e-3, 12, &Progress::none()).unwrap()
}

#[test]
fn a_simplified_sphere_becomes_a_round_one_again() {
    let dense = sphere(4);
    let coarse = simplify(&dense, 256, &Progress::none()).unwrap();
    let found = fitted(&coarse, dense.positions());
    let surface = Composed::new(&found.mesh, 3).unwrap().surface(found.mesh.positions()).unwrap();
    let off = surface.positions().iter().map(|point| (point.coords.norm() - 1.0).abs());
    let off = off.fold(0.0, f64::max);
    assert!(off < 5e-3, "{off}");
    assert_eq!(found.left_out, 0);
    let steps = found.trace.steps();
    assert!(steps[steps.len() - 1].rms < steps[0].rms / 5.0, "{:?}", found.trace);
}

#[test]
fn points_of_a_subdivision_surface_give_its_control_mesh_back() {
    let control = sphere(1);
    let pulled =
        control.positions().iter().map(|p| Point3::new(p.x * 1.3, p.y, p.z + p.x * p.x * 0.2));
    let control = control.with_positions(pulled.collect()).unwrap();
    let surface = Composed::new(&control, 2).unwrap();
    let points = surface.surface(control.positions()).unwrap().positions().to_vec();
    let nudged = control.positions().iter().enumerate().map(|(k, p)| {
        let k = k as f64;
        p + Vector3::new(libm::sin(k), libm::sin(2.0 * k), libm::sin(3.0 * k)) * 0.01
    });
    let start = control.with_positions(nudged.collect()).unwrap();
    let found = fit_subdivision(&start, &points, 0.0, 100, &Progress::none()).unwrap();
    let last = found.trace.steps().last().unwrap();
    assert!(last.rms < 2e-4, "{last:?}");
}

#[test]
fn points_far_away_are_left_out_and_none_near_is_an_error() {
    let coarse = sphere(1);
    let mut points = sphere(3).positions().to_vec();
    points.push(Point3::new(30.0, 0.0, 0.0));
    assert_eq!(fitted(&coarse, &points).left_out, 1);
    let far = fit_subdivision(&coarse, &points[points.len() - 1..], 1e-3, 6, &Progress::none());
    assert_eq!(far, Err(FitSubdivisionError::Apart { count: 1 }));
}
