//! An exact predicate that decides on which side of a triangle's plane a point is. Ties are broken by infinitesimal motions of the points,
//! so a point is never in the plane, unless the triangle is degenerate.

use std::cmp::Ordering;

use nalgebra::{Point3, Vector3};
use num_bigint::BigInt;

/// Half of the number of cells of the grid along its longest side. The number is limited because products of three coordinate differences
/// must fit into 128 bits, and products of two into 64 bits.
const HALF: f64 = (1 << 29) as f64;

/// Length to which the direction vector of a point's motion is scaled before it is rounded to integers. Only the direction matters.
const DIRECTION_LENGTH: f64 = 512.0;

type Row = [i64; 3];

/// A point on the grid that may move by an infinitesimal amount.
#[derive(Clone, Copy, Debug)]
pub(super) struct Site {
    /// Coordinates of the point, in cells of the grid.
    pub(super) at: Row,
    /// The direction of the point's infinitesimal motion; `None` if the point does not move.
    moves: Option<Row>,
}

impl Site {
    /// Returns the point with its x coordinate replaced by `x`; the infinitesimal motion stays.
    pub(super) fn far(self, x: i64) -> Self {
        Self { at: [x, self.at[1], self.at[2]], ..self }
    }
}

/// The grid to whose nodes points are rounded. The spacing of the grid is about 2e-9 of the extent of all points.
pub(super) struct Grid {
    middle: Point3<f64>,
    per_mm: f64,
}

impl Grid {
    /// Returns a grid that covers the box between two corners.
    pub(super) fn new([low, high]: [Point3<f64>; 2]) -> Self {
        let half = (high - low).amax() / 2.0;
        // The spacing is a power of two: short binary fractions are then exactly on the grid.
        let per_mm = if half > 0.0 { libm::exp2(libm::log2(HALF / half).floor()) } else { 1.0 };
        let middle = nalgebra::center(&low, &high).map(|x| (x * per_mm).round() / per_mm);
        Self { middle, per_mm }
    }

    /// Rounds a point to the grid, without an infinitesimal motion.
    pub(super) fn resting_site(&self, at: &Point3<f64>) -> Site {
        let cells = (at - self.middle) * self.per_mm;
        Site { at: [0, 1, 2].map(|axis| cells[axis].round() as i64), moves: None }
    }

    /// Rounds a point to the grid, with an infinitesimal motion in the direction `along`.
    pub(super) fn moving(&self, at: &Point3<f64>, along: Vector3<f64>) -> Site {
        let unit = along.try_normalize(0.0).unwrap_or_default() * DIRECTION_LENGTH;
        let moves = Some([0, 1, 2].map(|axis| unit[axis].round() as i64));
        Site { moves, ..self.resting_site(at) }
    }

    /// Returns the distance in mm below which two points count as equal: the length of a few cells of the grid.
    pub(super) fn tolerance(&self) -> f64 {
        4.0 / self.per_mm
    }
}

/// The first nonzero term of the polynomial of a height: its index among all terms, and its coefficient.
#[derive(Clone, Copy, Debug)]
pub(super) struct Leading {
    order: u8,
    factor: i128,
}

impl Leading {
    /// Returns true if the height is positive: the point is above the triangle.
    pub(super) fn is_above(self) -> bool {
        0 < self.factor
    }

    /// Returns true if the height is undefined, because the triangle is degenerate.
    pub(super) fn is_zero(self) -> bool {
        self.factor == 0
    }

    /// Interpolates between two heights: returns the fraction of the way from the first to the second at which the height is zero.
    pub(super) fn share(self, other: Self) -> f64 {
        match self.order.cmp(&other.order) {
            Ordering::Less => 1.0,
            Ordering::Greater => 0.0,
            Ordering::Equal => self.factor as f64 / (self.factor as f64 - other.factor as f64),
        }
    }
}

/// Returns the signed height of the last of four points above the plane of the first three. Seen from above, the first three are
/// counter-clockwise. The height is measured as six times the signed volume of the tetrahedron.
///
/// If the volume is zero, the infinitesimal motions decide. A moving point is `at + e * direction + (d, d^2, d^3)`, where e is
/// infinitesimal and d is infinitely smaller than each power of e. The volume is a polynomial in e and d, whose first nonzero term counts
/// (Edelsbrunner and Mucke, "Simulation of simplicity", 1990). All terms are zero only if the triangle is degenerate, or two of its edges
/// are parallel.
pub(super) fn height(sites: [&Site; 4]) -> Leading {
    let volume = determinant(rows(sites, |site| site.at));
    if volume != 0 {
        return Leading { order: 0, factor: volume };
    }
    let terms = terms(sites);
    let first = (0..).zip(terms.into_iter().flatten()).find(|term| term.1 != 0);
    let (order, factor) = first.unwrap_or((16, 0));
    Leading { order, factor }
}

/// Compares the two positions at which an edge crosses two triangles. Positions are measured from the first point of the edge.
///
/// If the heights `l` and `h` of the edge's ends over a triangle have different signs, the crossing is at the fraction `l / (l - h)` of the
/// edge. The fractions for both triangles are compared as polynomials in `d` and `e`, see `height`.
pub(super) fn first_of(edge: [&Site; 2], triangles: [[&Site; 3]; 2]) -> Ordering {
    let heights = triangles.map(|[a, b, c]| edge.map(|end| terms([a, b, c, end])));
    let lows = triangles.map(|[a, b, c]| height([a, b, c, edge[0]]).is_above());
    let mut sums = vec![BigInt::ZERO; 7 * 7];
    for (sign, [of_low, of_high]) in [(1, [1, 0]), (-1, [0, 1])] {
        let [low, high] = [&heights[of_low][0], &heights[of_high][1]].map(|it| it.as_flattened());
        for (i, a) in low.iter().enumerate().filter(|it| *it.1 != 0) {
            for (j, b) in high.iter().enumerate().filter(|it| *it.1 != 0) {
                sums[7 * (i / 4 + j / 4) + i % 4 + j % 4] += sign * BigInt::from(*a) * b;
            }
        }
    }
    let first = sums.iter().find(|sum| **sum != BigInt::ZERO);
    let order = first.map_or(Ordering::Equal, |sum| sum.cmp(&BigInt::ZERO));
    // Both fractions were multiplied by both denominators. If the product of the denominators is negative, the order is reversed.
    if lows[0] == lows[1] { order } else { order.reverse() }
}

/// Returns the coefficients of the polynomial of a height, see `height`. The first index is the power of `d`, the second the power of `e`.
fn terms(sites: [&Site; 4]) -> [[i128; 4]; 4] {
    let base = rows(sites, |site| site.at);
    let motion = rows(sites, |site| site.moves.unwrap_or_default());
    fn does_move(k: usize, sites: &[&Site; 4]) -> i64 {
        i64::from(sites[k].moves.is_some())
    }
    let mut terms = [[0; 4]; 4];
    fn add(
        power: usize,
        base: [Row; 3],
        fixed: Option<usize>,
        motion: &[[i64; 3]; 3],
        terms: &mut [[i128; 4]; 4],
    ) {
        for choice in 0..8u8 {
            fn is_moved(row: usize, choice: u8) -> bool {
                choice >> row & 1 == 1
            }
            if fixed.is_none_or(|row| !is_moved(row, choice)) {
                let own = [0, 1, 2]
                    .map(|row| if is_moved(row, choice) { motion[row] } else { base[row] });
                terms[power][choice.count_ones() as usize] += determinant(own);
            }
        }
    }
    add(0, base, None, &motion, &mut terms);
    // All moving points are shifted by the same infinitesimal vector (d, d^2, d^3), so products of two shifts cancel.
    for axis in 0..3 {
        for row in 0..3 {
            let mut own = base;
            own[row] = [0; 3];
            own[row][axis] = does_move(row + 1, &sites) - does_move(0, &sites);
            add(axis + 1, own, Some(row), &motion, &mut terms);
        }
    }
    terms
}

fn rows(sites: [&Site; 4], of: impl Fn(&Site) -> Row) -> [Row; 3] {
    let from = of(sites[0]);
    [1, 2, 3].map(|k| {
        let to = of(sites[k]);
        [0, 1, 2].map(|axis| to[axis] - from[axis])
    })
}

fn determinant([u, v, w]: [Row; 3]) -> i128 {
    fn minor(a: usize, b: usize, v: &[i64; 3], w: &[i64; 3]) -> i128 {
        i128::from(v[a] * w[b] - v[b] * w[a])
    }
    let [x, y, z] = u.map(i128::from);
    x * minor(1, 2, &v, &w) + y * minor(2, 0, &v, &w) + z * minor(0, 1, &v, &w)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grid() -> Grid {
        Grid::new([Point3::new(-1.0, -1.0, -1.0), Point3::new(1.0, 1.0, 1.0)])
    }

    #[test]
    fn a_place_is_above_a_triangle_or_below() {
        let [a, b, c] = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]
            .map(|it| grid().resting_site(&Point3::from(it)));
        let above = grid().resting_site(&Point3::new(0.2, 0.2, 1.0));
        let below = grid().resting_site(&Point3::new(0.2, 0.2, -0.5));
        let heights = [above, below].map(|site| height([&a, &b, &c, &site]));
        assert!(heights[0].is_above() && !heights[1].is_above());
        assert!((heights[0].share(heights[1]) - 2.0 / 3.0).abs() < 1e-9);
        assert_eq!(height([&a, &c, &b, &above]).factor, -heights[0].factor);
    }

    #[test]
    fn of_places_in_one_plane_the_motion_decides() {
        let [a, b, c] = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]
            .map(|it| grid().resting_site(&Point3::from(it)));
        let at = Point3::new(0.3, 0.3, 0.0);
        for (along, is_above) in
            [([0.0, 0.0, 1.0], true), ([1.0, 0.0, -0.1], false), ([1.0, 0.0, 0.0], true)]
        {
            let site = grid().moving(&at, Vector3::from(along));
            // If the infinitesimal motion is in the plane of the triangle, the symbolic shift along z decides.
            assert_eq!(height([&a, &b, &c, &site]).is_above(), is_above, "{along:?}");
            assert_eq!(height([&b, &a, &c, &site]).is_above(), !is_above, "{along:?}");
            assert_eq!(height([&a, &b, &site, &c]).is_above(), !is_above, "{along:?}");
        }
    }

    #[test]
    fn the_largest_differences_fit() {
        fn corner(x: f64, y: f64, z: f64) -> Site {
            grid().resting_site(&Point3::new(x, y, z))
        }
        let sites =
            [corner(-1., -1., -1.), corner(1., 1., -1.), corner(1., -1., 1.), corner(-1., 1., 1.)];
        let volume = height([&sites[0], &sites[1], &sites[2], &sites[3]]);
        assert_eq!(volume.factor.abs(), 2 * (1i128 << 90));
    }
}
