//! Shadows: cells without a point that the scan surrounds. They appear where a laser's light or its reflection was blocked, and at dark or
//! shiny spots of the object.

use maquette_base::linear::cholesky::{Cholesky, Dissection, Links, Symmetric};
use maquette_image::{Connectivity, label};
use maquette_node::{CancelledError, Progress};
use maquette_value::Mask;
use maquette_value::parallel::*;
use nalgebra::Point3;

use crate::grid::grid_triangles::quad_triangles;

/// The default maximum number of cells of a shadow (cells without a point) that is filled. Larger ones count as gaps in the object.
pub const MAX_SHADOW_CELLS: usize = 1000;

/// Returns the shadows of a grid: the components of cells without a point, connected by sides, each with its cells in raster order.
/// Components that reach the border of the grid are background and not returned.
pub(crate) fn shadows(width: usize, height: usize, points: &[Point3<f64>]) -> Vec<Vec<u32>> {
    let empty = points.iter().map(|point| u8::from(point.x.is_nan())).collect();
    let parts = label(&Mask::new(width, height, empty).expect("a cell each"), Connectivity::Four);
    let mut shadows = vec![Vec::new(); parts.statistics().len()];
    for (cell, &part) in (0..).zip(parts.pixels()).filter(|(_, part)| **part != 0) {
        let part = part as usize - 1;
        if !parts.statistics()[part].touches_border {
            shadows[part].push(cell);
        }
    }
    shadows.retain(|shadow| !shadow.is_empty());
    shadows
}

/// Returns the cells of the 3 x 3 square around each of `cells`, none of which may be on the border of the grid.
pub fn neighborhood(width: usize, cells: &[u32]) -> impl Iterator<Item = usize> {
    cells.iter().flat_map(move |&cell| {
        let cell = cell as usize;
        [cell - width, cell, cell + width].into_iter().flat_map(|it| [it - 1, it, it + 1])
    })
}

/// Marks in `joined` all triangles at `cells` as parts of the surface. None of the cells may be on the border of the grid.
pub(crate) fn join_around(width: usize, cells: &[u32], points: &[Point3<f64>], joined: &mut [u8]) {
    for &cell in cells {
        let cell = cell as usize;
        for quad in [cell - width - 1, cell - width, cell - 1, cell] {
            for triangle in quad_triangles(width, points, quad, joined[quad]) {
                if triangle.cells(width).contains(&cell) {
                    joined[quad] |= triangle.half.bit();
                }
            }
        }
    }
}

/// Fills those shadows of a grid (cells without a point, surrounded by the scan) that `wanted` accepts. A shadow stays open if filling it
/// needs an edge longer than `longest`, because an object and its background are not one surface. Returns the filled cells in raster order.
///
/// Returns an error if the evaluation is cancelled.
pub fn fill_shadows(
    width: usize,
    points: &mut [Point3<f64>],
    longest: f64,
    wanted: impl Fn(&[u32]) -> bool,
    progress: &Progress<'_>,
) -> Result<Vec<u32>, CancelledError> {
    let mut wanted: Vec<Vec<u32>> = shadows(width, points.len() / width.max(1), points)
        .into_iter()
        .filter(|it| wanted(it))
        .collect();
    fn sorted_cells(shadows: &[Vec<u32>]) -> Vec<u32> {
        let mut cells = shadows.concat();
        cells.sort_unstable();
        cells
    }
    fill(width, &sorted_cells(&wanted), points, progress)?;
    let fits: Vec<_> = wanted
        .iter()
        .map(|cells| {
            let edges = cells.iter().flat_map(|&cell| {
                let at = cell as usize;
                [at - width, at - 1, at + 1, at + width].map(|other| (cell, other))
            });
            // If no points surround a shadow, its points are still NaN. Then the comparison is false, and the shadow stays open.
            edges
                .map(|(cell, other): (u32, usize)| (points[cell as usize] - points[other]).norm())
                .all(|edge| edge <= longest)
        })
        .collect();
    for cells in wanted.iter().zip(&fits).filter(|(_, fits)| !**fits).map(|(cells, _)| cells) {
        cells.iter().for_each(|&cell| points[cell as usize] = Point3::from([f64::NAN; 3]));
    }
    let mut fits = fits.into_iter();
    wanted.retain(|_| fits.next() == Some(true));
    Ok(sorted_cells(&wanted))
}

/// The weight of stretching relative to bending, at a wavelength of one cell. With 0.02, both count equally at about seven cells. So a wide
/// shadow becomes a membrane between its edges, and a small pit continues the curvature around it.
const TENSION: f64 = 0.02;

/// Computes points for `cells`, coordinate by coordinate, as a thin plate under tension through the points around them: Schweikert, "An
/// interpolation curve using a spline in tension" (1966), extended to surfaces.
///
/// Returns an error if the evaluation is cancelled.
fn fill(
    width: usize,
    cells: &[u32],
    points: &mut [Point3<f64>],
    progress: &Progress<'_>,
) -> Result<(), CancelledError> {
    if cells.is_empty() {
        return Ok(());
    }
    let terms = terms(width, cells, points);
    let groups = groups(cells, &terms);
    let solved = groups
        .par_iter()
        .map(|(cells, terms)| {
            progress.check()?;
            solve(cells, terms, points, progress)
        })
        .collect::<Result<Vec<_>, CancelledError>>()?;
    for (cell, point) in solved.into_iter().flatten() {
        points[cell as usize] = point;
    }
    Ok(())
}

/// A term of the minimized energy: `weight` times the square of a weighted sum of the points of cells.
struct Term {
    weight: f64,
    parts: Vec<(u32, f64)>,
}

/// A finite difference: its weight, and the cells that it combines. Each cell is given by its offset in columns and rows, and a
/// coefficient.
type Difference = (f64, &'static [([i64; 2], f64)]);

/// The second differences, which measure bending, and the first differences, which measure stretching.
const DIFFERENCES: [Difference; 5] = [
    (1.0, &[([0, 0], 1.0), ([1, 0], -2.0), ([2, 0], 1.0)]),
    (1.0, &[([0, 0], 1.0), ([0, 1], -2.0), ([0, 2], 1.0)]),
    (2.0, &[([0, 0], 1.0), ([1, 0], -1.0), ([0, 1], -1.0), ([1, 1], 1.0)]),
    (TENSION, &[([0, 0], -1.0), ([1, 0], 1.0)]),
    (TENSION, &[([0, 0], -1.0), ([0, 1], 1.0)]),
];

/// Returns the terms of bending and stretching that involve `cells`. A term is left out if it involves a cell that has no point and is not
/// in `cells`.
fn terms(width: usize, cells: &[u32], points: &[Point3<f64>]) -> Vec<Term> {
    let height = points.len() / width;
    fn is_free(cell: u32, cells: &[u32]) -> bool {
        cells.binary_search(&cell).is_ok()
    }
    fn has_point(cell: u32, points: &[Point3<f64>], cells: &[u32]) -> bool {
        !points[cell as usize].x.is_nan() || is_free(cell, cells)
    }
    let mut terms = Vec::new();
    for &cell in cells {
        let at = [i64::from(cell) % width as i64, i64::from(cell) / width as i64];
        for (weight, steps) in DIFFERENCES {
            // Create a term for each position that the free cell (one of `cells`) can have in the difference. Skip the term if an earlier
            // cell of the difference is free, because that cell has created it.
            for own_step in 0..steps.len() {
                let parts: Option<Vec<(u32, f64)>> = steps
                    .iter()
                    .map(|&(step, factor)| {
                        let [column, row] = [0, 1].map(|k| at[k] + step[k] - steps[own_step].0[k]);
                        let inside = (0..width as i64).contains(&column)
                            && (0..height as i64).contains(&row);
                        let cell = (row * width as i64 + column) as u32;
                        (inside && has_point(cell, points, cells)).then_some((cell, factor))
                    })
                    .collect();
                let Some(parts) = parts else { continue };
                if !parts[..own_step].iter().any(|&(cell, _)| is_free(cell, cells)) {
                    terms.push(Term { weight, parts });
                }
            }
        }
    }
    terms
}

/// Divides the cells into groups that no term connects, and returns each group with its terms.
fn groups(cells: &[u32], terms: &[Term]) -> Vec<(Vec<u32>, Vec<Term>)> {
    fn index(cell: u32, cells: &[u32]) -> Option<usize> {
        cells.binary_search(&cell).ok()
    }
    let mut leaders: Vec<usize> = (0..cells.len()).collect();
    fn leader(leaders: &mut [usize], mut index: usize) -> usize {
        while leaders[index] != index {
            leaders[index] = leaders[leaders[index]];
            index = leaders[index];
        }
        index
    }
    fn free(term: &Term, cells: &[u32]) -> Vec<usize> {
        term.parts.iter().filter_map(|&(cell, _)| index(cell, cells)).collect::<Vec<_>>()
    }
    for term in terms {
        let free = free(term, cells);
        for pair in free.windows(2) {
            let [a, b] = [pair[0], pair[1]].map(|index| leader(&mut leaders, index));
            leaders[a.max(b)] = a.min(b);
        }
    }
    let mut groups: Vec<(Vec<u32>, Vec<Term>)> = Vec::new();
    let mut group_indices = vec![usize::MAX; cells.len()];
    for (at, &cell) in cells.iter().enumerate() {
        let leader = leader(&mut leaders, at);
        if leader == at {
            group_indices[at] = groups.len();
            groups.push((Vec::new(), Vec::new()));
        }
        groups[group_indices[leader]].0.push(cell);
    }
    for term in terms {
        let first = free(term, cells)[0];
        let group = group_indices[leader(&mut leaders, first)];
        groups[group].1.push(Term { weight: term.weight, parts: term.parts.clone() });
    }
    groups
}

/// Returns the points of `cells` that minimize the terms; an empty list if no points surround the cells or the equations have no solution.
fn solve(
    cells: &[u32],
    terms: &[Term],
    points: &[Point3<f64>],
    progress: &Progress<'_>,
) -> Result<Vec<(u32, Point3<f64>)>, CancelledError> {
    fn index(cell: u32, cells: &[u32]) -> Option<usize> {
        cells.binary_search(&cell).ok()
    }
    // Make coordinates relative to a point next to the shadow; otherwise precision would be lost far from the origin.
    let rim =
        terms.iter().flat_map(|term| &term.parts).find(|(cell, _)| index(*cell, cells).is_none());
    let Some(&(origin, _)) = rim else { return Ok(Vec::new()) };
    let origin = points[origin as usize];
    let mut rows = vec![std::collections::BTreeMap::<u32, f64>::new(); cells.len()];
    let mut right = vec![[0.0; 3]; cells.len()];
    for Term { weight, parts } in terms {
        for &(cell, factor) in parts {
            let Some(row) = index(cell, cells) else { continue };
            for &(other, times) in parts {
                let entry = weight * factor * times;
                match index(other, cells) {
                    Some(column) => *rows[row].entry(column as u32).or_default() += entry,
                    None => {
                        let point = points[other as usize] - origin;
                        (0..3).for_each(|axis| right[row][axis] -= entry * point[axis]);
                    }
                }
            }
        }
    }
    let mut matrix = Symmetric { starts: vec![0], indices: Vec::new(), entries: Vec::new() };
    for row in rows {
        matrix.indices.extend(row.keys());
        matrix.entries.extend(row.values());
        matrix.starts.push(matrix.indices.len() as u32);
    }
    let links = Links { starts: &matrix.starts, neighbors: &matrix.indices };
    let Some(factors) = Cholesky::with_ordering(&matrix, &Dissection::new(links, 1), progress)?
    else {
        return Ok(Vec::new());
    };
    factors.solve(&mut right);
    Ok(cells
        .iter()
        .zip(right)
        .map(|(&cell, x): (&u32, [f64; 3])| (cell, origin + nalgebra::Vector3::from(x)))
        .collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    const NONE: Point3<f64> = Point3::new(f64::NAN, f64::NAN, f64::NAN);

    fn points_from_drawing(
        rows: &[&str],
        point: impl Fn(f64, f64) -> Point3<f64>,
    ) -> Vec<Point3<f64>> {
        let width = rows[0].len();
        let cells = rows.iter().flat_map(|row| row.bytes()).enumerate();
        cells
            .map(|(cell, mark): (usize, u8)| match mark {
                b'#' => point((cell % width) as f64, (cell / width) as f64),
                _ => NONE,
            })
            .collect()
    }

    fn fill_drawing(rows: &[&str], point: impl Fn(f64, f64) -> Point3<f64>) -> Vec<Point3<f64>> {
        let mut points = points_from_drawing(rows, point);
        fill_shadows(rows[0].len(), &mut points, 1e3, |_| true, &Progress::silent()).unwrap();
        points
    }

    #[test]
    fn cells_that_the_scan_surrounds_are_shadows_and_the_background_is_not() {
        let rows = ["####.", "#.###", "#..#.", "#####", "##.##"];
        let points = points_from_drawing(&rows, |x, y| Point3::new(x, y, 1.0));
        assert_eq!(shadows(5, 5, &points), [[6, 11, 12]]);
    }

    #[test]
    fn a_plane_is_continued() {
        let rows = ["#######", "#..#.##", "#...###", "####.##", "#######"];
        fn plane(x: f64, y: f64) -> Point3<f64> {
            Point3::new(0.5 * x + 1e6, 0.5 * y, 700.0 + 3.0 * x - y)
        }
        for (cell, point) in fill_drawing(&rows, plane).iter().enumerate() {
            assert!((point - plane((cell % 7) as f64, (cell / 7) as f64)).norm() < 1e-8, "{cell}");
        }
    }

    #[test]
    fn a_pit_in_a_ball_is_as_round_as_the_ball() {
        let rows: Vec<String> = (0..21)
            .map(|y| {
                (0..21)
                    .map(|x: i32| if (x - 10).pow(2) + (y - 10i32).pow(2) <= 9 { '.' } else { '#' })
                    .collect()
            })
            .collect();
        let rows: Vec<&str> = rows.iter().map(String::as_str).collect();
        fn ball(x: f64, y: f64) -> Point3<f64> {
            let [x, y] = [x - 10.0, y - 10.0];
            Point3::new(x, y, 520.0 - (400.0 - x * x - y * y).sqrt())
        }
        let points = fill_drawing(&rows, ball);
        fn depth_error(cell: usize, points: &[Point3<f64>]) -> f64 {
            points[cell].z - ball((cell % 21) as f64, (cell / 21) as f64).z
        }
        let farthest =
            (0..21 * 21).map(|cell| depth_error(cell, &points).abs()).fold(0.0, f64::max);
        // A flat fill would deviate by 0.27 and a membrane by 0.23.
        assert!(0.0 < farthest && farthest < 0.06, "{farthest}");
    }

    #[test]
    fn points_between_two_surfaces_do_not_overshoot() {
        let rows = ["##########", "##......##", "##......##", "##......##", "##########"];
        let points =
            fill_drawing(&rows, |x, y| Point3::new(x, y, if x < 4.5 { 500.0 } else { 540.0 }));
        assert!(points.iter().all(|point| (498.0..542.0).contains(&point.z)));
    }

    #[test]
    fn a_gap_to_the_background_stays_open() {
        let rows = ["######", "#....#", "######", "##..##", "######"];
        let mut points = points_from_drawing(&rows, |x: f64, y: f64| {
            Point3::new(x, y, if y > 2.5 { 500.0 } else { 300.0 * x })
        });
        let filled = fill_shadows(6, &mut points, 100.0, |_| true, &Progress::silent());
        assert_eq!(filled, Ok(vec![]));
        let mut points = points_from_drawing(&rows, |x, y| {
            Point3::new(x, y, if y < 1.5 { 500.0 } else { 550.0 })
        });
        let filled = fill_shadows(6, &mut points, 20.0, |_| true, &Progress::silent());
        assert_eq!(filled, Ok(vec![20, 21]));
        assert!(points[7].x.is_nan() && !points[20].x.is_nan());
    }

    #[test]
    fn cells_without_surrounding_points_stay_empty() {
        let mut points = vec![NONE; 9];
        fill(3, &[4], &mut points, &Progress::silent()).unwrap();
        assert!(points[4].x.is_nan());
    }
}
