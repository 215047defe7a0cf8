//! Spheres, and surfaces of revolution such as cylinders and cones, fitted to a part of a surface.

use nalgebra::{DMatrix, DVector, Matrix3, Point3, Vector3};

/// A sphere.
#[derive(Clone, Debug)]
pub(crate) struct Sphere {
    center: Point3<f64>,
    radius: f64,
    /// 1 if normals point away from the center, otherwise -1.
    sign: f64,
}

/// The axis of a surface of revolution: a point on it, and its unit vector.
#[derive(Clone, Debug)]
pub(crate) struct Axis {
    pub(super) point: Point3<f64>,
    pub(super) direction: Vector3<f64>,
}

/// A surface of revolution.
#[derive(Clone, Debug)]
pub(crate) struct Revolution {
    axis: Axis,
    /// The coefficients of the radius as a polynomial of the distance along the axis from its point: 1 for a cylinder, 2 for a cone.
    profile: Vec<f64>,
    /// 1 if normals point away from the axis, otherwise -1.
    sign: f64,
}

/// A part of a surface.
pub(super) struct Samples {
    /// The vertices.
    pub(super) points: Vec<Point3<f64>>,
    /// The centers of the faces, and their area vectors.
    pub(super) centers: Vec<Point3<f64>>,
    pub(super) areas: Vec<Vector3<f64>>,
}

impl Samples {
    /// Returns the direction of the sum of the area vectors.
    pub(super) fn mean_normal(&self) -> Option<Vector3<f64>> {
        self.areas.iter().sum::<Vector3<f64>>().try_normalize(0.0)
    }

    /// Returns 1 if the faces look in the direction of `outward` on average, otherwise -1.
    fn sign(&self, outward: impl Fn(Point3<f64>) -> Vector3<f64>) -> f64 {
        let sides = self.centers.iter().zip(&self.areas);
        let sum: f64 = sides.map(|(&center, area)| area.dot(&outward(center))).sum();
        if sum < 0.0 { -1.0 } else { 1.0 }
    }

    /// Returns the centroid of the points, and the maximum distance of a point from it.
    fn extent(&self) -> (Point3<f64>, f64) {
        let sum: Vector3<f64> = self.points.iter().map(|point| point.coords).sum();
        let center = Point3::from(sum / self.points.len() as f64);
        let size = self.points.iter().map(|p| (p - center).norm()).fold(0.0, f64::max);
        (center, size)
    }
}

/// Number of Gauss-Newton steps on the distances of the points.
const STEPS: usize = 12;

/// Maximum rotation of an axis in one step, as a tangent, and the length of a step after which there is none, relative to the extent.
const MAX_TURN: f64 = 0.3;
const MIN_STEP: f64 = 1e-9;

/// Maximum radius, in multiples of the extent of the points. A surface with a larger one is as good as flat there.
const MAX_RADIUS: f64 = 50.0;

impl Sphere {
    /// Fits a sphere by least squares: first the algebraic distances, then the true ones.
    pub(super) fn fit(samples: &Samples) -> Option<Self> {
        let (origin, size) = samples.extent();
        // Divide lengths by the extent, which keeps the equations well scaled.
        let points: Vec<Vector3<f64>> =
            samples.points.iter().map(|p| (p - origin) / size).collect();
        let rows =
            points.iter().map(|p| (vec![2.0 * p.x, 2.0 * p.y, 2.0 * p.z, 1.0], p.norm_squared()));
        let first = least_squares(rows, 4)?;
        let mut center = Vector3::new(first[0], first[1], first[2]);
        let mut radius = (first[3] + center.norm_squared()).max(0.0).sqrt();
        for _ in 0..STEPS {
            let rows = points.iter().map(|p| {
                let spoke = p - center;
                let length = spoke.norm().max(1e-12);
                let out = spoke / length;
                (vec![out.x, out.y, out.z, 1.0], length - radius)
            });
            let step = least_squares(rows, 4)?;
            center += Vector3::new(step[0], step[1], step[2]);
            radius += step[3];
        }
        let center = origin + center * size;
        let sign = samples.sign(|point| point - center);
        let is_usable = 0.0 < radius && radius < MAX_RADIUS;
        is_usable.then_some(Self { center, radius: radius * size, sign })
    }

    /// Returns the signed distance of a point, and the normal at the nearest surface point.
    pub(super) fn distance(&self, point: Point3<f64>) -> (f64, Vector3<f64>) {
        let spoke = point - self.center;
        let normal = spoke.try_normalize(0.0).unwrap_or(Vector3::z()) * self.sign;
        (self.sign * (spoke.norm() - self.radius), normal)
    }
}

impl Revolution {
    /// Fits a surface of revolution whose profile has `terms` coefficients, by Gauss-Newton steps on the distances of the points. Two axes
    /// are tried to begin with: the line that the normals meet best (Pottmann and Randrup, "Rotational and helical surface approximation
    /// for reverse engineering", 1998), and that of the cylinder with the larger principal curvature of a paraboloid, which is better if
    /// the part is small and has noise.
    pub(super) fn fit(samples: &Samples, terms: usize, cylinder: Option<&Axis>) -> Option<Self> {
        let (center, size) = samples.extent();
        let points = scaled(&samples.points, center, size);
        let centers = scaled(&samples.centers, center, size);
        let starts = [
            axis_met_by_normals(&centers, &samples.areas),
            cylinder.map(|axis| Axis {
                point: ((axis.point - center) / size).into(),
                direction: axis.direction,
            }),
        ];
        let fits = starts.into_iter().flatten().filter_map(|axis| {
            Self { axis, profile: vec![0.0; terms], sign: 1.0 }.improve(&points)
        });
        let (_, mut fit) = fits.min_by(|a, b| a.0.total_cmp(&b.0))?;
        fit.axis.point = center + fit.axis.point.coords * size;
        for (k, coefficient) in (0_i32..).zip(&mut fit.profile) {
            *coefficient *= libm::pow(size, f64::from(1 - k));
        }
        fit.sign = samples.sign(|point| fit.distance(point).1);
        Some(fit)
    }

    /// Fits the profile, then the axis and the profile, to points around the origin of space. Returns the best of all steps, and the sum of
    /// the squared distances of the points.
    fn improve(mut self, points: &[Point3<f64>]) -> Option<(f64, Self)> {
        let mut best: Option<(f64, Self)> = None;
        for step in 0..=STEPS {
            // Measure along the axis from the point nearest to the origin of space.
            let axis = self.axis.direction;
            self.axis.point -= axis * axis.dot(&self.axis.point.coords);
            let across = axis.cross(&Vector3::ith(axis.iamin(), 1.0)).try_normalize(0.0)?;
            let length = self.step(points, [across, axis.cross(&across)], step > 0)?;
            let sum: f64 = points.iter().map(|&p| self.distance(p).0).map(|off| off * off).sum();
            let is_usable = 0.0 < self.profile[0] && self.profile[0] < MAX_RADIUS;
            if is_usable && best.as_ref().is_none_or(|(least, _)| sum < *least) {
                best = Some((sum, self.clone()));
            }
            if length < MIN_STEP {
                break;
            }
        }
        best
    }

    /// Moves the coefficients of the profile, and if `moves_axis` also the axis, by a Gauss-Newton step. `sides` are two unit vectors at
    /// right angles to the axis. Returns the length of the step.
    fn step(
        &mut self,
        points: &[Point3<f64>],
        sides: [Vector3<f64>; 2],
        moves_axis: bool,
    ) -> Option<f64> {
        let terms = self.profile.len();
        let rows = points.iter().map(|point| {
            let (along, spoke) = self.axis.split(point);
            let radius = spoke.norm().max(1e-12);
            let (profile_radius, slope) = evaluate(&self.profile, along);
            let scale = 1.0 / libm::hypot(1.0, slope);
            let mut row = Vec::with_capacity(4 + terms);
            if moves_axis {
                for side in &sides {
                    let part = side.dot(&spoke) / radius;
                    // Shifts of the axis, then rotations.
                    row.extend([part * scale, (along + slope * radius) * part * scale]);
                }
            }
            let powers = std::iter::successors(Some(scale), |power| Some(power * along));
            row.extend(powers.take(terms));
            (row, (radius - profile_radius) * scale)
        });
        let solution = least_squares(rows, if moves_axis { 4 + terms } else { terms })?;
        let (axis_step, profile_step) = solution.split_at(solution.len() - terms);
        let turn = axis_step.chunks(2).map(|pair| pair[1].abs()).fold(0.0, f64::max);
        let shorter = if turn > MAX_TURN { MAX_TURN / turn } else { 1.0 };
        for (pair, side) in axis_step.chunks(2).zip(sides) {
            self.axis.point += side * (pair[0] * shorter);
            self.axis.direction += side * (pair[1] * shorter);
        }
        self.axis.direction = self.axis.direction.try_normalize(0.0)?;
        for (coefficient, step) in self.profile.iter_mut().zip(profile_step) {
            *coefficient += step * shorter;
        }
        Some(solution.iter().map(|x| x.abs()).fold(0.0, f64::max))
    }

    /// Returns the approximate signed distance of a point, and the normal at the surface point nearest to it.
    pub(super) fn distance(&self, point: Point3<f64>) -> (f64, Vector3<f64>) {
        let (along, spoke) = self.axis.split(&point);
        let (radius, slope) = evaluate(&self.profile, along);
        let out = spoke.try_normalize(0.0).unwrap_or_default();
        let size = libm::hypot(1.0, slope);
        let normal = (out - self.axis.direction * slope) / size;
        (self.sign * (spoke.norm() - radius) / size, normal * self.sign)
    }
}

/// Returns points relative to a center, divided by `size`.
fn scaled(points: &[Point3<f64>], center: Point3<f64>, size: f64) -> Vec<Point3<f64>> {
    points.iter().map(|point| Point3::from((point - center) / size)).collect()
}

impl Axis {
    /// Returns the distance of a point along the axis, and the vector to the point from the nearest point on the axis.
    fn split(&self, point: &Point3<f64>) -> (f64, Vector3<f64>) {
        let offset = point - self.point;
        let along = self.direction.dot(&offset);
        (along, offset - self.direction * along)
    }
}

/// Returns the value and the slope of a polynomial.
fn evaluate(coefficients: &[f64], at: f64) -> (f64, f64) {
    coefficients.iter().rev().fold((0.0, 0.0), |(value, slope), coefficient| {
        (value * at + coefficient, slope * at + value)
    })
}

/// Returns the axis that lines through the points along the normals meet best. A line through `p` along `n`
/// meets an axis with direction `a` and moment `m` if a . (p x n) + m . n = 0. Longer normals count more.
fn axis_met_by_normals(points: &[Point3<f64>], normals: &[Vector3<f64>]) -> Option<Axis> {
    let (mut moments, mut mixed) = (Matrix3::zeros(), Matrix3::zeros());
    let total: f64 = normals.iter().map(|normal| normal.norm_squared()).sum();
    let mut directions = Matrix3::identity() * (1e-9 * total);
    for (point, normal) in points.iter().zip(normals) {
        let moment = point.coords.cross(normal);
        moments += moment * moment.transpose();
        mixed += moment * normal.transpose();
        directions += normal * normal.transpose();
    }
    let inverse = directions.try_inverse()?;
    let rest = moments - mixed * inverse * mixed.transpose();
    let eigen = (0.5 * (rest + rest.transpose())).symmetric_eigen();
    let direction = Vector3::from(eigen.eigenvectors.column(eigen.eigenvalues.imin()));
    let direction = direction.try_normalize(0.0)?;
    let moment = -(inverse * mixed.transpose() * direction);
    Some(Axis { point: direction.cross(&moment).into(), direction })
}

/// Solves equations for `count` unknowns by least squares, with a little damping; `None` if the solution is not finite.
fn least_squares(rows: impl Iterator<Item = (Vec<f64>, f64)>, count: usize) -> Option<Vec<f64>> {
    let (mut matrix, mut right) = (DMatrix::zeros(count, count), DVector::zeros(count));
    for (row, value) in rows {
        for i in 0..count {
            right[i] += row[i] * value;
            for j in 0..count {
                matrix[(i, j)] += row[i] * row[j];
            }
        }
    }
    for i in 0..count {
        matrix[(i, i)] *= 1.0 + 1e-9;
    }
    let solution: DVector<f64> = matrix.cholesky()?.solve(&right);
    solution.iter().all(|x| x.is_finite()).then(|| solution.iter().copied().collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns a part of a surface of revolution about a slanted axis.
    fn part(radius: fn(f64) -> f64, arc: f64) -> Samples {
        let turn = nalgebra::Rotation3::from_euler_angles(0.4, -0.8, 1.1);
        let at = |angle: f64, along: f64| {
            let (sine, cosine) = libm::sincos(angle);
            Point3::new(3.0, -7.0, 2.0)
                + turn * Vector3::new(radius(along) * cosine, radius(along) * sine, along)
        };
        let (mut points, mut normals) = (Vec::new(), Vec::new());
        for k in 0..100 {
            let (angle, along) = (arc * f64::from(k % 10) / 9.0, f64::from(k / 10));
            let [u, v] = [(1e-5, 0.0), (0.0, 1e-5)]
                .map(|(da, dz)| at(angle + da, along + dz) - at(angle - da, along - dz));
            points.push(at(angle, along));
            normals.push(u.cross(&v).normalize());
        }
        Samples { centers: points.clone(), points, areas: normals }
    }

    #[test]
    fn surfaces_of_revolution_are_found() {
        let profiles: [fn(f64) -> f64; 3] =
            [|_| 12.0, |z| 8.0 + 0.5 * z, |z| 14.0 + 0.2 * z - 0.03 * z * z];
        for (radius, terms) in profiles.into_iter().zip(1..) {
            for arc in [0.6, 1.5, 5.0] {
                let samples = part(radius, arc);
                let fit = Revolution::fit(&samples, terms, None).unwrap();
                for (point, normal) in samples.points.iter().zip(&samples.areas) {
                    let (distance, own) = fit.distance(*point);
                    assert!(distance.abs() < 1e-6, "{terms} terms, {arc}: {distance}");
                    assert!(own.dot(normal) > 0.9999, "{terms} terms, {arc}");
                }
            }
        }
    }

    #[test]
    fn a_sphere_is_found_from_inside() {
        let mut samples = part(|z| (100.0 - (z - 4.0) * (z - 4.0)).sqrt(), 0.8);
        samples.areas.iter_mut().for_each(|area| *area = -*area);
        let fit = Sphere::fit(&samples).unwrap();
        assert!((fit.radius - 10.0).abs() < 1e-9, "{}", fit.radius);
        let (inside, normal) = fit.distance(fit.center + Vector3::x() * 3.0);
        assert!((inside - 7.0).abs() < 1e-9 && (normal + Vector3::x()).norm() < 1e-9);
    }
}
