//! A control net of a region of any shape without holes, mapped to a square.
//!
//! The contour of the region is mapped to the border of the square; along each side of the square, lengths are proportional to those in the
//! range grid. Each inner cell is a weighted mean of its neighbors, which prevents overlaps ([`super::mean_value`]). The points of the net
//! are at a uniform grid in the square. The border of the net is the contour, and is fixed.

use std::collections::VecDeque;

use maquette_node::{Error, Progress, bail};
use maquette_value as value;
use maquette_value::{RangeImage, Region};
use nalgebra::Point3;

use super::mean_value::relax;
use super::parameterized::{on_border, parameterize};
use super::polar::PARTS;
use super::rows::resample;
use crate::grid::disk::Disk;
use crate::grid::window::GridWindow;

/// Minimum automatic number of rows and columns: enough for a cubic surface.
const MIN_LINES: usize = 4;

/// Maximum automatic number of rows and columns: the maximum that the node allows.
const MAX_LINES: usize = 4096;

/// Maximum distance of a given corner from the contour, in cells: the accuracy with which users pick a cell in a picture.
const SNAP: f64 = 3.0;

/// Returns the error of a region with too few rows or columns of cells.
pub(crate) fn degenerate_region(rows: usize, columns: usize) -> Error {
    Error::new(format!(
        "the region has {rows} rows and {columns} columns of cells, but a surface needs 2 of both; choose a larger region"
    ))
}

/// Makes the net with the given corners (column, row); if `corners` is `None`, they are chosen automatically. `rows` and `columns` are
/// automatic where they are 0.
pub(crate) fn net(
    region: &Region,
    range: &RangeImage,
    corners: Option<[[usize; 2]; 4]>,
    [rows, columns]: [usize; 2],
    progress: &Progress<'_>,
) -> Result<value::ControlNet, Error> {
    let window = GridWindow::new(region, range, 0, progress)?;
    let (low, high) = region.bounds();
    // A disk of three cells does not have four corners.
    let disk = Disk::new(window.rows, window.columns, &window.inside)
        .filter(|disk| disk.border.len() >= 4)
        .ok_or_else(|| degenerate_region(high[1] - low[1] + 1, high[0] - low[0] + 1))?;
    let corners = match corners {
        None => chosen_corners(&disk),
        Some(corners) => given_corners(&disk, &window, corners)?,
    };
    let sides = Sides::new(&disk, corners);
    let square = map_to_square(&disk, &sides)?;
    let lengths: Vec<f64> = sides.0.iter().map(|side| length(&disk, side)).collect();
    fn choose_count(given: usize, a: usize, b: usize, lengths: &[f64]) -> usize {
        match given {
            0 => {
                (((lengths[a] + lengths[b]) / 2.0).round() as usize + 1).clamp(MIN_LINES, MAX_LINES)
            }
            given => given,
        }
    }
    let (rows, columns) =
        (choose_count(rows, 0, 2, &lengths), choose_count(columns, 1, 3, &lengths));

    let mut points = interior(&disk, &window, &square, rows, columns)?;
    for (k, side) in sides.0.iter().enumerate() {
        let on_border: Vec<Point3<f64>> =
            side.iter().map(|&vertex| window.points[vertex as usize]).collect();
        let count = if k % 2 == 0 { rows } else { columns };
        for (step, point) in
            resample(&on_border, &shares(&disk, side), count).into_iter().enumerate()
        {
            let (row, column) = match k {
                0 => (step, 0),
                1 => (rows - 1, step),
                2 => (rows - 1 - step, columns - 1),
                _ => (0, columns - 1 - step),
            };
            points[row * columns + column] = point;
        }
    }
    let scale = [(rows - 1) as f64, (columns - 1) as f64];
    let coordinates = coordinates(region, &window, &disk, &square)?
        .into_iter()
        .map(|[u, v]| [u * scale[0], v * scale[1]])
        .collect();
    let size = [rows, columns];
    parameterize(range, size, points, on_border(size), region.cells().to_vec(), coordinates)
}

/// The border of a disk, divided into the four sides of the square: down the left side, to the right along the bottom, up the right side,
/// and back to the left along the top. Each side contains both of its corners.
struct Sides([Vec<u32>; 4]);

impl Sides {
    /// Divides the border into the sides between `corners`, given by their indices in the border.
    fn new(disk: &Disk, corners: [usize; 4]) -> Self {
        let n = disk.border.len();
        let steps = corners.map(|corner| (corner + n - corners[0]) % n);
        let ends = [0, steps[1], steps[2], steps[3], n];
        Self([0, 1, 2, 3].map(|k: usize| {
            (ends[k]..=ends[k + 1]).map(|step| disk.border[(corners[0] + step) % n]).collect()
        }))
    }
}

/// Returns true if the corners follow each other in this order along a closed chain of `n` vertices.
fn in_order(corners: [usize; 4], n: usize) -> bool {
    let [_, a, b, c] = corners.map(|corner| (corner + n - corners[0]) % n);
    0 < a && a < b && b < c
}

/// Returns the indices of the border vertices farthest along the diagonals of the disk's principal axes. If several are equally far, the
/// one nearest to the diagonal is taken. The axes are oriented so that rows run down and columns to the right.
fn chosen_corners(disk: &Disk) -> [usize; 4] {
    let n = disk.border.len();
    let frame = Frame::new(disk);
    let local: Vec<[f64; 2]> =
        disk.border.iter().map(|&vertex| frame.local(disk.places[vertex as usize])).collect();
    fn farthest(across: f64, down: f64, local: &[[f64; 2]], n: usize) -> usize {
        fn rank(k: &usize, across: f64, down: f64, local: &[[f64; 2]]) -> (f64, f64) {
            let [x, y] = local[*k];
            (across * x + down * y, -(across * x - down * y).abs())
        }
        // Ignore differences of the size of rounding errors: the choice of corners must not depend on rounding.
        let best =
            (0..n).map(|k| rank(&k, across, down, local).0).fold(f64::NEG_INFINITY, f64::max);
        let equals = (0..n).filter(|k| rank(k, across, down, local).0 >= best - 1e-9);
        equals
            .max_by(|a, b| {
                rank(a, across, down, local)
                    .1
                    .total_cmp(&rank(b, across, down, local).1)
                    .then(b.cmp(a))
            })
            .unwrap_or(0)
    }
    let corners = [(-1.0, -1.0), (-1.0, 1.0), (1.0, 1.0), (1.0, -1.0)]
        .map(|(across, down)| farthest(across, down, &local, n));
    match in_order(corners, n) {
        true => corners,
        // The corners do not follow each other along the border; for example, one vertex may be extreme in two directions. The border,
        // which has at least four vertices, is divided into quarters instead.
        false => [0, 1, 2, 3].map(|k| (corners[0] + k * n / 4) % n),
    }
}

/// Returns the indices in the border that are nearest to the given cells (column, row).
fn given_corners(
    disk: &Disk,
    window: &GridWindow,
    cells: [[usize; 2]; 4],
) -> Result<[usize; 4], Error> {
    let mut corners = [0; 4];
    for (corner, cell) in corners.iter_mut().zip(cells) {
        let (x, y) = (cell[0] as f64 - window.left as f64, cell[1] as f64 - window.top as f64);
        fn place(k: &usize, disk_places: &[[f64; 2]], disk_border: &[u32]) -> [f64; 2] {
            disk_places[disk_border[*k] as usize]
        }
        fn distance(
            k: &usize,
            x: f64,
            y: f64,
            disk_places: &[[f64; 2]],
            disk_border: &[u32],
        ) -> f64 {
            libm::hypot(
                place(k, disk_places, disk_border)[0] - x,
                place(k, disk_places, disk_border)[1] - y,
            )
        }
        let nearest = (0..disk.border.len()).min_by(|a, b| {
            distance(a, x, y, &disk.places, &disk.border).total_cmp(&distance(
                b,
                x,
                y,
                &disk.places,
                &disk.border,
            ))
        });
        *corner = nearest.unwrap_or(0);
        if distance(corner, x, y, &disk.places, &disk.border) > SNAP {
            let [column, row] = place(corner, &disk.places, &disk.border).map(|at| at as usize);
            bail!(
                "corner ({}, {}) is not on the region's contour: the nearest cell there is ({}, {})",
                cell[0],
                cell[1],
                window.left + column,
                window.top + row
            );
        }
    }
    if !in_order(corners, disk.border.len()) {
        let mut order = [0, 1, 2, 3];
        order.sort_by_key(|&k: &usize| corners[k]);
        let order = order.map(|k| format!("({}, {})", cells[k][0], cells[k][1])).join(", ");
        bail!(
            "the corners do not follow each other counter-clockwise along the region's contour; write them as {order}"
        );
    }
    Ok(corners)
}

/// The principal axes of a disk's cells, rotated by at most 45 degrees.
struct Frame {
    center: [f64; 2],
    cos: f64,
    sin: f64,
}

impl Frame {
    fn new(disk: &Disk) -> Self {
        let mut used = vec![false; disk.places.len()];
        disk.triangles.iter().flatten().for_each(|&vertex| used[vertex as usize] = true);
        // Only cells count: vertices between cells would shift the axes.
        let cells = disk.places.len() - disk.between.len();
        let places = (0..cells).filter(|&cell| used[cell]).map(|cell| disk.places[cell]);
        let n = places.clone().count() as f64;
        let center = [0, 1].map(|axis| places.clone().map(|place| place[axis]).sum::<f64>() / n);
        let mut moments = [0.0; 3];
        for place in places {
            let [x, y] = [0, 1].map(|axis| place[axis] - center[axis]);
            moments = [moments[0] + x * x, moments[1] + x * y, moments[2] + y * y];
        }
        let [xx, xy, yy] = moments;
        // A round region has no principal axes: those that rounding errors define are ignored.
        let round = xy.abs().max((xx - yy).abs()) <= 1e-9 * (xx + yy);
        let quarter = std::f64::consts::FRAC_PI_2;
        let angle = if round { 0.0 } else { libm::atan2(2.0 * xy, xx - yy) / 2.0 };
        let angle = angle - quarter * (angle / quarter).round();
        Self { center, cos: libm::cos(angle), sin: libm::sin(angle) }
    }

    fn local(&self, place: [f64; 2]) -> [f64; 2] {
        let [x, y] = [0, 1].map(|axis| place[axis] - self.center[axis]);
        [self.cos * x + self.sin * y, self.cos * y - self.sin * x]
    }
}

fn lengths(disk: &Disk, side: &[u32]) -> Vec<f64> {
    let mut along = 0.0;
    let mut lengths = vec![0.0];
    for pair in side.windows(2) {
        let [a, b] = [pair[0], pair[1]].map(|vertex| disk.places[vertex as usize]);
        along += libm::hypot(b[0] - a[0], b[1] - a[1]);
        lengths.push(along);
    }
    lengths
}

fn length(disk: &Disk, side: &[u32]) -> f64 {
    lengths(disk, side).last().copied().unwrap_or(0.0)
}

/// Returns, for each vertex of a side, the fraction of the side's length from the side's start to the vertex, from 0 to 1; all 0 if the
/// side has no length.
fn shares(disk: &Disk, side: &[u32]) -> Vec<f64> {
    let lengths = lengths(disk, side);
    let whole = lengths.last().copied().filter(|&whole| whole > 0.0).unwrap_or(1.0);
    lengths.into_iter().map(|along| along / whole).collect()
}

/// Returns the position of each vertex in the square: (0, 0) is the upper left corner, the first coordinate grows down, the second to the
/// right.
fn map_to_square(disk: &Disk, sides: &Sides) -> Result<Vec<[f64; 2]>, Error> {
    /// Returns the minimum or maximum of a coordinate over the border; `better` is `f64::min` or `f64::max`.
    fn bound(disk: &Disk, axis: usize, better: fn(f64, f64) -> f64) -> f64 {
        disk.border
            .iter()
            .map(|&vertex| disk.places[vertex as usize][axis])
            .reduce(better)
            .unwrap_or(0.0)
    }
    // The first guess is the position in the rectangle around the disk, which is exact for rectangles.
    let (left, top) = (bound(disk, 0, f64::min), bound(disk, 1, f64::min));
    let (width, height) = (bound(disk, 0, f64::max) - left, bound(disk, 1, f64::max) - top);
    let mut square: Vec<[f64; 2]> =
        disk.places.iter().map(|[x, y]| [(y - top) / height, (x - left) / width]).collect();
    for (k, side) in sides.0.iter().enumerate() {
        for (&vertex, share) in side.iter().zip(shares(disk, side)) {
            square[vertex as usize] = match k {
                0 => [share, 0.0],
                1 => [1.0, share],
                2 => [1.0 - share, 1.0],
                _ => [0.0, 1.0 - share],
            };
        }
    }
    relax(disk, &mut square).map_err(not_mapped)?;
    Ok(square)
}

/// Returns the error message for a region that could not be mapped to a square. The residual is a fraction of the square's side.
fn not_mapped(residual: f64) -> Error {
    Error::new(format!("the region could not be mapped to a square: residual {residual:e}"))
}

/// Returns the points at a uniform grid of the square, interpolated in the triangles that contain them; the points of the border are left
/// at the origin.
fn interior(
    disk: &Disk,
    window: &GridWindow,
    square: &[[f64; 2]],
    rows: usize,
    columns: usize,
) -> Result<Vec<Point3<f64>>, Error> {
    let cells = window.points.len();
    fn point(
        vertex: u32,
        cells: usize,
        window_points: &[Point3<f64>],
        disk_between: &[[u32; 2]],
    ) -> Point3<f64> {
        match (vertex as usize).checked_sub(cells) {
            None => window_points[vertex as usize],
            Some(middle) => {
                let [a, b] = disk_between[middle].map(|cell| window_points[cell as usize]);
                a + (b - a) * 0.5
            }
        }
    }
    // The depth of each point inside the triangle that has been chosen for it; negative if the point is outside. Due to rounding, a point
    // on an edge may be outside of both triangles at the edge, so the triangle with the greatest depth is chosen.
    let mut depths = vec![f64::NEG_INFINITY; rows * columns];
    let mut points = vec![Point3::origin(); rows * columns];
    for triangle in &disk.triangles {
        let corners = triangle.map(|vertex| {
            let [u, v] = square[vertex as usize];
            [u * (rows - 1) as f64, v * (columns - 1) as f64]
        });
        let [a, b, c] = corners;
        let area = cross(a, b, c);
        if area == 0.0 {
            continue;
        }
        fn reach(
            axis: usize,
            count: usize,
            corners: &[[f64; 2]; 3],
        ) -> std::ops::RangeInclusive<usize> {
            let at = corners.map(|corner| corner[axis]);
            let low = at[0].min(at[1]).min(at[2]) - MAX_OUTSIDE;
            let high = at[0].max(at[1]).max(at[2]) + MAX_OUTSIDE;
            (low.ceil().max(1.0) as usize)..=(high.floor().min((count - 2) as f64) as usize)
        }
        for row in reach(0, rows, &corners) {
            for column in reach(1, columns, &corners) {
                let at = [row as f64, column as f64];
                let shares = [cross(at, b, c), cross(a, at, c), cross(a, b, at)].map(|x| x / area);
                let depth = shares[0].min(shares[1]).min(shares[2]);
                let index = row * columns + column;
                if depth > depths[index] {
                    depths[index] = depth;
                    let [p, q, r] = triangle
                        .map(|vertex| point(vertex, cells, &window.points, &disk.between).coords);
                    points[index] = (p * shares[0] + q * shares[1] + r * shares[2]).into();
                }
            }
        }
    }
    match (0..depths.len())
        .filter(|at| {
            let (row, column) = (at / columns, at % columns);
            0 < row && row + 1 < rows && 0 < column && column + 1 < columns
        })
        .find(|&at| depths[at] == f64::NEG_INFINITY)
    {
        None => Ok(points),
        Some(_) => Err(not_mapped(f64::INFINITY)),
    }
}

/// Maximum distance, in steps of the net, between a point and the triangle that should contain it: far above rounding errors.
const MAX_OUTSIDE: f64 = 1e-6;

/// Returns twice the signed area of a triangle.
fn cross(a: [f64; 2], b: [f64; 2], c: [f64; 2]) -> f64 {
    (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
}

/// Returns the position in the square of each cell of the region. A cell outside of the disk gets the position of the nearest cell on the
/// disk, counted in steps from cell to cell.
fn coordinates(
    region: &Region,
    window: &GridWindow,
    disk: &Disk,
    square: &[[f64; 2]],
) -> Result<Vec<[f64; 2]>, Error> {
    let mut places: Vec<Option<[f64; 2]>> = vec![None; window.points.len()];
    let mut on_disk: Vec<usize> = disk.triangles.iter().flatten().map(|&v| v as usize).collect();
    on_disk.sort_unstable();
    on_disk.dedup();
    let mut queue = VecDeque::new();
    let cells = places.len();
    for vertex in on_disk.into_iter().filter(|&vertex| vertex < cells) {
        places[vertex] = Some(square[vertex]);
        queue.push_back(vertex);
    }
    while let Some(at) = queue.pop_front() {
        let (row, column) = (at / window.columns, at % window.columns);
        for next_row in row.saturating_sub(1)..=(row + 1).min(window.rows - 1) {
            for next_column in column.saturating_sub(1)..=(column + 1).min(window.columns - 1) {
                let next = next_row * window.columns + next_column;
                if window.inside[next] == 1 && places[next].is_none() {
                    places[next] = places[at];
                    queue.push_back(next);
                }
            }
        }
    }
    region
        .cells()
        .iter()
        .map(|&cell| {
            let [row, column] = window.place(cell);
            places[row * window.columns + column].ok_or_else(|| Error::new(PARTS))
        })
        .collect()
}

#[cfg(test)]
mod tests;
