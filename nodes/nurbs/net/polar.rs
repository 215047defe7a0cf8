//! A net of rings around the center of a region.
//!
//! Row 0 of the net is the pole, the mean of the region's cells. The last row follows the contour and is fixed. The rows between them
//! divide the spokes (lines from the pole to the contour) evenly in the range grid. Columns are counter-clockwise in the picture, and the
//! last `order - 1` of them repeat the first ones, so that knots of the kind `Periodic` close the surface smoothly. The surface has one
//! tangent plane at the pole if the first ring is coplanar with the pole; therefore the ring is made coplanar.
//!
//! The contour of a region that was found in a picture has steps and teeth, which a spoke may cross more than once. Therefore the last row
//! is a smooth line around the whole contour ([`super::rays`]), on the region's points extrapolated slightly beyond its cells.

use maquette_node::{Error, Progress, bail};
use maquette_range::contours;
use maquette_value as value;
use maquette_value::{RangeImage, Region};
use nalgebra::{Matrix3, Point3, Vector3};

use super::parameterized::parameterize;
use super::rays::{NotAStar, Rays, turn};
use crate::grid::window::GridWindow;

/// Maximum automatic number of spokes. A contour has some hundred cells, and spokes to more than half of these cells would only follow the
/// steps of the contour.
const MAX_SPOKES: usize = 64;

/// Minimum number of spokes and of rings: a pole needs three spokes around it.
const MIN_SPOKES: usize = 3;
const MIN_RINGS: usize = 3;

/// Makes the net for surfaces of the given order along the columns. `rows` and `columns` are automatic where they are 0.
pub(crate) fn net(
    region: &Region,
    range: &RangeImage,
    order: usize,
    [rows, columns]: [usize; 2],
    progress: &Progress<'_>,
) -> Result<value::ControlNet, Error> {
    if !(2..=10).contains(&order) {
        bail!("expected an order from 2 to 10, found {order}");
    }
    let repeated = order - 1;
    let least = MIN_SPOKES.max(repeated) + repeated;
    if columns != 0 && columns < least {
        bail!("expected at least {least} columns for a closed net of this order, found {columns}");
    }
    let window = GridWindow::around_region(region, progress)?;
    let center = middle(region, &window);
    let contour = outline(&window, center)?;
    fn cell(
        [x, y]: [f64; 2],
        center: [f64; 2],
        window_left: usize,
        window_top: usize,
    ) -> (usize, usize) {
        fn round_cell(middle: f64, step: f64) -> usize {
            (middle + step).round() as usize
        }
        (window_left + round_cell(center[0], x), window_top + round_cell(center[1], y))
    }
    let rays = Rays::new(&contour).map_err(|why| match why {
        NotAStar::NotInside => {
            let (column, row) = cell([0.0; 2], center, window.left, window.top);
            Error::new(format!(
                "the region's middle, cell ({column}, {row}), is not inside of its contour: use the method `Harmonic`"
            ))
        }
        NotAStar::Bay { at, depth } => {
            let (column, row) = cell(at, center, window.left, window.top);
            Error::new(format!(
                "the whole region is not visible from its center: {depth:.1} cells on the line to cell ({column}, {row}) are outside; \
                 use the method `Harmonic`"
            ))
        }
    })?;
    let count = match columns {
        0 => ((rays.length() / 2.0) as usize).min(MAX_SPOKES).max(MIN_SPOKES.max(repeated)),
        columns => columns - repeated,
    };
    let wheel = Wheel { center, spokes: rays.spokes(count) };
    let rings = if rows == 0 { (wheel.radius().ceil() as usize).max(MIN_RINGS) } else { rows - 1 };
    let points = wheel.points(&window, rings);
    let coordinates = region
        .cells()
        .iter()
        .map(|cell| {
            let [row, column] = window.place(*cell);
            wheel.coordinate([column as f64, row as f64], rings, order)
        })
        .collect();
    let columns = count + repeated;
    let points: Vec<Point3<f64>> = (0..(rings + 1) * columns)
        .map(|at| points[at / columns * count + at % columns % count])
        .collect();
    let size = [rings + 1, columns];
    parameterize(range, size, points, |row, _| row == rings, region.cells().to_vec(), coordinates)
}

/// Returns the (column, row) of the mean of the region's cells.
fn middle(region: &Region, window: &GridWindow) -> [f64; 2] {
    let n = region.cells().len() as f64;
    region.cells().iter().fold([0.0; 2], |[x, y], &cell| {
        let [row, column] = window.place(cell);
        [x + column as f64 / n, y + row as f64 / n]
    })
}

/// The error message for a region that has disconnected parts.
pub(crate) const PARTS: &str = "the region is in several parts, but a net covers one; keep one by `pick` of `ExtractRegion`, or join them by its `close`";

/// Returns the contour of the region as a closed line through the centers of its cells: the (column, row) of each, relative to the center.
fn outline(window: &GridWindow, center: [f64; 2]) -> Result<Vec<[f64; 2]>, Error> {
    let all = contours(window.columns, window.rows, &window.inside);
    if all.iter().filter(|contour| !contour.hole).count() != 1 {
        bail!("{PARTS}");
    }
    Ok(all[0]
        .cells
        .iter()
        .map(|&cell| {
            let (column, row) = (cell as usize % window.columns, cell as usize / window.columns);
            [column as f64 - center[0], row as f64 - center[1]]
        })
        .collect())
}

/// The center of a region and spokes to its contour.
struct Wheel {
    /// The (column, row) of the center.
    center: [f64; 2],
    /// Vectors from the center to the ends of the spokes, counter-clockwise with rows growing down.
    spokes: Vec<[f64; 2]>,
}

impl Wheel {
    /// Returns the mean length of the spokes, in cells.
    fn radius(&self) -> f64 {
        let lengths = self.spokes.iter().map(|[x, y]| libm::hypot(*x, *y));
        lengths.sum::<f64>() / self.spokes.len() as f64
    }

    /// Returns the points of the net, ring by ring from the pole to the contour, without repeated columns.
    fn points(&self, window: &GridWindow, rings: usize) -> Vec<Point3<f64>> {
        let count = self.spokes.len();
        let pole = window.interpolate(self.center);
        let mut points = vec![pole; count];
        for ring in 1..=rings {
            let share = ring as f64 / rings as f64;
            points.extend(self.spokes.iter().map(|[x, y]| {
                window.interpolate([self.center[0] + share * x, self.center[1] + share * y])
            }));
        }
        if rings > 1 {
            flatten(pole, &mut points[count..2 * count]);
        }
        points
    }

    /// Returns the net coordinate of a position, computed from the two spokes next to it and its distance from the center along them.
    ///
    /// Positions beyond the line through the ends of the spokes are projected onto it.
    fn coordinate(&self, [x, y]: [f64; 2], rings: usize, order: usize) -> [f64; 2] {
        let count = self.spokes.len();
        let place = [x - self.center[0], y - self.center[1]];
        let Some(k) = (0..count).find(|k| {
            turn(self.spokes[*k], place) >= 0.0 && turn(place, self.spokes[(k + 1) % count]) > 0.0
        }) else {
            return [0.0, order as f64 / 2.0];
        };
        let next = self.spokes[(k + 1) % count];
        let (before, after) = (turn(self.spokes[k], place), turn(place, next));
        let ring = (before + after) / turn(self.spokes[k], next) * rings as f64;
        let around = k as f64 + before / (before + after);
        // The domain of a surface with periodic knots begins at this net coordinate.
        let start = (order - 2) as f64 / 2.0;
        let around = if around < start { around + count as f64 } else { around };
        [ring.min(rings as f64), around]
    }
}

/// Projects the points of a ring of the net onto the plane through the pole that fits these points best.
fn flatten(pole: Point3<f64>, ring: &mut [Point3<f64>]) {
    let covariance = ring.iter().fold(Matrix3::zeros(), |sum: Matrix3<f64>, point| {
        let spoke = point - pole;
        sum + spoke * spoke.transpose()
    });
    if !covariance.iter().all(|x| x.is_finite()) {
        return;
    }
    let Some(eigen) = covariance.try_symmetric_eigen(f64::EPSILON, 1000) else { return };
    let least = (0..3).min_by(|&a, &b| eigen.eigenvalues[a].total_cmp(&eigen.eigenvalues[b]));
    let normal: Vector3<f64> = eigen.eigenvectors.column(least.unwrap_or(0)).into_owned();
    for point in ring {
        *point -= normal * normal.dot(&(*point - pole));
    }
}

#[cfg(test)]
mod tests {
    use maquette_value::Surface;

    use super::*;
    use crate::control_net::tests::{range, region};
    use crate::control_net::{NetMethod, control_net};
    use crate::knot_vectors::knot_vector::knots;
    use crate::knots_kind::KnotsKind;
    use crate::nurbs::nurbs;

    const POLAR: NetMethod = NetMethod::Polar { order: 3 };

    fn hill() -> RangeImage {
        range(44, 40, |x, y| {
            700.0 - 0.02 * (400.0 - (x - 21.0) * (x - 21.0) - (y - 19.0) * (y - 19.0))
        })
    }

    fn egg(range: &RangeImage) -> Region {
        region(range, |x, y| {
            let (x, y) = (x as f64 - 20.0, y as f64 - 19.0);
            x * x / 196.0 + y * y / (100.0 + 3.0 * x) < 1.0
        })
    }

    fn surface(net: &value::ControlNet, order: usize) -> Surface {
        let around = knots(net, value::ParameterDirection::V, order, &KnotsKind::Periodic).unwrap();
        nurbs(net, None, Some(&around), None).unwrap()
    }

    #[test]
    fn rings_go_from_the_pole_to_the_contour() {
        let range = hill();
        let egg = egg(&range);
        let net = control_net(&egg, &range, POLAR, 9, 34, &Progress::silent()).unwrap();
        assert_eq!((net.rows(), net.columns()), (9, 34));
        let points = net.points();
        assert!(points[..34].iter().all(|point| *point == points[0]));
        for row in 0..9 {
            assert_eq!(points[row * 34..row * 34 + 2], points[row * 34 + 32..][..2]);
            assert!(net.fixed_points()[row * 34..][..34].iter().all(|&f| f == u8::from(row == 8)));
        }
        // Checks that the first ring and the pole are coplanar.
        let normal = (points[34] - points[0]).cross(&(points[34 + 9] - points[0])).normalize();
        for point in &points[34..68] {
            assert!(normal.dot(&(point - points[0])).abs() <= 1e-9);
        }
    }

    #[test]
    fn a_surface_of_the_net_is_closed_and_faces_the_sensor() {
        let range = hill();
        for order in [2, 3, 4] {
            let net = control_net(
                &egg(&range),
                &range,
                NetMethod::Polar { order },
                0,
                0,
                &Progress::silent(),
            )
            .unwrap();
            let surface = surface(&net, order);
            let (start, end) = surface.v().domain();
            for k in 0..20 {
                let u = surface.u().domain().1 * f64::from(k) / 20.0;
                assert!((surface.point(u, start) - surface.point(u, end)).norm() <= 1e-9);
                let normal = surface.normal(u, start + 1.3).unwrap();
                assert!(normal.z < -0.5, "order {order}, {u}: {normal:?}");
            }
        }
    }

    #[test]
    fn the_chart_gives_the_positions_of_cells() {
        let range = hill();
        let egg = egg(&range);
        let net = control_net(&egg, &range, POLAR, 0, 0, &Progress::silent()).unwrap();
        let surface = surface(&net, 3);
        let chart = net.chart().unwrap();
        assert_eq!(&*chart.cells, egg.cells());
        let mut worst = 0.0f64;
        for (coordinate, point) in chart.coordinates.iter().zip(egg.points()) {
            let [u, v] = surface.parameters(*coordinate);
            worst = worst.max((surface.point(u, v) - point).norm());
        }
        // Cells at the contour are up to half a cell beyond the line through the ends of the spokes.
        assert!(worst <= 1.0, "{worst}");
    }

    /// Returns a disk with an irregular contour whose amplitude is `teeth` cells, with a spur and a speck beside it.
    fn jagged_disk(range: &RangeImage, teeth: f64) -> Region {
        fn noise(x: usize, y: usize) -> f64 {
            let mixed = (x * 7919 + y * 104_729 + 13).wrapping_mul(2_654_435_761) >> 7;
            (mixed % 1000) as f64 / 500.0 - 1.0
        }
        region(range, |x, y| {
            let radius = libm::hypot(x as f64 - 21.3, y as f64 - 19.6);
            radius < 13.0 + teeth / 2.0 * noise(x, y) && radius < 13.0 + teeth / 2.0
                || y == 17 && (21..36).contains(&x)
        })
    }

    #[test]
    fn a_jagged_disk_makes_a_calm_net() {
        let range = hill();
        for teeth in [0.0, 1.0, 2.0, 3.0] {
            let disk = jagged_disk(&range, teeth);
            // Because of the teeth, the region may have disconnected cells.
            let net = match control_net(&disk, &range, POLAR, 0, 0, &Progress::silent()) {
                Err(error) if error.to_string() == PARTS => continue,
                net => net.unwrap(),
            };
            let surface = surface(&net, 3);
            let (start, end) = surface.v().domain();
            let last = net.rows() - 1;
            for column in 0..net.columns() {
                let end = net.points()[last * net.columns() + column];
                let radius = libm::hypot(end.x - 21.3, end.y - 19.6);
                assert!((11.0..15.5).contains(&radius), "teeth {teeth}, column {column}: {radius}");
            }
            for k in 0..200 {
                let v = start + (end - start) * f64::from(k) / 200.0;
                for u in 1..20 {
                    let u = surface.u().domain().1 * f64::from(u) / 20.0;
                    assert!(surface.normal(u, v).unwrap().z < -0.5, "teeth {teeth}, ({u}, {v})");
                }
            }
        }
    }

    #[test]
    fn regions_that_are_not_star_shaped_are_refused() {
        let range = hill();
        let moon = region(&range, |x, y| {
            fn far(cx: usize, x: usize, y: usize) -> usize {
                x.abs_diff(cx).pow(2) + y.abs_diff(18).pow(2)
            }
            far(18, x, y) < 225 && far(27, x, y) > 150
        });
        fn error(
            region: &Region,
            method: NetMethod,
            rows: usize,
            columns: usize,
            range: &RangeImage,
        ) -> String {
            control_net(region, range, method, rows, columns, &Progress::silent())
                .unwrap_err()
                .to_string()
        }
        let not_visible = error(&moon, POLAR, 0, 0, &range);
        let expected = "the whole region is not visible from its center";
        assert!(not_visible.starts_with(expected), "{not_visible}");
        let line = region(&range, |x, y| y == 4 && x < 9);
        let no_middle = error(&line, POLAR, 0, 0, &range);
        let expected = "the region's middle, cell (4, 4), is not inside of its contour";
        assert!(no_middle.starts_with(expected), "{no_middle}");
        let ring = region(&range, |x, y| {
            let (x, y) = (x as f64 - 20.0, y as f64 - 19.0);
            (100.0..250.0).contains(&(x * x + y * y)) && (x < 0.0 || y.abs() > 2.0)
        });
        assert!(error(&ring, POLAR, 0, 0, &range).contains("is not inside of its contour"));
        let two = region(&range, |x, _| !(4..=9).contains(&x));
        assert_eq!(error(&two, POLAR, 0, 0, &range), PARTS);
        let egg = egg(&range);
        let few_columns = "expected at least 5 columns for a closed net of this order, found 4";
        assert_eq!(error(&egg, POLAR, 0, 4, &range), few_columns);
        let order = "expected an order from 2 to 10, found 11";
        assert_eq!(error(&egg, NetMethod::Polar { order: 11 }, 0, 0, &range), order);
    }
}
