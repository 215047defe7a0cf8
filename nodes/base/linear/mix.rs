//! Data of which weighted means can be taken.

use maquette_value::Rgb;
use nalgebra::Point3;

/// Data of which weighted means can be taken.
pub trait Mix: Copy + PartialEq + Send + Sync {
    /// The mean of some values with weights that add up to 1; there is at least one.
    fn mix(parts: impl Iterator<Item = (f64, Self)>) -> Self;
}

impl<const N: usize> Mix for [f64; N] {
    fn mix(parts: impl Iterator<Item = (f64, Self)>) -> Self {
        let mut sum = [0.0; N];
        for (weight, part) in parts {
            for k in 0..N {
                sum[k] += weight * part[k];
            }
        }
        sum
    }
}

impl Mix for Point3<f64> {
    fn mix(parts: impl Iterator<Item = (f64, Self)>) -> Self {
        <[f64; 3]>::mix(parts.map(|(weight, point)| (weight, point.coords.into()))).into()
    }
}

impl Mix for f64 {
    fn mix(parts: impl Iterator<Item = (Self, Self)>) -> Self {
        <[Self; 1]>::mix(parts.map(|(weight, number)| (weight, [number])))[0]
    }
}

/// Indices have no mean: the first one is taken.
impl Mix for u32 {
    fn mix(mut parts: impl Iterator<Item = (f64, Self)>) -> Self {
        parts.next().map_or(0, |(_, index)| index)
    }
}

/// A flag is set where any of the flags is.
impl Mix for u8 {
    fn mix(mut parts: impl Iterator<Item = (f64, Self)>) -> Self {
        Self::from(parts.any(|(_, flag)| flag == 1))
    }
}

/// Colors are mixed as their sRGB values and rounded.
impl Mix for Rgb {
    fn mix(parts: impl Iterator<Item = (f64, Self)>) -> Self {
        let mean = <[f64; 3]>::mix(parts.map(|(weight, color)| (weight, color.map(f64::from))));
        mean.map(|channel| (channel + 0.5) as u8)
    }
}
