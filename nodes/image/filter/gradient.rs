//! The gradient of a picture's levels (numbers per pixel).
//!
//! Differences are taken along rows and columns. At the border of the picture they are one-sided, so that no levels beyond it are needed. A
//! linear ramp has the same gradient everywhere, including the border.

use maquette_value::{Image, Mask, Rgb};

use crate::operator::Operator;

/// A picture with one number (level) per pixel.
#[derive(Clone, Copy)]
pub(crate) enum Levels<'a> {
    /// The luma, 0.299 red + 0.587 green + 0.114 blue: 0 to 255.
    Luma(&'a Image),
    /// The level is 1 inside the mask and 0 outside.
    Inside(&'a Mask),
    /// Given levels, row by row, and the number of columns.
    Plane(&'a [f32], usize),
}

impl Levels<'_> {
    /// Returns the width and height in pixels.
    pub(crate) fn size(self) -> [usize; 2] {
        match self {
            Self::Luma(image) => [image.width(), image.height()],
            Self::Inside(mask) => [mask.width(), mask.height()],
            Self::Plane(levels, width) => [width, levels.len().checked_div(width).unwrap_or(0)],
        }
    }

    /// Writes the levels of one row.
    #[inline(always)]
    pub(crate) fn write_row(self, row: usize, to: &mut [f32]) {
        let (first, count) = (row * to.len(), to.len());
        match self {
            Self::Luma(image) => {
                write_luma(&image.pixels()[first..][..count], to);
            }
            Self::Inside(mask) => {
                let pixels = &mask.pixels()[first..][..count];
                to.iter_mut().zip(pixels).for_each(|(to, &pixel)| *to = f32::from(pixel));
            }
            Self::Plane(levels, _) => to.copy_from_slice(&levels[first..][..count]),
        }
    }
}

/// Writes the luma of pixels. The channels of a block are separated first, so that the compiler vectorizes both loops. With a smaller block
/// size, it would unroll the loops to single bytes instead.
#[inline(always)]
fn write_luma(pixels: &[Rgb], to: &mut [f32]) {
    const BLOCK: usize = 256;
    let (blocks, rest) = pixels.as_chunks::<BLOCK>();
    let (to_blocks, to_rest) = to.as_chunks_mut::<BLOCK>();
    for (pixels, to) in blocks.iter().zip(to_blocks) {
        let [mut red, mut green, mut blue] = [[0; BLOCK]; 3];
        for k in 0..BLOCK {
            [red[k], green[k], blue[k]] = pixels[k];
        }
        for k in 0..BLOCK {
            to[k] = luma([red[k], green[k], blue[k]]);
        }
    }
    to_rest.iter_mut().zip(rest).for_each(|(to, &pixel)| *to = luma(pixel));
}

/// Returns the luma of a color. The weights are integers that sum to 1000, so the luma of a gray pixel is exactly its gray level.
#[inline(always)]
fn luma([r, g, b]: Rgb) -> f32 {
    thousandths((299 * i32::from(r) + 587 * i32::from(g) + 114 * i32::from(b)) as f32)
}

/// Returns a thousandth of an integer up to 255 000. The result is rounded to nearest like that of a division, but computed several times
/// faster: the first product is exact.
#[inline(always)]
fn thousandths(number: f32) -> f32 {
    const UPPER_PART: f32 = 33.0 / 32768.0;
    const LOWER_PART: f32 = (0.001 - 33.0 / 32768.0) as f32;
    number * UPPER_PART + number * LOWER_PART
}

/// Writes the length of the gradient at each pixel of the rows from `first` on, in levels per pixel.
pub(crate) fn write_gradient(
    levels: Levels<'_>,
    operator: Operator,
    first: usize,
    lengths: &mut [f32],
) {
    pulp::Arch::new().dispatch(Strip { levels, operator, first, lengths });
}

/// A kernel that computes the gradient of some rows; dispatched to SIMD code.
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

/// Writes the length of the gradient at each pixel of the rows from `first` on.
#[inline(always)]
fn gradient_of_strip(levels: Levels<'_>, operator: Operator, first: usize, lengths: &mut [f32]) {
    let [width, height] = levels.size();
    #[inline(always)]
    fn buffer(width: usize) -> Vec<f32> {
        vec![0.0; width]
    }
    // The levels of the previous, the current and the next row: row k is in `window[k % 3]`.
    let mut window = [buffer(width), buffer(width), buffer(width)];
    let (mut around, mut down) = (buffer(width), buffer(width));
    let mut read = first.saturating_sub(1);
    for (row, lengths) in (first..).zip(lengths.chunks_exact_mut(width)) {
        let needed = (row + 2).min(height);
        for next in read..needed {
            levels.write_row(next, &mut window[next % 3]);
        }
        read = read.max(needed);
        let (upper, lower) = neighbors(operator, row, height);
        let [upper, here, lower] = [upper, row, lower].map(|row| &window[row % 3]);
        let scale = 1.0 / neighbor_distance(operator, row, height);
        if operator == Operator::Sobel {
            let to = around.iter_mut().zip(&mut down);
            for ((around, down), ((a, b), c)) in to.zip(upper.iter().zip(here).zip(lower)) {
                *around = mean(*a, *b, *c);
                *down = (c - a) * scale;
            }
            write_lengths_of_means(&around, &down, lengths);
        } else {
            let pairs = down.iter_mut().zip(lower.iter().zip(upper));
            pairs.for_each(|(down, (lower, upper))| *down = (lower - upper) * scale);
            write_lengths(operator, here, &down, lengths);
        }
    }
}

/// Writes the lengths of the gradients in a row. The differences along the row are computed here; `down` holds the differences across the
/// row.
#[inline(always)]
fn write_lengths(operator: Operator, row: &[f32], down: &[f32], to: &mut [f32]) {
    let last = row.len() - 1;
    let [at_start, at_end] =
        [0, last].map(|index| length(slope(operator, row, index), down[index]));
    if operator == Operator::Forward {
        let pairs = row.iter().zip(&row[1..]).zip(down);
        let to = to.iter_mut().zip(pairs);
        to.for_each(|(to, ((here, after), &down))| *to = length(after - here, down));
    } else if last > 1 {
        let pairs = row.iter().zip(&row[2..]).zip(&down[1..]);
        let to = to[1..last].iter_mut().zip(pairs);
        to.for_each(|(to, ((before, after), &down))| *to = length((after - before) * 0.5, down));
    }
    (to[0], to[last]) = (at_start, at_end);
}

/// Writes the lengths of the gradients in a row for Sobel's operator. `down` holds the differences across the row, which are averaged along
/// the row. Beyond the ends of the row, its end values are repeated.
#[inline(always)]
fn write_lengths_of_means(row: &[f32], down: &[f32], to: &mut [f32]) {
    let last = row.len() - 1;
    let [at_start, at_end] = [0, last].map(|index| {
        let [before, after] = [index.saturating_sub(1), (index + 1).min(last)];
        length(slope(Operator::Sobel, row, index), mean(down[before], down[index], down[after]))
    });
    if last > 1 {
        let pairs = row.iter().zip(&row[2..]);
        let triples = down.iter().zip(&down[1..]).zip(&down[2..]);
        for (to, ((before, after), ((a, b), c))) in to[1..last].iter_mut().zip(pairs.zip(triples)) {
            *to = length((after - before) * 0.5, mean(*a, *b, *c));
        }
    }
    (to[0], to[last]) = (at_start, at_end);
}

#[inline(always)]
fn length(across: f32, down: f32) -> f32 {
    (across * across + down * down).sqrt()
}

/// Returns the mean of three adjacent values, weighted 1, 2, 1.
#[inline(always)]
fn mean(a: f32, b: f32, c: f32) -> f32 {
    (a + 2.0 * b + c) * 0.25
}

/// Returns the difference of levels along a row at `index`, per pixel.
#[inline(always)]
fn slope(operator: Operator, row: &[f32], index: usize) -> f32 {
    let (before, after) = neighbors(operator, index, row.len());
    (row[after] - row[before]) / neighbor_distance(operator, index, row.len())
}

/// Returns the two positions whose levels are compared at position `index` in a line of `count` pixels.
#[inline(always)]
fn neighbors(operator: Operator, index: usize, count: usize) -> (usize, usize) {
    let next = (index + 1).min(count - 1);
    match operator {
        Operator::Forward if next > index => (index, next),
        _ => (index.saturating_sub(1), next),
    }
}

/// Returns the distance between the two positions that [`neighbors`] returns. Returns 1 if the two positions are the same; the difference
/// of their levels is then 0.
#[inline(always)]
fn neighbor_distance(operator: Operator, index: usize, count: usize) -> f32 {
    let (before, after) = neighbors(operator, index, count);
    if after == before + 2 { 2.0 } else { 1.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the lengths of the gradients of a picture, computed in strips of `rows` rows.
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
    fn thousandths_are_quotients() {
        assert!((0..=255_000).map(|k| k as f32).all(|k| thousandths(k) == k / 1000.0));
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
