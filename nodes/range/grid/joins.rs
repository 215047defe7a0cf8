//! Decides which neighboring cells of a range image are on one surface.
//!
//! Cells are separated if their distance or the slope between them is large. Nodes that change the surface, `Blend` and `FillRange`, may
//! make steep surfaces on purpose. Therefore they mark the triangles of these surfaces in the range image (`RangeImage::forced_triangles`),
//! and `Triangulate` never removes marked triangles. There is one bit per triangle, not per cell: two adjacent cells may be on two
//! surfaces, such as an ear and the hood behind it, and the triangles between them are on neither.

use maquette_value::RangeImage;
use maquette_value::parallel::*;
use nalgebra::Point3;

use super::grid_triangles::{Rays, double_area};

/// The default maximum edge length on one surface, in multiples of the grid's median spacing.
pub const JUMP: f64 = 6.0;

/// The default maximum angle between a surface's normal and the line of sight, in degrees.
pub const GRAZING: f64 = 85.0;

/// Distinguishes triangles on a surface from those that bridge a step in depth.
pub struct Joins {
    spacing_sq: f64,
    max_length_sq: f64,
    min_cosine: f64,
    rays: Rays,
}

/// Returns the maximum edge length of triangles on a surface: `jump` times the median distance of valid cells that share a side.
pub fn longest_edge(range: &RangeImage, jump: f64) -> f64 {
    jump * median_spacing_sq(range).sqrt()
}

impl Joins {
    /// Creates a test that accepts a triangle if two conditions hold. Its edges are at most `jump` times as long as the median distance of
    /// valid cells that share a side. Its normal makes an angle of at most `grazing` degrees with the line of sight.
    pub fn new(range: &RangeImage, jump: f64, grazing: f64) -> Self {
        let joins = Self {
            spacing_sq: median_spacing_sq(range),
            max_length_sq: 0.0,
            min_cosine: 0.0,
            rays: Rays::new(range),
        };
        joins.with_limits(jump, grazing)
    }

    /// Returns a test for the same grid with other limits.
    pub fn with_limits(&self, jump: f64, grazing: f64) -> Self {
        Self {
            max_length_sq: jump * jump * self.spacing_sq,
            min_cosine: libm::cos(grazing.to_radians()),
            ..*self
        }
    }

    /// Returns true if a triangle is part of a surface rather than a bridge over a step in depth. Front and back are not distinguished.
    pub fn is_on_surface(&self, corners: [Point3<f64>; 3]) -> bool {
        let [a, b, c] = corners;
        let (ray, normal) = (self.rays.direction(middle(corners)), double_area(corners));
        [b - a, c - b, a - c].iter().all(|edge| edge.norm_squared() <= self.max_length_sq)
            && normal.dot(&ray).abs() >= self.min_cosine * normal.norm() * ray.norm()
    }

    /// Returns true if the sensor sees the back of a triangle.
    pub fn faces_away(&self, corners: [Point3<f64>; 3]) -> bool {
        double_area(corners).dot(&self.rays.direction(middle(corners))) > 0.0
    }
}

fn middle([a, b, c]: [Point3<f64>; 3]) -> Point3<f64> {
    Point3::from((a.coords + b.coords + c.coords) / 3.0)
}

/// Returns the squared median distance of valid cells that share a side; 0 if there are no such cells. Of an even number of distances, the
/// upper of the middle two is the median.
///
/// A list of all distances would be twice as large as the grid, so the grid is read twice. The first pass counts the distances by their
/// leading bits, which sort like the distances. The second pass collects the distances that have the leading bits of the median.
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
    let rank = middle - (before - buckets[found] as usize);
    *candidates.select_nth_unstable_by(rank, f64::total_cmp).1
}

/// Returns the sign, exponent and first four fraction bits of a nonnegative number: numbers sort in the order of these bits.
fn bucket(spacing: f64) -> usize {
    (spacing.to_bits() >> 48) as usize
}

fn rows_of(range: &RangeImage) -> impl Parallel<Item = usize> {
    (0..range.height()).into_par_iter().with_min_len(64)
}

/// Calls `each` with the squared distances from the valid cells of a row to their valid neighbors on the right and above.
fn each_spacing_sq(range: &RangeImage, row: usize, mut each: impl FnMut(f64)) {
    let (width, points) = (range.width(), range.points());
    let cells = &points[row * width..][..width];
    let to_the_right = cells.windows(2).map(|pair| (pair[1] - pair[0]).norm_squared());
    to_the_right.filter(|spacing| !spacing.is_nan()).for_each(&mut each);
    if row > 0 {
        let above = &points[(row - 1) * width..];
        let upwards = cells.iter().zip(above).map(|(a, b)| (b - a).norm_squared());
        upwards.filter(|spacing| !spacing.is_nan()).for_each(each);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_median_spacing_is_the_upper_of_the_middle_two() {
        fn spacing_sq(depths: &[f64]) -> f64 {
            let points =
                depths.iter().enumerate().map(|(k, &z)| Point3::new(k as f64, 0.0, z)).collect();
            median_spacing_sq(&RangeImage::new(depths.len(), 1, points).unwrap())
        }
        assert_eq!(spacing_sq(&[5.0, 5.0, 6.0, 9.0]), 2.0);
        assert_eq!(spacing_sq(&[5.0, 5.0, 6.0, 9.0, 13.0]), 10.0);
        assert_eq!(spacing_sq(&[5.0, f64::NAN, 6.0]), 0.0);
        assert_eq!(spacing_sq(&[5.0, 5.5, f64::NAN, 7.0, 7.25]), 1.25);
        assert_eq!(median_spacing_sq(&RangeImage::new(0, 0, vec![]).unwrap()), 0.0);
    }
}
