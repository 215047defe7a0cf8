//! Evaluation of points of a surface.
//!
//! All points are computed from homogeneous control points (w x, w y, w z, w) and divided by w at the end: Piegl and Tiller, *The NURBS
//! Book*, 2nd ed. (1997), algorithms A4.3 and A4.4. A parameter outside of the domain is clamped to the nearest end; NaN means the start.
//!
//! If only control points of weight 0 affect a parameter (at a clamped end whose row has weight 0), the quotient is 0/0. The surface has a
//! limit at such a parameter, and that limit is returned: see [`INWARD`].

use nalgebra::{Point3, Vector4};

use super::super::knots::Basis;
use super::{KnotVector, Surface};

/// The step inward from a parameter at which all weights are 0 to the point that approximates the limit, as a fraction of the span. No
/// terms cancel in the sums that are divided, so a tiny step loses no digits. A step below 1e-16 would be lost to rounding.
const INWARD: f64 = 1e-9;

impl Surface {
    /// The parameters (u, v) of a net coordinate (a, b): see [`KnotVector::parameter`].
    pub fn parameters(&self, [a, b]: [f64; 2]) -> [f64; 2] {
        [self.u.parameter(a), self.v.parameter(b)]
    }

    /// The point at (u, v).
    pub fn point(&self, u: f64, v: f64) -> Point3<f64> {
        let homogeneous =
            |u, v| self.contract(&self.u.basis_derivative(u, 0), &self.v.basis_derivative(v, 0));
        let sum = homogeneous(u, v);
        if sum.w > 0.0 {
            return divide(sum);
        }
        divide(homogeneous(inward(&self.u, u, INWARD), inward(&self.v, v, INWARD)))
    }

    /// `sum_ab N_a(u) N_b(v) (w_ab P_ab, w_ab)` for the basis functions at one parameter.
    pub(super) fn contract(&self, u: &Basis, v: &Basis) -> Vector4<f64> {
        let columns = self.net.columns();
        let (p, q) = (self.u.degree(), self.v.degree());
        let mut sum = Vector4::zeros();
        for (k, &n_u) in u.values[..=p].iter().enumerate() {
            let start = (u.first + k) * columns + v.first;
            let mut along = Vector4::zeros();
            for (l, &n_v) in v.values[..=q].iter().enumerate() {
                let weight = self.net.weights()[start + l];
                along += (self.net.points()[start + l].coords * weight).push(weight) * n_v;
            }
            sum += along * n_u;
        }
        sum
    }
}

pub(super) fn table(knots: &KnotVector, at: &[f64], order: usize) -> Vec<Basis> {
    at.iter().map(|&u| knots.basis_derivative(u, order)).collect()
}

fn divide(sum: Vector4<f64>) -> Point3<f64> {
    (sum.xyz() / sum.w).into()
}

/// Moves `u` by a fraction of its span towards the middle of the span. The middle itself does not move, because all basis functions are
/// positive at the middle.
pub(super) fn inward(knots: &KnotVector, u: f64, fraction: f64) -> f64 {
    let (start, end) = knots.domain();
    let u = u.max(start).min(end);
    let span = knots.span(u);
    let [low, high] = [knots.knots()[span], knots.knots()[span + 1]];
    u + (low + (high - low) / 2.0 - u) * fraction
}

#[cfg(test)]
pub(super) mod tests {
    use nalgebra::Vector3;

    use super::super::super::ControlNet;
    use super::*;

    /// A net whose points are a function of row and column.
    pub(crate) fn net(
        rows: usize,
        columns: usize,
        point: impl Fn(f64, f64) -> Point3<f64>,
    ) -> ControlNet {
        let points = (0..rows).flat_map(|a| (0..columns).map(move |b| (a as f64, b as f64)));
        let points: Vec<_> = points.map(|(a, b)| point(a, b)).collect();
        ControlNet::new(rows, columns, points).unwrap()
    }

    /// A wavy net with weights from 0.5 to 2.
    fn wavy(rows: usize, columns: usize) -> ControlNet {
        let weights = (0..rows * columns).map(|k| 0.5 + 1.5 * ((k * 7) % 10) as f64 / 9.0);
        let net = net(rows, columns, |a, b| {
            Point3::new(b + 0.2 * libm::sin(a), a + 0.1 * libm::cos(3.0 * b), libm::sin(a * b))
        });
        net.with_weights(weights.collect()).unwrap()
    }

    pub(crate) fn surface(orders: [usize; 2]) -> Surface {
        let u = KnotVector::uniform(8, orders[0]).unwrap();
        Surface::new(wavy(8, 9), u, KnotVector::uniform(9, orders[1]).unwrap()).unwrap()
    }

    pub(crate) fn samples(knots: &KnotVector, count: usize) -> Vec<f64> {
        let (start, end) = knots.domain();
        (0..=count).map(|k| start + (end - start) * k as f64 / count as f64).collect()
    }

    fn cylinder() -> Surface {
        let square = [(1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1), (1, 0)];
        let net = net(2, 9, |a, b| {
            let (x, y) = square[b as usize];
            Point3::new(f64::from(x), f64::from(y), 2.0 * a)
        });
        let weights = [1.0, 0.5f64.sqrt()].into_iter().cycle().take(9).collect::<Vec<_>>();
        let net = net.with_weights(weights.repeat(2)).unwrap();
        Surface::new(net, KnotVector::uniform(2, 2).unwrap(), KnotVector::cylinder()).unwrap()
    }

    // Checks the full circle and its tangents.
    #[test]
    fn the_cylinder_is_round() {
        let cylinder = cylinder();
        for v in samples(cylinder.v(), 1000) {
            let at = cylinder.derivatives(0.25, v);
            let radius = at.point.coords.xy();
            assert!((radius.norm() - 1.0).abs() <= 1e-14, "{v}: {}", radius.norm());
            assert!(radius.dot(&at.v.xy()).abs() <= 1e-13);
            assert!((at.point.z - 0.5).abs() <= 1e-14);
        }
    }

    #[test]
    fn a_quarter_circle_is_round() {
        let arc = [(1.0, 0.0), (1.0, 1.0), (0.0, 1.0)];
        let points = [0.0, 1.0].map(|z| arc.map(|(x, y)| Point3::new(x, y, z))).concat();
        let half = 0.5f64.sqrt();
        let net = ControlNet::new(2, 3, points).unwrap();
        let net = net.with_weights(vec![1.0, half, 1.0, 1.0, half, 1.0]).unwrap();
        let v = KnotVector::uniform(3, 3).unwrap();
        let quarter = Surface::new(net, KnotVector::uniform(2, 2).unwrap(), v).unwrap();
        for v in samples(quarter.v(), 1000) {
            assert!((quarter.point(0.5, v).coords.xy().norm() - 1.0).abs() <= 1e-14);
        }
    }

    #[test]
    fn a_grid_is_its_points() {
        for orders in [[2, 3], [3, 4], [5, 2]] {
            let surface = surface(orders);
            let (us, vs) = (samples(surface.u(), 23), samples(surface.v(), 17));
            let grid = surface.grid(&us, &vs);
            assert_eq!(grid.len(), us.len() * vs.len());
            for (index, point) in grid.iter().enumerate() {
                let alone = surface.point(us[index / vs.len()], vs[index % vs.len()]);
                assert!((point - alone).norm() <= 1e-13);
            }
        }
        assert!(surface([3, 3]).grid(&[], &[0.0]).is_empty());
    }

    #[test]
    fn a_grid_has_the_same_bits_for_any_number_of_threads() {
        let surface = surface([4, 3]);
        let (us, vs) = (samples(surface.u(), 60), samples(surface.v(), 50));
        let [one, eight] = [1, 8].map(|threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| (surface.grid(&us, &vs), surface.normal_grid(&us, &vs)))
        });
        assert_eq!(one, eight);
        assert_eq!(one.0, one.1.0);
    }

    #[test]
    fn a_moved_net_gives_the_moved_surface() {
        let surface = surface([4, 3]);
        let matrix = nalgebra::Matrix3::new(1.0, 0.5, -0.2, 0.3, -1.1, 0.7, 0.2, 0.4, 0.9);
        let shift = Vector3::new(3.0, -2.0, 0.5);
        let moved = |point: &Point3<f64>| matrix * point + shift;
        let points: Vec<_> = surface.net().points().iter().map(moved).collect();
        let net = surface.net().clone().with_points(points).unwrap();
        let other = Surface::new(net, surface.u().clone(), surface.v().clone()).unwrap();
        for u in samples(surface.u(), 9) {
            for v in samples(surface.v(), 9) {
                let difference = other.point(u, v) - moved(&surface.point(u, v));
                assert!(difference.norm() <= 1e-12);
            }
        }
    }

    // The property is checked with support functions in 100 directions.
    #[test]
    fn a_point_lies_in_the_hull_of_its_control_points() {
        let surface = surface([4, 3]);
        for u in samples(surface.u(), 7) {
            for v in samples(surface.v(), 7) {
                let point = surface.point(u, v);
                let ((a, values_u), (b, values_v)) = (surface.u().basis(u), surface.v().basis(v));
                for direction in (0..100).map(|k: usize| {
                    let (z, angle) = (2.0 * k as f64 / 99.0 - 1.0, 2.4 * k as f64);
                    let radius = (1.0 - z * z).sqrt();
                    Vector3::new(radius * libm::cos(angle), radius * libm::sin(angle), z)
                }) {
                    let local = (a..a + values_u.len()).flat_map(|row| {
                        let row = &surface.net().points()[row * surface.net().columns() + b..];
                        &row[..values_v.len()]
                    });
                    let support = local.map(|control| direction.dot(&control.coords));
                    let max = support.fold(f64::NEG_INFINITY, f64::max);
                    assert!(direction.dot(&point.coords) <= max + 1e-12);
                }
            }
        }
    }

    #[test]
    fn an_evenly_spaced_plane_is_reproduced_at_its_net_coordinates() {
        fn plane_point(a: f64, b: f64) -> Point3<f64> {
            Point3::new(3.0 + 0.5 * b, -1.0 + 0.25 * a + 0.1 * b, a - b)
        }
        for order in 2..=5 {
            let net = net(12, 13, plane_point);
            let [u, v] = [12, 13].map(|count| KnotVector::uniform(count, order).unwrap());
            let surface = Surface::new(net.clone(), u, v).unwrap();
            for (index, point) in net.points().iter().enumerate() {
                let [u, v] = surface.parameters([(index / 13) as f64, (index % 13) as f64]);
                assert!((surface.point(u, v) - point).norm() <= 1e-12, "order {order}, {index}");
            }
            let (u, v) = (surface.u().domain().1, surface.v().domain().1);
            for (row, column, u, v) in
                [(0, 0, 0.0, 0.0), (11, 0, u, 0.0), (0, 12, 0.0, v), (11, 12, u, v)]
            {
                assert_eq!(surface.point(u, v), net.points()[row * 13 + column]);
            }
            // A net that is linear in the Greville abscissae gives a surface that is linear in the parameters.
            let abscissae = surface.u().greville();
            let points = abscissae.iter().flat_map(|&x| [Point3::new(x, 2.0 * x, 0.0); 13]);
            let net = net.with_points(points.collect::<Vec<_>>()).unwrap();
            let surface = Surface::new(net, surface.u().clone(), surface.v().clone()).unwrap();
            for u in samples(surface.u(), 50) {
                assert!((surface.point(u, 1.3) - Point3::new(u, 2.0 * u, 0.0)).norm() <= 1e-12);
            }
        }
    }

    #[test]
    fn a_control_point_affects_only_its_own_spans() {
        let before = surface([3, 4]);
        let (row, column) = (3, 4);
        let mut points = before.net().points().to_vec();
        points[row * 9 + column].z += 5.0;
        let net = before.net().clone().with_points(points).unwrap();
        let after = Surface::new(net, before.u().clone(), before.v().clone()).unwrap();
        fn window(knots: &KnotVector, control: usize, at: f64) -> bool {
            knots.knots()[control] < at && at < knots.knots()[control + knots.degree() + 1]
        }
        let mut reached = 0;
        for u in samples(before.u(), 40) {
            for v in samples(before.v(), 40) {
                let inside = window(before.u(), row, u) && window(before.v(), column, v);
                assert_eq!(before.point(u, v) != after.point(u, v), inside, "({u}, {v})");
                reached += usize::from(inside);
            }
        }
        assert!(reached > 0);
    }

    #[test]
    fn only_the_ratio_of_weights_matters_and_a_heavy_point_attracts_the_surface() {
        let surface = surface([3, 3]);
        fn with_weights(weights: Vec<f64>, surface: &Surface) -> Surface {
            let net = surface.net().clone().with_weights(weights).unwrap();
            Surface::new(net, surface.u().clone(), surface.v().clone()).unwrap()
        }
        let scaled =
            with_weights(surface.net().weights().iter().map(|w| 7.0 * w).collect(), &surface);
        for (u, v) in [(0.0, 0.0), (0.4, 3.3), (2.5, 6.9), (6.0, 7.0)] {
            assert!((scaled.point(u, v) - surface.point(u, v)).norm() <= 1e-14);
        }
        let mut weights = surface.net().weights().to_vec();
        weights[3 * 9 + 4] = 1e12;
        let heavy = with_weights(weights, &surface);
        assert!((heavy.point(1.6, 2.4) - surface.net().points()[3 * 9 + 4]).norm() <= 1e-9);
    }

    #[test]
    fn a_border_of_weight_zero_has_the_limit_of_the_surface() {
        let mut weights = vec![1.0; 72];
        weights[..9].fill(0.0);
        let net = surface([3, 3]).net().clone().with_weights(weights).unwrap();
        let [u, v] = [8, 9].map(|count| KnotVector::uniform(count, 3).unwrap());
        let surface = Surface::new(net, u, v).unwrap();
        let corner = surface.point(0.0, 0.0);
        assert!((corner - surface.net().points()[9]).norm() <= 1e-8, "{corner}");
        assert_eq!(surface.grid(&[0.0], &[0.0]), [corner]);
        assert!(surface.derivatives(0.0, 2.0).uu.norm().is_finite());
        assert!(surface.normal(0.0, 2.0).is_some());
    }
}
