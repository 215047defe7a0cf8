//! How far a closed line reaches from a point inside of it, in every direction.
//!
//! Rays go out from the point, some to a cell of the line. A ray ends where it crosses the line for the last time, so that the
//! line may have teeth that hide parts of it; how much of a ray lies outside before that tells teeth from bays.

use std::f64::consts::TAU;

/// Rays to a cell of the line's length: fine enough that none of its steps falls between two.
const DENSITY: f64 = 8.0;

/// Rays reach as far as their neighbors over so many cells to both sides, and are then smoothed over as many: notches of twice
/// that width are gone, and no ray is shorter than it was. More would round off the corners of a region, less keeps the steps of
/// a line from cell to cell, which shows all the way to the middle.
const SMOOTHING: f64 = 2.0;

/// Teeth hide at most so many cells of a ray, or this share of it, whichever is more. Real contours have teeth of one or two
/// cells; twice as much would close bays that somebody wanted, half of it refuses noses with a freckle.
const TEETH: f64 = 3.0;
const TEETH_SHARE: f64 = 0.1;

/// Below this (square cells) a side of the line points to the middle or away from it.
const FLAT: f64 = 1e-12;

/// The length of a closed line's rays from the point at the origin. (Column, row) in cells, rows growing down.
pub(crate) struct Rays {
    /// The angle before the first ray by half a step, counter-clockwise as one sees the picture.
    start: f64,
    /// How far each ray reaches, smoothed; evenly around from `start`. Nothing of the line lies beyond.
    lengths: Vec<f64>,
    /// The length of the line through the rays' ends up to each of them, and all of it.
    along: Vec<f64>,
}

/// Why a line does not have one length for each direction.
#[derive(Debug, PartialEq)]
pub(crate) enum NotAStar {
    /// It does not go around the origin once.
    NotInside,
    /// A part of it is hidden behind another.
    Bay {
        /// (Column, row) at which the ray that the line hides most of ends.
        at: [f64; 2],
        /// How much of that ray lies outside, in cells.
        depth: f64,
    },
}

impl Rays {
    /// The rays to a closed line, which goes around counter-clockwise as one sees the picture.
    ///
    /// # Errors
    /// If the line does not go around the origin once, or a ray leaves it by more than teeth do before it ends.
    pub(crate) fn new(line: &[[f64; 2]]) -> Result<Self, NotAStar> {
        let sides = || line.iter().zip(line.iter().cycle().skip(1));
        let length: f64 = sides().map(|(a, b)| libm::hypot(b[0] - a[0], b[1] - a[1])).sum();
        let count = (DENSITY * length).ceil().max(8.0) as usize;
        let start = line.first().map_or(0.0, |[x, y]| libm::atan2(-y, *x));
        let step = TAU / count as f64;
        let (mut outermost, mut inside) = (vec![0.0f64; count], vec![0.0; count]);
        // Rays lie at half steps, so that no rounding at the line's first vertex, which is also its last, loses one.
        let mut from = 0.0;
        for (a, b) in sides() {
            let (turned, dot) = (turn(*a, *b), a[0] * b[0] + a[1] * b[1]);
            let to = from + libm::atan2(turned, dot) / step;
            let (low, high) = (f64::min(from, to), f64::max(from, to));
            let passed = (low - 0.5).floor() as i64 + 1..=(high - 0.5).floor() as i64;
            for ray in passed.filter(|_| turned.abs() > FLAT) {
                let index = ray.rem_euclid(count as i64) as usize;
                let direction = direction(start + (index as f64 + 0.5) * step);
                let reach = turned / turn(direction, [b[0] - a[0], b[1] - a[1]]);
                outermost[index] = outermost[index].max(reach);
                // What goes on counter-clockwise is left there, what turns back is entered.
                inside[index] += if to < from { -reach } else { reach };
            }
            from = to;
        }
        let around = (from - count as f64).abs() < 0.5;
        if !around || outermost.iter().any(|&reach| reach.is_nan() || reach <= FLAT) {
            return Err(NotAStar::NotInside);
        }
        fn hidden(ray: &usize, outermost: &[f64], inside: &[f64]) -> f64 {
            outermost[*ray] - inside[*ray]
        }
        let deepest = (0..count)
            .max_by(|a, b| {
                hidden(a, &outermost, &inside).total_cmp(&hidden(b, &outermost, &inside))
            })
            .unwrap_or(0);
        if TEETH.max(TEETH_SHARE * outermost[deepest]) < hidden(&deepest, &outermost, &inside) {
            let at = direction(start + (deepest as f64 + 0.5) * step);
            let at = at.map(|axis| axis * outermost[deepest]);
            return Err(NotAStar::Bay { at, depth: hidden(&deepest, &outermost, &inside) });
        }
        let lengths = smoothed(&outermost, ((SMOOTHING * DENSITY) as usize).min((count - 1) / 2));
        let mut along = vec![0.0];
        for ray in 0..count {
            let (reach, next) = (lengths[ray], lengths[(ray + 1) % count]);
            along.push(along[ray] + libm::hypot(next - reach, step * (next + reach) / 2.0));
        }
        Ok(Self { start, lengths, along })
    }

    /// The length of the line through the rays' ends.
    pub(crate) fn length(&self) -> f64 {
        self.along[self.lengths.len()]
    }

    /// The ends of so many spokes, evenly spaced along the line through the rays' ends: (column, row).
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

/// Twice the area between two spokes, positive if the second one follows counter-clockwise, seen with rows growing down.
pub(crate) fn turn([ax, ay]: [f64; 2], [bx, by]: [f64; 2]) -> f64 {
    ay * bx - ax * by
}

/// (Column, row) of a step in the direction of an angle.
fn direction(angle: f64) -> [f64; 2] {
    [libm::cos(angle), -libm::sin(angle)]
}

/// The mean, over so many to both sides around a circle, of the largest number over as many to both sides of each: nowhere below
/// the number itself.
fn smoothed(numbers: &[f64], reach: usize) -> Vec<f64> {
    let count = numbers.len();
    let window = |k: usize| (k + count - reach..=k + count + reach).map(|k| k % count);
    let largest: Vec<f64> =
        (0..count).map(|k: usize| window(k).map(|k| numbers[k]).fold(0.0, f64::max)).collect();
    (0..count)
        .map(|k: usize| window(k).map(|k| largest[k]).sum::<f64>() / (2 * reach + 1) as f64)
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A line of so many sides whose corners lie where `reach` says for an angle.
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
        // A square with a slit behind an overhang of `width` from the right side's lower part.
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
