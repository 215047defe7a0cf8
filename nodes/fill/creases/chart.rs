//! A plane or paraboloid fitted to a part of a surface. It extrapolates this part into a hole.

use nalgebra::{Matrix6, Point3, Vector3, Vector6};

/// A plane or paraboloid fitted to points: `height = q(u, v)` over a local frame. It extrapolates the surface on which the points are.
#[derive(Clone, Debug)]
pub(crate) struct Chart {
    origin: Point3<f64>,
    frame: [Vector3<f64>; 3],
    /// The coefficients of 1, u, v, u^2, u v and v^2.
    coefficients: [f64; 6],
}

impl Chart {
    /// Returns the approximate signed distance of a point from the surface, negative below the surface. Also returns the surface normal at
    /// the surface point nearest to `point`.
    pub(crate) fn distance(&self, point: Point3<f64>) -> (f64, Vector3<f64>) {
        let offset = point - self.origin;
        let [u, v, height] = self.frame.map(|axis| axis.dot(&offset));
        let [c, cu, cv, cuu, cuv, cvv] = self.coefficients;
        let q = c + cu * u + cv * v + cuu * u * u + cuv * u * v + cvv * v * v;
        let (slope_u, slope_v) = (cu + 2.0 * cuu * u + cuv * v, cv + cuv * u + 2.0 * cvv * v);
        let size = (1.0 + slope_u * slope_u + slope_v * slope_v).sqrt();
        let [x, y, z] = self.frame;
        ((height - q) / size, (z - x * slope_u - y * slope_v) / size)
    }

    /// Fits a plane to points, or a paraboloid if no plane fits. Returns `None` if the points deviate from both by more than `tolerance`
    /// (root mean square).
    pub(crate) fn fit(
        points: &[Point3<f64>],
        normal: Vector3<f64>,
        tolerance: f64,
    ) -> Option<Self> {
        let sum: Vector3<f64> = points.iter().map(|point| point.coords).sum();
        let origin = Point3::from(sum / points.len() as f64);
        let across = normal.cross(&Vector3::ith(normal.iamin(), 1.0)).try_normalize(0.0)?;
        let frame = [across, normal.cross(&across), normal];
        // Divide lengths by the maximum distance of a point from the origin, which keeps the equations well scaled.
        let size = points.iter().map(|point| (point - origin).norm()).fold(0.0, f64::max);
        if size == 0.0 {
            return None;
        }
        [3, 6].into_iter().find_map(|terms| {
            let (mut matrix, mut right) = (Matrix6::identity() * 1e-12, Vector6::zeros());
            for point in points {
                let [u, v, height] = frame.map(|axis| axis.dot(&(point - origin)) / size);
                let mut row = Vector6::new(1.0, u, v, u * u, u * v, v * v);
                (terms..6).for_each(|k| row[k] = 0.0);
                matrix += row * row.transpose();
                right += row * height;
            }
            let x = matrix.cholesky()?.solve(&right);
            let scales = [size, 1.0, 1.0, 1.0 / size, 1.0 / size, 1.0 / size];
            let chart =
                Self { origin, frame, coefficients: std::array::from_fn(|k| x[k] * scales[k]) };
            // A surface with as many coefficients as there are points fits all of them exactly, so count only the points in excess.
            let free = points.len() as f64 - terms as f64;
            let misfit = chart.misfit(points) * (points.len() as f64 / free.max(0.0)).sqrt();
            (misfit <= tolerance).then_some(chart)
        })
    }

    /// Returns the root mean square distance of points from the surface.
    pub(crate) fn misfit(&self, points: &[Point3<f64>]) -> f64 {
        let squares = points.iter().map(|&point| {
            let distance = self.distance(point).0;
            distance * distance
        });
        (squares.sum::<f64>() / points.len() as f64).sqrt()
    }
}
