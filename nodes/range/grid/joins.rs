//! Which neighboring cells of a range image lie on one surface.
//!
//! The tests are guesses from distance and slope, and a redesign makes both large on purpose. So `Blend` and `FillRange` mark the triangles
//! of their surfaces in the range image (`RangeImage::joined`), and `Triangulate` never cuts these. There is one bit for each triangle, not
//! for each cell: an ear and a hood are surfaces, and the triangles between them are not.

use maquette_value::RangeImage;
use maquette_value::parallel::*;
use nalgebra::Point3;

use super::grid_triangles::{Rays, double_area};

/// Longest edge on one surface, in multiples of the grid's median spacing, unless something else is asked for.
pub const JUMP: f64 = 6.0;

/// Largest angle between a surface's normal and the line of sight in degrees, unless something else is asked for.
pub const GRAZING: f64 = 85.0;

/// Tells triangles on a surface from those that bridge a step in depth.
pub struct Joins {
    spacing_sq: f64,
    longest_sq: f64,
    least_cosine: f64,
    rays: Rays,
}

/// The longest edge of a surface: so many times the median distance of valid cells that share a side.
pub fn longest_edge(range: &RangeImage, jump: f64) -> f64 {
    jump * median_spacing_sq(range).sqrt()
}

impl Joins {
    /// For triangles with edges up to `jump` times the median distance of valid cells that share a side, whose normals make angles
    /// up to `grazing` degrees with the line of sight.
    pub fn new(range: &RangeImage, jump: f64, grazing: f64) -> Self {
        let own = Self {
            spacing_sq: median_spacing_sq(range),
            longest_sq: 0.0,
            least_cosine: 0.0,
            rays: Rays::of(range),
        };
        own.allowing(jump, grazing)
    }

    /// The same grid judged by other bounds.
    pub fn allowing(&self, jump: f64, grazing: f64) -> Self {
        Self {
            longest_sq: jump * jump * self.spacing_sq,
            least_cosine: libm::cos(grazing.to_radians()),
            ..*self
        }
    }

    /// Whether the triangle between these cells is part of a surface, on whichever side it is seen.
    pub fn holds(&self, corners: [Point3<f64>; 3]) -> bool {
        let [a, b, c] = corners;
        let (ray, normal) = (self.rays.at(middle(corners)), double_area(corners));
        [b - a, c - b, a - c].iter().all(|edge| edge.norm_squared() <= self.longest_sq)
            && normal.dot(&ray).abs() >= self.least_cosine * normal.norm() * ray.norm()
    }

    /// Whether a triangle's back is towards the sensor.
    pub fn looks_away(&self, corners: [Point3<f64>; 3]) -> bool {
        double_area(corners).dot(&self.rays.at(middle(corners))) > 0.0
    }
}

fn middle([a, b, c]: [Point3<f64>; 3]) -> Point3<f64> {
    Point3::from((a.coords + b.coords + c.coords) / 3.0)
}

/// The squared median distance of valid cells that share a side, of an even number the upper of the middle two; 0 if no two do.
///
/// In two passes over the grid, because a list of all distances would be twice as large as the grid itself: the first counts
/// them by their leading bits, whose order is that of the numbers; the second collects those that share the median's.
fn median_spacing_sq(range: &RangeImage) -> f64 {
    let of_parts = rows_of(range).fold_parts(
        || vec![0_u32; 1 << 16],
        |mut counts, row| {
            each_spacing_sq(range, row, |spacing| counts[bucket(spacing)] += 1);
            counts
        },
    );
    let buckets = of_parts.into_iter().reduce(|mut counts, others| {
        counts.iter_mut().zip(others).for_each(|(count, other)| *count += other);
        counts
    });
    let buckets = buckets.unwrap_or_default();
    let middle = buckets.iter().map(|&count| count as usize).sum::<usize>() / 2;
    let mut before = 0;
    let found = buckets.iter().position(|&count| {
        before += count as usize;
        middle < before
    });
    let Some(found) = found else { return 0.0 };
    let candidates = rows_of(range).fold_parts(Vec::new, |mut kept, row| {
        each_spacing_sq(range, row, |spacing| {
            if bucket(spacing) == found {
                kept.push(spacing);
            }
        });
        kept
    });
    let mut candidates = candidates.concat();
    let place = middle - (before - buckets[found] as usize);
    *candidates.select_nth_unstable_by(place, f64::total_cmp).1
}

/// Sign, exponent and the first four bits behind the point of a number from 0 on.
fn bucket(spacing: f64) -> usize {
    (spacing.to_bits() >> 48) as usize
}

fn rows_of(range: &RangeImage) -> impl Parallel<Item = usize> {
    (0..range.height()).into_par_iter().with_min_len(64)
}

/// The squared distances of the valid cells of a row to those on their right and above them.
fn each_spacing_sq(range: &RangeImage, row: usize, mut each: impl FnMut(f64)) {
    let (width, points) = (range.width(), range.points());
    let cells = &points[row * width..][..width];
    let mut valid = |spacing: f64| {
        if !spacing.is_nan() {
            each(spacing);
        }
    };
    cells.windows(2).for_each(|pair| valid((pair[1] - pair[0]).norm_squared()));
    if row > 0 {
        let above = &points[(row - 1) * width..];
        cells.iter().zip(above).for_each(|(a, b)| valid((b - a).norm_squared()));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_median_spacing_is_the_upper_of_the_middle_two() {
        fn spaced(depths: &[f64]) -> f64 {
            let points =
                depths.iter().enumerate().map(|(k, &z)| Point3::new(k as f64, 0.0, z)).collect();
            median_spacing_sq(&RangeImage::new(depths.len(), 1, points).unwrap())
        }
        assert_eq!(spaced(&[5.0, 5.0, 6.0, 9.0]), 2.0);
        assert_eq!(spaced(&[5.0, 5.0, 6.0, 9.0, 13.0]), 10.0);
        assert_eq!(spaced(&[5.0, f64::NAN, 6.0]), 0.0);
        assert_eq!(spaced(&[5.0, 5.5, f64::NAN, 7.0, 7.25]), 1.25);
        assert_eq!(median_spacing_sq(&RangeImage::new(0, 0, vec![]).unwrap()), 0.0);
    }
}
