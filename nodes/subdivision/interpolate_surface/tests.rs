use super::*;
use crate::solve::interpolation::{Direction, Norm, Solver};

fn waves(rows: usize, columns: usize) -> ControlNet {
    ControlNet::new(
        rows,
        columns,
        (0..rows * columns)
            .map(|k: usize| {
                let (a, b) = ((k / columns) as f64, (k % columns) as f64);
                let (y, x) = (a + 0.3 * libm::sin(2.0 * a), b + 0.1 * b * b);
                Point3::new(x, y, libm::sin(0.7 * x) * libm::cos(0.9 * y))
            })
            .collect::<Vec<_>>(),
    )
    .unwrap()
}

fn interpolate_net(
    net: &ControlNet,
    order: [usize; 2],
    options: &Interpolation,
) -> InterpolationResult<Surface> {
    interpolate_surface(net, order, options, &Progress::silent()).unwrap()
}

#[test]
fn every_solver_finds_the_surface_through_the_points() {
    let net = waves(9, 12);
    for order in [[4, 4], [2, 3], [5, 4]] {
        let surfaces = NetSurfaces::new(&net, order).unwrap();
        for solver in [Solver::Pcg, Solver::Plain, Solver::Direct] {
            let how = Interpolation { solver, tolerance: 1e-10, ..Interpolation::default() };
            let how = Interpolation { iterations: 3000, ..how };
            let found = interpolate_net(&net, order, &how);
            assert!(found.settled, "{order:?} {solver:?}");
            for (k, point) in net.points().iter().enumerate() {
                let [u, v] = surfaces.point_parameters(k);
                let distance = (found.shape.point(u, v) - point).norm();
                assert!(distance <= 1e-8, "{order:?} {solver:?} {distance}");
            }
        }
    }
}

// On a B-spline surface, the iteration with closest foot points reaches the tolerance in both norms.
#[test]
fn closest_feet_interpolate_in_both_norms_and_directions() {
    let net = waves(6, 7);
    for norm in [Norm::Max, Norm::Mean] {
        for direction in [Direction::Residual, Direction::Normal] {
            let (foot, solver) = (Foot::Closest, Solver::Plain);
            let how =
                Interpolation { foot, direction, solver, norm, tolerance: 1e-5, iterations: 500 };
            let found = interpolate_net(&net, [4, 4], &how);
            assert!(found.settled, "{norm:?} {direction:?}");
            let allowed = 1e-5 * crate::solve::extent::diagonal(net.points());
            let distances: Vec<f64> =
                net.points().iter().map(|&point| found.shape.closest(point).distance).collect();
            let max = distances.iter().copied().fold(0.0, f64::max);
            let squares = distances.iter().map(|distance| distance * distance).sum::<f64>();
            let rms = (squares / distances.len() as f64).sqrt();
            let [distance, before] = match norm {
                Norm::Max => [max, found.trace.steps().iter().rev().nth(1).unwrap().max],
                Norm::Mean => [rms, found.trace.steps().iter().rev().nth(1).unwrap().rms],
            };
            assert!(distance <= allowed * (1.0 + 1e-9) && allowed < before);
        }
    }
}

/// A grid of points that alternate between high and low, 1 mm apart.
fn alternating_net([rows, columns]: [usize; 2], amplitude: f64) -> ControlNet {
    ControlNet::new(
        rows,
        columns,
        (0..rows * columns)
            .map(|k: usize| {
                let [row, column] = [k / columns, k % columns];
                let sign = if (row + column) % 2 == 0 { amplitude } else { -amplitude };
                Point3::new(column as f64, row as f64, sign)
            })
            .collect::<Vec<_>>(),
    )
    .unwrap()
}

#[test]
fn alternating_points_are_interpolated_with_every_foot_and_direction() {
    let mut far = 0;
    for size in [[5, 5], [5, 8]] {
        for amplitude in [0.2, 1.0, 5.0] {
            let net = alternating_net(size, amplitude);
            for (foot, direction) in [
                (Foot::Vertex, Direction::Residual),
                (Foot::Vertex, Direction::Normal),
                (Foot::Closest, Direction::Residual),
                (Foot::Closest, Direction::Normal),
            ] {
                let name = format!("{size:?} {amplitude} {foot:?} {direction:?}");
                let how = Interpolation { foot, direction, ..Interpolation::default() };
                let how = Interpolation { solver: Solver::Plain, iterations: 500, ..how };
                let found = interpolate_surface(&net, [4, 4], &how, &Progress::silent());
                let found = found.unwrap_or_else(|error| panic!("{name}: {error}"));
                let diagonal = crate::solve::extent::diagonal(net.points());
                let distances =
                    net.points().iter().map(|&point| found.shape.closest(point).distance);
                let distance = distances.fold(0.0, f64::max);
                assert!(found.settled && distance <= 1.001e-6 * diagonal, "{name}: {distance}");
                let control = found.shape.net().points();
                let moved = control.iter().zip(net.points()).map(|(a, b)| (a - b).norm());
                far += usize::from(moved.fold(0.0, f64::max) > diagonal);
                // The bound is generous: the surface may swing at most four times as high as the points.
                let drawn = found.shape.tessellate(0, 0).unwrap();
                let height = drawn.positions().iter().map(|p| p.z.abs()).fold(0.0, f64::max);
                assert!(height <= 4.0 * amplitude, "{name}: {height}");
            }
        }
    }
    assert!(far > 0, "some control points are far away");
}

#[test]
fn crossing_fins_are_named_with_their_row_and_column() {
    fn crossings(net: &ControlNet) -> Option<SelfCrossings> {
        let surface = interpolate_net(net, [4, 4], &Interpolation::default()).shape;
        self_crossings(net, &surface, &Progress::silent()).unwrap()
    }
    let mut points = alternating_net([8, 9], 0.0).points().to_vec();
    // Two columns are fins that lean towards each other.
    for row in 0..8 {
        points[row * 9 + 3] += nalgebra::Vector3::new(0.95, 0.0, 2.0);
        points[row * 9 + 5] += nalgebra::Vector3::new(-0.95, 0.0, 2.0);
    }
    let net = ControlNet::new(8, 9, points).unwrap();
    let found = crossings(&net).expect("the fins cross");
    assert!((3..6).contains(&(found.nearest % 9)), "{found:?}");
    assert!(fin_help(&net, [4, 4]).ends_with("`method: LeastSquares(rows: 4, columns: 4)`"));
    assert_eq!(crossings(&alternating_net([8, 9], 5.0)), None);
    assert_eq!(crossings(&waves(8, 9)), None);
}

/// A net of points on a surface of revolution. `profile` returns the radius and the height at 0 to 1.
fn revolved(center: Point3<f64>, profile: impl Fn(f64) -> [f64; 2]) -> ControlNet {
    let [rows, columns] = [9, 13];
    let points = (0..rows * columns).map(|k| {
        let [radius, height] = profile((k / columns) as f64 / (rows - 1) as f64);
        let turn = std::f64::consts::TAU * (k % columns) as f64 / (columns - 1) as f64;
        let [x, y] = [libm::cos(turn), libm::sin(turn)].map(|x| radius * x);
        center + nalgebra::Vector3::new(x, y, height)
    });
    ControlNet::new(rows, columns, points.collect::<Vec<_>>()).unwrap()
}

#[test]
fn normals_at_poles_look_outward() {
    // A vase with a bottom that is a pole.
    for center in [Point3::origin(), Point3::new(0.0, 0.0, 10.0), Point3::new(300.0, 9.0, -7.0)] {
        let shapes = [
            revolved(center, |t: f64| {
                let angle = std::f64::consts::PI * t;
                [10.0 * libm::sin(angle), -10.0 * libm::cos(angle)]
            }),
            revolved(center, |t: f64| match t < 0.3 {
                true => [30.0 * t, 0.0],
                false => [9.0 + 2.0 * libm::sin(6.0 * (t - 0.3)), 30.0 * (t - 0.3)],
            }),
        ];
        for (net, solver, tolerance) in shapes.iter().flat_map(|net| {
            [
                (net, Solver::Pcg, 1e-6),
                (net, Solver::Pcg, 1e-3),
                (net, Solver::Direct, 1e-6),
                (net, Solver::Plain, 1e-6),
            ]
        }) {
            let how = Interpolation { solver, tolerance, ..Interpolation::default() };
            let found = interpolate_net(net, [4, 4], &how);
            assert!(found.settled);
            // The net is closed, and so is the surface.
            for row in found.shape.net().points().chunks(net.columns()) {
                assert_eq!(row[0], row[row.len() - 1]);
            }
            let mesh = found.shape.tessellate_open(30, 60).unwrap();
            let normals = mesh.vertex().vectors("normal").unwrap();
            // Every vertex has the side of the normals of its row: outside, seen from the axis halfway up.
            for (k, (point, normal)) in mesh.positions().iter().zip(normals.iter()).enumerate() {
                let near = found.shape.normal(
                    found.shape.u().domain().1 * f64::from((k as u32 / 61).clamp(1, 29)) / 30.0,
                    found.shape.v().domain().1 * f64::from(k as u32 % 61) / 60.0,
                );
                let cosine = near.unwrap().dot(&nalgebra::Vector3::from(*normal));
                assert!(cosine > 0.5, "{solver:?} {tolerance}: {cosine} at {point}");
            }
        }
    }
}

#[test]
fn rows_in_one_place_are_named() {
    let flat = waves(6, 5);
    let mut points = flat.points().to_vec();
    points.copy_within(5..10, 10);
    let doubled = ControlNet::new(6, 5, points).unwrap();
    let how = Interpolation { solver: Solver::Direct, ..Interpolation::default() };
    let error = interpolate_surface(&doubled, [4, 4], &how, &Progress::silent()).unwrap_err();
    assert_eq!(
        error.to_string(),
        "the points do not determine the surface: rows 1 and 2 of the net, counted from 0, are in one place; remove one of them, or use \
         `solver: Pcg`"
    );
    let pcg = Interpolation::default();
    assert!(interpolate_net(&doubled, [4, 4], &pcg).settled);
}

#[test]
fn tolerances_below_rounding_are_met() {
    let far = ControlNet::new(
        5,
        5,
        (0..25)
            .map(|k| Point3::new(1e6 + f64::from(k % 5), f64::from(k / 5), f64::from(k % 2)))
            .collect::<Vec<_>>(),
    );
    for solver in [Solver::Pcg, Solver::Direct, Solver::Plain] {
        let how = Interpolation { solver, tolerance: 1e-14, ..Interpolation::default() };
        let how = Interpolation { iterations: 3000, ..how };
        let found = interpolate_net(far.as_ref().unwrap(), [4, 4], &how);
        assert!(found.settled, "{solver:?} {:?}", found.trace.steps().last());
    }
}

#[test]
fn coincident_points_and_too_few_points_are_errors() {
    fn interpolate(net: &ControlNet) -> Result<InterpolationResult<Surface>, Error> {
        interpolate_surface(net, [4, 4], &Interpolation::default(), &Progress::silent())
    }
    let error = interpolate(&waves(3, 5)).unwrap_err();
    assert_eq!(
        error.to_string(),
        "order 4 along u needs at least 4 rows of points, the net has 3; add rows, or lower `order`"
    );
    let flat = ControlNet::new(5, 5, vec![Point3::origin(); 25]).unwrap();
    assert!(interpolate(&flat).is_ok(), "one point is a surface of one point");
}
