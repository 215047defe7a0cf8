//! Distances of a closed line from a point inside of it, in every direction.
//!
//! Rays start at the point, several for each cell of the line. A ray ends where it crosses the line for the last time, because the line may
//! have teeth that hide parts of it. Before its end a ray may be outside of the line; the length of this part distinguishes teeth from
//! bays.

use std::f64::consts::TAU;

/// Number of rays per cell of the line's length: fine enough that no step of the line is between two rays.
const DENSITY: f64 = 8.0;

/// Half-width in cells of the window in which each ray gets the maximum length of its neighbors; afterwards the lengths are smoothed.
/// Notches up to twice this width vanish, and no ray becomes shorter. A larger window would round the corners of a region; a smaller one
/// keeps the steps from cell to cell, which would show up to the center.
const SMOOTHING: f64 = 2.0;

/// The part of a ray that a tooth may hide has at most this length in cells, or `TEETH_SHARE` of the ray's length, whichever is larger.
/// Real contours have teeth of one or two cells. With twice the limit, intended bays would be closed. With half of it, many noses would be
/// refused because of a freckle on the contour.
const MAX_TOOTH: f64 = 3.0;
const TEETH_SHARE: f64 = 0.1;

/// Tolerance for lengths and areas, in cells and square cells. A side of the line counts as pointing to the center if twice the area of the
/// triangle between the side and the center is below this value. A ray shorter than this value counts as a ray of length 0.
const FLAT: f64 = 1e-12;

/// The lengths of the rays from the origin to a closed line. Positions are (column, row) in cells, with rows growing down.
pub(crate) struct Rays {
    /// The angle at which the sector of the first ray begins: half the angle between two rays before the first ray. Angles are measured
    /// counter-clockwise in the picture.
    start: f64,
    /// The smoothed length of each ray, at uniform angles from `start`. No part of the line is beyond the end of a ray.
    lengths: Vec<f64>,
    /// For the closed line through the ends of all rays: the arc length from its start to the end of each ray, and its total length.
    along: Vec<f64>,
}

/// Reasons why a closed line is not star-shaped. A line is star-shaped if each ray from its center crosses it exactly once.
#[derive(Debug, PartialEq)]
pub(crate) enum NotAStar {
    /// The line does not go around the origin exactly once.
    NotInside,
    /// Part of the line is hidden from the center by another part.
    Bay {
        /// The (column, row) at the end of the ray with the longest hidden part.
        at: [f64; 2],
        /// The length in cells of the part of that ray that is outside of the line.
        depth: f64,
    },
}

impl Rays {
    /// Makes the rays to a closed line, which is counter-clockwise in the picture.
    ///
    /// # Errors
    /// Returns an error if the line does not go around the origin once, or a ray is outside for longer than teeth allow.
    pub(crate) fn new(line: &[[f64; 2]]) -> Result<Self, NotAStar> {
        let sides = line.iter().zip(line.iter().cycle().skip(1));
        let length: f64 = sides.clone().map(|(a, b)| libm::hypot(b[0] - a[0], b[1] - a[1])).sum();
        let count = (DENSITY * length).ceil().max(8.0) as usize;
        let start = line.first().map_or(0.0, |[x, y]| libm::atan2(-y, *x));
        let step = TAU / count as f64;
        let (mut outermost, mut inside) = (vec![0.0f64; count], vec![0.0; count]);
        // Rays are at half steps, so that no ray passes through the first vertex of the line, which is also the last. Because of rounding,
        // such a ray could miss the line.
        let mut from = 0.0;
        for (a, b) in sides {
            let (turned, dot) = (turn(*a, *b), a[0] * b[0] + a[1] * b[1]);
            let to = from + libm::atan2(turned, dot) / step;
            let (low, high) = (f64::min(from, to), f64::max(from, to));
            let passed = (low - 0.5).floor() as i64 + 1..=(high - 0.5).floor() as i64;
            for ray in passed.filter(|_| turned.abs() > FLAT) {
                let index = ray.rem_euclid(count as i64) as usize;
                let direction = direction(start + (index as f64 + 0.5) * step);
                let reach = turned / turn(direction, [b[0] - a[0], b[1] - a[1]]);
                outermost[index] = outermost[index].max(reach);
                // A ray leaves the inside where it crosses a counter-clockwise side, and enters the inside where it crosses a clockwise
                // side.
                inside[index] += if to < from { -reach } else { reach };
            }
            from = to;
        }
        let around = (from - count as f64).abs() < 0.5;
        if !around || outermost.iter().any(|&reach| reach.is_nan() || reach <= FLAT) {
            return Err(NotAStar::NotInside);
        }
        fn hidden_length(ray: &usize, outermost: &[f64], inside: &[f64]) -> f64 {
            outermost[*ray] - inside[*ray]
        }
        let deepest = (0..count)
            .max_by(|a, b| {
                hidden_length(a, &outermost, &inside)
                    .total_cmp(&hidden_length(b, &outermost, &inside))
            })
            .unwrap_or(0);
        if MAX_TOOTH.max(TEETH_SHARE * outermost[deepest])
            < hidden_length(&deepest, &outermost, &inside)
        {
            let at = direction(start + (deepest as f64 + 0.5) * step);
            let at = at.map(|axis| axis * outermost[deepest]);
            return Err(NotAStar::Bay { at, depth: hidden_length(&deepest, &outermost, &inside) });
        }
        let lengths = smooth(&outermost, ((SMOOTHING * DENSITY) as usize).min((count - 1) / 2));
        let mut along = vec![0.0];
        for ray in 0..count {
            let (reach, next) = (lengths[ray], lengths[(ray + 1) % count]);
            along.push(along[ray] + libm::hypot(next - reach, step * (next + reach) / 2.0));
        }
        Ok(Self { start, lengths, along })
    }

    /// Returns the length of the line through the rays' ends.
    pub(crate) fn length(&self) -> f64 {
        self.along[self.lengths.len()]
    }

    /// Returns the ends of spokes as (column, row), evenly spaced along the line through the rays' ends.
    pub(crate) fn spokes(&self, count: usize) -> Vec<[f64; 2]> {
        let rays = self.lengths.len();
        (0..count)
            .map(|k: usize| {
                let along = self.length() * k as f64 / count as f64;
                let ray = self.along[..rays].partition_point(|&before| before <= along) - 1;
                let share = (along - self.along[ray]) / (self.along[ray + 1] - self.along[ray]);
                let (reach, next) = (self.lengths[ray], self.lengths[(ray + 1) % rays]);
                let angle = self.start + (ray as f64 + 0.5 + share) * TAU / rays as f64;
                direction(angle).map(|axis| axis * (reach + (next - reach) * share))
            })
            .collect()
    }
}

/// Returns twice the area between two spokes; positive if the second one follows counter-clockwise, seen with rows growing down.
pub(crate) fn turn([ax, ay]: [f64; 2], [bx, by]: [f64; 2]) -> f64 {
    ay * bx - ax * by
}

/// Returns the (column, row) of a unit step in the direction of an angle.
fn direction(angle: f64) -> [f64; 2] {
    [libm::cos(angle), -libm::sin(angle)]
}

/// Applies a moving maximum and then a moving average to circular data, both with the half-width `reach`. No value becomes smaller.
fn smooth(numbers: &[f64], reach: usize) -> Vec<f64> {
    let count = numbers.len();
    /// Returns the indices of the rays that are at most `reach` from index `k`, in a ring of `count` rays.
    fn window(k: usize, count: usize, reach: usize) -> impl Iterator<Item = usize> {
        (k + count - reach..=k + count + reach).map(move |k| k % count)
    }
    let largest: Vec<f64> = (0..count)
        .map(|k: usize| window(k, count, reach).map(|k| numbers[k]).fold(0.0, f64::max))
        .collect();
    (0..count)
        .map(|k: usize| {
            window(k, count, reach).map(|k| largest[k]).sum::<f64>() / (2 * reach + 1) as f64
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns a closed polygon with the corner at each angle at the distance given by `reach`.
    fn star(sides: usize, reach: impl Fn(f64) -> f64) -> Vec<[f64; 2]> {
        let angles = (0..sides).map(|k| TAU * k as f64 / sides as f64);
        angles.map(|angle| direction(angle).map(|axis| axis * reach(angle))).collect()
    }

    #[test]
    fn spokes_of_a_circle_are_even() {
        let rays = Rays::new(&star(1000, |_| 20.0)).unwrap();
        assert!((rays.length() - 20.0 * TAU).abs() <= 0.01);
        for (k, [x, y]) in rays.spokes(12).into_iter().enumerate() {
            assert!((libm::hypot(x, y) - 20.0).abs() <= 1e-3);
            let [column, row] = direction(TAU * (k as f64 + 0.004) / 12.0);
            assert!(libm::hypot(x / 20.0 - column, y / 20.0 - row) <= 0.01, "{k}");
        }
    }

    #[test]
    fn spokes_of_a_long_ellipse_are_even_along_it() {
        let ellipse = star(2000, |angle| {
            let (x, y) = (libm::cos(angle) / 60.0, libm::sin(angle) / 15.0);
            1.0 / (x * x + y * y).sqrt()
        });
        let spokes = Rays::new(&ellipse).unwrap().spokes(64);
        let distances = (0..64).map(|k| {
            let ([x, y], [next_x, next_y]) = (spokes[k], spokes[(k + 1) % 64]);
            libm::hypot(next_x - x, next_y - y)
        });
        let distances: Vec<f64> = distances.collect();
        let mean = distances.iter().sum::<f64>() / 64.0;
        assert!(distances.iter().all(|distance| (distance / mean - 1.0).abs() <= 0.05));
    }

    #[test]
    fn a_tooth_is_passed_over_and_a_bay_is_named() {
        // Returns a square with a notch of depth `width` in its right side. The notch is wider inside than at its entrance: rays from the
        // center cross it and then a lip of width 1.
        fn square(width: f64) -> Vec<[f64; 2]> {
            let right = [[20.0, -20.0], [-20.0, -20.0], [-20.0, 20.0], [20.0, 20.0]];
            let slit = [[20.0, 6.0], [20.0 - width, 6.0], [20.0 - width, 3.0], [19.0, 3.0]];
            [right.as_slice(), &slit, &[[19.0, 5.0], [20.0, 5.0]]].concat()
        }
        let rays = Rays::new(&square(2.0)).unwrap();
        assert!(rays.spokes(64).windows(2).all(|pair| turn(pair[0], pair[1]) > 0.0));
        let Err(NotAStar::Bay { at, depth }) = Rays::new(&square(8.0)) else { panic!("no bay") };
        assert!((8.0..8.4).contains(&depth), "{depth}");
        assert!((at[0] - 20.0).abs() <= 0.1 && (at[1] - 6.0).abs() <= 0.1, "{at:?}");
    }

    #[test]
    fn a_line_that_does_not_go_around_the_origin_is_refused() {
        let beside: Vec<[f64; 2]> = star(40, |_| 5.0).iter().map(|[x, y]| [x + 9.0, *y]).collect();
        let line = [[-2.0, 0.0], [0.0, 0.0], [3.0, 0.0], [0.0, 0.0]];
        for line in [beside.as_slice(), &line, &[]] {
            assert_eq!(Rays::new(line).err(), Some(NotAStar::NotInside));
        }
    }
}
