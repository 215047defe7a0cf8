//! Points with exact rational coordinates.

use std::cmp::Ordering;
use std::collections::BTreeMap;

use maquette_value::Bounds;
use nalgebra::{Point3, Vector3};
use num_bigint::{BigInt, Sign};

/// Half of the number of cells of the grid along its longest side. Determinants of three coordinate differences must fit into 128 bits.
const HALF: f64 = (1u64 << 38) as f64;

/// Number of bits after the binary point in the keys of points.
const FRACTION_BITS: u32 = 20;

/// A point of the grid, in cells.
pub(super) type Site = [i64; 3];

/// The grid to whose nodes the vertices are rounded. Its spacing is about 2e-12 of the extent of all vertices.
#[derive(Clone, Copy)]
pub(super) struct Grid {
    middle: Point3<f64>,
    per_mm: f64,
}

impl Grid {
    pub(super) fn new([low, high]: [Point3<f64>; 2]) -> Self {
        let half = (high - low).amax() / 2.0;
        let per_mm = if half > 0.0 { libm::exp2(libm::log2(HALF / half).floor()) } else { 1.0 };
        let middle = nalgebra::center(&low, &high).map(|x| (x * per_mm).round() / per_mm);
        Self { middle, per_mm }
    }

    pub(super) fn site(&self, at: &Point3<f64>) -> Site {
        let cells = (at - self.middle) * self.per_mm;
        // Positions that are not finite would be outside of the grid.
        [0, 1, 2].map(|axis| cells[axis].round().clamp(-2.0 * HALF, 2.0 * HALF) as i64)
    }

    /// Returns the position in mm of a point given in cells of the grid, rounded to a node.
    pub(super) fn position(&self, cells: [f64; 3]) -> Point3<f64> {
        self.middle + Vector3::from(cells.map(f64::round)) / self.per_mm
    }
}

/// A point in homogeneous coordinates: `at` divided by `weight`, which is positive.
#[derive(Clone, Debug)]
pub(super) struct ExactPoint {
    at: [BigInt; 3],
    weight: BigInt,
}

impl ExactPoint {
    fn of_site(site: Site) -> Self {
        Self { at: site.map(BigInt::from), weight: BigInt::from(1) }
    }

    fn new(at: [BigInt; 3], weight: BigInt) -> Self {
        match weight.sign() {
            Sign::Minus => Self { at: at.map(|x| -x), weight: -weight },
            _ => Self { at, weight },
        }
    }

    /// Returns the coordinates rounded down to multiples of `2^-FRACTION_BITS`. Equal points have equal keys.
    fn key(&self) -> [i64; 3] {
        self.at.each_ref().map(|x| {
            let scaled: BigInt = x << FRACTION_BITS;
            let quotient: BigInt = &scaled / &self.weight;
            // The division rounds toward zero.
            let is_rounded_up = scaled.sign() == Sign::Minus && &quotient * &self.weight != scaled;
            let floor = if is_rounded_up { quotient - 1 } else { quotient };
            i64::try_from(floor).expect("points are inside of the grid")
        })
    }

    fn equals(&self, other: &Self) -> bool {
        (0..3).all(|k| &self.at[k] * &other.weight == &other.at[k] * &self.weight)
    }
}

/// All points of an arrangement. Equal points have one number.
pub(super) struct Points {
    exact: Vec<ExactPoint>,
    /// The points rounded to double precision, in cells; the error is below [`ERROR`].
    rounded: Vec<[f64; 3]>,
    numbers: BTreeMap<[i64; 3], Vec<u32>>,
}

/// Maximum error of a rounded coordinate in cells: coordinates have less than 2^39 cells, of which double precision keeps 2^-14.
const ERROR: f64 = 1.0 / (1 << 13) as f64;

impl Points {
    pub(super) fn new() -> Self {
        Self { exact: Vec::new(), rounded: Vec::new(), numbers: BTreeMap::new() }
    }

    pub(super) fn add_site(&mut self, site: Site) -> u32 {
        self.add(ExactPoint::of_site(site))
    }

    /// Returns the number of a point, which is added unless it is known.
    pub(super) fn add(&mut self, point: ExactPoint) -> u32 {
        let key = point.key();
        let known = self.numbers.entry(key).or_default();
        if let Some(number) = known.iter().find(|it| self.exact[**it as usize].equals(&point)) {
            return *number;
        }
        let number = self.exact.len() as u32;
        known.push(number);
        let scale = f64::from(1u32 << FRACTION_BITS);
        self.rounded.push(key.map(|x| x as f64 / scale));
        self.exact.push(point);
        number
    }

    /// Returns a point rounded to double precision, in cells of the grid.
    pub(super) fn rounded(&self, point: u32) -> [f64; 3] {
        self.rounded[point as usize]
    }

    /// Returns a box around a line in a projection, enlarged by more than the rounding of points.
    pub(super) fn bounds(&self, ends: [u32; 2], axes: [usize; 2]) -> Bounds {
        let flat = ends.map(|it| axes.map(|axis| self.rounded(it)[axis]));
        let Bounds { low, high } = Bounds::from_points(&flat.map(|[x, y]| Point3::new(x, y, 0.0)));
        let margin = Vector3::repeat(1.0);
        Bounds { low: low - margin, high: high + margin }
    }

    /// Returns the orientation of three points in a projection: `Greater` if they are counter-clockwise, `Equal` if they are on one line.
    pub(super) fn orientation(&self, [p, q, r]: [u32; 3], [i, j]: [usize; 2]) -> Ordering {
        if p == q || q == r || r == p {
            return Ordering::Equal;
        }
        let [a, b, c] = [p, q, r].map(|it| self.rounded(it));
        let [u, v] = [b, c].map(|it| [it[i] - a[i], it[j] - a[j]]);
        let [left, right] = [u[0] * v[1], u[1] * v[0]];
        let lengths = u[0].abs() + u[1].abs() + v[0].abs() + v[1].abs();
        let error = 4.0 * ERROR * (lengths + ERROR) + 1e-15 * (left.abs() + right.abs());
        if error < (left - right).abs() {
            return left.total_cmp(&right);
        }
        let [p, q, r] = [p, q, r].map(|it| &self.exact[it as usize]);
        let minor = |a: &ExactPoint, b: &ExactPoint| &a.at[i] * &b.at[j] - &a.at[j] * &b.at[i];
        let sum = minor(p, q) * &r.weight + minor(q, r) * &p.weight + minor(r, p) * &q.weight;
        sum.cmp(&BigInt::ZERO)
    }

    /// Compares a point with the circle through three counter-clockwise points, in a projection: `Greater` if the last point is inside.
    pub(super) fn in_circle(&self, corners: [u32; 4], [i, j]: [usize; 2]) -> Ordering {
        let places = corners.map(|it| self.rounded(it));
        let from = places[3];
        let [a, b, c] = [0, 1, 2].map(|k| {
            let [x, y] = [places[k][i] - from[i], places[k][j] - from[j]];
            [x, y, x * x + y * y]
        });
        let minor = |p: [f64; 3], q: [f64; 3]| p[0] * q[1] - p[1] * q[0];
        let sum = a[2] * minor(b, c) + b[2] * minor(c, a) + c[2] * minor(a, b);
        let most = [a, b, c].iter().fold(0.0, |most: f64, it| most.max(it[0].abs() + it[1].abs()));
        let error = 64.0 * most * most * most * (ERROR + 1e-15 * most);
        if error < sum.abs() {
            return sum.total_cmp(&0.0);
        }
        let rows = corners.map(|it| {
            let ExactPoint { at, weight } = &self.exact[it as usize];
            let [x, y] = [&at[i], &at[j]];
            [x * weight, y * weight, x * x + y * y, weight * weight]
        });
        let minor = |r: usize, s: usize, k: usize, l: usize| {
            &rows[r][k] * &rows[s][l] - &rows[r][l] * &rows[s][k]
        };
        // Laplace expansion along the first two rows.
        let sum = minor(0, 1, 0, 1) * minor(2, 3, 2, 3) - minor(0, 1, 0, 2) * minor(2, 3, 1, 3)
            + minor(0, 1, 0, 3) * minor(2, 3, 1, 2)
            + minor(0, 1, 1, 2) * minor(2, 3, 0, 3)
            - minor(0, 1, 1, 3) * minor(2, 3, 0, 2)
            + minor(0, 1, 2, 3) * minor(2, 3, 0, 1);
        sum.cmp(&BigInt::ZERO)
    }

    /// Adds the weighted mean of three points.
    pub(super) fn add_inside(&mut self, corners: [u32; 3], weights: [u32; 3]) -> u32 {
        let corners = corners.map(|it| &self.exact[it as usize]);
        // The weight of each corner times the denominators of the others.
        let factors = [0, 1, 2].map(|k| {
            let [i, j] = [(k + 1) % 3, (k + 2) % 3];
            &corners[i].weight * &corners[j].weight * weights[k]
        });
        let at =
            [0, 1, 2].map(|axis: usize| (0..3).map(|k| &corners[k].at[axis] * &factors[k]).sum());
        let weight = (0..3).map(|k| &corners[k].weight * &factors[k]).sum();
        self.add(ExactPoint::new(at, weight))
    }

    /// Compares the height of a point above a plane with 0.
    pub(super) fn height(&self, point: u32, plane: &Plane) -> Ordering {
        let point = &self.exact[point as usize];
        let along: BigInt = (0..3).map(|k| &point.at[k] * plane.normal[k]).sum();
        along.cmp(&(&point.weight * plane.offset))
    }

    /// Compares two points by one coordinate.
    fn compare_along(&self, p: u32, q: u32, axis: usize) -> Ordering {
        let [a, b] = [p, q].map(|it| self.rounded(it)[axis]);
        if 4.0 * ERROR < (a - b).abs() {
            return a.total_cmp(&b);
        }
        let [p, q] = [p, q].map(|it| &self.exact[it as usize]);
        (&p.at[axis] * &q.weight).cmp(&(&q.at[axis] * &p.weight))
    }

    /// Compares two points by their coordinates in a projection. On a line, this is their order along the line.
    pub(super) fn compare(&self, p: u32, q: u32, [i, j]: [usize; 2]) -> Ordering {
        if p == q {
            return Ordering::Equal;
        }
        self.compare_along(p, q, i).then_with(|| self.compare_along(p, q, j))
    }

    /// Adds the intersection of two lines in a plane, each given by two points. The lines are not parallel.
    pub(super) fn add_crossing(&mut self, lines: [[u32; 2]; 2], plane: &Plane) -> u32 {
        let [i, j] = plane.axes;
        let [l, m] = lines.map(|ends| {
            let [p, q] = ends.map(|it| &self.exact[it as usize]);
            cross([&p.at[i], &p.at[j], &p.weight], [&q.at[i], &q.at[j], &q.weight])
        });
        let [x, y, w] = cross(l.each_ref(), m.each_ref());
        let normal = plane.normal.map(BigInt::from);
        let z = BigInt::from(plane.offset) * &w - &normal[i] * &x - &normal[j] * &y;
        let mut at = [BigInt::ZERO, BigInt::ZERO, BigInt::ZERO];
        at[i] = x * &normal[plane.axis];
        at[j] = y * &normal[plane.axis];
        at[plane.axis] = z;
        self.add(ExactPoint::new(at, w * &normal[plane.axis]))
    }
}

fn cross(a: [&BigInt; 3], b: [&BigInt; 3]) -> [BigInt; 3] {
    [[1, 2], [2, 0], [0, 1]].map(|[i, j]: [usize; 2]| a[i] * b[j] - a[j] * b[i])
}

/// The plane of a triangle of the grid, and the projection along the axis that is nearest to its normal.
#[derive(Clone, Copy, Debug)]
pub(super) struct Plane {
    pub(super) normal: [i128; 3],
    offset: i128,
    /// The axis of the projection.
    pub(super) axis: usize,
    /// The other two axes, in the order in which the projected triangle is counter-clockwise.
    pub(super) axes: [usize; 2],
}

impl Plane {
    /// Returns the plane of a triangle; `None` if the triangle has no area.
    pub(super) fn new([a, b, c]: [Site; 3]) -> Option<Self> {
        let [u, v] = [b, c].map(|it| [0, 1, 2].map(|k| i128::from(it[k] - a[k])));
        let normal = [[1, 2], [2, 0], [0, 1]].map(|[i, j]: [usize; 2]| u[i] * v[j] - u[j] * v[i]);
        let axis = (0..3).max_by_key(|&k| normal[k].unsigned_abs())?;
        let [i, j] = [(axis + 1) % 3, (axis + 2) % 3];
        let axes = if normal[axis] < 0 { [j, i] } else { [i, j] };
        let offset = (0..3).map(|k| normal[k] * i128::from(a[k])).sum();
        (normal[axis] != 0).then_some(Self { normal, offset, axis, axes })
    }

    /// Returns the height of a point above the plane, times the length of the normal.
    pub(super) fn height(&self, site: Site) -> i128 {
        (0..3).map(|k| self.normal[k] * i128::from(site[k])).sum::<i128>() - self.offset
    }
}

/// Returns the point between two points of the grid at which a height, which has different signs at both, is zero.
pub(super) fn point_at_zero(ends: [Site; 2], heights: [i128; 2]) -> ExactPoint {
    let [low, high] = heights.map(BigInt::from);
    let at = [0, 1, 2].map(|k| &high * ends[0][k] - &low * ends[1][k]);
    ExactPoint::new(at, high - low)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_points_have_one_number_and_orientations_are_exact() {
        let mut points = Points::new();
        let sites = [[0, 0, 0], [3, 0, 0], [0, 3, 0], [1 << 38, (1 << 38) - 1, 0]];
        let [a, b, c, far] = sites.map(|site| points.add_site(site));
        assert_eq!(points.add_site([3, 0, 0]), b);
        let plane = Plane::new([[0, 0, 0], [3, 0, 0], [0, 3, 0]]).unwrap();
        let middle = points.add_crossing([[a, far], [b, c]], &plane);
        assert_eq!(points.add_crossing([[c, b], [far, a]], &plane), middle);
        assert_eq!(points.orientation([a, middle, far], [0, 1]), Ordering::Equal);
        assert_eq!(points.orientation([b, middle, c], [0, 1]), Ordering::Equal);
        assert_eq!(points.orientation([a, b, middle], [0, 1]), Ordering::Greater);
        let third = points.add(point_at_zero([[-1, 0, -1], [1, 0, 1]], [-5, 5]));
        assert_eq!(third, a);
        assert_eq!(points.compare(a, middle, [0, 1]), Ordering::Less);
        let near = points.add_site([3, 3, 0]);
        assert_eq!(points.in_circle([a, b, c, near], [0, 1]), Ordering::Equal);
        assert_eq!(points.in_circle([a, b, c, middle], [0, 1]), Ordering::Greater);
        assert_eq!(points.in_circle([a, b, c, far], [0, 1]), Ordering::Less);
        assert_eq!(points.in_circle([a, b, middle, c], [0, 1]), Ordering::Less);
    }
}
