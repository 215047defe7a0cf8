//! Filled cells beside a region whose border moves.

use maquette_base::linear::laplace;
use maquette_node::{Error, Progress};
use maquette_value::{Mask, Surface};
use nalgebra::{Point3, Vector3};

/// Returns true if a fixed point of the surface's net was moved, as those on the border of a region that sinks.
pub(crate) fn is_border_moved(surface: &Surface) -> bool {
    let net = surface.net();
    let mut points = net.points().iter().zip(net.base()).zip(net.fixed_points());
    points.any(|((point, base), &fixed)| fixed == 1 && point != base)
}

/// Moves the filled cells that are connected with a region as its border moves, so that they still lead from the region to the scan: by the
/// smooth displacement (the solution of Laplace's equation) that is that of the region at its border, and 0 at measured cells.
///
/// `before` and `points` are the points of all cells before and after a surface is written to the cells `inside`; NaN for a cell without a
/// point. `filled` is true for each filled cell.
pub(crate) fn move_filled_cells(
    inside: &Mask,
    filled: &[bool],
    before: &[Point3<f64>],
    points: &mut [Point3<f64>],
    progress: &Progress<'_>,
) -> Result<(), Error> {
    let (width, height) = (inside.width(), inside.height());
    let free = connected_cells(inside, filled, before);
    if !free.contains(&1) {
        return Ok(());
    }
    let mut moves = vec![Vector3::zeros(); points.len()];
    for axis in 0..3 {
        let mut values: Vec<f64> =
            points.iter().zip(before).map(|(after, before)| after[axis] - before[axis]).collect();
        laplace::solve(width, height, &free, 0.0, &mut values, progress)?;
        moves.iter_mut().zip(values).for_each(|(step, value)| step[axis] = value);
    }
    for (at, point) in points.iter_mut().enumerate().filter(|(at, _)| free[*at] == 1) {
        if moves[at].iter().all(|x| x.is_finite()) {
            *point += moves[at];
        }
    }
    Ok(())
}

/// Returns 1 for each filled cell outside of the region that is connected with it, by sides, through such cells.
fn connected_cells(inside: &Mask, filled: &[bool], points: &[Point3<f64>]) -> Vec<u8> {
    let (width, count) = (inside.width(), points.len());
    let mut connected = vec![0; count];
    let mut stack: Vec<usize> = (0..count).filter(|&cell| inside.pixels()[cell] == 1).collect();
    while let Some(cell) = stack.pop() {
        let column = cell % width;
        let near = [
            (column > 0).then(|| cell - 1),
            (column + 1 < width).then(|| cell + 1),
            cell.checked_sub(width),
            (cell + width < count).then(|| cell + width),
        ];
        for near in near.into_iter().flatten() {
            let is_new = connected[near] == 0 && inside.pixels()[near] == 0;
            if is_new && filled[near] && !points[near].x.is_nan() {
                connected[near] = 1;
                stack.push(near);
            }
        }
    }
    connected
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn filled_cells_lead_from_the_moved_region_to_the_scan() {
        // From the left: two cells of the region, three filled cells, a measured one, and a filled cell that is not connected.
        let inside = Mask::from_rows(&["##....."]);
        let filled = [false, false, true, true, true, false, true];
        let before: Vec<_> = (0..7).map(|k| Point3::new(f64::from(k), 0.0, 5.0)).collect();
        let mut points = before.clone();
        (points[0].z, points[1].z) = (9.0, 9.0);
        move_filled_cells(&inside, &filled, &before, &mut points, &Progress::silent()).unwrap();
        let depths = points.iter().map(|point| point.z);
        for (depth, expected) in depths.zip([9.0, 9.0, 8.0, 7.0, 6.0, 5.0, 5.0]) {
            assert!((depth - expected).abs() < 1e-9, "{depth} {expected}");
        }
    }
}
