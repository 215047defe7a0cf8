//! Weighted means of attribute data.

use maquette_value::Rgb;
use nalgebra::Point3;

/// A type whose values have weighted means.
pub trait WeightedMean: Copy + PartialEq + Send + Sync {
    /// Returns the weighted mean of one or more `(weight, value)` pairs. The weights must add up to 1.
    fn weighted_mean(parts: impl Iterator<Item = (f64, Self)>) -> Self;
}

impl<const N: usize> WeightedMean for [f64; N] {
    fn weighted_mean(parts: impl Iterator<Item = (f64, Self)>) -> Self {
        let mut sum = [0.0; N];
        for (weight, part) in parts {
            for k in 0..N {
                sum[k] += weight * part[k];
            }
        }
        sum
    }
}

impl WeightedMean for Point3<f64> {
    fn weighted_mean(parts: impl Iterator<Item = (f64, Self)>) -> Self {
        <[f64; 3]>::weighted_mean(parts.map(|(weight, point)| (weight, point.coords.into()))).into()
    }
}

impl WeightedMean for f64 {
    fn weighted_mean(parts: impl Iterator<Item = (Self, Self)>) -> Self {
        <[Self; 1]>::weighted_mean(parts.map(|(weight, number)| (weight, [number])))[0]
    }
}

/// Integer indices have no mean, so the first index is returned.
impl WeightedMean for u32 {
    fn weighted_mean(mut parts: impl Iterator<Item = (f64, Self)>) -> Self {
        parts.next().map_or(0, |(_, index)| index)
    }
}

/// Flags have values 0 or 1. The result is 1 if any of the flags is 1.
impl WeightedMean for u8 {
    fn weighted_mean(mut parts: impl Iterator<Item = (f64, Self)>) -> Self {
        Self::from(parts.any(|(_, flag)| flag == 1))
    }
}

/// Colors: the mean of the sRGB values, rounded.
impl WeightedMean for Rgb {
    fn weighted_mean(parts: impl Iterator<Item = (f64, Self)>) -> Self {
        let mean =
            <[f64; 3]>::weighted_mean(parts.map(|(weight, color)| (weight, color.map(f64::from))));
        mean.map(|channel| (channel + 0.5) as u8)
    }
}
