//! A net of a region of any shape without holes, mapped to a square.
//!
//! The contour goes to the border of the square, each side evenly by its length in the range grid; the cells inside go to means
//! of their neighbors, so that no two of them overlap ([`super::mean_value`]). The points of the net are what lies at an even
//! grid of the square. Its border is the contour, and is fixed.

use std::collections::VecDeque;

use maquette::value::{self, Chart, RangeImage, Region};
use nalgebra::Point3;

use super::control_net::NetError;
use super::disk::Disk;
use super::mean_value::relax;
use super::patch::Patch;
use super::rows::resampled;

/// Fewest rows and columns that are chosen: enough for a cubic.
const LEAST: usize = 4;

/// Most rows and columns that are chosen: those that the node takes.
const MOST: usize = 4096;

/// The net, with `rows` and `columns` where they are not 0.
pub(super) fn net(
    region: &Region,
    range: &RangeImage,
    rows: usize,
    columns: usize,
) -> Result<value::ControlNet, NetError> {
    let patch = Patch::new(region, range, 0)?;
    let (low, high) = region.bounds();
    let degenerate =
        NetError::DegenerateRegion { rows: high[1] - low[1] + 1, columns: high[0] - low[0] + 1 };
    // Three cells have no four corners.
    let disk = Disk::new(patch.rows, patch.columns, &patch.inside)
        .filter(|disk| disk.border.len() >= 4)
        .ok_or(degenerate)?;
    let sides = Sides::new(&disk);
    let square = map_to_square(&disk, &sides)?;
    let lengths: Vec<f64> = sides.0.iter().map(|side| length(&disk, side)).collect();
    let chosen = |given: usize, a: usize, b: usize| match given {
        0 => (((lengths[a] + lengths[b]) / 2.0).round() as usize + 1).clamp(LEAST, MOST),
        given => given,
    };
    let (rows, columns) = (chosen(rows, 0, 2), chosen(columns, 1, 3));

    let mut points = interior(&disk, &patch, &square, rows, columns)?;
    for (k, side) in sides.0.iter().enumerate() {
        let on_border: Vec<Point3<f64>> =
            side.iter().map(|&vertex| patch.points[vertex as usize]).collect();
        let count = if k % 2 == 0 { rows } else { columns };
        for (step, point) in
            resampled(&on_border, &shares(&disk, side), count).into_iter().enumerate()
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
    let on_border = |at: usize| {
        let (row, column) = (at / columns, at % columns);
        row == 0 || row + 1 == rows || column == 0 || column + 1 == columns
    };
    let fixed = (0..points.len()).map(|at| u8::from(on_border(at))).collect();
    let scale = [(rows - 1) as f64, (columns - 1) as f64];
    let chart = Chart {
        grid: [range.width(), range.height()],
        cells: region.cells().to_vec().into(),
        coordinates: coordinates(region, &patch, &disk, &square)?
            .into_iter()
            .map(|[u, v]| [u * scale[0], v * scale[1]])
            .collect(),
    };
    Ok(value::ControlNet::new(rows, columns, points)?.with_fixed(fixed)?.with_chart(chart))
}

/// The border of a disk from corner to corner of the square: down the left side, to the right, up, and back to the left. Each
/// side has both of its corners.
struct Sides([Vec<u32>; 4]);

impl Sides {
    /// The corners are the vertices of the border that lie farthest along the diagonals of the disk's principal frame; of equals
    /// the one nearest to the diagonal. The frame is turned so that its rows run down and its columns to the right.
    fn new(disk: &Disk) -> Self {
        let border = &disk.border;
        let frame = Frame::new(disk);
        let local: Vec<[f64; 2]> =
            border.iter().map(|&vertex| frame.local(disk.places[vertex as usize])).collect();
        let farthest = |across: f64, down: f64| {
            let rank = |k: &usize| {
                let [x, y] = local[*k];
                (across * x + down * y, -(across * x - down * y).abs())
            };
            // Differences of rounding are none: corners must not depend on them.
            let best = (0..border.len()).map(|k| rank(&k).0).fold(f64::NEG_INFINITY, f64::max);
            let equals = (0..border.len()).filter(|k| rank(k).0 >= best - 1e-9);
            equals.max_by(|a, b| rank(a).1.total_cmp(&rank(b).1).then(b.cmp(a))).unwrap_or(0)
        };
        let n = border.len();
        let corners = [(-1.0, -1.0), (-1.0, 1.0), (1.0, 1.0), (1.0, -1.0)]
            .map(|(across, down)| farthest(across, down));
        let mut steps = [1, 2, 3].map(|k| (corners[k] + n - corners[0]) % n);
        if steps[0] == 0 || steps[1] <= steps[0] || steps[2] <= steps[1] {
            // A region with a corner on two diagonals: quarters of the border, which has four vertices at least.
            steps = [1, 2, 3].map(|k| k * n / 4);
        }
        let ends = [0, steps[0], steps[1], steps[2], n];
        let side = |k: usize| {
            (ends[k]..=ends[k + 1]).map(|step| border[(corners[0] + step) % n]).collect()
        };
        Self([side(0), side(1), side(2), side(3)])
    }
}

/// The principal frame of a disk's cells, turned by at most 45 degrees.
struct Frame {
    center: [f64; 2],
    cos: f64,
    sin: f64,
}

impl Frame {
    fn new(disk: &Disk) -> Self {
        let mut used = vec![false; disk.places.len()];
        disk.triangles.iter().flatten().for_each(|&vertex| used[vertex as usize] = true);
        // Vertices between cells would pull it towards where they are.
        let cells = disk.places.len() - disk.between.len();
        let places = || (0..cells).filter(|&cell| used[cell]).map(|cell| disk.places[cell]);
        let n = places().count() as f64;
        let center = [0, 1].map(|axis| places().map(|place| place[axis]).sum::<f64>() / n);
        let mut moments = [0.0; 3];
        for place in places() {
            let [x, y] = [0, 1].map(|axis| place[axis] - center[axis]);
            moments = [moments[0] + x * x, moments[1] + x * y, moments[2] + y * y];
        }
        let [xx, xy, yy] = moments;
        // A round region has no axes, and rounding must not choose any.
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

/// For each vertex of a side the share of the side's length up to it; a side of one vertex has none.
fn shares(disk: &Disk, side: &[u32]) -> Vec<f64> {
    let lengths = lengths(disk, side);
    let whole = lengths.last().copied().filter(|&whole| whole > 0.0).unwrap_or(1.0);
    lengths.into_iter().map(|along| along / whole).collect()
}

/// The place of each vertex on the square: (0, 0) is the upper left corner, the first number grows down, the second to the right.
fn map_to_square(disk: &Disk, sides: &Sides) -> Result<Vec<[f64; 2]>, NetError> {
    // A first guess that is exact for rectangles: the place in the rectangle around the disk.
    let on_border = || disk.border.iter().map(|&vertex| disk.places[vertex as usize]);
    let bound = |axis: usize, better: fn(f64, f64) -> f64| {
        on_border().map(|place| place[axis]).reduce(better).unwrap_or(0.0)
    };
    let (left, top) = (bound(0, f64::min), bound(1, f64::min));
    let (width, height) = (bound(0, f64::max) - left, bound(1, f64::max) - top);
    let guess = |[x, y]: &[f64; 2]| [(y - top) / height, (x - left) / width];
    let mut square: Vec<[f64; 2]> = disk.places.iter().map(guess).collect();
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
    relax(disk, &mut square).map_err(|residual| NetError::Harmonic { residual })?;
    Ok(square)
}

/// The points at an even grid of the square, from the triangles that they lie in; those of the border are left at the origin.
fn interior(
    disk: &Disk,
    patch: &Patch,
    square: &[[f64; 2]],
    rows: usize,
    columns: usize,
) -> Result<Vec<Point3<f64>>, NetError> {
    let cells = patch.points.len();
    let point = |vertex: u32| match (vertex as usize).checked_sub(cells) {
        None => patch.points[vertex as usize],
        Some(middle) => {
            let [a, b] = disk.between[middle].map(|cell| patch.points[cell as usize]);
            a + (b - a) * 0.5
        }
    };
    // How deep in its triangle each point lies: on an edge rounding may put it outside of both.
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
        let reach = |axis: usize, count: usize| {
            let at = corners.map(|corner| corner[axis]);
            let low = at[0].min(at[1]).min(at[2]) - REACH;
            let high = at[0].max(at[1]).max(at[2]) + REACH;
            (low.ceil().max(1.0) as usize)..=(high.floor().min((count - 2) as f64) as usize)
        };
        for row in reach(0, rows) {
            for column in reach(1, columns) {
                let at = [row as f64, column as f64];
                let shares = [cross(at, b, c), cross(a, at, c), cross(a, b, at)].map(|x| x / area);
                let depth = shares[0].min(shares[1]).min(shares[2]);
                let index = row * columns + column;
                if depth > depths[index] {
                    depths[index] = depth;
                    let [p, q, r] = triangle.map(|vertex| point(vertex).coords);
                    points[index] = (p * shares[0] + q * shares[1] + r * shares[2]).into();
                }
            }
        }
    }
    let inner = |at: &usize| {
        let (row, column) = (at / columns, at % columns);
        0 < row && row + 1 < rows && 0 < column && column + 1 < columns
    };
    match (0..depths.len()).filter(inner).find(|&at| depths[at] == f64::NEG_INFINITY) {
        None => Ok(points),
        Some(_) => Err(NetError::Harmonic { residual: f64::INFINITY }),
    }
}

/// How far beyond its triangle a point is still looked for, in steps of the net: far above rounding.
const REACH: f64 = 1e-6;

/// Twice the area of a triangle.
fn cross(a: [f64; 2], b: [f64; 2], c: [f64; 2]) -> f64 {
    (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
}

/// The place on the square of each cell of the region. A cell that is not on the disk takes that of the nearest one, in steps
/// from cell to cell.
fn coordinates(
    region: &Region,
    patch: &Patch,
    disk: &Disk,
    square: &[[f64; 2]],
) -> Result<Vec<[f64; 2]>, NetError> {
    let mut places: Vec<Option<[f64; 2]>> = vec![None; patch.points.len()];
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
        let (row, column) = (at / patch.columns, at % patch.columns);
        for next_row in row.saturating_sub(1)..=(row + 1).min(patch.rows - 1) {
            for next_column in column.saturating_sub(1)..=(column + 1).min(patch.columns - 1) {
                let next = next_row * patch.columns + next_column;
                if patch.inside[next] == 1 && places[next].is_none() {
                    places[next] = places[at];
                    queue.push_back(next);
                }
            }
        }
    }
    let of_cell = |&cell: &u32| {
        let [row, column] = patch.place(cell);
        places[row * patch.columns + column].ok_or(NetError::Parts)
    };
    region.cells().iter().map(of_cell).collect()
}

#[cfg(test)]
mod tests {
    use super::super::control_net::tests::{range, region};
    use super::super::control_net::{NetMethod, control_net};
    use super::*;

    fn net(region: &Region, range: &RangeImage, rows: usize, columns: usize) -> value::ControlNet {
        control_net(region, range, NetMethod::Harmonic, rows, columns).unwrap()
    }

    // T-RNG-03, the method Harmonic.
    #[test]
    fn a_planar_rectangle_is_its_own_net() {
        let range = range(20, 16, |x, y| 700.0 + 0.3 * x - 0.2 * y);
        for (width, height) in [(7, 5), (5, 7), (6, 6), (4, 11)] {
            let inside = |x, y| (5..5 + width).contains(&x) && (3..3 + height).contains(&y);
            let rectangle = region(&range, inside);
            let net = net(&rectangle, &range, 0, 0);
            assert_eq!((net.rows(), net.columns()), (height, width));
            let coordinates = &net.chart().unwrap().coordinates;
            for (index, point) in net.points().iter().enumerate() {
                let (row, column) = (index / width, index % width);
                let border = row % (height - 1) == 0 || column % (width - 1) == 0;
                assert_eq!(net.fixed()[index] == 1, border);
                if border {
                    assert_eq!(*point, rectangle.points()[index], "bitwise");
                }
                assert!((point - rectangle.points()[index]).norm() <= 1e-10);
                let [a, b] = coordinates[index];
                assert!((a - row as f64).abs() <= 1e-10 && (b - column as f64).abs() <= 1e-10);
            }
        }
    }

    /// Numbers from 0 to 1 without any order.
    fn noise(k: u32) -> f64 {
        f64::from((k.wrapping_mul(2_654_435_761) ^ (k << 7)).wrapping_mul(40_503) >> 8)
            / f64::from(1 << 24)
    }

    /// A blob with three to six bays of random depth, some deep enough to be concave, or a horseshoe.
    fn blob(kind: u32) -> impl Fn(usize, usize) -> bool {
        let bays = f64::from(3 + kind % 4);
        let (depth, turn) = (0.15 + 0.35 * noise(kind), 6.0 * noise(kind + 1000));
        move |x, y| {
            let (x, y) = (x as f64 - 24.0, y as f64 - 24.0);
            let (radius, angle) = (libm::hypot(x, y), libm::atan2(y, x));
            if kind % 5 == 4 {
                return (9.0..20.0).contains(&radius) && (angle + turn - 3.0).abs() > 0.5;
            }
            radius < 14.0 * (1.0 + depth * libm::sin(bays * angle + turn))
        }
    }

    // T-RNG-04.
    #[test]
    fn no_triangle_turns_over() {
        let range = range(48, 48, |_, _| 1.0);
        for kind in 0..40 {
            let blob = region(&range, blob(kind));
            let patch = Patch::new(&blob, &range, 0).unwrap();
            let disk = Disk::new(patch.rows, patch.columns, &patch.inside).unwrap();
            let square = map_to_square(&disk, &Sides::new(&disk)).unwrap();
            for triangle in &disk.triangles {
                let [a, b, c] = triangle.map(|vertex| square[vertex as usize]);
                assert!(cross(a, b, c) > 0.0, "blob {kind}: {}", cross(a, b, c));
            }
        }
    }

    #[test]
    fn bays_and_holes_make_a_net_that_looks_at_the_sensor() {
        let range = range(48, 48, |x, y| 700.0 - 0.01 * (x * x + y * y));
        for kind in 0..20 {
            let shape = blob(kind);
            let holed = region(&range, |x, y| shape(x, y) && !(22..25).contains(&x));
            let whole = region(&range, shape);
            let net = net(&whole, &range, 0, 0);
            let at = |row: usize, column: usize| net.points()[row * net.columns() + column];
            let (row, column) = (net.rows() / 2, net.columns() / 2);
            let (down, right) =
                (at(row + 1, column) - at(row, column), at(row, column + 1) - at(row, column));
            assert!(down.cross(&right).z < 0.0);
            let chart = net.chart().unwrap();
            assert_eq!(&*chart.cells, whole.cells());
            // Two parts are refused, or one of them has no triangle.
            let _ = control_net(&holed, &range, NetMethod::Harmonic, 0, 0);
        }
    }

    #[test]
    fn spikes_go_with_the_cell_they_hang_on_and_parts_are_refused() {
        let range = range(16, 12, |_, _| 1.0);
        let spiked = region(&range, |x, y| (x < 6 && y < 5) || (y == 2 && x < 10));
        let net = net(&spiked, &range, 5, 9);
        let chart = net.chart().unwrap();
        let at = |x: usize| chart.coordinates[spiked.find(2 * 16 + x).unwrap()];
        assert_eq!(at(9), at(7));
        let refused =
            |region: &Region| control_net(region, &range, NetMethod::Harmonic, 0, 0).unwrap_err();
        assert_eq!(refused(&region(&range, |x, _| !(4..=9).contains(&x))), NetError::Parts);
        let line = NetError::DegenerateRegion { rows: 1, columns: 9 };
        assert_eq!(refused(&region(&range, |x, y| y == 4 && x < 9)), line);
    }
}
