//! The continuity of a range grid across the border of a region: the largest angle between normals, and the largest gap of curvature.

use maquette_value::{Mask, SeamGaps};
use nalgebra::{Matrix3, Point3, SMatrix, SVector, Vector3};

/// The size of the window of cells that determines a side's shape: cells at most this far away, along both axes of the grid.
const REACH: isize = 2;

/// Maximum distance between neighbors on one surface, in multiples of the median distance inside of the region. Where the sensor saw past
/// an edge, neighboring cells are on different surfaces.
const MAX_DISTANCE: f64 = 3.0;

/// Minimum number of cells on a side. A quadratic function has 6 coefficients.
const MIN_CELLS: usize = 8;

/// The minimum ratio of the smallest to the largest eigenvalue of the equations for a quadratic function. Below it the cells, for example
/// those of a single line, do not determine the function.
const MIN_EIGENVALUE_RATIO: f64 = 1e-6;

/// Measures the continuity across the border of the cells `inside`. `points` has the point of each cell, NaN if the cell is invalid.
/// Returns `None` if it can be measured nowhere.
///
/// At each pair of neighbors inside and outside, a quadratic height function over their common tangent plane is fitted to the cells near
/// each of the two on its side, 5 x 5 at most. The normals and the normal curvatures across the border are compared halfway between the
/// pair. So the roughness of a scan counts, too.
pub(crate) fn measure_gaps(inside: &Mask, points: &[Point3<f64>]) -> Option<SeamGaps> {
    let grid = BorderGrid { inside, points };
    let mut distances: Vec<f64> = grid
        .neighbors()
        .filter(|cells| cells.iter().all(|&cell| grid.is_inside(cell)))
        .map(|[a, b]| grid.distance(a, b))
        .collect();
    if distances.is_empty() {
        return None;
    }
    let middle = distances.len() / 2;
    let spacing = *distances.select_nth_unstable_by(middle, f64::total_cmp).1;
    let border = grid.neighbors().filter(|[a, b]| {
        grid.is_inside(*a) != grid.is_inside(*b) && grid.distance(*a, *b) <= MAX_DISTANCE * spacing
    });
    border.filter_map(|pair| grid.gaps(pair, spacing)).reduce(|a, b| SeamGaps {
        angle: a.angle.max(b.angle),
        curvature: a.curvature.max(b.curvature),
    })
}

/// A range grid whose cells are inside or outside of a region.
struct BorderGrid<'a> {
    inside: &'a Mask,
    points: &'a [Point3<f64>],
}

/// The slope of a surface over the common tangent plane of a pair of cells, and its second derivatives.
struct Fit {
    slope: [f64; 2],
    /// The second derivative across the border.
    bend: f64,
}

impl BorderGrid<'_> {
    fn is_inside(&self, cell: usize) -> bool {
        self.inside.pixels()[cell] == 1
    }

    fn is_valid(&self, cell: usize) -> bool {
        !self.points[cell].x.is_nan()
    }

    fn distance(&self, a: usize, b: usize) -> f64 {
        (self.points[a] - self.points[b]).norm()
    }

    /// Returns all pairs of valid cells that are neighbors in a row or column.
    fn neighbors(&self) -> impl Iterator<Item = [usize; 2]> {
        let (width, count) = (self.inside.width(), self.points.len());
        let pairs = (0..count).flat_map(move |cell| {
            let right = (cell + 1) % width != 0;
            let near = [right.then_some(cell + 1), (cell + width < count).then_some(cell + width)];
            near.into_iter().flatten().map(move |near| [cell, near])
        });
        pairs.filter(|cells| cells.iter().all(|&cell| self.is_valid(cell)))
    }

    /// Returns the points near `cell` that are on its side and on its surface.
    fn near(&self, cell: usize, spacing: f64) -> Vec<Point3<f64>> {
        let width = self.inside.width();
        let (row, column) = ((cell / width) as isize, (cell % width) as isize);
        let mut near = Vec::new();
        for down in -REACH..=REACH {
            for right in -REACH..=REACH {
                let (row, column) = (row + down, column + right);
                let height = self.inside.height() as isize;
                if !(0..height).contains(&row) || !(0..width as isize).contains(&column) {
                    continue;
                }
                let other = row as usize * width + column as usize;
                let steps = (down * down + right * right) as f64;
                let reach = MAX_DISTANCE * spacing * steps.sqrt();
                if self.is_valid(other)
                    && self.is_inside(other) == self.is_inside(cell)
                    && self.distance(cell, other) <= reach
                {
                    near.push(self.points[other]);
                }
            }
        }
        near
    }

    /// Returns the gaps at a pair of cells; `None` if a side has too few cells.
    fn gaps(&self, pair: [usize; 2], spacing: f64) -> Option<SeamGaps> {
        let sides = pair.map(|cell| self.near(cell, spacing));
        if sides.iter().any(|side| side.len() < MIN_CELLS) {
            return None;
        }
        let [a, b] = pair.map(|cell| self.points[cell]);
        let middle = nalgebra::center(&a, &b);
        let normal = common_normal(&sides)?;
        let across = b - a;
        let across = (across - normal * across.dot(&normal)).try_normalize(0.0)?;
        let axes = [across, normal.cross(&across), normal];
        let [a, b] = sides.map(|side| fit(&side, middle, axes));
        let (a, b) = (a?, b?);
        let [normal_a, normal_b] =
            [&a, &b].map(|fit| Vector3::new(-fit.slope[0], -fit.slope[1], 1.0));
        Some(SeamGaps {
            angle: normal_a.angle(&normal_b).to_degrees(),
            curvature: (a.curvature() - b.curvature()).abs(),
        })
    }
}

impl Fit {
    /// The normal curvature across the border, in 1/mm.
    fn curvature(&self) -> f64 {
        let [x, y] = self.slope;
        self.bend / ((1.0 + x * x) * (1.0 + x * x + y * y).sqrt())
    }
}

/// Returns the normal of the plane that is nearest to the points of both sides.
fn common_normal(sides: &[Vec<Point3<f64>>; 2]) -> Option<Vector3<f64>> {
    let count = (sides[0].len() + sides[1].len()) as f64;
    let points = || sides.iter().flatten();
    let center = points().map(|point| point.coords).sum::<Vector3<f64>>() / count;
    let spread: Matrix3<f64> = points()
        .map(|point| {
            let spoke = point.coords - center;
            spoke * spoke.transpose()
        })
        .sum();
    let eigen = spread.symmetric_eigen();
    let normal = eigen.eigenvectors.column(eigen.eigenvalues.imin()).into_owned();
    normal.try_normalize(0.0)
}

/// Fits a quadratic height function over the first two of `axes`. Returns its derivatives at `middle`, or `None` if the points do not
/// determine it.
fn fit(points: &[Point3<f64>], middle: Point3<f64>, axes: [Vector3<f64>; 3]) -> Option<Fit> {
    let places = points.iter().map(|point| axes.map(|axis| axis.dot(&(point - middle))));
    let places: Vec<[f64; 3]> = places.collect();
    let reach_sq = places.iter().map(|[x, y, _]| x * x + y * y).sum::<f64>() / places.len() as f64;
    let reach = reach_sq.sqrt();
    let (mut matrix, mut right) = (SMatrix::<f64, 6, 6>::zeros(), SVector::<f64, 6>::zeros());
    for place in places {
        let [x, y, z] = place.map(|part| part / reach);
        let row = SVector::from([1.0, x, y, x * x / 2.0, x * y, y * y / 2.0]);
        matrix += row * row.transpose();
        right += row * z;
    }
    let eigen = matrix.symmetric_eigen();
    if eigen.eigenvalues.min() < MIN_EIGENVALUE_RATIO * eigen.eigenvalues.max() {
        return None;
    }
    let found = matrix.cholesky()?.solve(&right);
    Some(Fit { slope: [found[1], found[2]], bend: found[3] / reach })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Measures a grid of 20 x 16 cells, 0.5 mm apart, with a region of 8 x 7 cells. `depth` is a function of x, of y and of the distance
    /// from the region's left border, positive inside.
    fn measure(depth: impl Fn(f64, f64, f64) -> f64) -> Option<SeamGaps> {
        let is_inside =
            |column: usize, row: usize| (5..13).contains(&column) && (4..11).contains(&row);
        let cells = || (0..320).map(|cell| (cell % 20, cell / 20));
        let inside: Vec<u8> = cells().map(|(x, y)| u8::from(is_inside(x, y))).collect();
        let points: Vec<_> = cells()
            .map(|(column, row)| {
                let [x, y] = [column, row].map(|k| 0.5 * k as f64);
                let depth_in = if is_inside(column, row) { x - 2.25 } else { 0.0 };
                Point3::new(x, y, depth(x, y, depth_in))
            })
            .collect();
        measure_gaps(&Mask::new(20, 16, inside).unwrap(), &points)
    }

    #[test]
    fn a_smooth_surface_has_no_gaps() {
        let plane = measure(|x, y, _| 700.0 + 0.3 * x - 0.2 * y).unwrap();
        assert!(plane.angle < 1e-5 && plane.curvature < 1e-9, "{plane:?}");
        let paraboloid = measure(|x, y, _| 0.01 * x * x + 0.02 * x * y - 0.03 * y * y).unwrap();
        assert!(paraboloid.angle < 0.5 && paraboloid.curvature < 0.005, "{paraboloid:?}");
    }

    #[test]
    fn a_fold_has_its_angle_and_a_bend_its_curvature() {
        // The other three borders have a step, too, which does not count.
        let fold = measure(|_, _, inside| 0.1 * inside).unwrap();
        assert!((fold.angle - libm::atan(0.1).to_degrees()).abs() < 1e-6, "{fold:?}");
        assert!(fold.curvature < 1e-6, "{fold:?}");
        let bend = measure(|_, _, inside| 0.05 * inside * inside).unwrap();
        // At the left border the curvature is 0.1; at the right border, where the slope is 0.4, it is a little less.
        assert!((bend.curvature - 0.1).abs() < 0.02, "{bend:?}");
    }

    #[test]
    fn another_surface_behind_the_border_does_not_count() {
        assert_eq!(measure(|_, _, inside| if inside > 0.0 { 700.0 } else { 900.0 }), None);
        assert_eq!(measure(|_, _, _| f64::NAN), None);
    }
}
