//! Blurs the levels of a picture with a Gaussian.

use maquette_value::memory::huge_vec;
use maquette_value::parallel::*;

use super::gradient::Levels;

/// The distance at which the Gaussian is cut off, in standard deviations; at this distance it has 1/3000 of its height.
const CUTOFF: f64 = 4.0;

/// Blurs levels along rows, then along columns, with a Gaussian of standard deviation `sigma` in pixels. At the border of the picture, the
/// weights of the pixels inside are scaled to sum to 1.
///
/// Weighted differences to neighbors are added to each level, so that constant areas stay exactly constant.
pub(crate) fn blur(levels: Levels<'_>, sigma: f64) -> Vec<f32> {
    let [width, height] = levels.size();
    let weights = &weights(sigma, width.max(height))[..];
    let sums = &sums(weights, width)[..];
    let mut along_rows = huge_vec(width * height);
    along_rows.par_chunks_mut(width.max(1)).enumerate().for_each(|(row, to)| {
        pulp::Arch::new().dispatch(AlongRow { levels, row, weights, sums, to });
    });
    let mut blurred = huge_vec(width * height);
    let rows = blurred.par_chunks_mut(width.max(1)).enumerate();
    rows.for_each(|(row, to)| {
        pulp::Arch::new().dispatch(AcrossRows { rows: &along_rows, row, weights, to });
    });
    blurred
}

/// Returns the values of the Gaussian at the distances 0, 1, ... pixels up to its cutoff, or up to the size of the picture.
fn weights(sigma: f64, size: usize) -> Vec<f32> {
    // Replace smaller values, because their squares could underflow to zero.
    let sigma = sigma.max(1e-100);
    let count = (CUTOFF * sigma).ceil() as usize;
    (0..=count.min(size))
        .map(|k: usize| libm::exp(-0.5 * (k * k) as f64 / (sigma * sigma)) as f32)
        .collect()
}

/// Returns, for each of `count` positions along a row or column, the sum of the weights of the pixels inside the picture.
fn sums(weights: &[f32], count: usize) -> Vec<f32> {
    (0..count)
        .map(|position: usize| {
            (1..).zip(&weights[1..]).fold(weights[0], |mut sum, (k, weight)| {
                for _ in 0..usize::from(k <= position) + usize::from(position + k < count) {
                    sum += weight;
                }
                sum
            })
        })
        .collect()
}

/// A kernel that blurs one row along the row, given the sums of the weights; dispatched to SIMD code.
struct AlongRow<'a> {
    levels: Levels<'a>,
    row: usize,
    weights: &'a [f32],
    sums: &'a [f32],
    to: &'a mut [f32],
}

impl pulp::NullaryFnOnce for AlongRow<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self { levels, row, weights, sums, to } = self;
        let count = to.len();
        let mut here = vec![0.0; count];
        levels.write_row(row, &mut here);
        to.fill(0.0);
        for (k, &weight) in weights.iter().enumerate().take(count).skip(1) {
            let span = count - k;
            add_changes(&mut to[k..], weight, &here[k..], &here[..span]);
            add_changes(&mut to[..span], weight, &here[..span], &here[k..]);
        }
        let changes = to.iter_mut().zip(here.iter().zip(sums));
        changes.for_each(|(to, (level, sum))| *to = level + *to / sum);
    }
}

/// A kernel that computes one row of the blur along columns; dispatched to SIMD code.
struct AcrossRows<'a> {
    rows: &'a [f32],
    row: usize,
    weights: &'a [f32],
    to: &'a mut [f32],
}

impl pulp::NullaryFnOnce for AcrossRows<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self { rows, row, weights, to } = self;
        let width = to.len();
        let height = rows.len() / width;
        let here = &rows[row * width..][..width];
        let mut sum = weights[0];
        to.fill(0.0);
        for (k, &weight) in weights.iter().enumerate().skip(1) {
            let others = [row.checked_sub(k), Some(row + k).filter(|other| *other < height)];
            for other in others.into_iter().flatten() {
                add_changes(to, weight, here, &rows[other * width..][..width]);
                sum += weight;
            }
        }
        to.iter_mut().zip(here).for_each(|(to, level)| *to = level + *to / sum);
    }
}

#[inline(always)]
fn add_changes(to: &mut [f32], weight: f32, here: &[f32], there: &[f32]) {
    let levels = to.iter_mut().zip(here.iter().zip(there));
    levels.for_each(|(to, (here, there))| *to += weight * (there - here));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn constant_levels_stay_exactly_constant() {
        let levels = vec![0.1; 13 * 5];
        assert_eq!(blur(Levels::Plane(&levels, 13), 2.5), levels);
    }

    #[test]
    fn a_deviation_whose_square_underflows_changes_nothing() {
        let levels: Vec<_> = (0..12).map(|k| (k * k) as f32).collect();
        for sigma in [1e-155, 1e-200, f64::from_bits(1)] {
            assert_eq!(blur(Levels::Plane(&levels, 4), sigma), levels);
        }
    }

    #[test]
    fn a_point_becomes_the_gaussian_and_keeps_its_sum() {
        let (width, sigma) = (41, 1.5);
        let mut levels = vec![0.0; width * width];
        levels[20 * width + 20] = 1.0;
        let blurred = blur(Levels::Plane(&levels, width), sigma);
        let sum: f64 = blurred.iter().map(|&x| f64::from(x)).sum();
        assert!((sum - 1.0).abs() < 1e-5, "{sum}");
        let ratio = f64::from(blurred[22 * width + 21] / blurred[20 * width + 20]);
        let expected = libm::exp(-0.5 * 5.0 / (sigma * sigma));
        assert!((ratio - expected).abs() < 1e-5, "{ratio} {expected}");
    }

    #[test]
    fn at_the_border_the_weights_inside_sum_to_one() {
        let weight = libm::exp(-0.5) as f32;
        let blurred = blur(Levels::Plane(&[0.0, 8.0], 2), 1.0);
        let expected = 8.0 * weight / (1.0 + weight);
        assert!((blurred[0] - expected).abs() < 1e-6, "{blurred:?}");
        assert!((blurred[0] + blurred[1] - 8.0).abs() < 1e-6, "{blurred:?}");
    }
}
