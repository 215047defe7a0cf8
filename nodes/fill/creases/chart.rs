//! A simple surface fitted to a part of a surface. It extrapolates this part into a hole.

use nalgebra::{Matrix2, Matrix6, Point3, Vector3, Vector6};

use super::round_chart::{Axis, Revolution, Samples, Sphere};

/// A plane, paraboloid, sphere, cylinder or cone fitted to points. It extrapolates the surface on which the points are.
#[derive(Clone, Debug)]
pub(crate) enum Chart {
    HeightField(HeightField),
    Sphere(Sphere),
    Revolution(Revolution),
}

/// The number of coefficients of a plane and of a paraboloid.
const PLANE: usize = 3;
const PARABOLOID: usize = 6;

/// Minimum decrease of the Bayesian information criterion for which a surface with more parameters is used.
const MIN_GAIN: f64 = 10.0;

/// Distance below which differences of fits do not count, in edge lengths.
const ROUNDING: f64 = 0.01;

impl Chart {
    /// Returns the approximate signed distance of a point from the surface, negative below the surface. Also returns the surface normal at
    /// the surface point nearest to `point`.
    pub(crate) fn distance(&self, point: Point3<f64>) -> (f64, Vector3<f64>) {
        match self {
            Self::HeightField(field) => field.distance(point),
            Self::Sphere(sphere) => sphere.distance(point),
            Self::Revolution(revolution) => revolution.distance(point),
        }
    }

    /// Fits a plane to points, or a paraboloid if no plane fits. Returns `None` if the points deviate from both by more than `tolerance`
    /// (root mean square).
    pub(crate) fn fit(
        points: &[Point3<f64>],
        normal: Vector3<f64>,
        tolerance: f64,
    ) -> Option<Self> {
        [PLANE, PARABOLOID].into_iter().find_map(|terms| {
            let chart = Self::HeightField(HeightField::fit(points, normal, terms)?);
            (chart.free_misfit(points, terms) <= tolerance).then_some(chart)
        })
    }

    /// Fits the surface that explains the points best with few parameters: a plane, sphere, cylinder, cone or paraboloid. `edge` is the
    /// mean edge length. Returns `None`
    /// if the points deviate from all of them by more than `tolerance` (root mean square).
    pub(super) fn fit_best(samples: &Samples, edge: f64, tolerance: f64) -> Option<Self> {
        let points = &samples.points[..];
        let normal = samples.mean_normal()?;
        let paraboloid = HeightField::fit(points, normal, PARABOLOID);
        let cylinder = paraboloid.as_ref().and_then(HeightField::osculating_cylinder);
        let fits = [
            (PLANE, HeightField::fit(points, normal, PLANE).map(Self::HeightField)),
            (4, Sphere::fit(samples).map(Self::Sphere)),
            (5, Revolution::fit(samples, 1, cylinder.as_ref()).map(Self::Revolution)),
            (6, Revolution::fit(samples, 2, cylinder.as_ref()).map(Self::Revolution)),
            (PARABOLOID, paraboloid.map(Self::HeightField)),
        ];
        let (count, floor) = (points.len() as f64, ROUNDING * edge);
        let mut best: Option<(f64, Self)> = None;
        for (terms, fit) in fits {
            let Some(chart) = fit.filter(|chart| chart.free_misfit(points, terms) <= tolerance)
            else {
                continue;
            };
            let misfit = chart.misfit(points);
            let information = count * libm::log(misfit * misfit + floor * floor)
                + terms as f64 * libm::log(count);
            if best.as_ref().is_none_or(|(least, _)| information + MIN_GAIN < *least) {
                best = Some((information, chart));
            }
        }
        best.map(|(_, chart)| chart)
    }

    /// Returns the root mean square distance of points from the surface.
    pub(crate) fn misfit(&self, points: &[Point3<f64>]) -> f64 {
        let squares = points.iter().map(|&point| {
            let distance = self.distance(point).0;
            distance * distance
        });
        (squares.sum::<f64>() / points.len() as f64).sqrt()
    }

    /// Returns the misfit of the points to which a surface with `terms` parameters is fitted. A surface with as many parameters as there
    /// are points fits all of them exactly, so only the points in excess count.
    fn free_misfit(&self, points: &[Point3<f64>], terms: usize) -> f64 {
        let free = points.len() as f64 - terms as f64;
        self.misfit(points) * (points.len() as f64 / free.max(0.0)).sqrt()
    }
}

/// A plane or paraboloid: `height = q(u, v)` over a local frame.
#[derive(Clone, Debug)]
pub(crate) struct HeightField {
    origin: Point3<f64>,
    frame: [Vector3<f64>; 3],
    /// The coefficients of 1, u, v, u^2, u v and v^2.
    coefficients: [f64; 6],
}

impl HeightField {
    fn distance(&self, point: Point3<f64>) -> (f64, Vector3<f64>) {
        let offset = point - self.origin;
        let [u, v, height] = self.frame.map(|axis| axis.dot(&offset));
        let [c, cu, cv, cuu, cuv, cvv] = self.coefficients;
        let q = c + cu * u + cv * v + cuu * u * u + cuv * u * v + cvv * v * v;
        let (slope_u, slope_v) = (cu + 2.0 * cuu * u + cuv * v, cv + cuv * u + 2.0 * cvv * v);
        let size = (1.0 + slope_u * slope_u + slope_v * slope_v).sqrt();
        let [x, y, z] = self.frame;
        ((height - q) / size, (z - x * slope_u - y * slope_v) / size)
    }

    /// Returns the axis of the cylinder that touches the surface above the origin and has its larger principal
    /// curvature; `None` for a plane.
    fn osculating_cylinder(&self) -> Option<Axis> {
        let [.., cuu, cuv, cvv] = self.coefficients;
        let eigen = Matrix2::new(2.0 * cuu, cuv, cuv, 2.0 * cvv).symmetric_eigen();
        let steep = eigen.eigenvalues.iamax();
        let curvature = eigen.eigenvalues[steep];
        let [u, v] = [0, 1].map(|row| eigen.eigenvectors[(row, 1 - steep)]);
        let (height, normal) = self.distance(self.origin);
        let point = self.origin + normal * (1.0 / curvature - height);
        let along = self.frame[0] * u + self.frame[1] * v;
        let direction = (along - normal * normal.dot(&along)).try_normalize(0.0)?;
        point.iter().all(|x| x.is_finite()).then_some(Axis { point, direction })
    }

    /// Fits a plane or paraboloid, which has `terms` coefficients, over the plane with the given normal.
    fn fit(points: &[Point3<f64>], normal: Vector3<f64>, terms: usize) -> Option<Self> {
        let sum: Vector3<f64> = points.iter().map(|point| point.coords).sum();
        let origin = Point3::from(sum / points.len() as f64);
        let across = normal.cross(&Vector3::ith(normal.iamin(), 1.0)).try_normalize(0.0)?;
        let frame = [across, normal.cross(&across), normal];
        // Divide lengths by the maximum distance of a point from the origin, which keeps the equations well scaled.
        let size = points.iter().map(|point| (point - origin).norm()).fold(0.0, f64::max);
        if size == 0.0 {
            return None;
        }
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
        Some(Self { origin, frame, coefficients: std::array::from_fn(|k| x[k] * scales[k]) })
    }
}
