//! Cells without a point that the scan surrounds: where a laser's light or its reflection was blocked, and dark or shiny spots.

use maquette_base::linear::cholesky::{Cholesky, Dissection, Links, Symmetric};
use maquette_image::{Connectivity, label};
use maquette_node::{Cancelled, Progress};
use maquette_value::Mask;
use maquette_value::parallel::*;
use nalgebra::Point3;

use crate::grid::grid_triangles::quad_triangles;

/// Cells of the largest shadow that is filled unless something else is asked for: what is larger is taken for a gap in the object.
pub const LARGEST_SHADOW: usize = 1000;

/// The shadows of a grid: the components of cells without a point, connected by sides, each with its cells in raster order. Components that
/// reach the border of the grid are background, not shadows.
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

/// The cells around each of `cells`, none of which is on the border of the grid, and the cells themselves.
pub fn around(width: usize, cells: &[u32]) -> impl Iterator<Item = usize> {
    cells.iter().flat_map(move |&cell| {
        let cell = cell as usize;
        [cell - width, cell, cell + width].into_iter().flat_map(|it| [it - 1, it, it + 1])
    })
}

/// Marks all triangles at `cells`, none of which is on the border of the grid, as parts of the surface.
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

/// Gives points to the shadows of a grid that `wanted` takes, unless an edge would be longer than `longest`: between an object and what
/// lies behind it is no surface. The cells that have points now, in raster order.
///
/// # Errors
/// If the evaluation is told to stop.
pub fn fill_shadows(
    width: usize,
    points: &mut [Point3<f64>],
    longest: f64,
    wanted: impl Fn(&[u32]) -> bool,
    progress: &Progress<'_>,
) -> Result<Vec<u32>, Cancelled> {
    let mut wanted: Vec<Vec<u32>> = shadows(width, points.len() / width.max(1), points)
        .into_iter()
        .filter(|it| wanted(it))
        .collect();
    fn sorted(shadows: &[Vec<u32>]) -> Vec<u32> {
        let mut cells = shadows.concat();
        cells.sort_unstable();
        cells
    }
    fill(width, &sorted(&wanted), points, progress)?;
    let fits: Vec<_> = wanted
        .iter()
        .map(|cells| {
            let edges = cells.iter().flat_map(|&cell| {
                let at = cell as usize;
                [at - width, at - 1, at + 1, at + width].map(|other| (cell, other))
            });
            // A part that nothing holds has no edges.
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
    Ok(sorted(&wanted))
}

/// How much more than bending stretching counts, at a wavelength of one cell: a wide shadow hangs like a skin between the edges that it
/// lies between, a small pit goes on as its surroundings bend. The two count the same over some seven cells.
const TENSION: f64 = 0.02;

/// Gives points to `cells`, which have none: a thin plate under tension through the points around them (Schweikert, "An interpolation
/// curve using a spline in tension", 1966, for surfaces), coordinate by coordinate.
///
/// # Errors
/// If the evaluation is told to stop.
fn fill(
    width: usize,
    cells: &[u32],
    points: &mut [Point3<f64>],
    progress: &Progress<'_>,
) -> Result<(), Cancelled> {
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
        .collect::<Result<Vec<_>, Cancelled>>()?;
    for (cell, point) in solved.into_iter().flatten() {
        points[cell as usize] = point;
    }
    Ok(())
}

/// A square of a weighted sum of cells' points that should be small.
struct Term {
    weight: f64,
    parts: Vec<(u32, f64)>,
}

/// A weight, and steps of columns and rows from a cell with their factors.
type Difference = (f64, &'static [([i64; 2], f64)]);

/// The differences of the second order, which bending is made of, and those of the first.
const DIFFERENCES: [Difference; 5] = [
    (1.0, &[([0, 0], 1.0), ([1, 0], -2.0), ([2, 0], 1.0)]),
    (1.0, &[([0, 0], 1.0), ([0, 1], -2.0), ([0, 2], 1.0)]),
    (2.0, &[([0, 0], 1.0), ([1, 0], -1.0), ([0, 1], -1.0), ([1, 1], 1.0)]),
    (TENSION, &[([0, 0], -1.0), ([1, 0], 1.0)]),
    (TENSION, &[([0, 0], -1.0), ([0, 1], 1.0)]),
];

/// Bending and stretching wherever `cells` have a share; other cells without a point have none.
fn terms(width: usize, cells: &[u32], points: &[Point3<f64>]) -> Vec<Term> {
    let height = points.len() / width;
    fn is_free(cell: u32, cells: &[u32]) -> bool {
        cells.binary_search(&cell).is_ok()
    }
    fn known(cell: u32, points: &[Point3<f64>], cells: &[u32]) -> bool {
        !points[cell as usize].x.is_nan() || is_free(cell, cells)
    }
    let mut terms = Vec::new();
    for &cell in cells {
        let at = [i64::from(cell) % width as i64, i64::from(cell) / width as i64];
        for (weight, steps) in DIFFERENCES {
            // Once for each place of the free cell in the difference, unless an earlier part is free: then that one has made it.
            for own in 0..steps.len() {
                let parts: Option<Vec<(u32, f64)>> = steps
                    .iter()
                    .map(|&(step, factor)| {
                        let [column, row] = [0, 1].map(|k| at[k] + step[k] - steps[own].0[k]);
                        let inside = (0..width as i64).contains(&column)
                            && (0..height as i64).contains(&row);
                        let cell = (row * width as i64 + column) as u32;
                        (inside && known(cell, points, cells)).then_some((cell, factor))
                    })
                    .collect();
                let Some(parts) = parts else { continue };
                if !parts[..own].iter().any(|&(cell, _)| is_free(cell, cells)) {
                    terms.push(Term { weight, parts });
                }
            }
        }
    }
    terms
}

/// Cells that no term connects, apart from each other, with the terms of each group.
fn groups(cells: &[u32], terms: &[Term]) -> Vec<(Vec<u32>, Vec<Term>)> {
    fn index(cell: u32, cells: &[u32]) -> Option<usize> {
        cells.binary_search(&cell).ok()
    }
    let mut leaders: Vec<usize> = (0..cells.len()).collect();
    fn leader(leaders: &mut [usize], mut of: usize) -> usize {
        while leaders[of] != of {
            leaders[of] = leaders[leaders[of]];
            of = leaders[of];
        }
        of
    }
    fn free(term: &Term, cells: &[u32]) -> Vec<usize> {
        term.parts.iter().filter_map(|&(cell, _)| index(cell, cells)).collect::<Vec<_>>()
    }
    for term in terms {
        let free = free(term, cells);
        for pair in free.windows(2) {
            let [a, b] = [pair[0], pair[1]].map(|of| leader(&mut leaders, of));
            leaders[a.max(b)] = a.min(b);
        }
    }
    let mut groups: Vec<(Vec<u32>, Vec<Term>)> = Vec::new();
    let mut places = vec![usize::MAX; cells.len()];
    for (at, &cell) in cells.iter().enumerate() {
        let leader = leader(&mut leaders, at);
        if leader == at {
            places[at] = groups.len();
            groups.push((Vec::new(), Vec::new()));
        }
        groups[places[leader]].0.push(cell);
    }
    for term in terms {
        let first = free(term, cells)[0];
        let group = places[leader(&mut leaders, first)];
        groups[group].1.push(Term { weight: term.weight, parts: term.parts.clone() });
    }
    groups
}

/// The points of `cells` at which the terms are least; none for cells that nothing holds.
fn solve(
    cells: &[u32],
    terms: &[Term],
    points: &[Point3<f64>],
    progress: &Progress<'_>,
) -> Result<Vec<(u32, Point3<f64>)>, Cancelled> {
    fn index(cell: u32, cells: &[u32]) -> Option<usize> {
        cells.binary_search(&cell).ok()
    }
    // Relative to a point of the rim: far from the origin, digits would be lost.
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
                let share = weight * factor * times;
                match index(other, cells) {
                    Some(column) => *rows[row].entry(column as u32).or_default() += share,
                    None => {
                        let point = points[other as usize] - origin;
                        (0..3).for_each(|axis| right[row][axis] -= share * point[axis]);
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
    let Some(factors) = Cholesky::ordered(&matrix, &Dissection::new(links, 1), progress)? else {
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

    fn drawn(rows: &[&str], point: impl Fn(f64, f64) -> Point3<f64>) -> Vec<Point3<f64>> {
        let width = rows[0].len();
        let cells = rows.iter().flat_map(|row| row.bytes()).enumerate();
        cells
            .map(|(cell, mark): (usize, u8)| match mark {
                b'#' => point((cell % width) as f64, (cell / width) as f64),
                _ => NONE,
            })
            .collect()
    }

    fn filled(rows: &[&str], point: impl Fn(f64, f64) -> Point3<f64>) -> Vec<Point3<f64>> {
        let mut points = drawn(rows, point);
        fill_shadows(rows[0].len(), &mut points, 1e3, |_| true, &Progress::none()).unwrap();
        points
    }

    #[test]
    fn what_the_scan_surrounds_is_a_shadow_and_the_background_is_none() {
        let rows = ["####.", "#.###", "#..#.", "#####", "##.##"];
        let points = drawn(&rows, |x, y| Point3::new(x, y, 1.0));
        assert_eq!(shadows(5, 5, &points), [[6, 11, 12]]);
    }

    #[test]
    fn a_plane_goes_on_as_itself() {
        let rows = ["#######", "#..#.##", "#...###", "####.##", "#######"];
        fn plane(x: f64, y: f64) -> Point3<f64> {
            Point3::new(0.5 * x + 1e6, 0.5 * y, 700.0 + 3.0 * x - y)
        }
        for (cell, point) in filled(&rows, plane).iter().enumerate() {
            assert!((point - plane((cell % 7) as f64, (cell / 7) as f64)).norm() < 1e-8, "{cell}");
        }
    }

    #[test]
    fn a_pit_in_a_ball_is_as_round_as_the_ball() {
        let rows: Vec<String> = (0..21)
            .map(|y| {
                let mark =
                    |x: i32| if (x - 10).pow(2) + (y - 10i32).pow(2) <= 9 { '.' } else { '#' };
                (0..21).map(mark).collect()
            })
            .collect();
        let rows: Vec<&str> = rows.iter().map(String::as_str).collect();
        fn ball(x: f64, y: f64) -> Point3<f64> {
            let [x, y] = [x - 10.0, y - 10.0];
            Point3::new(x, y, 520.0 - (400.0 - x * x - y * y).sqrt())
        }
        let points = filled(&rows, ball);
        fn off(cell: usize, points: &[Point3<f64>]) -> f64 {
            points[cell].z - ball((cell % 21) as f64, (cell / 21) as f64).z
        }
        let farthest = (0..21 * 21).map(|cell| off(cell, &points).abs()).fold(0.0, f64::max);
        // A flat lid would be off by 0.27, a membrane by 0.23.
        assert!(0.0 < farthest && farthest < 0.06, "{farthest}");
    }

    #[test]
    fn between_a_near_and_a_far_surface_nothing_is_nearer_or_farther() {
        let rows = ["##########", "##......##", "##......##", "##......##", "##########"];
        let points = filled(&rows, |x, y| Point3::new(x, y, if x < 4.5 { 500.0 } else { 540.0 }));
        assert!(points.iter().all(|point| (498.0..542.0).contains(&point.z)));
    }

    #[test]
    fn a_gap_to_what_is_behind_stays_open() {
        let rows = ["######", "#....#", "######", "##..##", "######"];
        let mut points = drawn(&rows, |x: f64, y: f64| {
            Point3::new(x, y, if y > 2.5 { 500.0 } else { 300.0 * x })
        });
        let filled = fill_shadows(6, &mut points, 100.0, |_| true, &Progress::none());
        assert_eq!(filled, Ok(vec![]));
        let mut points =
            drawn(&rows, |x, y| Point3::new(x, y, if y < 1.5 { 500.0 } else { 550.0 }));
        let filled = fill_shadows(6, &mut points, 20.0, |_| true, &Progress::none());
        assert_eq!(filled, Ok(vec![20, 21]));
        assert!(points[7].x.is_nan() && !points[20].x.is_nan());
    }

    #[test]
    fn cells_that_nothing_holds_stay_empty() {
        let mut points = vec![NONE; 9];
        fill(3, &[4], &mut points, &Progress::none()).unwrap();
        assert!(points[4].x.is_nan());
    }
}
