//! A net of the rows of a region, each divided evenly by arc length.
//!
//! The lines run along the rows or along the columns of the range grid, whichever have fewer gaps; the net's rows follow the range's rows
//! in both cases. A line extends from its first to its last cell of the region; the cells between belong to the net. The outermost points
//! of the net are fixed.

use maquette_node::Error;
use maquette_value as value;
use maquette_value::{RangeImage, Region};
use nalgebra::Point3;

use super::parameterized::{on_border, parameterize};

/// Minimum number of lines, and of points per line, if it is chosen automatically: enough for a cubic surface. Fewer would be an error for
/// surfaces of higher orders; more would only add interpolated points.
const MIN_LINES: usize = 4;

/// When a line is resampled, a sample closer to a point of the line than this fraction of the line's length becomes exactly that point. The
/// fraction is slightly larger than rounding errors.
const SAME: f64 = 1e-12;

/// Makes the net; `rows` and `columns` are automatic where they are 0. An automatic size is at least [`MIN_LINES`], even if the region has
/// fewer lines of cells.
pub(crate) fn net(
    region: &Region,
    range: &RangeImage,
    rows: usize,
    columns: usize,
) -> Result<value::ControlNet, Error> {
    let horizontal = Lines::new(region, range, false);
    let vertical = Lines::new(region, range, true);
    let (lines, [along, across]) = if vertical.gaps < horizontal.gaps {
        (vertical, [rows, columns])
    } else {
        (horizontal, [columns, rows])
    };
    let transposed = lines.transposed;
    let LineNet { points, across, along, mut chart } = lines.net(along, across);
    fn turn(pair: [usize; 2], transposed: bool) -> [usize; 2] {
        if transposed { [pair[1], pair[0]] } else { pair }
    }
    let [rows, columns] = turn([across, along], transposed);
    let points: Vec<Point3<f64>> = (0..rows * columns)
        .map(|at| turn([at / columns, at % columns], transposed))
        .map(|[line, k]| points[line * along + k])
        .collect();
    if transposed {
        chart.iter_mut().for_each(|(_, coordinate)| coordinate.reverse());
        chart.sort_by_key(|(cell, _)| *cell);
    }
    let size = [rows, columns];
    let (cells, coordinates) = chart.into_iter().unzip();
    parameterize(range, size, points, on_border(size), cells, coordinates)
}

/// The lines of cells of a region in one direction.
struct Lines {
    lines: Vec<Line>,
    /// Number of cells that are between the first and the last cell of a line but not in the region, over all lines.
    gaps: usize,
    /// True if the lines run along the grid's columns.
    transposed: bool,
}

struct Line {
    /// The cells of the region on the line: the index of each in the grid and its index in `points`.
    cells: Vec<(u32, usize)>,
    /// The points of the line's cells from the first to the last cell in the region; missing points are interpolated.
    points: Vec<Point3<f64>>,
    /// For each point of the line, the arc length from the line's start to the point, as a fraction of the line's length.
    shares: Vec<f64>,
}

/// A net, line by line.
struct LineNet {
    points: Vec<Point3<f64>>,
    /// Number of lines in the net.
    across: usize,
    /// Number of points of each line.
    along: usize,
    /// The cells of the region with their net coordinates (across, along).
    chart: Vec<(u32, [f64; 2])>,
}

impl Lines {
    fn new(region: &Region, range: &RangeImage, transposed: bool) -> Self {
        let width = range.width();
        let mut cells: Vec<[usize; 3]> = (region.cells().iter().enumerate())
            .map(|(index, &cell)| (index, [cell as usize / width, cell as usize % width]))
            .map(|(index, [row, column])| match transposed {
                false => [row, column, index],
                true => [column, row, index],
            })
            .collect();
        cells.sort_unstable();
        fn cell_at(line: usize, k: usize, width: usize, transposed: bool) -> usize {
            match transposed {
                false => line * width + k,
                true => k * width + line,
            }
        }
        let mut gaps = 0;
        let lines = cells.chunk_by(|a, b| a[0] == b[0]).map(|cells| {
            let (line, first, last) = (cells[0][0], cells[0][1], cells[cells.len() - 1][1]);
            gaps += last - first + 1 - cells.len();
            let mut points: Vec<Option<Point3<f64>>> =
                (first..=last).map(|k| range.point(cell_at(line, k, width, transposed))).collect();
            for &[_, k, index] in cells {
                points[k - first] = Some(region.points()[index]);
            }
            let points = bridge_gaps(&points);
            let own = cells.iter().map(|&[_, k, index]| (region.cells()[index], k - first));
            Line { cells: own.collect(), shares: shares(&points), points }
        });
        Self { lines: lines.collect(), gaps, transposed }
    }

    /// Makes the net of `across` lines of `along` points; both are automatic where they are 0.
    fn net(self, along: usize, across: usize) -> LineNet {
        let along = if along == 0 { self.median_length().max(MIN_LINES) } else { along };
        let lines: Vec<_> =
            self.lines.iter().map(|line| resample(&line.points, &line.shares, along)).collect();
        let wanted = if across == 0 { lines.len().max(MIN_LINES) } else { across };
        // If the net has as many lines as the region, the net's lines are those of the region. Evenly spaced lines would be at other
        // positions.
        let even = (wanted == lines.len()).then(|| vec![uniform_fractions(wanted); along]);
        let columns: Vec<_> = (0..along)
            .map(|k: usize| lines.iter().map(|line| line[k]).collect::<Vec<_>>())
            .collect();
        let across = even.unwrap_or_else(|| columns.iter().map(|points| shares(points)).collect());
        let columns: Vec<_> = (columns.iter().zip(&across))
            .map(|(points, shares)| resample(points, shares, wanted))
            .collect();
        let points = (0..wanted).flat_map(|line| columns.iter().map(move |column| column[line]));

        let mut chart = Vec::new();
        for (index, line) in self.lines.iter().enumerate() {
            for &(cell, k) in &line.cells {
                let b = line.shares[k] * (along - 1) as f64;
                let before = (b as usize).min(along - 2);
                let t = b - before as f64;
                let share = across[before][index] * (1.0 - t) + across[before + 1][index] * t;
                chart.push((cell, [share * (wanted - 1) as f64, b]));
            }
        }
        LineNet { points: points.collect(), across: wanted, along, chart }
    }

    /// Returns the median number of points of a line; the upper median if the number of lines is even.
    fn median_length(&self) -> usize {
        let mut lengths: Vec<usize> = self.lines.iter().map(|line| line.points.len()).collect();
        let middle = lengths.len() / 2;
        *lengths.select_nth_unstable(middle).1
    }
}

/// Interpolates missing points linearly between their neighbors on the line; the first and the last point exist.
fn bridge_gaps(points: &[Option<Point3<f64>>]) -> Vec<Point3<f64>> {
    let mut bridged: Vec<Point3<f64>> = Vec::with_capacity(points.len());
    for (k, point) in points.iter().enumerate() {
        let Some(point) = *point else { continue };
        if let Some(&before) = bridged.last() {
            let steps = k + 1 - bridged.len();
            bridged.extend(
                (1..steps).map(|step| before + (point - before) * (step as f64 / steps as f64)),
            );
        }
        bridged.push(point);
    }
    bridged
}

/// Returns, for each point of a line, the arc length from the line's start to the point, as a fraction of the total length. If the line has
/// no length, the fractions are evenly spaced.
pub(crate) fn shares(points: &[Point3<f64>]) -> Vec<f64> {
    let mut length = 0.0;
    let mut lengths = vec![0.0];
    for pair in points.windows(2) {
        length += (pair[1] - pair[0]).norm();
        lengths.push(length);
    }
    if length == 0.0 {
        return uniform_fractions(points.len());
    }
    lengths.iter().map(|along| along / length).collect()
}

/// Returns uniform fractions from 0 to 1; 0.5 for one point.
fn uniform_fractions(count: usize) -> Vec<f64> {
    match count {
        1 => vec![0.5],
        _ => (0..count).map(|k| k as f64 / (count - 1) as f64).collect(),
    }
}

/// Returns `count` (at least 2) evenly spaced points of the line through `points` at the fractions `shares`. The ends are exact.
pub(crate) fn resample(points: &[Point3<f64>], shares: &[f64], count: usize) -> Vec<Point3<f64>> {
    let last = points.len() - 1;
    if last == 0 {
        return vec![points[0]; count];
    }
    uniform_fractions(count)
        .into_iter()
        .map(|share: f64| {
            let after = shares.partition_point(|&at| at <= share).clamp(1, last);
            let [low, high] = [shares[after - 1], shares[after]];
            if share - low <= SAME {
                points[after - 1]
            } else if high - share <= SAME {
                points[after]
            } else {
                points[after - 1]
                    + (points[after] - points[after - 1]) * ((share - low) / (high - low))
            }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use maquette_node::Progress;

    use super::*;
    use crate::control_net::tests::{range, region};
    use crate::control_net::{NetMethod, control_net};

    fn net(region: &Region, range: &RangeImage, rows: usize, columns: usize) -> value::ControlNet {
        control_net(region, range, NetMethod::Rows, rows, columns, &Progress::silent()).unwrap()
    }

    // Tests the method `Rows`.
    #[test]
    fn a_planar_rectangle_is_its_own_net() {
        let range = range(20, 16, |x, y| 700.0 + 0.3 * x - 0.2 * y);
        for (width, height) in [(7, 5), (5, 7), (4, 11)] {
            let rectangle =
                region(&range, |x, y| (5..5 + width).contains(&x) && (3..3 + height).contains(&y));
            let net = net(&rectangle, &range, 0, 0);
            assert_eq!((net.rows(), net.columns()), (height, width));
            let coordinates = &net.chart().unwrap().coordinates;
            for (index, point) in net.points().iter().enumerate() {
                let (row, column) = (index / width, index % width);
                let border = row % (height - 1) == 0 || column % (width - 1) == 0;
                assert_eq!(net.fixed_points()[index] == 1, border);
                assert_eq!(*point, rectangle.points()[index], "bitwise");
                let [a, b] = coordinates[index];
                assert!((a - row as f64).abs() <= 1e-10 && (b - column as f64).abs() <= 1e-10);
            }
        }
    }

    #[test]
    fn a_net_of_another_size_keeps_the_corners_and_the_plane() {
        let range = range(20, 16, |x, y| 700.0 + 0.3 * x - 0.2 * y);
        let rectangle = region(&range, |x, y| (2..12).contains(&x) && (3..10).contains(&y));
        let net = net(&rectangle, &range, 4, 9);
        assert_eq!((net.rows(), net.columns()), (4, 9));
        assert_eq!(net.points()[0], rectangle.points()[0]);
        assert_eq!(net.points()[35], *rectangle.points().last().unwrap());
        let middle = net.points()[9 + 4];
        assert!((middle.x - 6.5).abs() <= 1e-12 && (middle.y - 5.0).abs() <= 1e-12);
        let [a, b] = net.chart().unwrap().coordinates[2 * 10 + 5];
        assert!((a - 1.0).abs() <= 1e-12 && (b - 5.0 * 8.0 / 9.0).abs() <= 1e-12);
    }

    #[test]
    fn lines_run_where_there_are_fewer_gaps() {
        // The region has two legs below a bar: rows have a gap, columns have none.
        let range = range(11, 9, |_, _| 1.0);
        let legs = region(&range, |x, y| x < 9 && y < 7 && (y < 2 || !(3..6).contains(&x)));
        let net = net(&legs, &range, 0, 0);
        assert_eq!((net.rows(), net.columns()), (7, 9));
        let chart = net.chart().unwrap();
        assert_eq!(&*chart.cells, legs.cells());
        fn chart_position(
            cell: usize,
            legs: &Region,
            chart_coordinates: &maquette_value::Column<[f64; 2]>,
        ) -> [f64; 2] {
            chart_coordinates[legs.find(cell).unwrap()]
        }
        assert_eq!(chart_position(0, &legs, &chart.coordinates), [0.0, 0.0]);
        // Between the legs, the bar is two cells high, so the lower of the two cells is the end of its line.
        assert_eq!(chart_position(11 + 4, &legs, &chart.coordinates), [6.0, 4.0]);
        assert_eq!(chart_position(6 * 11 + 8, &legs, &chart.coordinates), [6.0, 8.0]);
    }

    #[test]
    fn missing_points_of_a_line_are_interpolated() {
        let line = [Some(0.0), None, None, Some(3.0), Some(5.0)];
        let points = line.map(|x| x.map(|x| Point3::new(x, 0.0, 0.0)));
        let x: Vec<f64> = bridge_gaps(&points).iter().map(|point| point.x).collect();
        assert_eq!(x, [0.0, 1.0, 2.0, 3.0, 5.0]);
    }

    #[test]
    fn thin_regions_and_rows_of_one_cell_still_make_a_net() {
        let range = range(12, 9, |x, y| x * y);
        let strip = region(&range, |x, y| (1..11).contains(&x) && y == 4);
        assert_eq!(net(&strip, &range, 0, 0).rows(), MIN_LINES);
        let two = net(&region(&range, |x, y| y < 2 && x < 6), &range, 0, 0);
        assert_eq!((two.rows(), two.columns()), (MIN_LINES, 6));
        let triangle = region(&range, |x, y| x <= y);
        let tip = net(&triangle, &range, 0, 0);
        assert!(tip.points()[..tip.columns()].iter().all(|point| *point == range.points()[0]));
        assert_eq!(tip.chart().unwrap().coordinates[0][0], 0.0);
    }

    #[test]
    fn points_too_far_away_to_measure_are_an_error() {
        let range = range(6, 6, |x, _| if x > 3.0 { 1e300 } else { -1e300 });
        let all = region(&range, |_, _| true);
        assert!(control_net(&all, &range, NetMethod::Rows, 0, 7, &Progress::silent()).is_err());
    }
}
