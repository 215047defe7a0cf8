//! What labels are made of, and how they look.

use super::Labels;
use crate::hostile::SIZES;
use crate::layer::PLAIN;
use crate::{Image, Layer, Meaning, On, Parts, PartsError, Picture, Rgb};

pub(super) fn parts(labels: &Labels) -> Parts<'_> {
    let mut parts = Parts::default();
    parts.grid(labels.width, labels.height);
    parts.fact("components", labels.statistics.len());
    parts.push("label", On::Pixel, Meaning::Index, 1, labels.pixels());
    parts
}

pub(super) fn made_of(parts: &Parts<'_>) -> Result<Labels, PartsError> {
    let [width, height] = parts.size()?;
    let label = parts.need("label", 1)?.whole()?;
    Labels::new(width, height, label).map_err(PartsError::refused)
}

/// Each component in a color that is far from those of the next.
pub(super) fn show(labels: &Labels) -> Vec<Layer> {
    let pixels = labels.pixels().iter().map(|&label| match label {
        0 => PLAIN,
        label => hue(label),
    });
    Picture::drawn(Image::new(labels.width, labels.height, Vec::from_iter(pixels)))
}

/// A color that is far from those of the next labels: steps of the golden angle around the wheel of hues, in three brightnesses.
fn hue(label: u32) -> Rgb {
    const STEP: f64 = 0.618_033_988_749_894_9;
    const BRIGHT: [f64; 3] = [1.0, 0.72, 0.86];
    let around = (f64::from(label) * STEP).fract() * 6.0;
    let bright = BRIGHT[label as usize % 3];
    [0.0, 4.0, 2.0].map(|shift| {
        let ramp = ((around + shift) % 6.0 - 3.0).abs() - 1.0;
        (255.0 * bright * (0.3 + 0.7 * ramp.clamp(0.0, 1.0))).round() as u8
    })
}

pub(super) fn hostile() -> Vec<Labels> {
    fn labels([width, height]: [usize; 2], label: u32) -> Result<Labels, crate::SizeError> {
        Labels::new(width, height, vec![label; width * height])
    }
    SIZES.into_iter().flat_map(|size| [labels(size, 0), labels(size, u32::MAX)]).flatten().collect()
}

#[cfg(test)]
mod tests {
    use std::collections::HashSet;

    use super::*;

    #[test]
    fn labels_have_colors_of_their_own() {
        let labels = Labels::new(20, 10, (0..200).collect()).unwrap();
        let [Layer::Picture(picture)] = &show(&labels)[..] else { panic!("one picture") };
        assert_eq!(picture.image.at([0, 0]), PLAIN);
        assert_eq!(picture.image.pixels().iter().collect::<HashSet<_>>().len(), 200);
    }
}
