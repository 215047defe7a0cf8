//! Tests with vertices that alternate between high and low: the control points are far from the vertices, but the surface is not.

use super::*;
use crate::shapes::polygons;

/// Creates a closed or open grid of quads whose vertices alternate between displacements of `amplitude` and `-amplitude` from a torus or
/// plane.
fn alternating_grid(closed: bool, [n, m]: [u32; 2], amplitude: f64) -> Mesh {
    fn sign(k: u32, n: u32, amplitude: f64) -> f64 {
        if (k % n + k / n).is_multiple_of(2) { amplitude } else { -amplitude }
    }
    if closed {
        let flat = torus(n, m, false);
        fn displacement(k: u32, n: u32, m: u32, amplitude: f64) -> Vector3<f64> {
            let [u, v] = [f64::from(k % n) / f64::from(n), f64::from(k / n) / f64::from(m)];
            let [u, v] = [u, v].map(|t| t * std::f64::consts::TAU);
            let [x, y] = [libm::cos(u), libm::sin(u)].map(|x| x * libm::cos(v));
            Vector3::new(x, y, libm::sin(v)) * sign(k, n, amplitude)
        }
        let positions = (0..)
            .zip(flat.positions().iter())
            .map(|(k, position)| position + displacement(k, n, m, amplitude));
        return flat.with_positions(positions.collect()).unwrap();
    }
    let positions =
        (0..n * m).map(|k| Point3::new(f64::from(k % n), f64::from(k / n), sign(k, n, amplitude)));
    let quads = (0..n * (m - 1))
        .filter(|k| k % n + 1 < n)
        .map(|k: u32| [k, k + 1, k + 1 + n, k + n].to_vec());
    polygons(quads.collect(), positions.collect())
}

/// Computes the control points by a dense factorization of the limit masks.
fn solve_densely(mesh: &Mesh, scheme: Scheme) -> Vec<Point3<f64>> {
    let rows = limits(mesh, scheme).positions;
    let count = mesh.positions().len();
    let mut dense = DMatrix::zeros(count, count);
    for row in 0..count {
        let (indices, weights) = rows.row(row);
        indices.iter().zip(weights).for_each(|(&k, weight)| dense[(row, k as usize)] = *weight);
    }
    let right = DMatrix::from_fn(count, 3, |row, k| mesh.positions()[row][k]);
    let control = dense.lu().solve(&right).expect("there is a control mesh");
    (0..count).map(|k| Point3::new(control[(k, 0)], control[(k, 1)], control[(k, 2)])).collect()
}

/// The largest distance of the control points from the vertices, relative to the diagonal of the bounding box.
fn farthest_control(mesh: &Mesh, control: &[Point3<f64>]) -> f64 {
    let pairs = mesh.positions().iter().zip(control);
    let distance = pairs.map(|(a, b)| (a - b).norm()).fold(0.0, f64::max);
    distance / crate::solve::extent::diagonal(mesh.positions())
}

#[test]
fn alternating_vertices_are_met_by_every_scheme_foot_and_direction() {
    let mut far = 0;
    for (closed, size) in [(true, [8, 6]), (true, [16, 8]), (false, [5, 5]), (false, [12, 9])] {
        let amplitudes = if closed { [0.1, 0.3, 0.5] } else { [0.2, 1.0, 5.0] };
        for (amplitude, scheme) in amplitudes.into_iter().flat_map(|a| SCHEMES.map(|s| (a, s))) {
            let mesh = alternating_grid(closed, size, amplitude);
            let mesh = if scheme == Scheme::Loop { triangulate_fans(&mesh) } else { mesh };
            let truth = solve_densely(&mesh, scheme);
            let size = crate::solve::extent::diagonal(mesh.positions());
            for (foot, direction) in [
                (Foot::Vertex, Direction::Residual),
                (Foot::Vertex, Direction::Normal),
                (Foot::Closest, Direction::Residual),
                (Foot::Closest, Direction::Normal),
            ] {
                let mut options = options(Solver::Plain, 1e-6);
                (options.how.foot, options.how.direction) = (foot, direction);
                let name = format!("{size:?} {amplitude} {scheme:?} {foot:?} {direction:?}");
                let found = interpolate(&mesh, scheme, &options, &[], &Progress::silent());
                let found = found.unwrap_or_else(|error| panic!("{name}: {error}"));
                let last = found.trace.steps().last().unwrap().max;
                assert!(found.settled && last <= 1e-6 * size, "{name}: {last}");
                far += usize::from(farthest_control(&mesh, found.shape.positions()) > 1.0);
                // With `Foot::Vertex` the control mesh is unique.
                if foot == Foot::Vertex {
                    let off = farthest(&mesh, &found.shape, scheme);
                    assert!(off <= 1.001e-6 * size, "{name}: {off}");
                    let pairs = found.shape.positions().iter().zip(&truth);
                    let off = pairs.map(|(a, b)| (a - b).norm()).fold(0.0, f64::max);
                    assert!(off <= 1e-4 * size, "{name}: {off} from the solution");
                }
            }
        }
    }
    assert!(far > 0, "some control points are far away");
}
