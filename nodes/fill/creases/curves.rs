//! Curves that join two ends of creases across a hole: lines, circular arcs and splines.

use nalgebra::{DMatrix, Matrix3, Point3, Vector3};

use super::ends::{CreaseEnd, transport};

/// Numbers of edges of each end to which a line or a circle is fitted, in turn. The largest number that fits is used.
const WINDOWS: [usize; 3] = [40, 20, 10];

/// Numbers of edges of an end to which a parabola is fitted for a spline, in turn.
const SPLINE_WINDOWS: [usize; 4] = [16, 12, 8, 5];

/// Limits of the root mean square distance of the ends from a curve, in edge lengths. Between the limits, it is [`NOISE_RATIO`] times the
/// noise of the ends.
const MIN_MISFIT: f64 = 0.03;
const MAX_MISFIT: f64 = 0.15;
const NOISE_RATIO: f64 = 2.5;

/// Maximum root mean square distance of long ends that are notched, as where a relief meets an edge, in edge lengths; and the minimum
/// number of edges of such an end.
const MAX_NOTCHES: f64 = 0.6;
const NOTCHED_EDGES: usize = 12;

/// Minimum decrease of the Bayesian information criterion for which a circle is used instead of a line.
const MIN_GAIN: f64 = 10.0;

/// Maximum value of the bending of a spline: its length cubed, times the integral of the square of the change of its curvature. A spline
/// whose curvature changes evenly from 0 to the curvature at which it turns by 90 degrees has a value of 10.
const MAX_BENDING: f64 = 40.0;

/// Cosine of the maximum angle, 20 degrees, between two straight creases that are joined. Those at a larger angle meet in a corner.
const MAX_STRAIGHT_TURN: f64 = 0.9396926207859084;

/// Distance from the ends over which a curve is moved to end exactly at the rim, in edge lengths.
const BLEND: f64 = 4.0;

/// Minimum cosine of the angle between the normals beside one end, moved along the curve to the other end, and the normals there.
const MIN_NORMAL_COSINE: f64 = 0.5;

/// A curve that continues two creases of the data and joins them.
#[derive(Clone, Debug)]
pub(super) struct Joint {
    /// At least 3 points about an edge length apart, from the rim vertex of the first end to that of the second one.
    pub(super) points: Vec<Point3<f64>>,
    /// For each of both sides, the normal of the surface at each point. The first side is that of the rim from the first to the second end.
    pub(super) normals: [Vec<Vector3<f64>>; 2],
    /// The cost of the curve: its bending, and the misfit relative to the limit.
    pub(super) cost: f64,
    pub(super) is_straight: bool,
}

/// Returns the best curve that joins two ends; `None` if they are not ends of one crease. `edge` is the mean edge length.
pub(super) fn join(a: &CreaseEnd, b: &CreaseEnd, edge: f64) -> Option<Joint> {
    let (curve, cost, is_straight) = curve_between(a, b, edge)?;
    let length: f64 = curve.windows(2).map(|pair| (pair[1] - pair[0]).norm()).sum();
    let mut points = resample(&curve, (length / edge).round().max(2.0) as usize);
    let last = points.len() - 1;
    let offsets = [a.points[0] - points[0], b.points[0] - points[last]];
    let reach = (BLEND * edge).min(0.5 * length);
    for (k, point) in points.iter_mut().enumerate() {
        let along = length * k as f64 / last as f64;
        for (offset, distance) in offsets.iter().zip([along, length - along]) {
            let weight = (1.0 - distance / reach).max(0.0);
            *point += offset * (weight * weight * (3.0 - 2.0 * weight));
        }
    }
    let normals = [0, 1].map(|side| side_normals(&points, a.normals[side], b.normals[1 - side]));
    let [first, second] = normals;
    Some(Joint { points, normals: [first?, second?], cost, is_straight })
}

/// Returns the normals of a surface beside a curve, from those at its ends. `None` if the latter do not belong to one surface.
fn side_normals(
    points: &[Point3<f64>],
    first: Vector3<f64>,
    last: Vector3<f64>,
) -> Option<Vec<Vector3<f64>>> {
    let count = points.len();
    let tangents: Vec<Vector3<f64>> =
        (0..count).map(|k| points[(k + 1).min(count - 1)] - points[k.saturating_sub(1)]).collect();
    let mut forward = vec![first; count];
    for k in 1..count {
        forward[k] = transport(forward[k - 1], tangents[k - 1], tangents[k]);
    }
    let mut backward = vec![last; count];
    for k in (0..count - 1).rev() {
        backward[k] = transport(backward[k + 1], tangents[k + 1], tangents[k]);
    }
    if forward[count - 1].dot(&last) < MIN_NORMAL_COSINE {
        return None;
    }
    (0..count)
        .map(|k| {
            let fraction = k as f64 / (count - 1) as f64;
            let mixed = forward[k] * (1.0 - fraction) + backward[k] * fraction;
            let tangent = tangents[k].try_normalize(0.0)?;
            (mixed - tangent * tangent.dot(&mixed)).try_normalize(0.0)
        })
        .collect()
}

/// Returns points on the best curve between two ends, its cost, and whether it is a line.
fn curve_between(a: &CreaseEnd, b: &CreaseEnd, edge: f64) -> Option<(Vec<Point3<f64>>, f64, bool)> {
    let noise = [a, b].map(|end| noise(&end.points)).into_iter().fold(0.0, f64::max);
    let limit = (NOISE_RATIO * noise).clamp(MIN_MISFIT * edge, MAX_MISFIT * edge);
    for window in WINDOWS {
        if let Some(curve) = simple_curve(a, b, window, limit, edge) {
            return Some(curve);
        }
        if a.points.len().max(b.points.len()) <= window {
            break;
        }
    }
    let locals = [a, b].map(|end| LocalFit::new(&end.points, limit));
    if let [Some(first), Some(last)] = locals {
        if [a, b].iter().all(|end| is_straight(end, limit))
            && a.heading().dot(&b.heading()) > -MAX_STRAIGHT_TURN
        {
            return None;
        }
        let (points, bending) = spline(&first, &last)?;
        if bending > MAX_BENDING {
            return None;
        }
        let points = polynomial(a, b, &points, limit, edge).unwrap_or(points);
        return Some((points, 1.0 + bending, false));
    }
    let is_long = NOTCHED_EDGES < a.points.len().min(b.points.len());
    is_long.then(|| simple_curve(a, b, WINDOWS[0], MAX_NOTCHES * edge, edge))?
}

/// Returns true if the crease is a line up to [`NOTCHED_EDGES`] from the rim.
fn is_straight(end: &CreaseEnd, limit: f64) -> bool {
    let points = &end.points[..=NOTCHED_EDGES.min(end.points.len() - 1)];
    principal_axes(points)
        .is_some_and(|(origin, axes)| line_misfit(points, origin, axes[0]) <= limit)
}

/// Returns the root mean square distance of points from a line.
fn line_misfit(points: &[Point3<f64>], origin: Point3<f64>, axis: Vector3<f64>) -> f64 {
    let squares = points.iter().map(|p| (p - origin).cross(&axis).norm_squared());
    (squares.sum::<f64>() / points.len() as f64).sqrt()
}

/// Estimates the noise of points on a curve from their third differences across the curve.
fn noise(points: &[Point3<f64>]) -> f64 {
    let (mut sum, mut count) = (0.0, 0.0);
    for four in points.windows(4) {
        let along = (four[3] - four[0]).try_normalize(0.0).unwrap_or_default();
        let third = (four[3] - four[0]) - (four[2] - four[1]) * 3.0;
        sum += (third - along * along.dot(&third)).norm_squared();
        count += 1.0;
    }
    // The variance of a third difference is 20 times that of the points; noise across the curve has two components.
    if count > 0.0 { (sum / count / 20.0).sqrt() } else { 0.0 }
}

/// Returns the line or the circular arc that fits both ends within `limit`.
fn simple_curve(
    a: &CreaseEnd,
    b: &CreaseEnd,
    window: usize,
    limit: f64,
    edge: f64,
) -> Option<(Vec<Point3<f64>>, f64, bool)> {
    fn own(end: &CreaseEnd, window: usize) -> Vec<Point3<f64>> {
        end.points[..=window.min(end.points.len() - 1)].to_vec()
    }
    let points = [own(a, window), own(b, window)].concat();
    let count = points.len() as f64;
    let floor = 0.01 * edge;
    fn information(misfit: f64, terms: f64, count: f64, floor: f64) -> f64 {
        2.0 * count * libm::log(misfit * misfit + floor * floor) + terms * libm::log(2.0 * count)
    }
    let (origin, axes) = principal_axes(&points)?;
    let line_misfit = line_misfit(&points, origin, axes[0]);
    let circle = Circle::fit(&points, origin, axes);
    let circle = circle.map(|circle| (circle.misfit(&points), circle));
    let prefers_circle = circle.as_ref().is_some_and(|(misfit, _)| {
        information(*misfit, 6.0, count, floor) + MIN_GAIN
            < information(line_misfit, 4.0, count, floor)
    });
    match circle {
        Some((misfit, circle)) if prefers_circle && misfit <= limit => {
            let arc = circle.arc(a, b, edge)?;
            Some((arc, (misfit / limit) * (misfit / limit), false))
        }
        _ if line_misfit <= limit => {
            let [from, to] =
                [a, b].map(|end| origin + axes[0] * axes[0].dot(&(end.points[0] - origin)));
            let along = to - from;
            let is_ahead = along.dot(&a.heading()) > 0.0 && along.dot(&b.heading()) < 0.0;
            is_ahead.then(|| (vec![from, to], (line_misfit / limit) * (line_misfit / limit), true))
        }
        _ => None,
    }
}

/// Returns the centroid of points and their principal axes, that of the largest extent first.
fn principal_axes(points: &[Point3<f64>]) -> Option<(Point3<f64>, [Vector3<f64>; 3])> {
    let sum: Vector3<f64> = points.iter().map(|p| p.coords).sum();
    let origin = Point3::from(sum / points.len() as f64);
    let scatter: Matrix3<f64> =
        points.iter().map(|p| (p - origin) * (p - origin).transpose()).sum();
    let eigen = scatter.symmetric_eigen();
    let mut order = [0, 1, 2];
    order.sort_by(|&i, &j| eigen.eigenvalues[j].total_cmp(&eigen.eigenvalues[i]).then(i.cmp(&j)));
    let axes = order.map(|k| Vector3::from(eigen.eigenvectors.column(k)));
    axes.iter().all(|axis| axis.norm() > 0.5).then_some((origin, axes))
}

/// A circle in space.
struct Circle {
    center: Point3<f64>,
    /// Two unit vectors in the plane of the circle, and its normal.
    axes: [Vector3<f64>; 3],
    radius: f64,
}

/// Maximum radius of a circle, as a multiple of the extent of the points to which it is fitted.
const MAX_RADIUS: f64 = 100.0;

impl Circle {
    /// Fits a circle in the plane of the first two axes: Taubin, "Estimation of planar curves, surfaces, and nonplanar space curves defined
    /// by implicit equations" (1991), then Gauss-Newton steps on the distances.
    fn fit(points: &[Point3<f64>], origin: Point3<f64>, axes: [Vector3<f64>; 3]) -> Option<Self> {
        let size = points.iter().map(|p| (p - origin).norm()).fold(0.0, f64::max);
        let flat: Vec<[f64; 2]> =
            points.iter().map(|p| [0, 1].map(|k| axes[k].dot(&(p - origin)) / size)).collect();
        let count = flat.len() as f64;
        fn mean(f: &dyn Fn(f64, f64, f64) -> f64, flat: &[[f64; 2]], count: f64) -> f64 {
            flat.iter().map(|&[x, y]| f(x, y, x * x + y * y)).sum::<f64>() / count
        }
        let (xx, yy, xy) = (
            mean(&|x, _, _| x * x, &flat, count),
            mean(&|_, y, _| y * y, &flat, count),
            mean(&|x, y, _| x * y, &flat, count),
        );
        let (xz, yz, zz) = (
            mean(&|x, _, z| x * z, &flat, count),
            mean(&|_, y, z| y * z, &flat, count),
            mean(&|_, _, z| z * z, &flat, count),
        );
        let z = xx + yy;
        let (cov, var) = (xx * yy - xy * xy, zz - z * z);
        // The smallest root of the characteristic polynomial, by Newton steps from 0.
        let a2 = -3.0 * z * z - zz;
        let a1 = var * z + 4.0 * cov * z - xz * xz - yz * yz;
        let a0 = xz * (xz * yy - yz * xy) + yz * (yz * xx - xz * xy) - var * cov;
        let mut root = 0.0;
        for _ in 0..30 {
            let value = a0 + root * (a1 + root * (a2 + root * 4.0 * z));
            let slope = a1 + root * (2.0 * a2 + root * 12.0 * z);
            if slope == 0.0 {
                break;
            }
            root -= value / slope;
        }
        let det = root * root - root * z + cov;
        let mut x = (xz * (yy - root) - yz * xy) / (2.0 * det);
        let mut y = (yz * (xx - root) - xz * xy) / (2.0 * det);
        let mut radius = (x * x + y * y + z).sqrt();
        for _ in 0..5 {
            let (mut matrix, mut right) = (Matrix3::zeros(), Vector3::zeros());
            for &[px, py] in &flat {
                let distance = libm::hypot(px - x, py - y).max(1e-12);
                let row = Vector3::new((x - px) / distance, (y - py) / distance, -1.0);
                matrix += row * row.transpose();
                right -= row * (distance - radius);
            }
            let step = matrix.cholesky()?.solve(&right);
            (x, y, radius) = (x + step.x, y + step.y, radius + step.z);
        }
        let is_usable =
            [x, y, radius].iter().all(|x| x.is_finite()) && 0.0 < radius && radius < MAX_RADIUS;
        let center = origin + (axes[0] * x + axes[1] * y) * size;
        is_usable.then_some(Self { center, axes, radius: radius * size })
    }

    /// Returns the root mean square distance of points from the circle.
    fn misfit(&self, points: &[Point3<f64>]) -> f64 {
        let squares = points.iter().map(|point| {
            let [x, y, height] = self.axes.map(|axis| axis.dot(&(point - self.center)));
            let off = libm::hypot(x, y) - self.radius;
            off * off + height * height
        });
        (squares.sum::<f64>() / points.len() as f64).sqrt()
    }

    /// Returns points on the arc that leaves the first end in its direction and arrives at the second end.
    fn arc(&self, a: &CreaseEnd, b: &CreaseEnd, edge: f64) -> Option<Vec<Point3<f64>>> {
        fn angle(point: Point3<f64>, axes: &[Vector3<f64>; 3], center: Point3<f64>) -> f64 {
            let [x, y] = [0, 1].map(|k| axes[k].dot(&(point - center)));
            libm::atan2(y, x)
        }
        fn direction(angle: f64, axes: &[Vector3<f64>; 3]) -> Vector3<f64> {
            let (sine, cosine) = libm::sincos(angle);
            axes[1] * cosine - axes[0] * sine
        }
        let [from, to] = [a, b].map(|end| angle(end.points[0], &self.axes, self.center));
        let sign = direction(from, &self.axes).dot(&a.heading()).signum();
        if (direction(to, &self.axes) * sign).dot(&b.heading()) > -0.5 {
            return None;
        }
        let sweep = ((to - from) * sign).rem_euclid(std::f64::consts::TAU);
        let count = (4.0 * sweep * self.radius / edge).ceil().clamp(2.0, 10_000.0);
        let points = (0..=count as usize).map(|k| {
            let (sine, cosine) = libm::sincos(from + sign * sweep * k as f64 / count);
            self.center + (self.axes[0] * cosine + self.axes[1] * sine) * self.radius
        });
        Some(points.collect())
    }
}

/// The position, the direction into the hole and the curvature vector of a crease at the rim.
struct LocalFit {
    position: Point3<f64>,
    direction: Vector3<f64>,
    curvature: Vector3<f64>,
}

impl LocalFit {
    /// Fits a parabola over the arc length to the points next to the rim; `None` if none fits within `limit`.
    fn new(points: &[Point3<f64>], limit: f64) -> Option<Self> {
        let mut windows = SPLINE_WINDOWS.iter().map(|&window| window.min(points.len() - 1));
        windows.find_map(|window| Self::from_points(&points[..=window], limit))
    }

    fn from_points(points: &[Point3<f64>], limit: f64) -> Option<Self> {
        let mut along = vec![0.0];
        for pair in points.windows(2) {
            along.push(along[along.len() - 1] - (pair[1] - pair[0]).norm());
        }
        let size = -along[along.len() - 1];
        let (mut matrix, mut right) = (Matrix3::zeros(), Matrix3::zeros());
        for (point, along) in points.iter().zip(&along) {
            let s = along / size;
            let row = Vector3::new(1.0, s, s * s);
            matrix += row * row.transpose();
            right += row * (point - points[0]).transpose();
        }
        let fit = matrix.cholesky()?.solve(&right);
        let squares = points.iter().zip(&along).map(|(point, along)| {
            let s = along / size;
            let at = fit.transpose() * Vector3::new(1.0, s, s * s);
            (point - points[0] - at).norm_squared()
        });
        if (squares.sum::<f64>() / points.len() as f64).sqrt() > limit {
            return None;
        }
        let [at, first, second] = [0, 1, 2].map(|k| fit.row(k).transpose());
        let direction = (first / size).try_normalize(0.0)?;
        let curvature = second * (2.0 / (size * size));
        Some(Self {
            position: points[0] + at,
            direction,
            curvature: curvature - direction * direction.dot(&curvature),
        })
    }
}

/// Number of points on a spline.
const SPLINE_POINTS: usize = 64;

/// Returns points on the spline with the positions, directions and curvatures of two ends, and its bending. It is a polynomial of degree 5
/// of the arc length, which approximates the curve whose curvature changes as evenly as possible.
fn spline(a: &LocalFit, b: &LocalFit) -> Option<(Vec<Point3<f64>>, f64)> {
    let chord = b.position - a.position;
    let mut length = chord.norm();
    let mut result = None;
    for _ in 0..8 {
        let (p1, q1) = (a.direction * length, -b.direction * length);
        let (p2, q2) = (a.curvature * (length * length), b.curvature * (length * length));
        // The coefficients of t^3, t^4 and t^5 follow from the conditions at t = 1.
        let rest = [chord - p1 - p2 / 2.0, q1 - p1 - p2, q2 - p2];
        let c3 = rest[0] * 10.0 - rest[1] * 4.0 + rest[2] * 0.5;
        let c4 = rest[0] * -15.0 + rest[1] * 7.0 - rest[2];
        let c5 = rest[0] * 6.0 - rest[1] * 3.0 + rest[2] * 0.5;
        let points: Vec<Point3<f64>> = (0..=SPLINE_POINTS)
            .map(|k| {
                let t = k as f64 / SPLINE_POINTS as f64;
                a.position + (p1 + (p2 / 2.0 + (c3 + (c4 + c5 * t) * t) * t) * t) * t
            })
            .collect();
        let third = (0..=SPLINE_POINTS).map(|k| {
            let t = k as f64 / SPLINE_POINTS as f64;
            (c3 * 6.0 + (c4 * 24.0 + c5 * 60.0 * t) * t).norm_squared()
        });
        let bending = third.sum::<f64>() / (SPLINE_POINTS + 1) as f64 / (length * length);
        length = points.windows(2).map(|pair| (pair[1] - pair[0]).norm()).sum();
        result = Some((points, bending));
        if length.is_nan() || length >= 4.0 * chord.norm() {
            return None;
        }
    }
    result
}

/// Maximum degree of a polynomial, and number of points of each end to which it is fitted.
const MAX_DEGREE: usize = 7;
const POLYNOMIAL_POINTS: usize = 17;

/// Maximum length of a gap that a polynomial bridges, as a multiple of the length of both ends to which it is fitted.
const MAX_BRIDGE: f64 = 1.0;

/// Fits a polynomial of the arc length to both ends at once, which determines a curve with noise better than a spline between local fits.
/// Returns its points between the ends; `None` if the gap is too long or no polynomial fits. The degree is that with the least Bayesian
/// information criterion. `spline` is an estimate of the curve.
fn polynomial(
    a: &CreaseEnd,
    b: &CreaseEnd,
    spline: &[Point3<f64>],
    limit: f64,
    edge: f64,
) -> Option<Vec<Point3<f64>>> {
    let [first, last] = [a, b].map(|end| &end.points[..POLYNOMIAL_POINTS.min(end.points.len())]);
    let [back, ahead] = [first, last].map(arc_lengths);
    let reach = back[back.len() - 1] + ahead[ahead.len() - 1];
    let points: Vec<Point3<f64>> = first.iter().chain(last).copied().collect();
    let mut gap = spline.to_vec();
    for _ in 0..4 {
        let lengths = arc_lengths(&gap);
        let length = lengths[lengths.len() - 1];
        if length > MAX_BRIDGE * reach {
            return None;
        }
        let places: Vec<f64> =
            back.iter().map(|s| -s).chain(ahead.iter().map(|s| length + s)).collect();
        let range = [-back[back.len() - 1], length + ahead[ahead.len() - 1]];
        let fits = (3..=MAX_DEGREE).filter_map(|degree| {
            let fit = Polynomial::fit(&points, &places, range, degree)?;
            let misfit = fit.misfit(&points, &places);
            let (count, floor) = (2.0 * points.len() as f64, 0.003 * edge);
            let information = count * libm::log(misfit * misfit + floor * floor)
                + 2.0 * (degree + 1) as f64 * libm::log(count);
            Some((information, misfit, fit))
        });
        let (_, misfit, fit) = fits.min_by(|a, b| a.0.total_cmp(&b.0))?;
        if misfit > limit {
            return None;
        }
        gap = (0..=SPLINE_POINTS)
            .map(|k| fit.point(length * k as f64 / SPLINE_POINTS as f64))
            .collect();
    }
    Some(gap)
}

/// A polynomial curve, as a sum of Chebyshev polynomials over a range.
struct Polynomial {
    range: [f64; 2],
    coefficients: Vec<Vector3<f64>>,
}

impl Polynomial {
    fn fit(points: &[Point3<f64>], places: &[f64], range: [f64; 2], degree: usize) -> Option<Self> {
        let size = degree + 1;
        if points.len() < 2 * size {
            return None;
        }
        let (mut matrix, mut right) = (DMatrix::zeros(size, size), DMatrix::zeros(size, 3));
        for (point, &place) in points.iter().zip(places) {
            let row = chebyshev(range, place, size);
            for i in 0..size {
                for j in 0..size {
                    matrix[(i, j)] += row[i] * row[j];
                }
                for axis in 0..3 {
                    right[(i, axis)] += row[i] * (point[axis] - points[0][axis]);
                }
            }
        }
        let solution = matrix.cholesky()?.solve(&right);
        let coefficients = (0..size).map(|k| {
            let own = Vector3::new(solution[(k, 0)], solution[(k, 1)], solution[(k, 2)]);
            if k == 0 { own + points[0].coords } else { own }
        });
        Some(Self { range, coefficients: coefficients.collect() })
    }

    fn point(&self, place: f64) -> Point3<f64> {
        let row = chebyshev(self.range, place, self.coefficients.len());
        Point3::from(
            row.iter().zip(&self.coefficients).map(|(x, own)| own * *x).sum::<Vector3<f64>>(),
        )
    }

    /// Returns the root mean square distance of points from the curve, enlarged by the number of coefficients.
    fn misfit(&self, points: &[Point3<f64>], places: &[f64]) -> f64 {
        let squares = points
            .iter()
            .zip(places)
            .map(|(point, &place)| (point - self.point(place)).norm_squared());
        (squares.sum::<f64>() / (points.len() - self.coefficients.len()) as f64).sqrt()
    }
}

/// Returns the values of the first Chebyshev polynomials at a position in a range.
fn chebyshev([low, high]: [f64; 2], place: f64, count: usize) -> Vec<f64> {
    let x = (2.0 * place - low - high) / (high - low);
    let mut values = vec![1.0, x];
    while values.len() < count {
        let k = values.len();
        values.push(2.0 * x * values[k - 1] - values[k - 2]);
    }
    values
}

/// Returns the distance along a polyline from its first point to each point.
fn arc_lengths(curve: &[Point3<f64>]) -> Vec<f64> {
    let mut lengths = vec![0.0];
    for pair in curve.windows(2) {
        lengths.push(lengths[lengths.len() - 1] + (pair[1] - pair[0]).norm());
    }
    lengths
}

/// Returns `count` + 1 points evenly spaced along a polyline.
fn resample(curve: &[Point3<f64>], count: usize) -> Vec<Point3<f64>> {
    let along = arc_lengths(curve);
    let length = along[along.len() - 1];
    (0..=count)
        .map(|k| {
            let at = length * k as f64 / count as f64;
            let next = along.partition_point(|&along| along < at).clamp(1, curve.len() - 1);
            let size = along[next] - along[next - 1];
            let fraction = if size > 0.0 { (at - along[next - 1]) / size } else { 0.0 };
            curve[next - 1] + (curve[next] - curve[next - 1]) * fraction
        })
        .collect()
}
