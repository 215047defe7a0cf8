//! Smooths the depth of a range image where it is noise, not where it is an edge.

use maquette_node::{Cancelled, Carry, Context, Error, Fate, In, Node, Progress};
use maquette_value::RangeImage;
use maquette_value::parallel::*;
use nalgebra::Point3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::grid::grid_triangles::Rays;

/// Takes the noise out of a range image and keeps its edges, by a bilateral filter (Tomasi and Manduchi, 1998) on pairs of neighbors.
///
/// Each point moves along its line of sight only, so that it stays in its cell. Cells without a point stay without one.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct Denoise {
    /// The range image.
    pub range: In<RangeImage>,
    /// How it is smoothed.
    #[serde(flatten)]
    pub how: Denoising,
}

/// How a range image is smoothed.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Denoising {
    /// How far around a cell its neighbors count.
    #[schemars(range(min = 1, max = 16), extend("unit" = "cells"))]
    #[serde(default = "two")]
    pub radius: u32,
    /// Neighbors whose depth is off by more than this do not count. It should be five to ten times the noise: below, noise
    /// stays; above, details of this depth go.
    #[schemars(range(min = 0.0), extend("unit" = "mm"))]
    #[serde(default = "one_millimeter")]
    pub depth: f64,
    /// How many times it is smoothed.
    #[schemars(range(min = 1, max = 100))]
    #[serde(default = "once")]
    pub iterations: u32,
}

fn two() -> u32 {
    2
}

fn one_millimeter() -> f64 {
    1.0
}

fn once() -> u32 {
    1
}

impl Node for Denoise {
    type Outputs = (RangeImage,);
    const OUTPUTS: [&'static str; 1] = ["range"];

    const CARRIES: &'static [Carry] = &[Carry::cells("range", "range", Fate::Kept)];

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        Ok((denoise(cx.get(&self.range), self.how, cx.progress())?,))
    }
}

/// Smooths the depth of `range` and keeps edges of `how.depth` mm and more; everything else stays as it is.
///
/// The bilateral filter of Tomasi and Manduchi, "Bilateral filtering for gray and color images" (1998), eq. 5, with two
/// changes. It weighs *pairs* of opposite neighbors by how far their mean is from the cell, as in Harwood, Subbarao, Hakalahti
/// and Davis, "A new class of edge-preserving smoothing filters" (1987), so that a plane stays a plane however much it slants,
/// also at borders and holes. And the weight of a deviation is Tukey's biweight `(1 - (deviation / depth)^2)^2`, which ends at
/// `depth`: Durand and Dorsey, "Fast bilateral filtering for the display of high-dynamic-range images" (2002), table 1. What is
/// averaged is 1/z, which is linear in column and row on a plane seen by a pinhole; z itself where rays are parallel.
///
/// # Errors
/// If the evaluation was told to stop.
pub fn denoise(
    range: &RangeImage,
    how: Denoising,
    progress: &Progress<'_>,
) -> Result<RangeImage, Cancelled> {
    let rays = Rays::of(range);
    let before: Vec<f64> = range
        .points()
        .par_iter()
        .with_min_len(4096)
        .map(|point| match rays {
            // Points at or behind the sensor lie on no line of sight.
            Rays::FromOrigin if point.z > 0.0 => 1.0 / point.z,
            Rays::FromOrigin => f64::NAN,
            Rays::AlongZ => point.z,
        })
        .collect();
    let pairs = pairs(how.radius as isize);
    let mut heights = before.clone();
    for iteration in 0..how.iterations {
        progress.tick(f64::from(iteration) / f64::from(how.iterations))?;
        heights = smoothed(&heights, range.width(), rays, how.depth, &pairs);
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

/// A neighbor, whose opposite is the other one of a pair, and the pair's weight.
struct Pair {
    row: isize,
    column: isize,
    weight: f64,
}

/// The pairs within a circle; the weights are those of a Gaussian of half the radius.
fn pairs(radius: isize) -> Vec<Pair> {
    let mut pairs = Vec::new();
    for row in 0..=radius {
        for column in -radius..=radius {
            let distance_sq = row * row + column * column;
            // One of each two opposite neighbors, and not the cell itself.
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

/// One pass over a grid of this width.
fn smoothed(heights: &[f64], width: usize, rays: Rays, depth: f64, pairs: &[Pair]) -> Vec<f64> {
    if width == 0 {
        return Vec::new();
    }
    let rows = heights.len() / width;
    fn inside(row: isize, column: isize, rows: usize, width: usize) -> bool {
        (0..rows as isize).contains(&row) && (0..width as isize).contains(&column)
    }
    let one = |cell: usize| {
        let here = heights[cell];
        let [row, column] = [cell / width, cell % width].map(|place| place as isize);
        // Deviations in mm: that of z is -z^2 times that of 1/z.
        let scale = match rays {
            Rays::FromOrigin => 1.0 / (here * here * depth),
            Rays::AlongZ => 1.0 / depth,
        };
        let (mut sum, mut weights) = (0.0, 0.5);
        for pair in pairs {
            let [above, below] = [row - pair.row, row + pair.row];
            let [left, right] = [column - pair.column, column + pair.column];
            if !(inside(above, left, rows, width) && inside(below, right, rows, width)) {
                continue;
            }
            let step = pair.row * width as isize + pair.column;
            let opposite = [cell as isize - step, cell as isize + step];
            let [a, b] = opposite.map(|cell| heights[cell as usize]);
            let deviation = (a - here + (b - here)) / 2.0;
            let share = deviation * scale;
            // False for NaN: no pair with an invalid cell.
            if share.abs() < 1.0 {
                let bell = 1.0 - share * share;
                sum += pair.weight * bell * bell * deviation;
                weights += pair.weight * bell * bell;
            }
        }
        here + sum / weights
    };
    (0..heights.len()).into_par_iter().with_min_len(2048).map(one).collect()
}

#[cfg(test)]
mod tests {
    use maquette_value::Pinhole;

    use super::*;

    const CAMERA: Pinhole = Pinhole { focal: [1400.0; 2], center: [31.5, 23.5] };
    const WIDTH: usize = 64;

    /// What a camera sees at depths by column and row.
    fn seen(depth: impl Fn(f64, f64) -> f64) -> RangeImage {
        let points = (0..WIDTH * 48)
            .map(|cell: usize| {
                let pixel = [(cell % WIDTH) as f64, (cell / WIDTH) as f64];
                CAMERA.unproject(pixel, depth(pixel[0], pixel[1]))
            })
            .collect();
        RangeImage::new(WIDTH, 48, points).unwrap().with_camera(Some(CAMERA))
    }

    /// A number between -1 and 1 for each pixel that looks random, of variance 1/3.
    fn noise(column: f64, row: f64) -> f64 {
        let mut bits = (column as u64) << 32 | row as u64;
        for _ in 0..3 {
            bits = (bits ^ bits >> 29).wrapping_mul(0xbf58_476d_1ce4_e5b9).wrapping_add(0x9e37);
        }
        (bits >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }

    /// A plane that slants by some 50 degrees, with a step of some 5 mm down its middle.
    fn plane(column: f64) -> f64 {
        let slope = 700.0 / (1.0 + (column - 31.5) * 0.001);
        if column < 32.0 { slope } else { 1.0075 * slope }
    }

    fn rms(range: &RangeImage, truth: impl Fn(f64, f64) -> f64) -> f64 {
        let error = |cell: usize| {
            let error =
                range.points()[cell].z - truth((cell % WIDTH) as f64, (cell / WIDTH) as f64);
            error * error
        };
        let valid = (0..WIDTH * 48).filter(|&cell| range.point(cell).is_some());
        let (sum, count) = valid.fold((0.0, 0.0), |(sum, n), cell| (sum + error(cell), n + 1.0));
        f64::sqrt(sum / count)
    }

    fn run(range: &RangeImage, iterations: u32) -> RangeImage {
        let how = Denoising { radius: 2, depth: 1.0, iterations };
        denoise(range, how, &Progress::none()).unwrap()
    }

    #[test]
    fn slanted_planes_and_the_step_between_them_stay_as_they_are() {
        let clean = seen(|column, _| plane(column));
        assert!(rms(&run(&clean, 3), |column, _| plane(column)) < 1e-10);
    }

    #[test]
    fn noise_goes_and_the_step_stays() {
        let noisy = seen(|column, row| plane(column) + 0.15 * noise(column, row));
        let before = rms(&noisy, |column, _| plane(column));
        let after = rms(&run(&noisy, 1), |column, _| plane(column));
        let later = rms(&run(&noisy, 3), |column, _| plane(column));
        assert!((0.08..0.095).contains(&before), "{before}");
        assert!(after < before / 2.2 && later < before / 3.0, "{before} {after} {later}");
    }

    #[test]
    fn points_stay_on_their_rays_and_holes_stay_holes() {
        let noisy = seen(|column, row| {
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
    fn iterations_are_runs_and_a_depth_of_nothing_changes_nothing() {
        let noisy = seen(|column, row| 700.0 + noise(column, row));
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
        assert_eq!(denoise(&noisy, how, &Progress::none()).unwrap(), noisy);
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
