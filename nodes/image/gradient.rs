//! How steeply the levels of a picture change.
//!
//! Differences are taken along rows and columns; at the picture's border they are one-sided, so that nothing is made up
//! beyond it. Levels that change evenly have the same gradient everywhere, the border included.

use maquette::value::{Image, Mask, Rgb};

use super::edges::Operator;

/// A picture as one number a pixel.
#[derive(Clone, Copy)]
pub(super) enum Levels<'a> {
    /// 0.299 red + 0.587 green + 0.114 blue: 0 to 255.
    Luma(&'a Image),
    /// 0 outside, 1 inside.
    Inside(&'a Mask),
    /// Numbers as they are, and how many there are in a row.
    Plane(&'a [f32], usize),
}

impl Levels<'_> {
    /// Width and height.
    pub(super) fn size(self) -> [usize; 2] {
        match self {
            Self::Luma(image) => [image.width(), image.height()],
            Self::Inside(mask) => [mask.width(), mask.height()],
            Self::Plane(levels, width) => [width, levels.len().checked_div(width).unwrap_or(0)],
        }
    }

    /// Writes the levels of one row.
    #[inline(always)]
    pub(super) fn write_row(self, row: usize, to: &mut [f32]) {
        let (first, count) = (row * to.len(), to.len());
        match self {
            Self::Luma(image) => {
                let pixels = &image.pixels()[first..][..count];
                to.iter_mut().zip(pixels).for_each(|(to, &pixel)| *to = luma(pixel));
            }
            Self::Inside(mask) => {
                let pixels = &mask.pixels()[first..][..count];
                to.iter_mut().zip(pixels).for_each(|(to, &pixel)| *to = f32::from(pixel));
            }
            Self::Plane(levels, _) => to.copy_from_slice(&levels[first..][..count]),
        }
    }
}

/// The sum is a whole number of thousandths, so that gray has exactly its own level.
#[inline(always)]
fn luma([r, g, b]: Rgb) -> f32 {
    (299 * i32::from(r) + 587 * i32::from(g) + 114 * i32::from(b)) as f32 / 1000.0
}

/// Writes the length of the gradient at the pixels of some rows, from row `first` on, in levels per pixel.
pub(super) fn write_gradient(
    levels: Levels<'_>,
    operator: Operator,
    first: usize,
    lengths: &mut [f32],
) {
    pulp::Arch::new().dispatch(Strip { levels, operator, first, lengths });
}

/// Some rows, to be compiled for wide instructions.
struct Strip<'a> {
    levels: Levels<'a>,
    operator: Operator,
    first: usize,
    lengths: &'a mut [f32],
}

impl pulp::NullaryFnOnce for Strip<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        gradient_of_strip(self.levels, self.operator, self.first, self.lengths);
    }
}

/// The rows from `first` on.
#[inline(always)]
fn gradient_of_strip(levels: Levels<'_>, operator: Operator, first: usize, lengths: &mut [f32]) {
    let [width, height] = levels.size();
    let buffer = || vec![0.0; width];
    // The levels of the rows around the current one: row k is in window[k % 3].
    let mut window = [buffer(), buffer(), buffer()];
    let (mut across, mut down, mut spare) = (buffer(), buffer(), buffer());
    let mut read = first.saturating_sub(1);
    for (row, lengths) in (first..).zip(lengths.chunks_exact_mut(width)) {
        let needed = (row + 2).min(height);
        for next in read..needed {
            levels.write_row(next, &mut window[next % 3]);
        }
        read = read.max(needed);
        let (upper, lower) = neighbors(operator, row, height);
        let [upper, here, lower] = [upper, row, lower].map(|row| &window[row % 3]);
        let share = 1.0 / neighbors_apart(operator, row, height);
        let pairs = down.iter_mut().zip(lower.iter().zip(upper));
        pairs.for_each(|(down, (lower, upper))| *down = (lower - upper) * share);
        if operator == Operator::Sobel {
            let around = spare.iter_mut().zip(upper.iter().zip(here).zip(lower));
            around.for_each(|(to, ((a, b), c))| *to = (a + 2.0 * b + c) * 0.25);
            slope(operator, &spare, &mut across);
            smooth(&down, &mut spare);
            std::mem::swap(&mut down, &mut spare);
        } else {
            slope(operator, here, &mut across);
        }
        let parts = lengths.iter_mut().zip(across.iter().zip(&down));
        parts.for_each(|(to, (across, down))| *to = (across * across + down * down).sqrt());
    }
}

/// The two places whose levels are compared at place `index` of `count`.
#[inline(always)]
fn neighbors(operator: Operator, index: usize, count: usize) -> (usize, usize) {
    let next = (index + 1).min(count - 1);
    match operator {
        Operator::Forward if next > index => (index, next),
        _ => (index.saturating_sub(1), next),
    }
}

/// How far apart they are; 1 where there is only one place, so that its difference with itself is 0.
#[inline(always)]
fn neighbors_apart(operator: Operator, index: usize, count: usize) -> f32 {
    let (before, after) = neighbors(operator, index, count);
    if after == before + 2 { 2.0 } else { 1.0 }
}

/// Differences along a row.
#[inline(always)]
fn slope(operator: Operator, row: &[f32], to: &mut [f32]) {
    let count = row.len();
    let at = |index: usize| {
        let (before, after) = neighbors(operator, index, count);
        (row[after] - row[before]) / neighbors_apart(operator, index, count)
    };
    to[0] = at(0);
    to[count - 1] = at(count - 1);
    if operator == Operator::Forward {
        let pairs = to.iter_mut().zip(row.iter().zip(&row[1..]));
        pairs.for_each(|(to, (here, after))| *to = after - here);
    } else if count > 2 {
        let pairs = to[1..count - 1].iter_mut().zip(row.iter().zip(&row[2..]));
        pairs.for_each(|(to, (before, after))| *to = (after - before) * 0.5);
    }
}

/// Means of three neighbors along a row, weighed 1, 2, 1; beyond the ends are their own values.
#[inline(always)]
fn smooth(row: &[f32], to: &mut [f32]) {
    let last = row.len() - 1;
    let mean = |a: f32, b: f32, c: f32| (a + 2.0 * b + c) * 0.25;
    to[0] = mean(row[0], row[0], row[1.min(last)]);
    to[last] = mean(row[last.saturating_sub(1)], row[last], row[last]);
    if last > 1 {
        let around = to[1..last].iter_mut().zip(row.iter().zip(&row[1..]).zip(&row[2..]));
        around.for_each(|(to, ((&a, &b), &c))| *to = mean(a, b, c));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The whole picture, in strips of some rows.
    fn gradient(levels: &[f32], width: usize, operator: Operator, rows: usize) -> Vec<f32> {
        let mut lengths = vec![f32::NAN; levels.len()];
        for (strip, lengths) in lengths.chunks_mut(rows * width.max(1)).enumerate() {
            write_gradient(Levels::Plane(levels, width), operator, strip * rows, lengths);
        }
        lengths
    }

    const ALL: [Operator; 3] = [Operator::Central, Operator::Forward, Operator::Sobel];

    fn check(size: [usize; 2], a: f32, b: f32, expected: f64) {
        let levels: Vec<f32> = (0..size[0] * size[1])
            .map(|index| a * (index / size[0]) as f32 + b * (index % size[0]) as f32)
            .collect();
        for operator in ALL {
            let lengths = gradient(&levels, size[0], operator, 32);
            assert_eq!(lengths.len(), levels.len());
            for length in lengths {
                assert!((f64::from(length) - expected).abs() <= 1e-12, "{operator:?}: {length}");
            }
        }
    }

    // T-IMG-01.
    #[test]
    fn a_plane_has_the_same_gradient_everywhere() {
        check([25, 90], 3.0, 4.0, 5.0);
        check([2, 2], 3.0, 4.0, 5.0);
        check([3, 33], -5.0, 12.0, 13.0);
    }

    #[test]
    fn a_single_row_or_column_has_a_gradient_along_itself() {
        check([1, 9], 3.0, 4.0, 3.0);
        check([9, 1], 3.0, 4.0, 4.0);
        check([1, 1], 3.0, 4.0, 0.0);
        check([0, 0], 3.0, 4.0, 0.0);
    }

    #[test]
    fn gray_has_its_own_level() {
        for level in 0..=255 {
            assert_eq!(luma([level; 3]), f32::from(level));
        }
    }

    #[test]
    fn strips_join_without_a_seam() {
        let levels: Vec<f32> = (0..7 * 100).map(|k| ((k * k * 31) % 251) as f32).collect();
        for operator in ALL {
            let whole = gradient(&levels, 7, operator, 100);
            for rows in [1, 2, 32] {
                assert_eq!(gradient(&levels, 7, operator, rows), whole, "{operator:?} {rows}");
            }
        }
    }
}
