//! Smooths the depth of a range image, except at depth edges.

use maquette_node::{
    CancelledError, Carry, Context, Error, Forecast, In, Node, Progress, Sizes, Transfer,
};
use maquette_value::RangeImage;
use maquette_value::parallel::*;
use nalgebra::Point3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::grid::grid_triangles::Rays;

/// Removes noise from a range image and keeps its edges, by a bilateral filter (Tomasi and Manduchi, 1998) on pairs of neighbors.
///
/// Each point moves only along its line of sight, so it stays in its cell. Cells without a point stay empty.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct Denoise {
    /// Range image.
    pub range: In<RangeImage>,
    /// Parameters of the filter.
    #[serde(flatten)]
    pub how: Denoising,
}

/// Parameters of the filter.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Denoising {
    /// Radius of the neighborhood of a cell.
    #[schemars(range(min = 1, max = 16), extend("unit" = "cells"))]
    #[serde(default = "default_radius")]
    pub radius: u32,
    /// Maximum depth difference of neighbors that are averaged. It should be five to ten times the noise: smaller values keep noise, larger
    /// ones remove details of this depth.
    #[schemars(range(min = 0.0), extend("unit" = "mm"))]
    #[serde(default = "default_depth")]
    pub depth: f64,
    /// Number of times the filter is applied.
    #[schemars(range(min = 1, max = 100))]
    #[serde(default = "default_iterations")]
    pub iterations: u32,
}

fn default_radius() -> u32 {
    2
}

fn default_depth() -> f64 {
    1.0
}

fn default_iterations() -> u32 {
    1
}

impl Node for Denoise {
    type Outputs = (RangeImage,);
    const OUTPUTS: [&'static str; 1] = ["range"];

    const CARRIES: &'static [Carry] = &[Carry::cells("range", "range", Transfer::Kept)];

    fn forecast(&self, sizes: &Sizes<'_>) -> Option<Forecast> {
        Some(Forecast::by_law(sizes.get(&self.range)?))
    }

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        Ok((denoise(cx.get(&self.range), self.how, cx.progress())?,))
    }
}

/// Smooths the depth of `range`, but keeps depth edges of `how.depth` mm and more.
///
/// The bilateral filter of Tomasi and Manduchi, "Bilateral filtering for gray and color images" (1998), eq. 5, with two changes. First, the
/// filter weights *pairs* of opposite neighbors by the deviation of their mean from the cell: Harwood, Subbarao, Hakalahti and Davis, "A
/// new class of edge-preserving smoothing filters" (1987). So a plane stays a plane for any slope, also at borders and holes. Second, the
/// weight of a deviation is Tukey's biweight `(1 - (deviation / depth)^2)^2`, which is 0 for deviations of `depth` and more: Durand and
/// Dorsey, "Fast bilateral filtering for the display of high-dynamic-range images" (2002), table 1. For a pinhole camera the averaged
/// quantity is 1/z, which is linear in column and row on a plane; for parallel rays it is z.
///
/// Returns an error if the evaluation was cancelled.
pub fn denoise(
    range: &RangeImage,
    how: Denoising,
    progress: &Progress<'_>,
) -> Result<RangeImage, CancelledError> {
    let rays = Rays::new(range);
    let before: Vec<f64> = range
        .points()
        .par_iter()
        .with_min_len(4096)
        .map(|point| match rays {
            // No line of sight reaches points at or behind the sensor.
            Rays::FromOrigin if point.z > 0.0 => 1.0 / point.z,
            Rays::FromOrigin => f64::NAN,
            Rays::AlongZ => point.z,
        })
        .collect();
    let pairs = pairs(how.radius as isize);
    let mut heights = before.clone();
    for iteration in 0..how.iterations {
        progress.tick(f64::from(iteration) / f64::from(how.iterations))?;
        heights = smooth(&heights, range.width(), rays, how.depth, &pairs);
    }
    let points = range.points().par_iter().with_min_len(4096);
    let points = points
        .zip(before.par_iter().zip(&heights))
        .map(|(&point, (&old, &new)): (&Point3<f64>, (&f64, &f64))| {
            let moved = match rays {
                Rays::FromOrigin => point * (old / new),
                Rays::AlongZ => Point3::new(point.x, point.y, new),
            };
            if moved.coords.iter().all(|x| x.is_finite()) { moved } else { point }
        })
        .collect();
    Ok(range.with_points(points).expect("as many points as before"))
}

/// One of two opposite neighbors of a cell, as offset from the cell, and the weight of the pair. The other one has the opposite offset.
struct Pair {
    row: isize,
    column: isize,
    weight: f64,
}

/// Returns the pairs of neighbors within a circle around a cell. Their weights are those of a Gaussian whose standard deviation is half the
/// radius.
fn pairs(radius: isize) -> Vec<Pair> {
    let mut pairs = Vec::new();
    for row in 0..=radius {
        for column in -radius..=radius {
            let distance_sq = row * row + column * column;
            // List only one of two opposite neighbors, and not the cell itself.
            let is_first = 0 < row || 0 < column;
            if is_first && distance_sq <= radius * radius {
                let sigma = radius as f64 / 2.0;
                let weight = libm::exp(-(distance_sq as f64) / (2.0 * sigma * sigma));
                pairs.push(Pair { row, column, weight });
            }
        }
    }
    pairs
}

/// Applies the filter once to a grid with `width` columns. `heights` are the averaged quantities: 1/z or z, depending on `rays`.
fn smooth(heights: &[f64], width: usize, rays: Rays, depth: f64, pairs: &[Pair]) -> Vec<f64> {
    if width == 0 {
        return Vec::new();
    }
    let rows = heights.len() / width;
    fn is_inside(row: isize, column: isize, rows: usize, width: usize) -> bool {
        (0..rows as isize).contains(&row) && (0..width as isize).contains(&column)
    }
    let cells = (0..heights.len()).into_par_iter().with_min_len(2048);
    let smoothed = cells.map(|cell: usize| {
        let here = heights[cell];
        let [row, column] = [cell / width, cell % width].map(|index| index as isize);
        // Convert deviations to mm: a small deviation of z is -z^2 times that of 1/z.
        let scale = match rays {
            Rays::FromOrigin => 1.0 / (here * here * depth),
            Rays::AlongZ => 1.0 / depth,
        };
        let (mut sum, mut weights) = (0.0, 0.5);
        for pair in pairs {
            let [above, below] = [row - pair.row, row + pair.row];
            let [left, right] = [column - pair.column, column + pair.column];
            if !(is_inside(above, left, rows, width) && is_inside(below, right, rows, width)) {
                continue;
            }
            let step = pair.row * width as isize + pair.column;
            let opposite = [cell as isize - step, cell as isize + step];
            let [a, b] = opposite.map(|cell| heights[cell as usize]);
            let deviation = (a - here + (b - here)) / 2.0;
            let relative = deviation * scale;
            // The comparison is false for NaN, so pairs with an invalid cell are skipped.
            if relative.abs() < 1.0 {
                let bell = 1.0 - relative * relative;
                sum += pair.weight * bell * bell * deviation;
                weights += pair.weight * bell * bell;
            }
        }
        here + sum / weights
    });
    smoothed.collect()
}

#[cfg(test)]
mod tests {
    use maquette_value::Pinhole;

    use super::*;

    const CAMERA: Pinhole = Pinhole { focal: [1400.0; 2], center: [31.5, 23.5] };
    const WIDTH: usize = 64;

    /// Returns a range image with the depths `depth(column, row)`.
    fn capture(depth: impl Fn(f64, f64) -> f64) -> RangeImage {
        let points = (0..WIDTH * 48)
            .map(|cell: usize| {
                let pixel = [(cell % WIDTH) as f64, (cell / WIDTH) as f64];
                CAMERA.unproject(pixel, depth(pixel[0], pixel[1]))
            })
            .collect();
        RangeImage::new(WIDTH, 48, points).unwrap().with_camera(Some(CAMERA))
    }

    /// Returns a pseudorandom number from -1 to 1 for each pixel; the variance is 1/3.
    fn noise(column: f64, row: f64) -> f64 {
        let mut bits = (column as u64) << 32 | row as u64;
        for _ in 0..3 {
            bits = (bits ^ bits >> 29).wrapping_mul(0xbf58_476d_1ce4_e5b9).wrapping_add(0x9e37);
        }
        (bits >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }

    /// Returns the depth of a plane inclined by about 50 degrees, with a step of about 5 mm at the center.
    fn plane(column: f64) -> f64 {
        let slope = 700.0 / (1.0 + (column - 31.5) * 0.001);
        if column < 32.0 { slope } else { 1.0075 * slope }
    }

    fn rms(range: &RangeImage, truth: impl Fn(f64, f64) -> f64) -> f64 {
        let (mut sum, mut count) = (0.0, 0.0);
        for cell in (0..WIDTH * 48).filter(|&cell| range.point(cell).is_some()) {
            let error =
                range.points()[cell].z - truth((cell % WIDTH) as f64, (cell / WIDTH) as f64);
            sum += error * error;
            count += 1.0;
        }
        f64::sqrt(sum / count)
    }

    fn run(range: &RangeImage, iterations: u32) -> RangeImage {
        let how = Denoising { radius: 2, depth: 1.0, iterations };
        denoise(range, how, &Progress::silent()).unwrap()
    }

    #[test]
    fn inclined_planes_and_the_step_between_them_are_unchanged() {
        let clean = capture(|column, _| plane(column));
        assert!(rms(&run(&clean, 3), |column, _| plane(column)) < 1e-10);
    }

    #[test]
    fn noise_is_removed_and_the_step_is_kept() {
        let noisy = capture(|column, row| plane(column) + 0.15 * noise(column, row));
        let before = rms(&noisy, |column, _| plane(column));
        let after = rms(&run(&noisy, 1), |column, _| plane(column));
        let later = rms(&run(&noisy, 3), |column, _| plane(column));
        assert!((0.08..0.095).contains(&before), "{before}");
        assert!(after < before / 2.2 && later < before / 3.0, "{before} {after} {later}");
    }

    #[test]
    fn points_stay_on_their_rays_and_holes_stay_holes() {
        let noisy = capture(|column, row| {
            let hole = (column * 7.0 + row * 3.0) % 11.0 == 0.0;
            if hole { f64::NAN } else { 700.0 + noise(column, row) }
        });
        let smooth = run(&noisy, 2);
        assert_eq!(smooth.n_valid(), noisy.n_valid());
        for cell in (0..WIDTH * 48).filter(|&cell| smooth.point(cell).is_some()) {
            let [column, row] = CAMERA.project(smooth.points()[cell]);
            assert!((column - (cell % WIDTH) as f64).abs() < 1e-9);
            assert!((row - (cell / WIDTH) as f64).abs() < 1e-9);
            assert!(noisy.point(cell).is_some());
        }
    }

    #[test]
    fn iterations_equal_repeated_runs_and_depth_0_changes_nothing() {
        let noisy = capture(|column, row| 700.0 + noise(column, row));
        let twice = run(&run(&noisy, 1), 1);
        let both = run(&noisy, 2);
        let farthest = both
            .points()
            .iter()
            .zip(twice.points())
            .map(|(a, b): (&Point3<f64>, &Point3<f64>)| (a - b).norm())
            .fold(0.0, f64::max);
        assert!(farthest < 1e-9);
        let how = Denoising { radius: 2, depth: 0.0, iterations: 1 };
        assert_eq!(denoise(&noisy, how, &Progress::silent()).unwrap(), noisy);
    }

    #[test]
    fn grids_of_a_sensor_far_away_are_smoothed_along_z() {
        let points = (0..25).map(|k| Point3::new(f64::from(k % 5), f64::from(k / 5), -1.0));
        let mut points: Vec<_> = points.collect();
        points[12].z = -0.7;
        let smooth = run(&RangeImage::new(5, 5, points).unwrap(), 1);
        let middle = smooth.points()[12];
        assert_eq!((middle.x, middle.y), (2.0, 2.0));
        assert!(-1.0 < middle.z && middle.z < -0.9, "{middle}");
    }
}
