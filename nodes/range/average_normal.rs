//! Computes the mean surface normal of a region of a range image.

use maquette_node::{Context, Error, In, Node, bail};
use maquette_value::{Direction, RangeImage, Region};
use nalgebra::{Matrix3, Point3, SymmetricEigen, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::grid::grid_triangles::{Rays, double_area, grid_triangles};

/// Computes the mean normal of a region's triangles, towards the sensor.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct AverageNormal {
    /// Region, with its filled cells.
    pub region: In<Region>,
    /// Range image from which the region was taken.
    pub range: In<RangeImage>,
    /// Weight of each triangle.
    #[serde(default)]
    pub weight: Weight,
}

/// Weight of each triangle in an average normal.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Weight {
    /// Equal weights.
    #[default]
    Unit,
    /// Weight by area. The direction then depends only on the border of the region, not on its inside.
    Area,
}

/// The error for a region that has no triangle.
#[derive(Debug, thiserror::Error)]
#[error("the region has no triangle: no three of its cells share a corner")]
struct NoTriangleError;

impl Node for AverageNormal {
    type Outputs = (Direction,);
    const OUTPUTS: [&'static str; 1] = ["normal"];

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let (region, range) = (cx.get(&self.region), cx.get(&self.range));
        match average_normal(region, range, self.weight) {
            Err(error) if error.downcast::<NoTriangleError>().is_some() => {
                let normal = principal_normal(region, range)?;
                cx.warn("the region has no triangle: the normal of the plane closest to its points is used");
                Ok((normal,))
            }
            normal => Ok((normal?,)),
        }
    }
}

/// Returns the mean of the normals of the triangles between the region's cells, on the side of the sensor. The resultant in the returned
/// direction is the length of the mean: 1 if all normals agree.
///
/// With `t` the cross product of two edges of a triangle, [`Weight::Unit`] gives the mean of the unit normals `t / |t|`, and
/// [`Weight::Area`] gives the sum of all `t` divided by the sum of their lengths. Triangles without area are left out.
///
/// # Errors
/// Returns an error if the region's grid does not have the size of `range`, if no triangle has an area, or if the normals cancel out.
pub fn average_normal(
    region: &Region,
    range: &RangeImage,
    weight: Weight,
) -> Result<Direction, Error> {
    check_size(region, range)?;
    let (width, height, points) = grid_of(region);
    // The minimum length of a triangle's cross product `t`, which is twice its area. A shorter product results from rounding errors only.
    let min_length = 1e-18 * square(size_of(region.points()));
    let (mut sum, mut total) = (Vector3::zeros(), 0.0);
    for triangle in grid_triangles(width, height, &points, |_| 0, |_, _| true) {
        let normal = double_area(triangle.cells(width).map(|cell| points[cell]));
        let length = normal.norm();
        if length <= min_length {
            continue;
        }
        match weight {
            Weight::Unit => {
                sum += normal / length;
                total += 1.0;
            }
            Weight::Area => {
                sum += normal;
                total += length;
            }
        }
    }
    if total == 0.0 {
        return Err(NoTriangleError.into());
    }
    Ok(Direction::mean(towards_sensor(sum / total, region, range))?)
}

/// Returns the normal of the plane closest to the region's points: the axis along which the points spread least, towards the sensor. Used
/// for a region without triangles.
///
/// Pearson, "On lines and planes of closest fit to systems of points in space" (1901).
///
/// Returns an error if the region's grid does not have the size of `range`, or if the points are on a line.
pub fn principal_normal(region: &Region, range: &RangeImage) -> Result<Direction, Error> {
    check_size(region, range)?;
    let (center, size) = (centroid(region.points()), size_of(region.points()));
    if size == 0.0 || !size.is_finite() {
        return Err(no_plane(region));
    }
    let covariance: Matrix3<f64> = region
        .points()
        .iter()
        .map(|point| {
            let offset = (point - center) / size;
            offset * offset.transpose()
        })
        .sum();
    let axes = SymmetricEigen::new(covariance);
    let mut order = [0, 1, 2];
    order.sort_by(|&a, &b| axes.eigenvalues[a].total_cmp(&axes.eigenvalues[b]));
    let [smallest, middle, largest] = order;
    if axes.eigenvalues[middle] <= MIN_SPREAD * axes.eigenvalues[largest] {
        return Err(no_plane(region));
    }
    let axis = axes.eigenvectors.column(smallest).into_owned();
    Ok(Direction::mean(towards_sensor(axis, region, range))?)
}

fn no_plane(region: &Region) -> Error {
    let (count, at) = (region.points().len(), centroid(region.points()));
    Error::new(format!(
        "the {count} points of the region around ({:.3}, {:.3}, {:.3}) are on a line or coincide, so there is no normal; choose a larger region",
        at.x, at.y, at.z
    ))
}

/// The minimum spread of points across a line for which they define a plane, as the squared ratio to the spread along the line: a ratio of
/// one in ten thousand. The rounding of files in single precision gives a ratio of about 6e-6. A row of a scan over a curved surface has a
/// ratio of about 1e-2.
const MIN_SPREAD: f64 = 1e-8;

fn check_size(region: &Region, range: &RangeImage) -> Result<(), Error> {
    let region = [region.width(), region.height()];
    let range = [range.width(), range.height()];
    if region != range {
        bail!("the region has a grid of {region:?} cells, but the range image has {range:?}");
    }
    Ok(())
}

/// Returns the smallest rectangle of grid cells that contains the region: its width, its height, and its points, NaN outside the region.
fn grid_of(region: &Region) -> (usize, usize, Vec<Point3<f64>>) {
    let (low, high) = region.bounds();
    let [width, height] = [0, 1].map(|axis| high[axis] + 1 - low[axis]);
    let mut points = vec![Point3::from(Vector3::repeat(f64::NAN)); width * height];
    for (&cell, &point) in region.cells().iter().zip(region.points()) {
        let (column, row) = (cell as usize % region.width(), cell as usize / region.width());
        points[(row - low[1]) * width + column - low[0]] = point;
    }
    (width, height, points)
}

fn square(x: f64) -> f64 {
    x * x
}

/// Returns the diagonal of the bounding box of `points`.
fn size_of(points: &[Point3<f64>]) -> f64 {
    let start = Vector3::repeat(f64::INFINITY);
    let (low, high) = points.iter().fold((start, -start), |(low, high), point| {
        (low.inf(&point.coords), high.sup(&point.coords))
    });
    (high - low).norm()
}

fn centroid(points: &[Point3<f64>]) -> Point3<f64> {
    let sum: Vector3<f64> = points.iter().map(|point| point.coords).sum();
    Point3::from(sum / points.len() as f64)
}

/// Flips a vector if necessary, so that it points to the side of the sensor.
fn towards_sensor(vector: Vector3<f64>, region: &Region, range: &RangeImage) -> Vector3<f64> {
    let ray = Rays::new(range).direction(centroid(region.points()));
    if vector.dot(&ray) > 0.0 { -vector } else { vector }
}

#[cfg(test)]
mod tests {
    use maquette_value::DirectionError;
    use proptest::prelude::*;

    use super::*;

    const BOTH: [Weight; 2] = [Weight::Unit, Weight::Area];

    /// Returns a region that contains all cells of a grid with the points `at(column, row)`, and the range image of this grid.
    fn full_grid(
        width: usize,
        height: usize,
        at: impl Fn(f64, f64) -> Point3<f64>,
    ) -> (Region, RangeImage) {
        part(width, height, at, |_, _| true)
    }

    /// Returns a region of the cells for which `inside` returns true, and its range image.
    fn part(
        width: usize,
        height: usize,
        at: impl Fn(f64, f64) -> Point3<f64>,
        inside: impl Fn(usize, usize) -> bool,
    ) -> (Region, RangeImage) {
        fn grid_position(cell: usize, width: usize) -> (usize, usize) {
            (cell % width, cell / width)
        }
        let points: Vec<Point3<f64>> = (0..width * height)
            .map(|cell| {
                at(grid_position(cell, width).0 as f64, grid_position(cell, width).1 as f64)
            })
            .collect();
        let cells: Vec<u32> = (0..width * height)
            .filter(|&cell| inside(grid_position(cell, width).0, grid_position(cell, width).1))
            .map(|cell| cell as u32)
            .collect();
        let inner: Vec<Point3<f64>> = cells.iter().map(|&cell| points[cell as usize]).collect();
        let filled = vec![0; cells.len()];
        let region = Region::new(width, height, cells, inner, filled, vec![]).unwrap();
        (region, RangeImage::new(width, height, points).unwrap())
    }

    proptest! {
        #[test]
        fn a_plane_has_its_normal_for_any_grid(
            tilt in prop::array::uniform2(-2.0..2.0f64),
            // Shifts are limited, because larger ones could exchange neighboring points and flip triangles.
            shifts in prop::collection::vec(prop::array::uniform2(-0.2..0.2f64), 42),
            missing in prop::collection::vec(prop::bool::weighted(0.2), 42),
        ) {
            let at = |column: f64, row: f64| {
                let [dx, dy] = shifts[row as usize * 7 + column as usize];
                let (x, y) = (column + dx - 3.0, row + dy - 2.0);
                Point3::new(x, y, 100.0 + tilt[0] * x + tilt[1] * y)
            };
            let (region, range) = part(7, 6, at, |column, row| {
                (column < 3 && row < 3) || !missing[row * 7 + column]
            });
            let expected = Vector3::new(tilt[0], tilt[1], -1.0).normalize();
            for weight in BOTH {
                let normal = average_normal(&region, &range, weight).unwrap();
                prop_assert!((normal.vector().into_inner() - expected).norm() < 1e-12);
                prop_assert!((normal.resultant() - 1.0).abs() < 1e-12);
            }
            let normal = principal_normal(&region, &range).unwrap();
            prop_assert!((normal.vector().into_inner() - expected).norm() < 1e-10);
        }
    }

    #[test]
    fn a_symmetric_hemisphere_has_its_axis() {
        let (region, range) = part(
            21,
            21,
            |column: f64, row: f64| {
                let (x, y) = (column - 10.0, row - 10.0);
                Point3::new(x, y, 500.0 - (400.0 - x * x - y * y).sqrt())
            },
            |column, row| column.abs_diff(10).pow(2) + row.abs_diff(10).pow(2) <= 100,
        );
        for weight in BOTH {
            let normal = average_normal(&region, &range, weight).unwrap();
            assert!((normal.vector().into_inner() + Vector3::z()).norm() < 1e-12);
            assert!(0.8 < normal.resultant() && normal.resultant() < 0.99);
        }
    }

    proptest! {
        #[test]
        fn by_area_the_normal_depends_on_the_border_alone(
            moves in prop::collection::vec(prop::array::uniform3(-0.4..0.4f64), 2 * 81),
        ) {
            fn is_in_disk(column: usize, row: usize) -> bool {
                column.abs_diff(4).pow(2) + row.abs_diff(4).pow(2) <= 17
            }
            fn is_on_border(column: usize, row: usize) -> bool {
                let neighbors = [(column + 1, row), (column, row + 1), (column.wrapping_sub(1), row), (column, row.wrapping_sub(1))];
                neighbors.iter().any(|&(column, row)| column > 8 || row > 8 || !is_in_disk(column, row))
            }
            let normals = [0, 1].map(|set| {
                let (region, range) = part(9, 9, |column: f64, row: f64| {
                    let (c, r) = (column as usize, row as usize);
                    let set = if is_on_border(c, r) { 0 } else { set };
                    let moved = Vector3::from(moves[set * 81 + r * 9 + c]);
                    Point3::new(column, row, 300.0 + column * 0.2) + moved
                }, is_in_disk);
                average_normal(&region, &range, Weight::Area).unwrap().vector().into_inner()
            });
            prop_assert!((normals[0] - normals[1]).norm() < 1e-10);
        }
    }

    #[test]
    fn a_large_triangle_counts_more_by_area() {
        // The grid has two triangles of 1 mm that face the sensor, and next to them two triangles on a slope of 3 mm.
        let (region, range) = full_grid(3, 2, |column: f64, row: f64| match column as u32 {
            2 => Point3::new(1.0, row, 103.0),
            _ => Point3::new(column, row, 100.0),
        });
        fn normal_x(weight: Weight, region: &Region, range: &RangeImage) -> f64 {
            average_normal(region, range, weight).unwrap().vector().x.abs()
        }
        assert!((normal_x(Weight::Unit, &region, &range) - 0.5f64.sqrt()).abs() < 1e-12);
        assert!((normal_x(Weight::Area, &region, &range) - 3.0 / 10f64.sqrt()).abs() < 1e-12);
    }

    #[test]
    fn one_row_has_no_triangle_and_falls_back_to_the_closest_plane() {
        let (region, range) = full_grid(5, 1, |column: f64, _: f64| {
            Point3::new(column, column * column * 0.1, 100.0)
        });
        for weight in BOTH {
            let error = average_normal(&region, &range, weight).unwrap_err();
            assert!(error.downcast::<NoTriangleError>().is_some(), "{error}");
        }
        let normal = principal_normal(&region, &range).unwrap();
        assert!((normal.vector().into_inner() + Vector3::z()).norm() < 1e-12);
    }

    fn assert_no_plane(region: &Region, range: &RangeImage) {
        let error = principal_normal(region, range).unwrap_err().to_string();
        assert!(error.contains("are on a line or coincide, so there is no normal"), "{error}");
    }

    #[test]
    fn a_line_and_a_point_have_no_normal() {
        for width in [1, 5] {
            let (region, range) =
                full_grid(width, 1, |column, _| Point3::new(column, 0.3 * column, 9.0));
            assert_no_plane(&region, &range);
        }
    }

    #[test]
    fn points_too_far_apart_to_be_measured_are_an_error() {
        let (region, range) = full_grid(9, 9, |column: f64, row: f64| {
            Point3::new(column * 1e307, row * 1e307, 1e307)
        });
        assert_no_plane(&region, &range);
        assert!(average_normal(&region, &range, Weight::Unit).is_err());
    }

    #[test]
    fn a_region_that_turns_back_on_itself_has_no_direction() {
        let (region, range) =
            full_grid(3, 2, |column: f64, row: f64| Point3::new((column - 1.0).abs(), row, 100.0));
        let error = average_normal(&region, &range, Weight::Unit).unwrap_err();
        let error = error.downcast::<DirectionError>();
        assert!(matches!(error, Some(DirectionError::Vanishes { .. })), "{error:?}");
    }

    #[test]
    fn a_region_of_another_grid_is_an_error() {
        fn plane_point(column: f64, row: f64) -> Point3<f64> {
            Point3::new(column, row, 9.0)
        }
        let ((region, _), (_, range)) =
            (full_grid(3, 2, plane_point), full_grid(2, 3, plane_point));
        let error = average_normal(&region, &range, Weight::Unit).unwrap_err().to_string();
        assert!(error.starts_with("the region has a grid of [3, 2] cells"), "{error}");
    }
}
