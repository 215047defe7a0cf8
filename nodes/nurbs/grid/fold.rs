//! Counts the cells of a range grid at which the grid folds over, so that neighboring cells hide each other from the sensor.

use maquette_value::Pinhole;
use nalgebra::Point3;

/// Returns the number of `changed` cells that touch a newly folded square of four cells. A square is newly folded if it was front-facing in
/// the sensor's view before the change, and is flipped or degenerate after it. Without a camera the sensor is at infinity, and its view is
/// the projection to x and y.
pub(crate) fn folded_cells(
    width: usize,
    before: &[Point3<f64>],
    after: &[Point3<f64>],
    changed: &[usize],
    camera: Option<&Pinhole>,
) -> usize {
    let height = before.len() / width;
    changed
        .iter()
        .filter(|&&cell| {
            let (row, column) = (cell / width, cell % width);
            let squares = [(0, 0), (0, 1), (1, 0), (1, 1)].into_iter();
            squares.filter(|&(up, left)| up <= row && left <= column).any(|(up, left)| {
                let (row, column) = (row - up, column - left);
                if row + 1 == height || column + 1 == width {
                    return false;
                }
                let corner = row * width + column;
                let corners = [corner, corner + 1, corner + width + 1, corner + width];
                fn cell_area(
                    points: &[Point3<f64>],
                    corners: [usize; 4],
                    camera: &Option<&Pinhole>,
                ) -> f64 {
                    area(corners.map(|at| points[at]), *camera)
                }
                // If a corner is invalid, both areas are NaN, and both comparisons are false.
                cell_area(before, corners, &camera) > 0.0
                    && cell_area(after, corners, &camera) <= 0.0
            })
        })
        .count()
}

/// Returns twice the signed area of a square of cells in the picture: positive if front-facing, with columns to the right and rows down.
fn area(corners: [Point3<f64>; 4], camera: Option<&Pinhole>) -> f64 {
    let [a, b, c, d] = corners.map(|point: Point3<f64>| match camera {
        Some(camera) => camera.project(point),
        None => [point.x, point.y],
    });
    let falling = [c[0] - a[0], c[1] - a[1]];
    let rising = [d[0] - b[0], d[1] - b[1]];
    falling[0] * rising[1] - falling[1] * rising[0]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grid() -> Vec<Point3<f64>> {
        (0..16).map(|k| Point3::new((k % 4) as f64, (k / 4) as f64, 100.0)).collect()
    }

    #[test]
    fn a_cell_pulled_over_its_neighbors_folds() {
        let mut after = grid();
        after[5].z -= 50.0;
        assert_eq!(folded_cells(4, &grid(), &after, &[5], None), 0);
        after[5].x += 3.0;
        assert_eq!(folded_cells(4, &grid(), &after, &[5, 15], None), 1);
        after[5].x = f64::NAN;
        assert_eq!(folded_cells(4, &grid(), &after, &[5], None), 0);
    }

    #[test]
    fn a_camera_sees_a_near_cell_further_out() {
        let camera = Pinhole { focal: [100.0; 2], center: [0.0; 2] };
        let mut after = grid();
        after[5].z = 20.0;
        assert_eq!(folded_cells(4, &grid(), &after, &[5], None), 0);
        assert_eq!(folded_cells(4, &grid(), &after, &[5], Some(&camera)), 1);
    }
}
