//! Otsu's threshold, which divides a histogram into two classes.

/// Returns the level that divides a histogram best: the classes are the levels up to it and the levels above it. If several levels are
/// best, returns their mean, rounded down. If the histogram has only one level, returns that level.
///
/// Otsu, "A threshold selection method from gray-level histograms" (1979), eq. 18: the level maximizes the variance between classes, `(mu_T
/// w - mu)^2 / (w (1 - w))`. Here `w` and `mu` are the zeroth and first moments of the histogram up to the level, and `mu_T` is the mean of
/// the histogram. All sums are integers, so that equal variances compare as equal.
pub fn otsu(histogram: &[u64; 256]) -> u32 {
    let total: u64 = histogram.iter().sum();
    let moment: u64 =
        histogram.iter().zip(0..).map(|(count, level): (&u64, u64)| count * level).sum();
    let (mut below, mut moment_below) = (0u64, 0u64);
    let mut best = (-1.0, 0, 1);
    for (level, count) in (0u64..).zip(histogram) {
        below += count;
        moment_below += count * level;
        let above = total - below;
        let variance = if below == 0 || above == 0 {
            0.0
        } else {
            let difference = (moment as f64 * below as f64) - (moment_below as f64 * total as f64);
            difference * difference / (below as f64 * above as f64)
        };
        if variance > best.0 {
            best = (variance, level, 1);
        } else if variance == best.0 {
            best = (variance, best.1 + level, best.2 + 1);
        }
    }
    if best.0 <= 0.0 {
        return (0..).zip(histogram).find(|(_, count)| **count > 0).map_or(0, |(level, _)| level);
    }
    (best.1 / best.2) as u32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn otsu_of_two_levels_lies_between_them() {
        for (a, b) in [(0, 1), (10, 200), (254, 255), (7, 8), (3, 250)] {
            for percent in [1, 50, 99] {
                let mut histogram = [0; 256];
                histogram[a] = percent;
                histogram[b] = 100 - percent;
                assert_eq!(otsu(&histogram) as usize, (a + b - 1) / 2, "{a} {b} {percent}");
            }
        }
    }

    #[test]
    fn otsu_of_one_level_is_that_level() {
        let mut histogram = [0; 256];
        histogram[77] = 5;
        assert_eq!(otsu(&histogram), 77);
    }
}
