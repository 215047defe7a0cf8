//! A finer range grid over the same view, and the net coordinates of its cells.
//!
//! Each cell becomes `rows x columns` smaller cells that cover the same area. All data of the old grid is interpolated bilinearly between
//! the centers of the old cells, and extrapolated linearly beyond the outermost centers.

use std::array;

use maquette_value::parallel::*;
use maquette_value::{Pinhole, RangeImage, Registration, SizeError};
use nalgebra::{Point3, Vector3};

use super::canvas::{Canvas, Target};

/// Up to four old cells around a position, each with its weight for bilinear interpolation; `None` instead of a cell of weight 0.
type Corners = [Option<(usize, f64)>; 4];

/// Returns the canvas with each cell divided into `factors` = (rows, columns), at least 1 each.
pub(crate) fn refine(canvas: &Canvas, [down, right]: [usize; 2]) -> Canvas {
    let old = Old::new(canvas);
    let (width, height) = (canvas.width * right, canvas.height * down);
    let rows: Vec<_> = (0..height)
        .into_par_iter()
        .map(|row: usize| {
            let places = (0..width)
                .map(|column: usize| {
                    let at = [position(row, down), position(column, right)];
                    (row / down * canvas.width + column / right, old.corners(at))
                })
                .enumerate();
            let points: Vec<_> =
                places.clone().map(|(_, (_, corners))| old.point(&corners)).collect();
            (
                points,
                places
                    .filter_map(|(column, (owner, corners)): (usize, (usize, Corners))| {
                        let (coordinate, depth) = old.target(owner, &corners)?;
                        Some(Target { cell: row * width + column, coordinate, depth })
                    })
                    .collect::<Vec<_>>(),
            )
        })
        .collect();
    let (mut points, mut targets) = (Vec::with_capacity(width * height), Vec::new());
    for (row, inside) in rows {
        points.extend(row);
        targets.extend(inside);
    }
    Canvas { width, height, points, targets }
}

/// Returns the position of the center of a new row or column, counted in old rows or columns.
fn position(line: usize, factor: usize) -> f64 {
    (line as f64 + 0.5) / factor as f64 - 0.5
}

/// The grid before refinement, with an index to look up its cells.
struct Old<'a> {
    canvas: &'a Canvas,
    /// For each old cell, its index in the canvas's `targets`; `None` for a cell outside of the region.
    index: Vec<Option<u32>>,
}

impl<'a> Old<'a> {
    fn new(canvas: &'a Canvas) -> Self {
        let mut index = vec![None; canvas.points.len()];
        (0..).zip(&canvas.targets).for_each(|(k, target)| index[target.cell] = Some(k));
        Self { canvas, index }
    }

    fn own_target(&self, cell: usize) -> Option<&Target> {
        self.index[cell].map(|k| &self.canvas.targets[k as usize])
    }

    fn corners(&self, at: [f64; 2]) -> Corners {
        let sizes = [self.canvas.height, self.canvas.width];
        let [(row, t), (column, s)] = [0, 1].map(|axis| {
            let first = (at[axis] as usize).min(sizes[axis].saturating_sub(2));
            let share = if sizes[axis] == 1 { 0.0 } else { at[axis] - first as f64 };
            (first, share)
        });
        let weights = [(1.0 - t) * (1.0 - s), (1.0 - t) * s, t * (1.0 - s), t * s];
        array::from_fn(|k| {
            let cell = (row + k / 2) * self.canvas.width + column + k % 2;
            (weights[k] != 0.0).then_some((cell, weights[k]))
        })
    }

    /// Returns the interpolated point; NaN if a corner is invalid.
    fn point(&self, corners: &Corners) -> Point3<f64> {
        Point3::from(
            corners
                .iter()
                .flatten()
                .map(|&(cell, share)| self.canvas.points[cell].coords * share)
                .sum::<Vector3<f64>>(),
        )
    }

    /// Returns the net coordinate and the depth of a smaller cell within the old cell `owner`; `None` if `owner` is outside of the region.
    fn target(&self, owner: usize, corners: &Corners) -> Option<([f64; 2], f64)> {
        self.own_target(owner)?;
        let mut coordinate = [0.0; 2];
        let mut depth = 0.0;
        for &(cell, share) in corners.iter().flatten() {
            let at = match self.own_target(cell) {
                Some(target) => target.coordinate,
                None => self.extrapolate(owner, cell),
            };
            (0..2).for_each(|k| coordinate[k] += at[k] * share);
            // The depth may be infinite. It is made finite, so that sums of weighted depths do not overflow or become NaN.
            let deep =
                self.own_target(cell).map_or(0.0, |target| target.depth.min(f64::MAX / 16.0));
            depth += deep * share;
        }
        Some((coordinate, depth.max(0.0)))
    }

    /// Returns the net coordinate of an outside cell, extrapolated from the coordinates around the inside cell `owner`.
    fn extrapolate(&self, owner: usize, cell: usize) -> [f64; 2] {
        let width = self.canvas.width;
        let here = self.own_target(owner).expect("the owner is inside").coordinate;
        let slope = |before: Option<usize>, after: Option<usize>| {
            let [before, after] =
                [before, after].map(|cell| cell.and_then(|cell| self.own_target(cell)));
            [0, 1].map(|k| match (before, after) {
                (Some(before), Some(after)) => (after.coordinate[k] - before.coordinate[k]) / 2.0,
                (Some(before), None) => here[k] - before.coordinate[k],
                (None, Some(after)) => after.coordinate[k] - here[k],
                (None, None) => 0.0,
            })
        };
        let (row, column) = (owner / width, owner % width);
        let down = slope(
            owner.checked_sub(width),
            Some(owner + width).filter(|_| row + 1 < self.canvas.height),
        );
        let right = slope(
            Some(owner).filter(|_| column > 0).map(|owner| owner - 1),
            Some(owner + 1).filter(|_| column + 1 < width),
        );
        let rows = (cell / width) as f64 - row as f64;
        let columns = (cell % width) as f64 - column as f64;
        [0, 1].map(|k| here[k] + down[k] * rows + right[k] * columns)
    }
}

/// Returns the range image of the finer grid. Each smaller cell gets the color of its old cell; the registration and the camera are
/// adapted.
pub(crate) fn refined_range(
    range: &RangeImage,
    [down, right]: [usize; 2],
    points: Vec<Point3<f64>>,
    filled: Vec<u8>,
) -> Result<RangeImage, SizeError> {
    let (width, height) = (range.width() * right, range.height() * down);
    let factors = [right, down].map(|factor| factor as f64);
    let map = range.registration();
    let registration = Registration {
        scale: [0, 1].map(|axis| map.scale[axis] / factors[axis]),
        offset: [0, 1].map(|axis| map.offset[axis] + map.scale[axis] * (0.5 / factors[axis] - 0.5)),
        picture: map.picture,
    };
    let camera = range.camera().map(|camera| Pinhole {
        focal: [0, 1].map(|axis| camera.focal[axis] * factors[axis]),
        center: [0, 1].map(|axis| (camera.center[axis] + 0.5) * factors[axis] - 0.5),
    });
    let fine = RangeImage::new(width, height, points)?
        .with_filled(filled)?
        .with_registration(registration)
        .with_camera(camera)
        .with_world_from_camera(range.world_from_camera().copied());
    match range.colors() {
        None => Ok(fine),
        Some(colors) => {
            fn owner(
                cell: usize,
                width: usize,
                down: usize,
                right: usize,
                range: &RangeImage,
            ) -> usize {
                cell / width / down * range.width() + cell % width / right
            }
            fine.with_colors(
                (0..width * height)
                    .map(|cell| colors[owner(cell, width, down, right, range)])
                    .collect(),
            )
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plane(x: f64, y: f64) -> Point3<f64> {
        Point3::new(x, y, 5.0 + 0.5 * x - 0.25 * y)
    }

    /// Returns a canvas of 7 x 5 cells on a plane, with a region in its middle whose net coordinates are curved.
    fn canvas() -> Canvas {
        Canvas {
            width: 7,
            height: 5,
            points: (0..35).map(|cell| plane((cell % 7) as f64, (cell / 7) as f64)).collect(),
            targets: (0..35)
                .filter(|cell| (2..6).contains(&(cell % 7)) && (1..4).contains(&(cell / 7)))
                .map(|cell: usize| Target {
                    cell,
                    coordinate: [(cell / 7) as f64 * 2.0, (cell % 7) as f64 - (cell / 7) as f64],
                    depth: 1.0,
                })
                .collect(),
        }
    }

    #[test]
    fn a_finer_plane_is_the_same_plane() {
        let fine = refine(&canvas(), [3, 2]);
        assert_eq!((fine.width, fine.height), (14, 15));
        for (cell, point) in fine.points.iter().enumerate() {
            let expected = plane(position(cell % 14, 2), position(cell / 14, 3));
            assert!((point - expected).norm() <= 1e-12, "{cell}");
        }
    }

    #[test]
    fn a_straight_chart_is_continued_to_the_border_of_the_region() {
        let fine = refine(&canvas(), [3, 2]);
        assert_eq!(fine.targets.len(), 12 * 6);
        for target in &fine.targets {
            let (x, y) = (position(target.cell % 14, 2), position(target.cell / 14, 3));
            let [a, b] = target.coordinate;
            assert!((a - 2.0 * y).abs() <= 1e-12 && (b - (x - y)).abs() <= 1e-12);
            assert!((0.0..=1.0).contains(&target.depth));
        }
    }

    #[test]
    fn a_new_cell_needs_all_its_old_neighbors() {
        let mut canvas = canvas();
        canvas.points[0] = Point3::new(f64::NAN, f64::NAN, f64::NAN);
        let fine = refine(&canvas, [2, 1]);
        let invalid: Vec<usize> =
            (0..fine.points.len()).filter(|&cell| fine.points[cell].x.is_nan()).collect();
        assert_eq!(invalid, [0, 7, 14]);
    }

    #[test]
    fn the_finer_grid_sees_the_same_picture() {
        let camera = Pinhole { focal: [100.0, 90.0], center: [3.0, 2.0] };
        let old = canvas();
        let range = RangeImage::new(7, 5, old.points.clone())
            .and_then(|range| range.with_colors((0..35).map(|k| [k, 0, 0]).collect()))
            .unwrap()
            .with_camera(Some(camera))
            .with_registration(Registration::corners([7, 5], [14, 20]));
        let points = refine(&old, [3, 2]).points;
        let fine = refined_range(&range, [3, 2], points, vec![0; 210]).unwrap();
        let (from, to) = ([position(9, 2), position(4, 3)], [9.0, 4.0]);
        let [a, b] = [
            range.registration().picture_from_range(from),
            fine.registration().picture_from_range(to),
        ];
        assert!((a[0] - b[0]).abs() <= 1e-12 && (a[1] - b[1]).abs() <= 1e-12);
        let [a, b] = [camera.unproject(from, 3.0), fine.camera().unwrap().unproject(to, 3.0)];
        assert!((a - b).norm() <= 1e-12);
        assert_eq!(fine.colors().unwrap()[4 * 14 + 9], [7 + 4, 0, 0]);
    }
}
